"""Sensors that fail under the drift estimate: silent, lying, or simply not there. The map hardly notices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scanned_floor import Dive, dive, floor_error, register_dive, rotation, seconds, true_trajectory

from garbi_map.log.records import Imu
from garbi_map.navigate import NavigateSettings, navigate
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import DriftSettings


@pytest.fixture
def one(tmp_path) -> Dive:
    return dive(tmp_path, 16.0)


def with_imu(one: Dive, keep: np.ndarray) -> Dive:
    record = Imu(**{name: column[keep] for name, column in vars(one.log.imu).items()})
    return replace(one, log=replace(one.log, imu=record))


def sensors_of(one: Dive) -> Sensors:
    navigated = navigate(one.log, NavigateSettings(), one.store.stamps())
    first = int(one.store.stamps()[0])
    return Sensors(
        one.log, navigated.trajectory, navigated.inertial, navigated.attitude, NavigateSettings(), first, clocks=True
    )


def locked_to_the_water(one: Dive) -> Dive:
    """Three seconds in which the DVL measures the current."""
    t, velocity = seconds(one.log.dvl.stamp_ns), one.log.dvl.velocity
    flow = np.where(((t > 6.0) & (t < 9.0))[:, None], [0.2, 0.2, 0.05], 0.0)
    return replace(one, log=replace(one.log, dvl=replace(one.log.dvl, velocity=velocity + flow)))


def test_a_dvl_that_takes_the_water_for_the_bottom_is_not_believed(one):
    """Its pings then are no factor's; the map is as good as with the true poses but for three tenths; a line tells."""
    wrong = locked_to_the_water(one)
    track = sensors_of(wrong)._bottom_track(0.0, 16.0)
    off = wrong.log.dvl.stamp_ns[(np.abs(wrong.log.dvl.velocity - one.log.dvl.velocity) > 0.1).any(axis=1)]
    told = track.time * 1e9 + wrong.store.stamps()[0]
    assert np.abs(told[:, None] - off).min() > 1e6
    assert len(told) > 0.9 * (len(wrong.log.dvl.stamp_ns) - len(off))
    registered, navigated = register_dive(wrong)
    assert floor_error(one, registered.trajectory) < 1.3 * floor_error(one, true_trajectory(one.store.stamps()))
    assert any("DVL" in note and "outliers" in note for note in navigated.report["notes"])


def test_a_silent_gyro_gets_finer_knots(one):
    """With it the attitude's knots are the settings'; two seconds without it they are about the position's."""
    settings, t = DriftSettings(), seconds(one.log.imu.stamp_ns)
    assert sensors_of(one).attitude_knots(settings) == settings.attitude_knots
    silent = with_imu(one, (t < 7.0) | (t > 9.0))
    assert sensors_of(silent).attitude_knots(settings) == 2 * settings.position_knots


def test_two_seconds_without_an_imu_are_bridged_and_named(one):
    """The sweeps carry on; no clock is blamed for it; one line says how long."""
    t = seconds(one.log.imu.stamp_ns)
    registered, navigated = register_dive(with_imu(one, (t < 7.0) | (t > 9.0)))
    assert floor_error(one, registered.trajectory) < 1.5 * floor_error(one, true_trajectory(one.store.stamps()))
    assert not [offset for offset in registered.clocks if offset.state == "applied"]
    assert "IMU: silent 1 time, 2.0 s in all" in navigated.report["notes"]


def test_a_pause_of_the_dvl_or_of_the_pressure_is_named(one):
    """In the middle of the dive, where nothing begins late or stops early."""
    for name, called in (("dvl", "DVL"), ("pressure", "pressure")):
        record = getattr(one.log, name)
        t = seconds(record.stamp_ns)
        keep = (t < 5.0) | (t > 9.0)
        cut = type(record)(**{column: value[keep] for column, value in vars(record).items()})
        notes = navigate(replace(one.log, **{name: cut})).report["notes"]
        assert sum(note.startswith(f"{called}: silent 1 time, 4.") for note in notes) == 1


def test_without_a_gyro_the_levers_turn_with_the_motion(one):
    """A DVL's lever counts by the rates of the motion that is estimated, not by zeros."""
    bare = replace(one, log=replace(one.log, imu=None))
    track = sensors_of(bare)._bottom_track(0.0, 16.0)
    from garbi_map.register.motion import Motion, PriorAttitude

    t = np.linspace(0.0, 16.0, 801)
    at = (one.store.stamps()[0] - one.log.imu.stamp_ns[0]) * 1e-9
    motion = Motion(0.0, 16.0, PriorAttitude(np.array([0.0]), np.array([[0.0, 0.0, 0.0, 1.0]])), 0.2, 0.4)
    motion.fit(t, true_trajectory(one.store.stamps()[:1]).position + 0.0 * t[:, None], rotation(t + at))
    swing = np.cross(motion.rate(track.time), track.lever)
    assert np.linalg.norm(swing, axis=1).max() > 5e-3
    assert track._predicted(motion, track.time) == pytest.approx(swing, abs=2e-3)
