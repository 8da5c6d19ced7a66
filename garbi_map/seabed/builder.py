"""From sweeps and their poses to the seabed: to see, to see through, then to judge and fuse."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed.evidence import Evidence
from garbi_map.seabed.settings import SeabedSettings
from garbi_map.seabed.surface import SurfaceGrid
from garbi_map.seabed.types import AcceptedPoints, JudgedPoints, Points, Seabed, Verdict
from garbi_map.sweep.types import Sweep

Posed = tuple[Sweep, Trajectory]


class SeabedBuilder:
    """`observe` every sweep, `see_through` every sweep, `add` every sweep, each in any order. Then `finish`.

    The poses are those of the rig frame (map <- rig) at the sweep's profiles, with the covariance of base_link as
    `Trajectory.mounted` leaves it; `mount` (base_link <- rig) tells how far from base_link the points are; eyes
    (e, 3) m, rig frame: where camera and laser are, for what moves is seen through from both.
    """

    def __init__(
        self, settings: SeabedSettings, mount: Mount | None = None, eyes: NDArray[np.float64] | None = None
    ) -> None:
        mount = mount or Mount()
        self._eyes = np.zeros((1, 3)) if eyes is None else eyes
        self.surface = SurfaceGrid(settings)
        self.rejected: Counter[str] = Counter()
        self.accepted = 0
        self._evidence = Evidence(settings.outliers)
        self._base_in_rig = -Rotation.from_quat(mount.quaternion).inv().apply(mount.translation)

    @property
    def is_full(self) -> bool:
        """Whether what was observed takes as much memory as it may."""
        return self._evidence.is_full

    def observe(self, sweep: Sweep, poses: Trajectory) -> None:
        """See where the points of a sweep are, without taking them in."""
        placed = _place(sweep, poses)
        self._evidence.observe(placed, sweep.sigma, sweep.profile, len(sweep.stamp_ns))

    def see_through(self, sweep: Sweep, poses: Trajectory) -> None:
        """Note what was seen on the way of the light and of the view, which was not there at that moment."""
        eyes = np.stack([poses.position + poses.rotation.apply(eye) for eye in self._eyes])
        self._evidence.pass_through(_place(sweep, poses), sweep.sigma, sweep.profile, sweep.row, eyes)

    def judge(self, sweep: Sweep, poses: Trajectory) -> JudgedPoints:
        """The points of a sweep that are seabed by all that was observed, not yet fused."""
        from garbi_map.seabed import kernels

        placed = _place(sweep, poses)
        verdict, gradient = self._evidence.judge(placed, sweep.points, sweep.sigma, sweep.profile, sweep.row)
        sigma, noise, pose = kernels.point_errors(
            placed,
            sweep.profile,
            sweep.sigma,
            poses.position,
            poses.position + poses.rotation.apply(self._base_in_rig),
            poses.covariance,
            gradient,
        )
        chosen = verdict == Verdict.ACCEPTED

        def those(mask: NDArray[np.bool_]) -> tuple[NDArray, NDArray, NDArray, NDArray]:
            return sweep.point_stamp_ns[mask], placed[mask], sigma[mask], sweep.intensity[mask]

        points = JudgedPoints(
            *those(chosen),
            verdict,
            Points(*those(verdict == Verdict.SEEN_THROUGH)),
            gradient=gradient[chosen],
            noise=noise[chosen],
            pose=pose[chosen],
        )
        self.accepted += len(points.points)
        self.rejected.update(points.rejected)
        return points

    def add(self, sweep: Sweep, poses: Trajectory) -> JudgedPoints:
        """Judge the points of a sweep by all that was observed, and fuse the accepted ones into the surface."""
        points = self.judge(sweep, poses)
        self.surface.add(points)
        return points

    def finish(self) -> Seabed:
        """The elevation grid. Raises GarbiError when no point was accepted."""
        return self.surface.finish()


def build_seabed(
    sweeps: Callable[[], Iterable[Posed]],
    settings: SeabedSettings,
    mount: Mount | None = None,
    take: Callable[[AcceptedPoints], None] = lambda points: None,
    eyes: NDArray[np.float64] | None = None,
) -> tuple[Seabed, SeabedBuilder]:
    """All passes over sweeps that can be read again; `take` is given the accepted points sweep by sweep."""
    builder = SeabedBuilder(settings, mount, eyes)
    for sweep, poses in sweeps():
        builder.observe(sweep, poses)
    for sweep, poses in sweeps():
        builder.see_through(sweep, poses)
    for sweep, poses in sweeps():
        take(builder.add(sweep, poses))
    return builder.finish(), builder


def _place(sweep: Sweep, poses: Trajectory) -> NDArray[np.float64]:
    """The points (n, 3) in `map`, each by the pose of its own profile."""
    from garbi_map.navigate.kernels import place_points

    return place_points(sweep.points, sweep.profile, poses.rotation.as_matrix(), poses.position)
