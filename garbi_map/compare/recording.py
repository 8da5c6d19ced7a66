"""Both surfaces and what changed, in Rerun."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.compare.maps import MapFolder
from garbi_map.seabed import Mesh, Seabed, triangulate
from garbi_map.view import style
from garbi_map.view.blueprint import change_blueprint
from garbi_map.view.stream import recording_file
from garbi_map.view.surface import draw_surface

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.compare.run import Comparison

_TRIANGLES = 400_000
_WIDEST_HOLE = 0.03
"""m, closed in the drawn surfaces."""
_LIFTED = 0.002
"""m by which what changed is drawn above the surface."""


def record_change(path: Path, found: Comparison, words: str) -> None:
    """Write compare.rrd, complete or not at all. Raises GarbiError where the file system refuses."""
    import rerun as rr

    origin = np.array([*found.first.origin, np.nanmean(found.first.elevation)]).round()
    before, after = (_surface(one) for one in (found.first, found.second))
    before = Mesh(before.vertices - origin, before.triangles, before.filled)
    after = Mesh(found.motion.apply(after.vertices) - origin, after.triangles, after.filled)
    with recording_file(
        path, "change", f"{found.first.title}, {found.second.title}", change_blueprint(before.vertices)
    ) as recording:
        draw_surface(recording, before, style.BEFORE.path)
        draw_surface(recording, after, style.AFTER.path)
        _draw_changes(recording, found, origin)
        _draw_patches(recording, found, origin)
        recording.log(style.ABOUT, rr.TextDocument(words, media_type="text/markdown"), static=True)


def _surface(one: MapFolder) -> Mesh:
    known = one.known
    band = np.zeros(known.shape, np.float32)
    seabed = Seabed(
        origin=one.origin,
        cell=one.cell,
        elevation=one.elevation.astype(np.float32),
        uncertainty=np.maximum(np.nan_to_num(one.uncertainty, nan=1.0), 1e-6).astype(np.float32),
        density=known.astype(np.int32),
        standard_deviation=band,
        intensity=band,
        sweeps=known.astype(np.int32),
    )
    return triangulate(seabed, _TRIANGLES, _WIDEST_HOLE)


def _draw_changes(recording: RecordingStream, found: Comparison, origin: NDArray[np.float64]) -> None:
    """The changed cells at their height in the later map where something was gained, else in the earlier one."""
    import rerun as rr

    change = found.change
    row, column = np.nonzero((found.labels > 0) & np.isfinite(change.rise))
    rise = change.rise[row, column]
    x = change.origin[0] + (column + 0.5) * change.cell
    y = change.origin[1] + (row + 0.5) * change.cell
    z = change.elevation[row, column] + np.maximum(rise, 0.0) + _LIFTED
    places = np.stack([x, y, z], axis=1) - origin
    for thing, mine in ((style.RISEN, rise > 0), (style.FALLEN, rise <= 0)):
        points = rr.Points3D(places[mine].astype(np.float32), colors=[thing.colour], radii=0.6 * change.cell)
        recording.log(thing.path, points, static=True)


def _draw_patches(recording: RecordingStream, found: Comparison, origin: NDArray[np.float64]) -> None:
    """A name over each patch, and an arrow for what moved."""
    import rerun as rr

    if not found.patches:
        return
    change = found.change
    places = []
    for patch in found.patches:
        column, row = ((np.array(patch.place) - change.origin) / change.cell).astype(int)
        row, column = (int(np.clip(k, 0, n - 1)) for k, n in zip((row, column), change.elevation.shape, strict=True))
        height = change.elevation[row, column]
        places.append([*patch.place, float(height) if np.isfinite(height) else float(np.nanmean(change.elevation))])
    above = np.array(places) - origin + [0.0, 0.0, 0.12]
    labels = [
        f"{patch.number} {patch.kind}" + (f" {100 * patch.moved:.1f} cm" if patch.moved is not None else "")
        for patch in found.patches
    ]
    names = rr.Points3D(above.astype(np.float32), labels=labels, radii=0.004, colors=[style.MOVE.colour])
    recording.log(f"{style.MOVE.path}/names", names, static=True)
    moved = [k for k, patch in enumerate(found.patches) if patch.move is not None]
    vectors = [[*(found.patches[k].move or (0.0, 0.0)), 0.0] for k in moved]
    if moved:
        arrows = rr.Arrows3D(
            origins=above[moved] - [0, 0, 0.02], vectors=vectors, colors=[style.MOVE.colour], radii=0.004
        )
        recording.log(style.MOVE.path, arrows, static=True)
