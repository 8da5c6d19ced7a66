"""The local volume about the vehicle: seen free, occupied, unknown, each with its age; and what moved through it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from behaviours import kernels
from behaviours.kernels_proof import proved
from behaviours.settings import ClearWater, FeedSettings, SpaceSettings, Vehicle
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats, Mount
from garbi_map.rig import Rig

EVERY = 2  # profiles of which one carves: neighbours prove the same
SLOWEST = 0.1  # m/s, surge at least, by which it is told how far the water carries the hull on its way
RETURNED_NS = 1_000_000_000  # ns of profiles that tell whether anything returns at all
DOT = 2  # hits that a dot of a profile counts: one may be a flake of snow, two in the same place are something


@dataclass(frozen=True)
class Nearby:
    """The nearest things about the hull, one per direction, base_link.

    distance (m,) m from the hull; normal (m, 3) out of the hull; point (m, 3) of the hull; unknown (m,) bool, else hit
    """

    distance: Floats
    normal: Floats
    point: Floats
    unknown: NDArray[np.bool_]

    def hit(self) -> Nearby:
        """Without what is unknown."""
        kept = ~self.unknown
        return Nearby(self.distance[kept], self.normal[kept], self.point[kept], self.unknown[kept])


@dataclass(frozen=True)
class Corridor:
    """What lies before the bow: free length m, age s of its view, and what ends it: "nothing", "obstacle", "unseen"."""

    length: float
    age: float
    end: str


class Space:
    """Bounded: a grid that moves with the vehicle. Incremental: one call of `see` per profile."""

    def __init__(
        self, rig: Rig, mount: Mount, vehicle: Vehicle, settings: SpaceSettings, feed: FeedSettings, water: ClearWater
    ) -> None:
        self.settings, self.water, self._rig, self._mount = settings, water, rig, mount
        self.half = np.array(vehicle.hull) / 2
        self._sway_time, self._skid = vehicle.sway_time, vehicle.skid
        self.voxel = settings.voxel
        width, height = settings.reach
        self.shape = np.array([2 * round(width / self.voxel)] * 2 + [2 * round(height / self.voxel)], np.int64)
        size = tuple(int(n) for n in self.shape)
        self.layers = (
            np.full(size, kernels.NEVER, np.int32),
            np.full(size, kernels.NEVER, np.int32),
            np.full(size, kernels.NEVER, np.int32),
            np.zeros(size, np.uint8),
            np.zeros(size, np.uint8),
            np.full(size, -1, np.int32),
            np.zeros(size, np.uint8),
            np.full(size, kernels.NEVER, np.int32),
        )
        self._blank = (kernels.NEVER, kernels.NEVER, kernels.NEVER, 0, 0, -1, 0, kernels.NEVER)
        self.low = np.zeros(3, np.int64)
        self._start_ns: int | None = None
        self._turn = Rotation.from_quat(mount.quaternion).as_matrix()
        self._rows = max(round(feed.carve * rig.camera.alpha_v), 1)
        columns = max(round(feed.carve * rig.camera.alpha_u), 1)
        v = np.arange(self._rows // 2, rig.camera.height, self._rows)
        u = np.arange(columns // 2, rig.camera.width, columns)
        uu, vv = np.meshgrid(u, v)
        origins, directions = rig.rays(uu.ravel(), vv.ravel())
        self._origins = np.ascontiguousarray(origins.reshape(len(v), len(u), 3))
        self._directions = np.ascontiguousarray(directions.reshape(len(v), len(u), 3))
        self._axis = np.ascontiguousarray(rig.camera.rotation[:, 2])
        self._count = 0
        self._proof: list[tuple[int, float]] = []
        self._returned: list[tuple[int, bool]] = []
        self._reaches = np.arange(0.3, water.farthest + 0.05, 0.05)
        self._fading = np.exp(-2 * water.attenuation * self._reaches) / self._reaches**2
        self.assumed_free_above = np.inf

    @property
    def _hold(self) -> tuple[int, int]:
        return round(self.settings.hold * 1e3), round(self.settings.hold_moving * 1e3)

    def milliseconds(self, stamp_ns: int) -> int:
        """The times that the layers hold."""
        assert self._start_ns is not None
        return (stamp_ns - self._start_ns) // 1_000_000

    def be_at(self, pose: Pose) -> None:
        """The vehicle is here: where its hull is there is nothing else; the grid follows."""
        first = self._start_ns is None
        if first or pose.stamp_ns < self._start_ns - 3_600_000_000_000:  # type: ignore[operator]
            self._start_ns = pose.stamp_ns - 1_000_000_000
        self._follow(pose.position)
        now = self.milliseconds(pose.stamp_ns)
        if first:
            clearance = self.half + self.settings.launch_clearance
            kernels.free_box(
                pose.position, pose.rotation, clearance, self.voxel, self.low, self.shape, now, False, self.layers
            )
        kernels.free_box(
            pose.position, pose.rotation, self.half, self.voxel, self.low, self.shape, now, True, self.layers
        )

    def _follow(self, position: Floats) -> None:
        wanted = np.floor(position / self.voxel).astype(np.int64) - self.shape // 2
        if (np.abs(wanted - self.low) * self.voxel < 0.5).all():
            return
        layers: tuple[NDArray[Any], ...] = self.layers
        for axis in range(3):
            shift = int(wanted[axis] - self.low[axis])
            count = int(self.shape[axis])
            if shift == 0:
                continue
            new = (
                np.arange(count)
                if abs(shift) >= count
                else (
                    np.arange(self.low[axis] + count, wanted[axis] + count)
                    if shift > 0
                    else np.arange(wanted[axis], self.low[axis])
                )
            )
            place = (slice(None),) * axis + (np.mod(new, count),)
            for layer, blank in zip(layers, self._blank, strict=True):
                layer[place] = blank
            self.low[axis] = wanted[axis]

    def see(self, profile: Profile) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Take in a profile; True (n,) for its points that lie where water had long been free: something moved; and for
        those where it was free in an earlier pass: something may have."""
        pose, settings = profile.pose, self.settings
        if self._start_ns is None:
            self.be_at(pose)
        now, sweep = self.milliseconds(profile.stamp_ns), profile.sweep
        rotation = np.ascontiguousarray(pose.rotation @ self._turn)
        position = pose.rotation @ self._mount.translation + pose.position
        grid = (self.voxel, self.low, self.shape)
        carving = (*grid, settings.hits, now, sweep, *self._hold, self.layers)
        newly = kernels.was_free(profile.points, *grid, now, sweep, self.layers)
        surprising = np.zeros(len(profile.points), bool)
        surprising[profile.solid] = self._hit(profile.points[profile.solid], 1, now)
        dots = np.flatnonzero(~profile.solid)
        _, first = np.unique(profile.piece[dots], return_index=True)
        self._hit(profile.points[dots[first]], DOT, now)
        self._learn_clarity(profile)
        self._count += 1
        if self._count % EVERY == 0:
            self._carve_clear(profile, rotation, position, carving)
        shown = np.ascontiguousarray(profile.points[::10])
        for eye in (self._rig.camera.centre, self._rig.laser.apex):
            kernels.carve((rotation @ eye + position)[None], shown, 0.9 * self.voxel, *carving)
        return surprising, newly

    def _carve_clear(self, profile: Profile, rotation: Floats, position: Floats, carving: tuple[Any, ...]) -> None:
        """Free what rows without a stripe prove."""
        nearest = np.full(len(self._origins), np.inf)
        group = np.minimum(profile.row // self._rows, len(nearest) - 1)
        np.minimum.at(nearest, group, profile.depth - self.voxel)
        starts, ends = proved(
            self._origins, self._directions, nearest, self.clear_range(profile.stamp_ns), self._axis,
            self._rig.camera.centre, np.ascontiguousarray(self._rig.sheet(profile.alpha)[0]), self._rig.laser.apex,
        )  # fmt: skip
        kernels.carve(starts @ rotation.T + position, ends @ rotation.T + position, 0.0, *carving)

    def _hit(self, points: Floats, weight: int, now: int) -> NDArray[np.bool_]:
        settings = self.settings
        return kernels.hit(
            points, np.full(len(points), weight), self.voxel, self.low, self.shape, settings.hits, now,
            settings.free_passes,
            round(settings.free_time * 1e3), self.layers,
        )  # fmt: skip

    def _learn_clarity(self, profile: Profile) -> None:
        """Returns prove how far a missing stripe means free water: the faintest surface there would have been found."""
        water = self.water
        self._proof = [
            (when, reach) for when, reach in self._proof if 0 <= profile.stamp_ns - when < water.believed * 1e9
        ]
        shown = len(profile.depth) >= 20
        self._returned = [one for one in self._returned if 0 <= profile.stamp_ns - one[0] < RETURNED_NS]
        self._returned.append((profile.stamp_ns, shown))
        if not shown:
            return
        depth = float(np.median(profile.depth))
        light = float(np.median(profile.intensity)) * water.darkest * depth**2 * np.exp(2 * water.attenuation * depth)
        enough = int((light * self._fading >= water.faintest).sum())
        self._proof.append((profile.stamp_ns, float(self._reaches[enough - 1]) if enough else 0.0))

    def clear_range(self, stamp_ns: int) -> float:
        """Depth, m, up to which a row without a stripe is free water; 0 where nothing has proved the water clear."""
        lately = sorted(reach for when, reach in self._proof if 0 <= stamp_ns - when < self.water.believed * 1e9)
        return lately[int(0.8 * (len(lately) - 1))] if len(lately) >= 5 else 0.0

    def state(self, points: Floats) -> NDArray[np.int64]:
        """UNKNOWN, FREE or OCCUPIED (n,) of points (n, 3), odom."""
        index = np.floor(np.asarray(points) / self.voxel).astype(np.int64)
        inside = ((index >= self.low) & (index < self.low + self.shape)).all(1)
        place = tuple(np.mod(index, self.shape).T)
        known = np.where(self.layers[0][place] != kernels.NEVER, kernels.FREE, kernels.UNKNOWN)
        known = np.where(self.layers[3][place] >= self.settings.hits, kernels.OCCUPIED, known)
        return np.where(inside, known, kernels.UNKNOWN)

    def nearby(self, pose: Pose, horizon: float) -> Nearby:
        """The nearest occupied and unknown voxels about the hull."""
        found, kinds = kernels.nearest(
            pose.position, np.ascontiguousarray(pose.rotation), self.half, horizon, self.voxel, self.low, self.shape,
            self.settings.hits, self.assumed_free_above, self.layers,
        )  # fmt: skip
        return Nearby(found[:, 0], found[:, 1:4], found[:, 4:7], kinds == kernels.UNKNOWN)

    def forget(self, centre: Floats, radius: float, before_ns: int) -> None:
        """What was hit about there (3,) m, odom, before that moment was something that moves, and has gone."""
        reach = radius + self.voxel
        low = np.maximum(np.floor((centre - reach) / self.voxel).astype(np.int64), self.low)
        high = np.minimum(np.floor((centre + reach) / self.voxel).astype(np.int64) + 1, self.low + self.shape)
        if (high <= low).any():
            return
        place = np.ix_(*(np.mod(np.arange(a, b), n) for a, b, n in zip(low, high, self.shape, strict=True)))
        gone = (self.layers[3][place] > 0) & (self.layers[1][place] < self.milliseconds(before_ns))
        self.layers[3][place] = np.where(gone, 0, self.layers[3][place])
        self.layers[6][place] = np.where(gone, 0, self.layers[6][place])

    def snapshot(self) -> tuple[Floats, Floats]:
        """Centres (n, 3) of the occupied voxels and (m, 3) of every eighth free one, m in odom."""
        occupied = self.layers[3] >= self.settings.hits
        free = (self.layers[0] != kernels.NEVER) & ~occupied
        kept = [
            np.mod(np.mod(np.arange(n) - low, n) + low, 2) == 0 for n, low in zip(self.shape, self.low, strict=True)
        ]
        free &= kept[0][:, None, None] & kept[1][None, :, None] & kept[2][None, None, :]
        found = [self.low + np.mod(np.argwhere(layer) - self.low, self.shape) for layer in (occupied, free)]
        return (found[0] + 0.5) * self.voxel, (found[1] + 0.5) * self.voxel

    def corridor(self, pose: Pose, reach: float, current: Floats) -> Corridor:
        """What lies before the bow, on the way that the vehicle makes over ground: what a wave adds to its sway fades,
        the current (2,) m/s, odom, and the skid of a turn go on."""
        surge = max(float(pose.velocity[0]), SLOWEST)
        abeam = np.array([-np.sin(pose.heading), np.cos(pose.heading)]) @ current
        skid = -self._skid * self._sway_time * float(pose.velocity[0] * pose.rate[2])
        slide, carried = np.clip(np.array([pose.velocity[1], abeam + skid]) / surge, -1.0, 1.0)
        length, age, end = kernels.ahead(
            pose.position, np.ascontiguousarray(pose.rotation), self.half, float(slide), float(carried),
            surge * self._sway_time, reach, self.voxel, self.low, self.shape,
            self.settings.hits, self.assumed_free_above, self.milliseconds(pose.stamp_ns), self.layers,
        )  # fmt: skip
        names = {kernels.FREE: "nothing", kernels.OCCUPIED: "obstacle", kernels.UNKNOWN: "unseen"}
        return Corridor(float(length), min(float(age) * 1e-3, 1e6), names[int(end)])

    def known_astern(self, pose: Pose, heading: float, reach: float, drift: Floats) -> float:
        """m, `reach` at most, that the hull could go back from here, level, at that heading (rad), in water that was seen
        free; drift: (2,) m, odom, that water carries it for each metre of that way."""
        back = Rotation.from_euler("z", heading + np.pi).as_matrix()
        aside = float(np.clip(back[:2, 1] @ drift, -1.0, 1.0))
        length, _, _ = kernels.ahead(
            pose.position, back, self.half, aside, aside, 1.0, reach, self.voxel, self.low, self.shape,
            self.settings.hits, self.assumed_free_above, self.milliseconds(pose.stamp_ns), self.layers,
        )  # fmt: skip
        return float(length)

    def returning(self, stamp_ns: int) -> float:
        """Share of the profiles of the last second in which something returned; 1 where there were none."""
        lately = [shown for when, shown in self._returned if 0 <= stamp_ns - when < RETURNED_NS]
        return sum(lately) / len(lately) if lately else 1.0

    def assume_free(self, above: float | None) -> None:
        """The stated prior: water is free this much above the highest mapped bottom; None: nothing is assumed."""
        if above is None:
            self.assumed_free_above = np.inf
            return
        occupied = np.asarray((self.layers[3] >= self.settings.hits).any(axis=(0, 1)))
        numbers = np.arange(self.low[2], self.low[2] + self.shape[2])
        heights = numbers[occupied[np.mod(numbers, self.shape[2])]]
        self.assumed_free_above = (heights.max() + 1) * self.voxel + above if len(heights) else np.inf

    def view(self, stamp_ns: int) -> Floats:
        """(4,) camera before base_link, m; half angle, rad; nearest m at which the whole hull's height shows; farthest."""
        camera = self._rig.camera
        down = abs(float(np.arcsin(np.clip(self._turn[2, 0], -1.0, 1.0))))
        high = np.tan(np.arctan(0.5 * camera.height / camera.alpha_v) - down)
        aside = np.arctan(0.42 * camera.width / camera.alpha_u)
        near = self.half[2] / max(0.95 * high, 0.1)
        return np.array([self._mount.translation[0], aside, near, max(self.clear_range(stamp_ns) - 0.2, 1.0)])

    def to_rig(self, points: Floats) -> Floats:
        """Points (n, 3) in base_link, seen from the rig."""
        return (points - self._mount.translation) @ self._turn
