"""Clocks that differ: found from what the sweeps see twice, set right, and named; clocks that agree are left alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from rigs import WINDOW, make_rig
from scanned_floor import MOUNTS, SWEEP, Dive, dive, floor_error, register_dive, seconds, true_trajectory
from scipy.spatial.transform import Rotation
from synthetic_navigation import BEGIN_NS

from garbi_map.log.records import Encoder, Mount
from garbi_map.navigate import NavigateSettings, navigate
from garbi_map.outputs import drift_notes
from garbi_map.register.agreement import Agreement
from garbi_map.register.constants import Constant, Constants, Learnt, learnt
from garbi_map.register.drift import Round, estimate_drift
from garbi_map.register.motion import Motion
from garbi_map.register.scanner import Scanner
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import DriftSettings
from garbi_map.register.timing import Offset, judged, restamped
from garbi_map.register.windows import load_scans
from garbi_map.sweep import LaserAngle, SweepSettings
from garbi_map.sweep.retime import retimed
from garbi_map.sweep.types import Sweep

RATE = np.deg2rad(20.0)
"""rad/s of the floor scanner's laser."""


@dataclass(frozen=True)
class FloorScanner:
    """The scanner of `scanned_floor`: its angle turns the rays about the rig's y axis."""

    def constants(self) -> list[Constant]:
        return [Constant("encoder_latency", 0.025, "s", patient=True)]

    def changes(self, points: np.ndarray, stamp_ns: np.ndarray) -> dict[str, np.ndarray]:
        turn = Rotation.from_quat(MOUNTS["rig"].quaternion)
        seen = turn.inv().apply(points - MOUNTS["rig"].translation)
        way = RATE * (-1.0) ** np.floor(seconds(stamp_ns) / SWEEP)
        return {"encoder_latency": turn.apply(way[:, None] * self.by_angle(seen))}

    def by_angle(self, seen: np.ndarray) -> np.ndarray:
        x, y, z = seen.T
        flat = np.hypot(y, z)
        return np.stack([flat, -x * y / flat, -x * z / flat], axis=1)

    def retimed(self, sweep: Sweep, latency: float) -> Sweep:
        """Points at the angle that the laser has `latency` later."""
        way = RATE * (-1.0) ** np.floor(seconds(sweep.stamp_ns) / SWEEP)
        angle = (np.arctan2(sweep.points[:, 0], np.hypot(*sweep.points.T[1:])) + latency * way[sweep.profile])[:, None]
        across = sweep.points * [0, 1, 1] / np.hypot(*sweep.points.T[1:])[:, None]
        length = np.linalg.norm(sweep.points, axis=1, keepdims=True)
        return replace(sweep, points=length * (np.sin(angle) * [1, 0, 0] + np.cos(angle) * across))


def shifted(one: Dive, sensor: str, late: float) -> Dive:
    record = getattr(one.log, sensor)
    record = replace(record, stamp_ns=record.stamp_ns + round(late * 1e9))
    return replace(one, log=replace(one.log, **{sensor: record}))


@pytest.fixture
def one(tmp_path) -> Dive:
    return dive(tmp_path, 16.0)


def test_clocks_that_agree_are_left_alone(one):
    """Nothing is applied to a dive whose clocks are right, and every clock is told of."""
    registered, _ = register_dive(one, scanner=FloorScanner())
    assert {offset.name for offset in registered.clocks} == {
        "imu_clock", "dvl_clock", "pressure_clock", "encoder_latency",
    }  # fmt: skip
    assert all(offset.state != "applied" for offset in registered.clocks)
    assert all(abs(offset.value) < 4 * offset.sigma for offset in registered.clocks)


def test_clocks_wait_until_the_motion_is_known(one):
    """The first rounds, whose matches are decimetres apart, leave the clocks alone; the last ones may move them."""
    navigated = navigate(one.log, NavigateSettings(), one.store.stamps())
    known = (navigated.trajectory, navigated.inertial, navigated.attitude, NavigateSettings())
    sensors = Sensors(shifted(one, "imu", 0.02).log, *known, int(one.store.stamps()[0]), FloorScanner(), clocks=True)
    settings = DriftSettings()
    scans = load_scans(one.store, one.log.mount("rig"), sensors, 0.0, 16.0, 100_000)
    knots = settings.position_knots, sensors.attitude_knots(settings)
    motion = Motion(0.0, 16.0, sensors.prior_attitude, *knots, sensors.constants())
    factors = sensors.factors(0.0, 16.0, settings, np.zeros(3))
    clocks: list[np.ndarray] = []

    def note(_: Round) -> None:
        clocks.append(motion.constants.value[motion.constants.patient].copy())

    estimate_drift(scans, motion, factors, settings, near_only=True, progress=note)
    moved = np.abs(clocks).max(axis=1)
    assert motion.constants.patient.size == 4
    assert moved[:5].max() < 2e-4
    assert moved[-1] > 5e-3


@pytest.mark.parametrize(("sensor", "late"), [("imu", 0.05), ("dvl", -0.05)])
def test_a_clock_fifty_milliseconds_off_is_found_and_set_right(one, sensor, late):
    """Within five of its sigmas; the map is as good as with the true poses but for three tenths; one line names it."""
    registered, _ = register_dive(shifted(one, sensor, late))
    offset = next(offset for offset in registered.clocks if offset.name == f"{sensor}_clock")
    assert offset.state == "applied"
    assert abs(offset.value - late) < 5 * offset.sigma < 0.05
    assert f"{sensor.upper()}'s stamps are" in str(offset) and ("late" if late > 0 else "early") in str(offset)
    assert floor_error(one, registered.trajectory) < 1.3 * floor_error(one, true_trajectory(one.store.stamps()))


def test_an_encoder_fifteen_milliseconds_late_is_found_and_the_sweeps_are_set_right(one):
    """To half a millisecond; the stored points come back to where they were to 0.2 mm, and the store says so."""
    scanner = FloorScanner()
    right = one.store.load(3).points
    one.store.retime(lambda sweep: scanner.retimed(sweep, -0.015), 0.0)
    assert np.abs(one.store.load(3).points - right).max() > 5e-3
    registered, _ = register_dive(one, scanner=scanner)
    offset = next(offset for offset in registered.clocks if offset.name == "encoder_latency")
    assert offset.state == "applied"
    assert offset.value == pytest.approx(0.015, abs=5e-4)
    assert one.store.latency == offset.value or one.store.latency == pytest.approx(offset.value, abs=5e-4)
    assert np.abs(one.store.load(3).points - right).max() < 5e-4
    assert floor_error(one, registered.trajectory) < 1.3 * floor_error(one, true_trajectory(one.store.stamps()))


def told(value: float, sigma: float) -> dict[str, Learnt]:
    return {"dvl_clock": Learnt(np.array([value]), np.array([sigma]), 0.025, "s")}


def test_only_what_is_sure_and_matters_is_applied():
    """Five sigmas and half a millisecond; a dive that does not tell says so; what is applied stays."""
    assert judged(told(0.02, 1e-3), {})[0].state == "applied"
    assert judged(told(0.004, 1e-3), {})[0].state == "kept"
    assert judged(told(2e-4, 1e-6), {})[0].state == "kept"
    assert judged(told(0.004, 0.02), {})[0].state == "unseen"
    again = judged(told(1e-4, 1e-3), {"dvl_clock": 0.02})[0]
    assert (again.value, again.state) == (0.02, "applied")
    more = judged(told(0.01, 1e-3), {"dvl_clock": 0.02})[0]
    assert more.value == pytest.approx(0.03)


def test_stamps_are_moved_back_by_what_was_found(one):
    """A sensor that is late comes earlier; the others stay."""
    moved = restamped(one.log, judged(told(0.02, 1e-3), {}))
    assert (one.log.dvl.stamp_ns - moved.dvl.stamp_ns == 20_000_000).all()
    assert moved.imu is one.log.imu and moved.pressure is one.log.pressure


def test_windows_are_averaged_by_what_they_know():
    """Two windows, one four times as sure."""
    declared = [Constant("a", 1.0, "m", 2), Constant("b", 1.0, "s")]
    windows = []
    for value, sigma in ((1.0, 0.1), (2.0, 0.2)):
        constants = Constants(declared)
        constants.value[:] = value
        windows.append((constants, np.eye(3) * sigma**2))
    found = learnt(windows)
    assert found["a"].value == pytest.approx([1.2, 1.2])
    assert found["b"].sigma == pytest.approx([1 / np.sqrt(125)])
    assert (found["a"].unit, found["b"].unit) == ("m", "s")


def test_a_constant_that_is_not_declared_is_zero():
    """Factors may ask for whatever they know of."""
    constants = Constants([Constant("dvl_scale", 0.02, "1")])
    constants.value[:] = 0.01
    assert (constants.number("dvl_scale"), constants.number("imu_clock")) == (0.01, 0.0)
    assert not constants.vector("gyro_bias").any() and "gyro_bias" not in constants


def scanned(port: bool) -> tuple[Scanner, Sweep, LaserAngle]:
    """A sweep of a real rig on a wall that is not flat, and an encoder that moves unevenly."""
    rig = make_rig(WINDOW if port else None)
    time = np.arange(0.0, 4.0, 0.01)
    encoder = Encoder(BEGIN_NS + np.round(time * 1e9).astype(np.int64), np.zeros(400, np.int64), 0.3 * np.sin(time))
    angle = LaserAngle(encoder, SweepSettings())
    stamps = BEGIN_NS + np.round(np.arange(0.3, 1.3, 0.1) * 1e9).astype(np.int64)
    alpha, _ = angle.at(stamps)
    row, profile = np.tile(np.arange(40, 540, 25, dtype=np.int32), 10), np.repeat(np.arange(10, dtype=np.int32), 20)
    first, last = rig.column_window(float(alpha[0]), 1.2, 2.0)
    u = 0.5 * (first + last)[row] - 18.0 * profile + 5.0 * np.sin(row / 90.0)
    points = rig.triangulate(u, row, alpha[profile]).points
    n = len(points)
    sweep = Sweep(0, stamps, alpha, points, np.full(n, 1e-3, np.float32), np.ones(n, np.float32), profile, row)
    return Scanner(rig, angle, Mount(np.array([0.3, 0.0, 0.1]), Rotation.from_euler("y", 0.4).as_quat())), sweep, angle


@pytest.mark.parametrize("port", [False, True])
def test_points_come_back_when_the_encoder_is_set_right(port):
    """Triangulated with angles 15 ms early and then 15 ms late: to a micrometre, a port's refraction included."""
    scanner, sweep, angle = scanned(port)
    assert np.isfinite(sweep.points).all()
    wrong = retimed(sweep, scanner.rig, angle, -0.015)
    assert np.abs(wrong.points - sweep.points).max() > 1e-3
    again = retimed(wrong, scanner.rig, angle, 0.0)
    assert again.points == pytest.approx(sweep.points, abs=1e-6)
    assert again.alpha == pytest.approx(sweep.alpha, abs=1e-12)


@pytest.mark.parametrize("port", [False, True])
def test_the_scanner_knows_how_a_latency_moves_its_points(port):
    """The change of a unit is the difference of two triangulations."""
    scanner, sweep, angle = scanned(port)
    turn, at, h = Rotation.from_quat(scanner.mount.quaternion), scanner.mount.translation, 2e-3
    before, after = (retimed(sweep, scanner.rig, angle, side).points for side in (-h, h))
    expected = turn.apply((after - before) / (2 * h))
    found = scanner.changes(turn.apply(sweep.points) + at, sweep.point_stamp_ns)["encoder_latency"]
    assert np.abs(expected).max() > 0.1
    assert found == pytest.approx(expected, abs=0.02 * np.abs(expected).max())


def test_only_what_matters_is_told_of_the_drift_estimate():
    """A tenth of a millisecond is corrected in silence, twenty are named, and so are sweeps that do not come together."""

    def told_of(latency: float, apart: float) -> list[str]:
        pair = np.full(3, apart, np.float32)
        agreement = Agreement(np.zeros((3, 2), np.float32), pair, pair, (0.0, 0.0))
        clocks = [Offset("encoder_latency", latency, 1e-5, "applied")]
        return drift_notes(SimpleNamespace(clocks=clocks, agreement=agreement, rig_notes=[]))  # type: ignore[arg-type]

    assert told_of(1e-4, 2e-4) == []
    assert told_of(1e-4, float("nan")) == []
    assert told_of(0.02, 2e-4)[0].startswith("the encoder's stamps are 20.00")
    assert "3.0 mm apart" in told_of(1e-4, 3e-3)[0]
