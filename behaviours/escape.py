"""Out of the way of what moves: manoeuvres are rehearsed against where it will be, and the one it misses by most is flown.

A vehicle without sway cannot step aside from what comes abeam: it has to have turned, risen or gone on in time. So it is
not how near something is that counts but how near it will come within the next seconds, the doubt of its velocity included
(compare the velocity obstacles of Fiorini and Shiller, 1998)."""

from __future__ import annotations

import itertools

import numpy as np

from behaviours.kernels_escape import flee
from behaviours.moving import Mover
from behaviours.settings import EscapeSettings, Vehicle
from behaviours.situation import Situation
from behaviours.types import Command
from garbi_map.log.records import Floats

STEP = 0.5  # s
LAG = 0.6  # s, of surge, heave and yaw
VIEW, EFFORT = 0.1, 0.15  # m of gap that keeping it in view is worth; that a m/s of change costs
NEAREST, AFTER = 3.0, 2.0  # m of mean gap that the least one counts for, and the least one afterwards
ASTERN = 0.3  # m of gap: that way it sees nothing
SIGHT, BLIND = 0.7, 1.5  # share of profiles that show something; m of gap that rising costs where fewer do
STEADY = 0.4  # m of gap that going on with what was begun is worth
# m of gap that the best known way leaves: less, and unseen water is entered; more, and it is shunned again
HOPELESS, HOPEFUL = 0.1, 0.3
BETTER = 0.15  # m of gap more, for which unseen water is entered


class Escape:
    """Remembers that it is under way: it ends only when the vehicle would be missed even at rest; and that it has dared
    unseen water: once the hull is in it, it shuts no way out."""

    def __init__(self, settings: EscapeSettings, vehicle: Vehicle) -> None:
        self._settings, self._vehicle = settings, vehicle
        self._half = np.array(vehicle.hull) / 2
        self._shell = _shell(self._half)
        self._room = self._shell * (1.0 + settings.clearance / self._half)
        self._model = np.array([LAG, LAG, vehicle.sway_time, vehicle.skid])
        self._under_way = self._dares = False
        self._begun: Floats | None = None
        self._begun_ns = 0
        self._manoeuvres = _manoeuvres(vehicle)

    def propose(self, situation: Situation) -> tuple[Command, str, bool] | None:
        """What to do, why in words, and whether it leads into unseen water; None where nothing will come too near."""
        dared, self._dares = self._dares, False
        movers = [one for one in situation.movers if self._matters(one, situation)]
        if not movers:
            self._under_way = False
            return None
        pose = situation.pose
        speed, rate = float(pose.velocity[0]), float(pose.rate[2])
        ways = np.array([[speed, rate, 1.5, speed, float(pose.velocity[2])], [0.0, 0.0, 1.5, 0.0, 0.0]])
        going_on, resting = self._rehearse(situation, movers, ways, dare=False)[:, 0]
        if self._under_way:
            self._under_way = bool(min(going_on, resting) < self._settings.release)
        else:
            self._under_way = bool(going_on < self._settings.near)
            self._begun = None
        if not self._under_way:
            return None
        ways = self._manoeuvres if self._begun is None else np.vstack([self._manoeuvres, self._rest(pose.stamp_ns)])
        best, gap = self._best(situation, movers, ways, dare=False)
        if gap < (HOPEFUL if dared else HOPELESS):
            other, wider = self._best(situation, movers, ways, dare=True)
            if wider > gap + (0.0 if dared else BETTER):
                best, gap, self._dares = other, wider, True
        if best < len(self._manoeuvres):
            self._begun, self._begun_ns = ways[best], pose.stamp_ns
        surge, yaw, _, _, heave = ways[best]
        words = (
            f"something moving will come within {max(going_on, 0.0):.2f} m, at rest {max(resting, 0.0):.2f} m; "
            f"this way {max(gap, 0.0):.2f} m{', through unseen water' if self._dares else ''}"
        )
        level = float(np.clip(-0.6 * pose.tilt, -0.1, 0.1))
        return Command(float(surge), float(heave), float(yaw), level), words, self._dares

    def _best(self, situation: Situation, movers: list[Mover], ways: Floats, dare: bool) -> tuple[int, float]:
        """Which of the manoeuvres (m, 5) is worth most, and the least gap that it leaves, m; dare: see `flee`."""
        pose = situation.pose
        speed = float(pose.velocity[0])
        found = self._rehearse(situation, movers, ways, dare)
        effort = np.abs(ways[:, [0, 4]] - [speed, 0.0]).sum(1) + 0.3 * np.abs(ways[:, 1])
        keep = self._settings.keep
        worth = NEAREST * np.minimum(found[:, 0], keep) + AFTER * np.minimum(found[:, 3], keep) + found[:, 1]
        worth += VIEW * found[:, 2] - EFFORT * effort - ASTERN * (ways[:, 3] < 0.0)
        worth[len(self._manoeuvres) :] += STEADY
        # Out of sight of the ground nothing proves the water free.
        if situation.space.returning(situation.now_ns) < SIGHT:
            worth -= BLIND * (ways[:, 4] > 0.0)
        best = int(np.argmax(worth))
        return best, float(found[best, 0])

    def _rest(self, now_ns: int) -> Floats:
        """What is left of the manoeuvre that was begun, (1, 5)."""
        assert self._begun is not None
        surge, yaw, seconds, then, heave = self._begun
        left = seconds - (now_ns - self._begun_ns) * 1e-9
        return np.array([[surge, yaw, left, then, heave] if left > 0.0 else [then, 0.0, 1.0, then, heave]])

    def _matters(self, mover: Mover, situation: Situation) -> bool:
        pose = situation.pose
        away = float(np.linalg.norm(mover.at(pose.stamp_ns) - pose.position))
        reach = float(np.linalg.norm(mover.velocity)) + self._vehicle.limits[0]
        return away < self._settings.horizon * reach + 1.5

    def _rehearse(self, situation: Situation, movers: list[Mover], manoeuvres: Floats, dare: bool) -> Floats:
        pose, space, now = situation.pose, situation.space, situation.pose.stamp_ns
        # What was seen in one pass only has no velocity yet: it is taken to come from where it is.
        rows = [
            [*one.at(now), *one.velocity, one.radius, one.doubt * (now - one.stamp_ns) * 1e-9, one.doubt]
            for one in movers
        ]
        state = np.array([*pose.position, pose.heading, *pose.velocity, pose.rate[2]])
        return flee(
            state, situation.current, np.ascontiguousarray(manoeuvres), STEP, round(self._settings.horizon / STEP),
            self._model, self._half, self._shell, self._room, np.array(rows), self._settings.keep, space.voxel, space.low,
            space.shape, space.settings.hits, space.assumed_free_above, space.layers, dare,
        )  # fmt: skip


def _manoeuvres(vehicle: Vehicle) -> Floats:
    """(m, 5), see `flee`: straight on or turning first, ahead, astern or on the spot, each level or rising. Never sinking:
    what lies below is the ground, and a rig that looks ahead does not see it."""
    surge, heave, yaw, _ = vehicle.limits
    speeds = (-vehicle.astern, 0.0, surge)
    found = [(speed, 0.0, 1.5, speed, rise) for speed in speeds for rise in (0.0, heave)]
    for first, rate, seconds in itertools.product(speeds, (-yaw, yaw), (1.5, 3.0, 4.5)):
        for then, rise in itertools.product((-vehicle.astern, surge), (0.0, heave)):
            found.append((first, rate, seconds, then, rise))
    return np.array(found)


def _shell(half: Floats) -> Floats:
    """Points (p, 3) of the hull's faces, base_link."""
    axes = [np.linspace(-h, h, max(int(2 * h / 0.24), 2) + 1) for h in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return np.ascontiguousarray(grid[(np.abs(np.abs(grid) - half) < 1e-9).any(1)] * 0.98)
