"""What moves: points where water had long been free, and compact things that are elsewhere from pass to pass.

Both are clustered pass by pass and tracked by a Kalman filter of place and velocity. A thing that was hit in water that had
long been free moves; so does one whose places in two passes differ by more than chance, if it is now where the water was
free in an earlier pass."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from behaviours.types import Profile
from garbi_map.log.records import Floats

LEAST, QUIET, LONGEST = 12, 0.2, 0.8  # points, s, s of a cluster
FORGET_FIRST, FORGET = 8.0, 60.0  # s without being seen: without and with a velocity
SPREAD = 0.07  # m, 1 sigma of a cluster's centre seen by a slit
SPEED, CHANGE = 0.15, 0.004  # m/s, 1 sigma of a speed of which nothing is known; m/s per square root of a second
GATE = 0.3  # m, beyond two sigma, within which a cluster is what was tracked
SMALLEST, TALLEST = 0.1, 0.7  # m, of a compact thing
BESIDE = 10  # rows within which what is nearer may hide the rest
CHANCE, NEWLY = 2.5, 0.6  # sigmas; share of the points in water that was free before
MERGED = 0.5  # s within which two clusters belong to one pass
STILL, DECIDED, LATELY = (
    0.05,
    5,
    5.0,
)  # m/s; passes after which a thing that was not faster stands; s, since it was seen


@dataclass(frozen=True)
class Mover:
    """One moving thing: centre (3,) m and velocity (3,) m/s in odom at stamp_ns, radius m, passes in which it was seen;
    doubt: m/s, 1 sigma of its velocity."""

    number: int
    stamp_ns: int
    first_ns: int
    centre: Floats
    velocity: Floats
    radius: float
    passes: int
    doubt: float = 0.0

    def at(self, now_ns: int) -> Floats:
        """Where it is by now, (3,)."""
        return self.centre + self.velocity * min((now_ns - self.stamp_ns) * 1e-9, FORGET)


@dataclass
class _Cluster:
    first_ns: int
    last_ns: int
    points: list[Floats] = field(default_factory=list)
    count: int = 0
    surprising: int = 0
    newly: int = 0
    used: bool = False

    @property
    def centre(self) -> Floats:
        return np.median(np.concatenate(self.points), axis=0)


@dataclass(frozen=True)
class _Track:
    """state (2, 3) m, m/s of the centre; covariance (2, 2), of each axis alike."""

    number: int
    stamp_ns: int
    first_ns: int
    state: Floats
    covariance: Floats
    radius: float
    passes: int
    moves: bool

    def predicted(self, stamp_ns: int) -> _Track:
        seconds = (stamp_ns - self.stamp_ns) * 1e-9
        step = np.array([[1.0, seconds], [0.0, 1.0]])
        grown = step @ self.covariance @ step.T + np.diag([0.0, CHANGE**2 * abs(seconds)])
        return replace(self, stamp_ns=stamp_ns, state=step @ self.state, covariance=grown)

    def seen(self, centre: Floats, radius: float) -> _Track:
        gain = self.covariance[:, 0] / (self.covariance[0, 0] + SPREAD**2)
        state = self.state + np.outer(gain, centre - self.state[0])
        return replace(
            self, state=state, covariance=self.covariance - np.outer(gain, self.covariance[0]),
            radius=max(radius, 0.7 * self.radius), passes=self.passes + 1,
        )  # fmt: skip

    @property
    def doubt(self) -> float:
        return float(np.sqrt(self.covariance[1, 1]))

    @property
    def fastest(self) -> float:
        """m/s, that it may move, two sigmas over what it seems to."""
        return float(np.linalg.norm(self.state[1])) + 2 * self.doubt

    def mover(self) -> Mover:
        velocity = self.state[1] if self.passes > 1 else np.zeros(3)
        return Mover(
            self.number, self.stamp_ns, self.first_ns, self.state[0], velocity, self.radius, self.passes, self.doubt
        )


class Movers:
    """`see` each profile with what the space found surprising; `now` says what is tracked."""

    def __init__(self, rows: int = 2**31) -> None:
        """rows: of the image; what reaches its border is cut off there and tells no place."""
        self._rows = rows
        self._open: list[_Cluster] = []
        self._tracks: list[_Track] = []
        self._number = 0
        self._left: list[tuple[Floats, float, int]] = []

    def see(self, profile: Profile, surprising: NDArray[np.bool_], newly: NDArray[np.bool_]) -> None:
        """Points (n,) of the profile flagged by `Space.see`: hit where water had long been free; or free in an earlier
        pass."""
        for points in self._pieces(profile, surprising):
            self._gather(profile, points, surprising, newly)
        for cluster in self._open:
            quiet = (profile.stamp_ns - cluster.last_ns) * 1e-9 > QUIET
            long = (cluster.last_ns - cluster.first_ns) * 1e-9 > LONGEST
            if not cluster.used and cluster.count >= LEAST and len(cluster.points) > 1 and (quiet or long):
                self._track(cluster)
        self._open = [one for one in self._open if abs(profile.stamp_ns - one.last_ns) * 1e-9 <= QUIET]
        self._tracks = [
            one
            for one in self._tracks
            if 0 <= profile.stamp_ns - one.stamp_ns < (FORGET if one.passes > 1 else FORGET_FIRST) * 1e9
        ]

    def _pieces(self, profile: Profile, surprising: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
        """Numbers of the points that hang together: of compact pieces all, of others what is surprising."""
        found = []
        solid = np.flatnonzero(profile.solid)
        for piece in np.split(solid, np.flatnonzero(np.diff(profile.piece[solid])) + 1):
            if len(piece) < 3:
                continue
            if not self._compact(profile, piece):
                piece = piece[surprising[piece]]
                piece = piece[np.argsort(profile.points[piece, 2], kind="stable")]
                apart = np.flatnonzero(np.diff(profile.points[piece, 2]) > 0.15) + 1
                found += [part for part in np.split(piece, apart) if len(part) >= 3]
            else:
                found.append(piece)
        return found

    def _compact(self, profile: Profile, piece: NDArray[np.int64]) -> bool:
        """Whether a piece is all there is of an upright thing: neither cut off by the image's border or by something nearer,
        nor ground, which lies and runs away in depth."""
        row, depth = profile.row, profile.depth
        inside = row[piece[0]] > 2 and row[piece[-1]] < self._rows - 3
        for end, beside in ((piece[0], piece[0] - 1), (piece[-1], piece[-1] + 1)):
            if 0 <= beside < len(row) and abs(int(row[beside]) - int(row[end])) < BESIDE:
                inside = inside and depth[beside] > depth[end]
        tall = float(np.ptp(profile.points[piece, 2]))
        return bool(inside and SMALLEST < tall < TALLEST and tall > np.ptp(depth[piece]))

    def _gather(
        self, profile: Profile, piece: NDArray[np.int64], surprising: NDArray[np.bool_], newly: NDArray[np.bool_]
    ) -> None:
        points = profile.points[piece]
        middle = np.median(points, axis=0)
        near = [one for one in self._open if np.linalg.norm(np.median(one.points[-1], axis=0) - middle) < 0.3]
        if near:
            cluster = near[0]
        else:
            cluster = _Cluster(profile.stamp_ns, profile.stamp_ns)
            self._open.append(cluster)
        cluster.points.append(points)
        cluster.count += len(piece)
        cluster.surprising += int(surprising[piece].sum())
        cluster.newly += int(newly[piece].sum())
        cluster.last_ns = profile.stamp_ns

    def _track(self, cluster: _Cluster) -> None:
        cluster.used = True
        centre = cluster.centre
        stamp = (cluster.first_ns + cluster.last_ns) // 2
        radius = float(np.percentile(np.linalg.norm(np.concatenate(cluster.points) - centre, axis=1), 90))
        surprising = cluster.surprising >= max(LEAST, 0.3 * cluster.count)
        best, least = None, np.inf
        for index, track in enumerate(self._tracks):
            if stamp < track.stamp_ns:
                continue
            there = track.predicted(stamp)
            off = float(np.linalg.norm(centre - there.state[0]))
            if off < GATE + 2 * float(np.sqrt(there.covariance[0, 0])) and off < least:
                best, least = index, off
        if best is None:
            self._number += 1
            covariance = np.diag([SPREAD**2, SPEED**2])
            state = np.stack([centre, np.zeros(3)])
            one = _Track(self._number, stamp, cluster.first_ns, state, covariance, radius, 1, surprising)
            self._tracks.append(one)
            return
        track = self._tracks[best]
        if (stamp - track.stamp_ns) * 1e-9 < MERGED:  # the same pass: more of the same thing
            state = np.stack([(track.state[0] + centre) / 2, track.state[1]])
            moves = track.moves or surprising
            self._tracks[best] = replace(track, state=state, radius=max(radius, track.radius), moves=moves)
            return
        seen = track.predicted(stamp).seen(centre, radius)
        shifted = np.linalg.norm(seen.state[1]) > CHANCE * seen.doubt and cluster.newly > NEWLY * cluster.count
        self._tracks[best] = replace(seen, moves=track.moves or surprising or bool(shifted))
        if self._tracks[best].moves:
            self._left.append((track.state[0], radius, cluster.first_ns))

    def left(self) -> list[tuple[Floats, float, int]]:
        """Since the last call: places (3,) m, odom, where something of a radius (m) that moves was before a moment (ns)."""
        left, self._left = self._left, []
        return left

    def now(self) -> list[Mover]:
        """The things that move, or did until lately."""
        return [one.mover() for one in self._tracks if one.moves]

    def undecided(self, now_ns: int) -> list[Mover]:
        """Compact things of which too few passes tell whether they move."""
        recent = [one for one in self._tracks if not one.moves and (now_ns - one.stamp_ns) * 1e-9 < LATELY]
        return [one.mover() for one in recent if one.passes < DECIDED and one.fastest > STILL]
