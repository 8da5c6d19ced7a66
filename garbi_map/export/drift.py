"""The drift that was found, drawn: this map's trajectory less the navigation filter's, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.export.axes import BOTTOM, WIDTH, Axes, path_of, thinned, ticks
from garbi_map.navigate.trajectory import Trajectory

Floats = NDArray[np.float64]

_HALF = WIDTH // 2 - 10
_LEFT = 56


@dataclass(frozen=True)
class Correction:
    """What the map corrected at each pose, but for one constant turn about the vertical, which is no drift.

    stamp_ns (n,); position (n, 3) m along the map's axes; attitude (n, 3) rad: roll, pitch, yaw, about the axes of the
    vehicle's heading, so that a wrong heading does not show as roll and pitch; position_sigma and attitude_sigma (n, 3):
    what the navigation filter thought of itself, 1 sigma, along the same axes. heading rad: the constant turn.
    """

    stamp_ns: NDArray[np.int64]
    position: Floats
    attitude: Floats
    position_sigma: Floats
    attitude_sigma: Floats
    heading: float

    @property
    def distance(self) -> float:
        """Root mean square of the position's correction, m."""
        return float(np.sqrt((self.position**2).sum(axis=1).mean()))

    @property
    def angle(self) -> float:
        """Root mean square of the attitude's correction, rad."""
        return float(np.sqrt((self.attitude**2).sum(axis=1).mean()))


def correction(navigation: Trajectory, trajectory: Trajectory) -> Correction:
    """The correction at some hundreds of the map's poses."""
    stamps = thinned(trajectory.stamp_ns)
    before, after = navigation.at(stamps), trajectory.at(stamps)
    heading = float(np.mean((after.rotation * before.rotation.inv()).as_rotvec()[:, 2]))
    turn = Rotation.from_rotvec([0.0, 0.0, heading])
    turned = turn * before.rotation
    start = before.position[0]
    forward = turned.as_matrix()[:, :2, 0]
    level = Rotation.from_rotvec(-np.arctan2(forward[:, 1], forward[:, 0])[:, None] * [0.0, 0.0, 1.0])
    return Correction(
        stamps,
        after.position - start - turn.apply(before.position - start),
        level.apply((after.rotation * turned.inv()).as_rotvec()),
        _sigma(before.covariance[:, :3, :3], turn),
        _sigma(before.covariance[:, 3:, 3:], level * turn),
        heading,
    )


def _sigma(covariance: NDArray[np.floating], turn: Rotation) -> Floats:
    """1 sigma (n, 3) along the axes of a turned frame."""
    matrix = np.broadcast_to(turn.as_matrix(), covariance.shape)
    return np.asarray(np.sqrt(np.maximum(np.einsum("nij,njk,nik->ni", matrix, covariance, matrix), 0.0)), np.float64)


def draw_correction(found: Correction, begin_ns: int) -> str:
    """Six small charts: x and y in one scale and z in its own on the left, roll, pitch and yaw likewise on the right."""
    seconds = (found.stamp_ns - begin_ns).astype(np.float64) * 1e-9
    columns = (
        ("xyz", found.position, found.position_sigma, _metric),
        (("roll", "pitch", "yaw"), np.rad2deg(found.attitude), np.rad2deg(found.attitude_sigma), _degrees),
    )
    drawn = []
    for names, values, sigmas, unit_of in columns:
        level, third = _reach(values[:, :2]), _reach(values[:, 2])
        for k, (name, reach) in enumerate(zip(names, (level, level, third), strict=True)):
            unit, scale = unit_of(reach)
            panel = f"{name}, {unit}", scale * values[:, k], scale * sigmas[:, k], scale * reach
            drawn.append(_panel(name, *panel, seconds, last=k == 2))
    return f"<div>{''.join(drawn[:3])}</div><div>{''.join(drawn[3:])}</div>"


def draw_steps(sweeps: Sequence[tuple[float, float]], step_m: Floats) -> str:
    """How far the pose graph moved each sweep: bars from its begin to its end, s. Empty where there are no sweeps."""
    count = min(len(sweeps), len(step_m))
    if not count:
        return ""
    height = 1e3 * step_m[:count]
    begin, end = np.array(sweeps[:count]).T
    axes = Axes((begin.min(), max(end.max(), begin.min() + 1e-3)), (0.0, 1.15 * max(float(height.max()), 1e-3)), 170)
    axes.grid("s since the begin of the log", "moved, mm")
    floor, left, right, top = axes.down(0.0), axes.across(begin), axes.across(end), axes.down(height)
    for x0, x1, y in zip(left, right, top, strict=True):
        axes.bar(x0, y, max(x1 - x0 - 1.0, 0.5), floor - y)
    return axes.svg("How far the pose graph moved each sweep")


def _reach(values: Floats) -> float:
    """What an axis must span on either side of zero."""
    return 1.15 * max(float(np.abs(values).max(initial=0.0)), 1e-4)


def _metric(metres: float) -> tuple[str, float]:
    """The unit that suits a length, and what to multiply metres by."""
    return ("m", 1.0) if metres > 1 else ("cm", 100.0) if metres > 0.01 else ("mm", 1000.0)


def _degrees(_: float) -> tuple[str, float]:
    return "°", 1.0


def _panel(name: str, label: str, values: Floats, sigma: Floats, reach: float, seconds: Floats, last: bool) -> str:
    """One curve about zero; the shade is 1 sigma, cut at the edge of the chart."""
    below = BOTTOM if last else 8
    axes = Axes((seconds[0], max(seconds[-1], seconds[0] + 1e-3)), (-reach, reach), 96 + below, _LEFT, _HALF, 8, below)
    blank = [(value, "") for value, _ in ticks(*axes.x, 5)]
    axes.grid("s since the begin of the log" if last else "", label, None if last else blank, ticks(*axes.y, 5))
    across, edge = axes.across(seconds), np.minimum(sigma, reach)
    outline = np.r_[np.c_[across, axes.down(edge)], np.c_[across, axes.down(-edge)][::-1]]
    axes.parts.append(f'<path class="s f" d="{path_of(outline)}Z"/>')
    axes.parts.append(f'<path class="a l" d="{path_of(np.c_[across, axes.down(values)])}"/>')
    return axes.svg(f"Correction of {name} over time")
