"""Things that move, found in the feed: precision and recall per object, and how long it takes.

The vehicle stands among still pillars, swayed by waves, while one or two balls cross before it.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import numpy as np

from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings
from garbi_map.log.records import Floats
from tools.simulator.scenario import Mover
from tools.simulator.seabed import mover_centre
from tools.simulator.sensors import START_NS
from tools.simulator.vehicle import Command
from tools.trials.feed import DiveFeed
from tools.trials.scenario import open_water
from tools.trials.world import Block, Rod, World, shown

PERIOD, END = 0.1, 36.0  # s
OFF = 0.35  # m, from a ball's skin within which a track is that ball


@dataclass
class Found:
    """One trial: balls that were shown in two passes or more, those found of them; tracks, those that are a ball; the
    same of tracks seen in two passes; s from the first profile that shows a ball to its first track, to its velocity."""

    seed: int
    shown: int = 0
    found: int = 0
    tracks: int = 0
    true: int = 0
    moving_found: int = 0
    moving_tracks: int = 0
    moving_true: int = 0
    latency: list[float] = field(default_factory=list)
    velocity_latency: list[float] = field(default_factory=list)

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


def make_world(seed: int) -> World:
    """A wall or pillars behind, and one or two balls whose ways lead through the view after ten seconds."""
    rng = np.random.default_rng([seed, 79])
    still: list[Block | Rod] = [Block((3.6, 0.0, 1.2), (0.1, 2.5, 1.6), float(rng.uniform(-0.2, 0.2)))]
    for _ in range(rng.integers(0, 3)):
        x, y = float(rng.uniform(2.4, 3.2)), float(rng.uniform(-1.0, 1.0))
        still.append(Rod((x, y, -0.3), (x, y, 3.2), float(rng.uniform(0.05, 0.15))))
    movers = []
    for number in range(1 + seed % 2):
        speed, side = float(rng.uniform(0.06, 0.15)), 1.0 if rng.uniform() < 0.5 else -1.0
        x, z = float(rng.uniform(1.5, 2.2)) - 0.25 * number, 1.1 + 0.25 * (number - 0.5 * (seed % 2))
        begin = (x, side * (0.7 + speed * float(rng.uniform(10.0, 14.0))), z)
        away = float(rng.uniform(-0.2, 0.2)) * speed
        size = float(rng.uniform(0.25, 0.45))
        movers.append(Mover(kind="sphere", size=size, start=begin, velocity=(away, -side * speed, 0.0)))
    return World(still, tuple(movers))


def run(seed: int) -> Found:
    """Stand and look."""
    world = make_world(seed)
    dive = world.make(open_water(seed, water={"current_sigma": 0.01}))
    settings = BehaviourSettings(travel=None)
    feed = DiveFeed(dive, settings.feed, lost=0.05)
    pilot = Pilot(settings, feed.rig, feed.mount)
    start = dive.vehicle.position.copy()
    passes: list[set[int]] = [set() for _ in world.movers]
    first: dict[int, float] = {}
    tracks: dict[int, tuple[int, int | None]] = {}  # number: most passes, the ball that it is
    got: dict[tuple[int, bool], float] = {}
    for n in range(1, round(END / PERIOD) + 1):
        now = n * PERIOD
        seen = feed.until(START_NS + round(now * 1e9))
        pilot.decide(seen)
        for profile in seen.profiles:
            for one in shown(dive, world.movers, profile):
                passes[one].add(profile.sweep)
                first.setdefault(one, (profile.stamp_ns - START_NS) * 1e-9)
        for track in pilot.movers.now():
            ball = _which(world, track.at(seen.now_ns) + start, now)
            most, was = tracks.get(track.number, (0, None))
            tracks[track.number] = (max(most, track.passes), was if was is not None else ball)
            if ball is not None:
                got.setdefault((ball, False), now)
                if track.passes > 1:
                    got.setdefault((ball, True), now)
        dive_heave = float(np.clip(0.5 * (start[2] - dive.vehicle.position[2]), -0.1, 0.1))
        yaw = float(np.clip(-0.6 * dive.vehicle.attitude.as_euler("ZYX")[0], -0.2, 0.2))
        dive.step(Command(0.5 * float(start[0] - dive.vehicle.position[0]), dive_heave, yaw, 0.0), PERIOD)
    return _judge(seed, passes, first, tracks, got)


def _which(world: World, centre: Floats, now: float) -> int | None:
    off = [np.linalg.norm(centre - mover_centre(one, now)) - one.size / 2 for one in world.movers]
    return int(np.argmin(off)) if off and min(off) < OFF else None


def _judge(
    seed: int,
    passes: list[set[int]],
    first: dict[int, float],
    tracks: dict[int, tuple[int, int | None]],
    got: dict[tuple[int, bool], float],
) -> Found:
    seen = [one for one, sweeps in enumerate(passes) if len(sweeps) >= 2]
    moving = [was for most, was in tracks.values() if most > 1]
    return Found(
        seed,
        len(seen),
        sum((one, False) in got for one in seen),
        len(tracks),
        sum(was is not None for _, was in tracks.values()),
        sum((one, True) in got for one in seen),
        len(moving),
        sum(was is not None for was in moving),
        [got[one, False] - first[one] for one in seen if (one, False) in got],
        [got[one, True] - first[one] for one in seen if (one, True) in got],
    )
