"""Whether small stones survive in a map: their heights over the ground around them, against the true surface's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import grey_opening, label, maximum_filter
from scipy.spatial import cKDTree

from garbi_map.evaluate import Truth

Floats = NDArray[np.float64]

GRID = 0.004
"""m, step of the true elevation grid in which stones are found."""
WIDEST = 0.06
"""m across: what is narrower and stands out of its surroundings is a stone; ripples and pipes are wider or longer."""
LOWEST, HIGHEST = 0.010, 0.030
"""m that a small stone stands out: about 2 cm."""
TOP, RING = 0.006, (0.030, 0.040)
"""m from its summit: what is its top, and what is the ground around it."""
KEPT = 0.002
"""m by which the height of a stone that is kept may be wrong."""


@dataclass(frozen=True)
class Stones:
    """Small stones of a true surface: summit (n, 2) m and height (n,) m of the top's median over the ring's."""

    summit: Floats
    height: Floats

    def heights_in(self, points: Floats) -> Floats:
        """The same heights (n,) in a cloud (k, 3) that lies on the surface; NaN where it hardly covers a stone."""
        near = points[cKDTree(self.summit).query(points[:, :2], distance_upper_bound=RING[1])[0] < np.inf]
        return _heights(self.summit, near)


def find_stones(truth: Truth) -> Stones:
    """The small stones where the scanner saw the bottom."""
    import open3d as o3d

    assert truth.surface is not None and truth.seen is not None
    vertices, triangles = truth.surface
    low, high = truth.seen[:, :2].min(0), truth.seen[:, :2].max(0)
    x, y = (np.arange(low[k], high[k], GRID) for k in (0, 1))
    xx, yy = np.meshgrid(x, y)
    top = float(vertices[:, 2].max()) + 1.0
    down = np.broadcast_to([0.0, 0.0, -1.0], (xx.size, 3))
    rays = np.concatenate([np.stack([xx.ravel(), yy.ravel(), np.full(xx.size, top)], 1), down], 1)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(triangles.astype(np.uint32)),
    )
    reach = scene.cast_rays(o3d.core.Tensor.from_numpy(rays.astype(np.float32)))["t_hit"].numpy().astype(float)
    ground = np.where(np.isfinite(reach), top - reach, np.nan).reshape(xx.shape)
    filled = np.where(np.isfinite(ground), ground, np.nanmedian(ground))
    span = round(WIDEST / GRID)
    out = filled - grey_opening(filled, size=(span, span))
    summit = (out == maximum_filter(out, size=span)) & (out > LOWEST) & (out < HIGHEST) & np.isfinite(ground)
    # of neighbours that are equally high the first
    _, first = np.unique(label(summit, np.ones((3, 3)))[0][summit], return_index=True)
    places = np.stack([xx[summit], yy[summit]], 1)[first]
    seen = cKDTree(truth.seen[:, :2]).query(places)[0] < 2 * TOP if len(places) else np.zeros(0, bool)
    surface = np.stack([xx.ravel(), yy.ravel(), ground.ravel()], 1)
    heights = _heights(places[seen], surface[np.isfinite(surface[:, 2])])
    known = (heights > LOWEST) & (heights < HIGHEST)
    return Stones(places[seen][known], heights[known])


def _heights(summit: Floats, points: Floats) -> Floats:
    if len(points) == 0 or len(summit) == 0:
        return np.full(len(summit), np.nan)
    tree = cKDTree(points[:, :2])
    out = np.full(len(summit), np.nan)
    for k, rows in enumerate(tree.query_ball_point(summit, RING[1])):
        distance = np.linalg.norm(points[rows, :2] - summit[k], axis=1)
        z = points[rows, 2]
        top, ring = z[distance < TOP], z[distance > RING[0]]
        if len(top) >= 4 and len(ring) >= 20:
            out[k] = np.median(top) - np.median(ring)
    return out


def kept(stones: Stones, reference: Floats, heights: Floats) -> tuple[int, float | None, float | None]:
    """How many stones the reference cloud, that of the true poses, covers; per cent of them whose height (n,) is that of
    the true surface within `KEPT`; per cent of the reference's heights (n,) that are there (by regression; what is not
    covered counts as flat)."""
    there = np.isfinite(reference)
    if there.sum() < 5:
        return int(there.sum()), None, None
    found = heights[there]
    share = 100.0 * float((np.abs(found - stones.height[there]) < KEPT).mean())
    return int(there.sum()), share, 100.0 * float(np.nansum(found * reference[there]) / np.sum(reference[there] ** 2))
