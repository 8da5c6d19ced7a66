"""Is the sheet a plane? A test from points on it, that small residuals do not fool.

Three models: a plane; a circular cone, which a sheet through a fixed flat window nearly is; and that window itself.
Points come in groups (a board's pose, an image) whose points are wrong together; each model is judged on groups that
its fit has not seen, and a richer model is supported only if it predicts them better by more than their scatter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from garbi_map.log.records import Floats
from garbi_map.rig.window_kernels import off_sheet

FOLDS = 8
TILTS = np.array([1.0, 1.0, 0.1, 0.6, 0.6])  # rad and m, 1 sigma beforehand of the window model's unknowns
PANE_DISTANCE, PANE_THICKNESS, INDEX_GLASS, INDEX_WATER = 0.05, 0.01, 1.49, 1.335  # m; the tilt is what matters
DECISIVE = 2.0  # standard errors


@dataclass(frozen=True)
class SheetModel:
    """A model, fitted: parameters (k,); rms (m) in sample; held_out rms (m) of groups that were not fitted;
    group_error (g,) mean square (m^2) of each of those groups."""

    name: str
    parameters: Floats
    rms: float
    held_out: float
    group_error: Floats


@dataclass(frozen=True)
class SheetTest:
    """The models in order of their richness, and which one the points support.

    gain (j,): by how many standard errors each model predicts unseen groups better than the plane
    """

    models: tuple[SheetModel, ...]
    gain: Floats
    supported: str
    evidence: str


def compare_sheets(points: Floats, group: NDArray, source: Floats | None = None) -> SheetTest:
    """Compare models on points (n, 3) m with group numbers (n,).

    source   (3,) m, where the laser is, about: needed for the window model, which is left out otherwise
    """
    _, group = np.unique(group, return_inverse=True)
    count = int(group.max()) + 1
    fits: list[tuple[str, Callable[[Floats], Floats], Callable[[Floats, Floats], Floats]]] = [
        ("plane", fit_plane, plane_distance),
        ("cone", fit_cone, cone_distance),
    ]
    models = [_judged(name, fit, distance, points, group, count) for name, fit, distance in fits]
    if source is not None:
        where = source
        models.append(
            _judged(
                "window",
                lambda part: fit_window(part, where),
                lambda parameters, part: window_distance(parameters, part, where),
                points,
                group,
                count,
            )
        )
    size = np.bincount(group)
    weight = size / size.sum()
    gains = []
    for model in models:
        better = models[0].group_error - model.group_error
        mean = float(weight @ better)
        scatter = float(np.sqrt((weight**2) @ (better - mean) ** 2))
        gains.append(mean / scatter if scatter > 0 else 0.0)
    best = 0
    for i in range(1, len(models)):
        if gains[i] > DECISIVE and models[i].held_out < 0.98 * models[best].held_out:
            best = i
    lines = [f"{m.name} {1e3 * m.rms:.3f} mm fitted, {1e3 * m.held_out:.3f} held out ({g:+.1f} standard errors)"
             for m, g in zip(models, gains, strict=True)]  # fmt: skip
    return SheetTest(tuple(models), np.array(gains), models[best].name, f"{count} groups: " + "; ".join(lines))


def _judged(
    name: str,
    fit: Callable[[Floats], Floats],
    distance: Callable[[Floats, Floats], Floats],
    points: Floats,
    group: NDArray,
    count: int,
) -> SheetModel:
    parameters = fit(points)
    error = np.zeros(len(points))
    fold = np.arange(count) % FOLDS
    for k in range(min(FOLDS, count)):
        test = fold[group] == k
        error[test] = distance(fit(points[~test]), points[test]) ** 2
    per_group = np.bincount(group, error) / np.bincount(group)
    rms = float(np.sqrt((distance(parameters, points) ** 2).mean()))
    return SheetModel(name, parameters, rms, float(np.sqrt(error.mean())), per_group)


def fit_plane(points: Floats) -> Floats:
    """Unit normal and offset (4,) of the best plane: normal . p = offset."""
    centre = points.mean(axis=0)
    normal = np.linalg.svd(points - centre, full_matrices=False)[2][2]
    return np.append(normal, normal @ centre)


def plane_distance(plane: Floats, points: Floats) -> Floats:
    """Distances (n,) m."""
    return np.asarray(points @ plane[:3] - plane[3])


def fit_cone(points: Floats) -> Floats:
    """A cone (18,) that begins as the best plane, which is its limit of no bend: see cone_distance."""
    centre = points.mean(axis=0)
    along = np.linalg.svd(points - centre, full_matrices=False)[2]
    frame = np.concatenate([centre, along.ravel()])
    size = float(np.abs((points - centre) @ along[:2].T).max())
    limit = np.array([1.0, 1.0, 1.0, 5.0, 10.0, 0.7])
    best: tuple[float, Floats] | None = None
    for bend, turn in ((0.02, 0.0), (-0.02, 0.0), (0.02, 1.5), (-0.02, 1.5)):

        def off(x: Floats) -> Floats:
            return cone_distance(np.concatenate([frame, x]), points) / (1e-3 * size)

        start = np.array([0.0, 0.0, 0.0, bend, turn, 0.1])
        found = least_squares(off, start, bounds=(-limit, limit), max_nfev=60)
        if best is None or found.cost < best[0]:
            best = (float(found.cost), np.concatenate([frame, found.x]))
    assert best is not None
    return best[1]


def cone_distance(cone: Floats, points: Floats) -> Floats:
    """Distances (n,) m, to first order, from a cone that is nearly a plane.

    cone (18,): a centre on it (3), m; two directions along it and its normal (3, 3) there; then six unknowns: offset
    (m), two slopes, bend, the direction of its rulings (rad), and one over how far along them the apex is (1/m).
    In homogeneous terms height = bend (sqrt(reach^2 + across^2) - reach), with reach = 0 at the apex.
    """
    offset, slope_p, slope_q, bend, turn, narrowing = cone[12:]
    p, q, height = ((points - cone[:3]) @ cone[3:12].reshape(3, 3).T).T
    along, across = np.cos(turn) * p + np.sin(turn) * q, np.cos(turn) * q - np.sin(turn) * p
    reach = np.maximum(1.0 + narrowing * along, 0.05)
    return np.asarray(height - offset - slope_p * p - slope_q * q - bend * (np.hypot(reach, across) - reach))


def fit_window(points: Floats, source: Floats) -> Floats:
    """A plane out of a fixed flat window of common glass, 5 cm before a source (3,) m: see window_distance."""
    plane = fit_plane(points)
    ahead = points.mean(axis=0) - source
    ahead -= (ahead @ plane[:3]) * plane[:3]
    frame = np.concatenate([plane[:3], ahead / np.linalg.norm(ahead)])
    best: tuple[float, Floats] | None = None
    for tilt in (0.0, 0.3, -0.3):

        def off(x: Floats) -> Floats:
            miss = window_distance(np.concatenate([frame, x]), points, source) / 1e-3
            return np.append(miss, x / TILTS)  # tilts that nothing determines stay small

        found = least_squares(off, np.array([0.0, 0.0, 0.0, tilt, 0.0]), x_scale="jac", max_nfev=100)
        if best is None or found.cost < best[0]:
            best = (float(found.cost), np.concatenate([frame, found.x]))
    assert best is not None
    return best[1]


def window_distance(window: Floats, points: Floats, source: Floats) -> Floats:
    """Distances (n,) m from a plane that leaves its housing through a flat window, refracted.

    window (11,): normal (3) and forward direction (3) of the sheet, about; two tilts of the sheet inside (rad) and its
    offset at the source (m); two tilts of the window (rad)
    """
    normal, ahead = window[:3], window[3:6]
    aside = np.cross(normal, ahead)
    tilt, twist, offset, turn, rise = window[6:]
    sheet = normal + tilt * ahead + twist * aside
    sheet /= np.linalg.norm(sheet)
    out = ahead + turn * normal + rise * aside
    out /= np.linalg.norm(out)
    first = np.cross(sheet, aside)
    first /= np.linalg.norm(first)
    axis = np.ascontiguousarray(np.stack([first, sheet, np.cross(first, sheet)], axis=1))
    apex = source + offset * normal
    pane = np.array([0.0, *out, PANE_DISTANCE, PANE_THICKNESS, INDEX_GLASS, INDEX_WATER])
    zero, step = np.zeros(len(points)), 1e-4
    shifted = [np.ascontiguousarray(points + k * step * sheet) for k in (-1.0, 0.0, 1.0)]
    behind, sine, ahead = (off_sheet(part, zero, 0.0, 0.0, axis, apex, pane) for part in shifted)
    return np.nan_to_num(sine * 2.0 * step / (ahead - behind), nan=1.0)
