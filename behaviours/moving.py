"""What moves: points where water had long been free, clustered pass by pass, tracked with a velocity."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from behaviours.types import Profile
from garbi_map.log.records import Floats

GATE, LEAST, QUIET, LONGEST, FORGET = 0.6, 12, 0.2, 0.8, 8.0  # m, points, s, s, s
FASTEST = 0.5  # m/s
SPREAD = 0.05  # m, 1 sigma of a cluster's centre seen by a slit


@dataclass(frozen=True)
class Mover:
    """One moving thing: centre (3,) m and velocity (3,) m/s in odom at stamp_ns, radius m, passes in which it was seen."""

    number: int
    stamp_ns: int
    first_ns: int
    centre: Floats
    velocity: Floats
    radius: float
    passes: int

    def at(self, now_ns: int) -> Floats:
        """Where it is by now, (3,)."""
        return self.centre + self.velocity * min((now_ns - self.stamp_ns) * 1e-9, 4.0)


@dataclass
class _Cluster:
    first_ns: int
    last_ns: int
    sweep: int
    points: list[Floats] = field(default_factory=list)
    count: int = 0
    used: bool = False

    @property
    def centre(self) -> Floats:
        return np.median(np.concatenate(self.points), axis=0)


class Movers:
    """`see` each profile with what the space found surprising; `now` says what is tracked."""

    def __init__(self) -> None:
        self._open: list[_Cluster] = []
        self._tracks: list[Mover] = []
        self._number = 0

    def see(self, profile: Profile, surprising: np.ndarray) -> None:
        """Points (n,) of the profile flagged by `Space.see`."""
        if surprising.sum() >= 3:
            self._gather(profile, profile.points[surprising])
        for cluster in self._open:
            quiet = (profile.stamp_ns - cluster.last_ns) * 1e-9 > QUIET
            long = (cluster.last_ns - cluster.first_ns) * 1e-9 > LONGEST
            if not cluster.used and cluster.count >= LEAST and len(cluster.points) > 1 and (quiet or long):
                self._track(cluster)
        self._open = [one for one in self._open if abs(profile.stamp_ns - one.last_ns) * 1e-9 <= QUIET]
        self._tracks = [one for one in self._tracks if 0 <= profile.stamp_ns - one.stamp_ns < FORGET * 1e9]

    def _gather(self, profile: Profile, points: Floats) -> None:
        order = np.argsort(points[:, 2], kind="stable")
        pieces = np.split(points[order], np.flatnonzero(np.diff(points[order][:, 2]) > 0.15) + 1)
        for piece in pieces:
            if len(piece) < 3:
                continue
            middle = np.median(piece, axis=0)
            near = [one for one in self._open if np.linalg.norm(np.median(one.points[-1], axis=0) - middle) < 0.3]
            if near:
                cluster = near[0]
            else:
                cluster = _Cluster(profile.stamp_ns, profile.stamp_ns, profile.sweep)
                self._open.append(cluster)
            cluster.points.append(piece)
            cluster.count += len(piece)
            cluster.last_ns = profile.stamp_ns

    def _track(self, cluster: _Cluster) -> None:
        cluster.used = True
        centre = cluster.centre
        stamp = (cluster.first_ns + cluster.last_ns) // 2
        radius = float(np.percentile(np.linalg.norm(np.concatenate(cluster.points) - centre, axis=1), 90))
        best, least = None, np.inf
        for index, track in enumerate(self._tracks):
            age = (stamp - track.stamp_ns) * 1e-9
            predicted = track.centre + track.velocity * age
            off = float(np.linalg.norm(centre - predicted))
            if off < GATE + FASTEST * (age if track.passes == 1 else 0.3 * age) and off < least and age >= 0:
                best, least = index, off
        if best is None:
            self._number += 1
            self._tracks.append(Mover(self._number, stamp, cluster.first_ns, centre, np.zeros(3), radius, 1))
            return
        track = self._tracks[best]
        age = max((stamp - track.stamp_ns) * 1e-9, 1e-3)
        if age < 0.5:  # the same pass: more of the same thing
            merged = (track.centre + centre) / 2
            self._tracks[best] = replace(track, centre=merged, radius=max(radius, track.radius))
            return
        measured = (centre - track.centre) / age
        trust = 1.0 if track.passes == 1 else 0.5
        velocity = track.velocity + trust * (measured - track.velocity)
        speed = float(np.linalg.norm(velocity))
        if speed > FASTEST:
            velocity = velocity * FASTEST / speed
        self._tracks[best] = Mover(
            track.number, stamp, track.first_ns, centre, velocity, max(radius, 0.7 * track.radius), track.passes + 1
        )

    def now(self) -> list[Mover]:
        """The things that move, or did until lately."""
        return list(self._tracks)
