"""Station on a wall, a pipe, a rock, in current and waves; and a step of half a metre."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings, HoldSettings, SpaceSettings
from behaviours.stabilisation import Stabilisation
from garbi_map.log.records import Floats
from tools.simulator import shapes
from tools.simulator.dive import Dive
from tools.simulator.seabed import Scene
from tools.simulator.sensors import START_NS
from tools.simulator.shapes import Mesh
from tools.trials.feed import DiveFeed
from tools.trials.scenario import open_water
from tools.trials.world import Block, Rod, World

Thing = Literal["wall", "pipe", "rock"]
Way = Literal["along", "across"]
EYE = np.array([0.45, 0.0, 0.0])
CURRENT = 0.1  # m/s
PERIOD, SETTLE, STEP_AT, END = 0.1, 20.0, 50.0, 75.0


@dataclass(frozen=True)
class Held:
    """What became of a trial.

    range_mm, yaw_deg, pitch_deg  rms errors after settling, where the object fixes them (NaN elsewhere); across the current
                                  while a target is held
    settle_s, overshoot_mm        of the step: s until the mean over a wave stays within 5 cm, and by how much it passed
    target                        share of the time after settling with a target; takes: how often an object was taken
    drift                         share of the time in which it was said that the vehicle drifts abeam
    """

    thing: str
    seed: int
    current: str
    range_mm: float
    yaw_deg: float
    pitch_deg: float
    settle_s: float
    overshoot_mm: float
    target: float
    takes: int
    drift: float

    def as_dict(self) -> dict[str, object]:
        """Plain."""
        return asdict(self)


class _Rock(World):
    """A boulder half in the ground."""

    mesh: Mesh

    def make(self, scenario: Any) -> Dive:
        dive = super().make(scenario)
        rock = shapes.stone(0.9, np.random.default_rng([scenario.seed, 5]))
        self.mesh = shapes.moved(rock, np.array([2.9, 0.0, 0.9]), Rotation.from_euler("y", 0.3))
        dive.scene = Scene(shapes.merged([dive.scene.mesh, self.mesh]), dive.scene.texture)
        return dive


def world_of(thing: Thing) -> World:
    """The object about 1.75 m before the rig."""
    if thing == "wall":
        return World([Block((2.3, 0.0, 1.2), (0.1, 5.0, 1.6), 0.15)])
    if thing == "pipe":
        return World([Rod((2.35, -5.0, 1.05), (2.35, 5.0, 1.15), 0.15, "pipe")])
    return _Rock()


def run(thing: Thing, seed: int, way: Way = "along", end: float = END) -> Held:
    """Hold at 1.5 m for `end` s; after 50 s at 2 m. Current of 0.1 m/s along or across the view, waves of 5 cm and 4 s."""
    world = world_of(thing)
    scenario = open_water(
        seed,
        water={"current": (-CURRENT, 0.0) if way == "along" else (0.0, -CURRENT)},
        sway={"translation": 0.05 / np.sqrt(2), "rotation": 0.005, "period": 4.0},
    )
    dive = world.make(scenario)
    target: Literal["plane", "cylinder", "patch"] = {"wall": "plane", "pipe": "cylinder", "rock": "patch"}[thing]  # type: ignore[assignment]
    # Across the current it drifts into water that a forward view never showed, in which safety forbids every correction:
    # the operator's word has to do. Without it range rms is 30 to 154 mm.
    word = SpaceSettings() if way == "along" else SpaceSettings(launch_clearance=5.0)
    settings = BehaviourSettings(travel=None, hold=HoldSettings(target=target), space=word)
    feed = DiveFeed(dive, settings.feed)
    pilot = Pilot(settings, feed.rig, feed.mount)
    holding = next(one for one in pilot.behaviours if isinstance(one, Stabilisation))
    rows, drifts = [], []
    now = 0.0
    while now < (end if way == "along" else STEP_AT):  # across it the vehicle would be past the wall's end
        now += PERIOD
        holding.wanted = 1.5 if now < STEP_AT else 2.0
        decision = pilot.decide(feed.until(START_NS + round(now * 1e9)))
        feed.step(decision.command, PERIOD)
        hold = decision.proposal("hold")
        drifts.append(hold is not None and "drifting" in hold.reason)
        true = _truth(thing, world, dive)
        rows.append([now, *true, hold.facts.get("target", 0.0) if hold else 0.0])
    return _judge(thing, seed, way, np.array(rows), holding.target.takes, float(np.mean(drifts)))


def _truth(thing: Thing, world: World, dive: Dive) -> tuple[float, float, float]:
    """True range m of the rig along the view, yaw and pitch rad off the object's normal."""
    rotation = dive.vehicle.attitude
    eye = dive.vehicle.position + rotation.apply(EYE)
    view = rotation.apply([1.0, 0.0, 0.0])
    if thing == "rock":
        across, up = rotation.apply([0.0, 1.0, 0.0]), rotation.apply([0.0, 0.0, 1.0])
        aside = np.linspace(-0.3, 0.3, 9)
        rays = np.array([view + a * across / 1.5 + b * up / 1.5 for a in aside for b in aside])
        length = np.linalg.norm(rays, axis=1, keepdims=True)
        reach, _ = dive.scene.cast(np.broadcast_to(eye, rays.shape).copy(), rays / length, dive.vehicle.time)
        met = np.isfinite(reach)
        points = rays[met] / length[met] * reach[met, None]
        return float(np.median(points @ view)), np.nan, np.nan
    if thing == "wall":
        block = world.still[0]
        assert isinstance(block, Block)
        facing = Rotation.from_euler("z", block.heading).apply([1.0, 0.0, 0.0])
        surface = np.array(block.centre) - facing * block.half[0]
        towards = rotation.inv().apply(facing)
        yaw, pitch = np.arctan2(towards[1], towards[0]), np.arctan2(towards[2], np.hypot(towards[0], towards[1]))
        return float((surface - eye) @ facing / (view @ facing)), float(yaw), float(pitch)
    rod = world.still[0]
    assert isinstance(rod, Rod)
    foot, head = np.array(rod.foot), np.array(rod.head)
    axis = (head - foot) / np.linalg.norm(head - foot)
    away: Floats = foot - eye - ((foot - eye) @ axis) * axis
    towards = rotation.inv().apply(away)
    return float(np.linalg.norm(away)) - rod.radius, float(np.arctan2(towards[1], towards[0])), np.nan


def _judge(thing: Thing, seed: int, way: Way, rows: Floats, takes: int, drift: float) -> Held:
    time, distance, yaw, pitch, target = rows.T
    steady = (time > SETTLE) & (time < STEP_AT) & ((target > 0.5) | (way == "along"))
    after = time >= STEP_AT
    waves = round(4.0 / PERIOD)  # the step is judged on the mean over a wave, which the range rms has in it
    settle = overshoot = float("nan")
    if after.sum() > waves:
        smooth = np.convolve(distance, np.ones(waves) / waves, "same")[after][: -waves // 2]
        off = np.abs(smooth - 2.0) > 0.05
        settle = float(time[after][: -waves // 2][off][-1] - STEP_AT) if off.any() else 0.0
        overshoot = 1e3 * float(max(smooth.max() - 2.0, 0.0))
    return Held(
        thing,
        seed,
        way,
        1e3 * _rms(distance[steady] - 1.5),
        float(np.degrees(_rms(yaw[steady]))),
        float(np.degrees(_rms(pitch[steady]))),
        settle,
        overshoot,
        float(target[time > SETTLE].mean()),
        takes,
        drift,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
