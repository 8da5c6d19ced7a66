"""A vehicle of four propellers for surge, heave, yaw and pitch; sway and roll are what the water does.

No coefficients of GARBI are published: the ones here are assumed from its size (1.3 x 0.9 x 0.7 m, 150 kg). Those of a
BlueROV2 Heavy are von Benzon et al., An Open-Source Benchmark Simulator: Control of a BlueROV2 Underwater Robot, Journal of
Marine Science and Engineering, 2022; damping opposes motion here, whereas with the signs as printed the model diverges. Its
eight thrusters are taken as two pairs, and its sway thrust is not used.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Floats
from tools.simulator.hydrodynamics import HISTORY, STATE, advance
from tools.simulator.motion import Motion
from tools.simulator.scenario import Scenario

STEP = 0.005  # s, of the integration
CURRENT_TIME = 20.0  # s, correlation of the slow current


@dataclass(frozen=True)
class Command:
    """Velocities asked for, of base_link over ground: surge, heave m/s, yaw, pitch rad/s (body axes)."""

    surge: float = 0.0
    heave: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0


@dataclass(frozen=True)
class Coefficients:
    """Surge, sway, heave, roll, pitch, yaw. SI units."""

    mass: Floats = field(default_factory=lambda: np.array([210.0, 270.0, 300.0, 24.0, 42.0, 51.0]))  # with added mass
    linear: Floats = field(default_factory=lambda: np.array([25.0, 40.0, 50.0, 40.0, 45.0, 30.0]))
    quadratic: Floats = field(default_factory=lambda: np.array([260.0, 420.0, 600.0, 30.0, 40.0, 40.0]))
    restoring: float = 75.0  # N m/rad, roll and pitch
    arms: Floats = field(default_factory=lambda: np.array([0.35, 0.45]))  # m, horizontal and vertical pair
    gains: Floats = field(  # 1/s, 1/s^2: of the velocity loops in surge, heave, yaw, pitch
        default_factory=lambda: np.array([[2.0, 2.0, 2.0, 5.0], [0.5, 0.5, 0.5, 4.0]])
    )
    limit: float = 60.0  # N, per propeller
    lag: float = 0.15  # s, of the propellers


RIGID = np.array([13.5, 13.5, 13.5, 0.26, 0.23, 0.37])  # kg, kg m^2
ADDED = np.array([6.36, 7.12, 18.68, 0.189, 0.135, 0.222])
MODELS = {
    "garbi": Coefficients(),
    "bluerov2": Coefficients(
        mass=RIGID + ADDED,
        linear=np.array([13.7, 0.0, 33.0, 0.0, 0.8, 0.0]),
        quadratic=np.array([141.0, 217.0, 190.0, 1.19, 0.47, 1.5]),
        restoring=5.0,  # assumed, as are arms, thrust and loops
        arms=np.array([0.17, 0.12]),
        gains=np.array([[6.0, 6.0, 6.0, 8.0], [6.0, 6.0, 4.0, 8.0]]),
        limit=40.0,
        lag=0.1,
    ),
}


class Vehicle:
    """The vehicle in its water: `step(command)` moves it on; `motion` remembers where it was."""

    def __init__(self, scenario: Scenario, position: Floats, heading: float, model: Coefficients | None = None) -> None:
        """At position (3,) m, map, with a heading (rad), moving with the water."""
        model = model or MODELS[scenario.vehicle]
        self._rng = np.random.default_rng([scenario.seed, 2])
        amplitude, omega, phase = _sea(scenario, model, self._rng)
        self._model = (
            model.mass, model.linear, model.quadratic, model.restoring, model.arms, model.gains,
            model.limit, model.lag, amplitude, omega, phase,
        )  # fmt: skip
        self._mean = np.array([*scenario.water.current, 0.0])
        self._sigma = scenario.water.current_sigma
        self._eddy = self._rng.normal(0, self._sigma, 3) * [1, 1, 0.3] if self._sigma else np.zeros(3)
        self._state = np.zeros(STATE)
        self._state[:3] = position
        self._state[3:7] = Rotation.from_euler("z", heading).as_quat()
        water = self._mean + (amplitude[:3] * omega * np.cos(phase[:3])).sum(1)
        self._state[7:10] = Rotation.from_euler("z", heading).inv().apply(water)
        self._steps = 0
        self._history = np.empty((1024, HISTORY))
        self.step(Command(), STEP)

    @property
    def time(self) -> float:
        """s since the start, of the newest remembered state."""
        return (self._steps - 1) * STEP

    @property
    def position(self) -> Floats:
        """(3,) m of base_link in map, now."""
        return self._history[self._steps - 1, 1:4]

    @property
    def velocity(self) -> Floats:
        """(3,) m/s of base_link in map, now."""
        return self._history[self._steps - 1, 8:11]

    @property
    def attitude(self) -> Rotation:
        """map <- base_link, now."""
        return Rotation.from_quat(self._history[self._steps - 1, 4:8])

    @property
    def motion(self) -> Motion:
        """Everything up to now."""
        return Motion(self._history[: self._steps])

    def step(self, command: Command, dt: float) -> None:
        """Hold the command for dt (s, rounded to whole integration steps)."""
        count = max(1, round(dt / STEP))
        while self._steps + count > len(self._history):
            self._history = np.concatenate([self._history, np.empty_like(self._history)])
        asked = np.array([command.surge, command.heave, command.yaw, command.pitch])
        currents = np.stack([self._mean + self._next_eddy() for _ in range(count)])
        self._state, rows = advance(self._state, self._steps, STEP, currents, asked, *self._model)
        self._history[self._steps : self._steps + count] = rows
        self._steps += count

    def _next_eddy(self) -> Floats:
        """The slow current's variation one step on: exact discretisation of the Ornstein-Uhlenbeck process."""
        if self._sigma:
            decay = np.exp(-STEP / CURRENT_TIME)
            kick = self._sigma * np.sqrt(1 - decay**2) * self._rng.normal(size=3) * [1, 1, 0.3]
            self._eddy = decay * self._eddy + kick
        return self._eddy


def _sea(scenario: Scenario, model: Coefficients, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Sines of the waves: amplitude (6, k) (translation m, moment N m), angular frequency (k,), phase (6, k)."""
    sway = scenario.sway
    period = sway.period * np.array([1.0, 0.81, 0.63, 0.46, 0.33]) * rng.uniform(0.95, 1.05, 5)
    share = (period / period[0]) ** 2
    share *= np.sqrt(2) / np.linalg.norm(share)
    size = np.array([
        sway.translation, sway.translation, 0.5 * sway.translation,
        model.restoring * sway.rotation, model.restoring * sway.rotation, 0.5 * model.linear[5] * sway.rotation,
    ])  # fmt: skip
    return size[:, None] * share, 2 * np.pi / period, rng.uniform(0, 2 * np.pi, (6, 5))
