"""The sweeps as they arrive: the growing map, the profiles and stripes behind it, and how well each sweep fits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.view import style
from garbi_map.view.budget import Budget
from garbi_map.view.cloud import FinishedMap
from garbi_map.view.images import send_stripes, style_stripe
from garbi_map.view.stream import at, name_curves, send_curves, set_time
from garbi_map.view.thin import runs, thinned
from garbi_map.view.vehicle import draw_profiles

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.dive import Dive, Map
    from garbi_map.log import Mount
    from garbi_map.navigate import Trajectory
    from garbi_map.seabed import Seabed
    from garbi_map.sweep import Sweep
    from garbi_map.sweep.store import SweepStore

_REJECTED = 500
"""Most points of a sweep that are drawn although they are not of the map."""
_STEP_NS = 250_000_000
"""How often the growing map gets new points."""


def send_sweeps(
    recording: RecordingStream,
    dive: Dive,
    store: SweepStore,
    built: Map,
    budget: Budget,
    shown: NDArray[np.int64] | None,
) -> None:
    """All sweeps, one in memory at a time. shown: stamps of the images in the recording; None where it has none."""
    import rerun as rr

    radius = _closed(built.seabed, len(store), budget.points_per_sweep, dive.config.view.point_radius)
    recording.log(style.POINTS.path, rr.Points3D.from_fields(radii=radius), static=True)
    style_stripe(recording)
    name_curves(recording, style.MISFIT)
    rejected = rr.Points3D.from_fields(radii=radius, colors=[style.REJECTED.colour])
    recording.log(style.REJECTED.path, rejected, static=True)
    ours = built.registered.trajectory
    finished = FinishedMap.of(built.seabed, (int(ours.stamp_ns[0]), int(ours.stamp_ns[-1])))
    misfit = []
    for sweep in store:
        _send_profiles(recording, dive, sweep, budget, shown)
        misfit.append(_send_points(recording, dive, sweep, built, budget, finished))
    ends = np.array([entry.end_ns for entry in store.entries], np.int64)
    send_curves(recording, style.MISFIT, ends, np.reshape(misfit, (-1, 2)))


def _closed(seabed: Seabed, sweeps: int, points: int, least: float) -> float:
    """The radius, m, with which so many points of a sweep look like a surface; `least` where they are close, and at most
    four times that."""
    footprint = float(seabed.sweeps.sum()) * seabed.cell**2 / max(sweeps, 1)
    return float(np.clip(0.5 * np.sqrt(footprint / points), least, 4.0 * least))


def _send_points(
    recording: RecordingStream, dive: Dive, sweep: Sweep, built: Map, budget: Budget, finished: FinishedMap
) -> tuple[float, float]:
    """The sweep's part of the map; returns its median distance from the finished map, mm: ours, navigation's."""
    import rerun as rr

    mount = dive.navigation.mount("rig")
    chosen = thinned(len(sweep.points), round(1.2 * budget.points_per_sweep))  # a sixth may be snow
    points = _placed(sweep, chosen, built.registered.trajectory, mount)
    good = finished.belongs(points, dive.config.view.outlier_band)
    _send_rejected(recording, sweep, points[~good])
    chosen, points = chosen[good], points[good]
    if len(points) == 0:
        return np.nan, np.nan
    before = _placed(sweep, chosen, built.navigated.trajectory, mount)
    stamps = sweep.stamp_ns[sweep.profile[chosen]]
    first, lengths = runs((stamps - stamps[0]) // _STEP_NS)
    colours = finished.colours(points, sweep.intensity[chosen], sweep.index, stamps)
    named = {
        one.component.partition(":")[2]: rr.components.ColorBatch(colours[one.name]) for one in style.COLOURINGS[1:]
    }
    rows = [
        *rr.Points3D.columns(positions=points.astype(np.float32), colors=colours["Depth"]).partition(lengths),
        *rr.DynamicArchetype.columns("Colouring", components=named).partition(lengths),
    ]
    recording.send_columns(style.POINTS.path, at(stamps[first + lengths - 1]), rows)
    return _typical(finished.beside(points)), _typical(finished.beside(before))


def _send_rejected(recording: RecordingStream, sweep: Sweep, points: NDArray) -> None:
    """What is not of the seabed: points (n, 3) in `map`, seen for the time of their sweep."""
    import rerun as rr

    few = thinned(len(points), _REJECTED)
    for stamp_ns, shown in ((sweep.stamp_ns[0], points[few]), (sweep.stamp_ns[-1], points[:0])):
        set_time(recording, int(stamp_ns))
        recording.log(style.REJECTED.path, rr.Points3D.from_fields(positions=shown.astype(np.float32)))
    recording.reset_time()


def _send_profiles(
    recording: RecordingStream, dive: Dive, sweep: Sweep, budget: Budget, shown: NDArray[np.int64] | None
) -> None:
    used = np.ones(len(sweep.stamp_ns), bool) if shown is None else np.isin(sweep.stamp_ns, shown)
    kept = np.flatnonzero(used[sweep.profile])
    kept = kept[thinned(len(kept), budget.points_per_profile * int(used.sum()))]
    if len(kept) == 0:
        return
    points, profile = sweep.points[kept], sweep.profile[kept]
    stamps, lengths = sweep.stamp_ns[used], np.bincount(profile, minlength=len(used))[used]
    draw_profiles(recording, dive.rig.laser.apex, stamps, points, lengths)
    if shown is not None:
        send_stripes(recording, stamps, dive.rig.project(points), lengths)


def _placed(sweep: Sweep, chosen: NDArray[np.int64], trajectory: Trajectory, mount: Mount) -> NDArray[np.float64]:
    """Chosen points (k, 3) of a sweep in `map`."""
    poses = trajectory.at(sweep.stamp_ns).mounted(mount)
    profile = sweep.profile[chosen]
    turn = poses.rotation.as_matrix()[profile]
    return np.einsum("nij,nj->ni", turn, sweep.points[chosen]) + poses.position[profile]


def _typical(off: NDArray) -> float:
    """Median distance, mm, of heights in m; NaN where none is known."""
    known = np.abs(off[np.isfinite(off)])
    return 1e3 * float(np.median(known)) if len(known) else np.nan
