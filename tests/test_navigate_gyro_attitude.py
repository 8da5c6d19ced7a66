"""The attitude of the gyro alone, with its bias removed by the trend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_navigation import Errors, build, rotation, seconds, typical_errors

from garbi_map.log.records import Navigation
from garbi_map.navigate import GyroAttitude, NavigateSettings, gyro_attitude, prepare_inertial

SETTINGS = NavigateSettings()
BIAS = np.array([2e-3, -1.5e-3, 1e-3])


def error(found: GyroAttitude | None) -> np.ndarray:
    """Rotation error (n, 3) rad, map axes."""
    assert found is not None
    return (rotation(seconds(found.stamp_ns)) * Rotation.from_quat(found.quaternion).inv()).as_rotvec()


def without_attitude(log: Navigation) -> Navigation:
    return replace(log, imu=replace(log.imu, attitude=np.full_like(log.imu.attitude, np.nan)))


def test_a_constant_bias_is_removed_exactly() -> None:
    """Perfect topic, biased gyro: the bias to a microradian per second, the attitude to a tenth of a milliradian."""
    log = build(30.0, Errors(gyro_bias=BIAS))
    log = replace(log, imu=replace(log.imu, specific_force=np.full_like(log.imu.rate, np.nan)))
    found = gyro_attitude(log, NavigateSettings(gyro_bias=0.1))
    assert found is not None
    assert found.reference == "attitude topic"
    assert np.abs(found.bias - BIAS).max() < 2e-5
    assert np.abs(error(found)).max() < 2e-4


def test_the_error_is_slow_and_within_its_sigma() -> None:
    """A noisy topic: what is left is a rotation and a slope, not noise, and four of the stated sigmas contain it."""
    for seed in range(4):
        found = gyro_attitude(build(30.0, typical_errors(seed), seed), SETTINGS)
        left = error(found)
        assert found is not None
        assert (np.abs(left) < 4.0 * found.sigma).all()
        t = seconds(found.stamp_ns)
        line = np.stack([np.polyval(np.polyfit(t, column, 1), t) for column in left.T], axis=1)
        assert np.abs(left - line).max() < 2e-3


def test_a_long_dive_with_a_strong_bias_does_not_wrap_around() -> None:
    """Ten minutes at 0.6 degrees per second of drift: six turns, and still the right one."""
    errors = replace(typical_errors(3), gyro_bias=np.array([0.0, 0.0, 0.01]))
    found = gyro_attitude(build(600.0, errors, 3, imu_rate=25.0), SETTINGS)
    assert found is not None
    assert abs(found.bias[2] - 0.01) < 3e-4
    assert not found.disturbed.any()
    assert np.abs(error(found)[:, 2]).max() < 0.1


def test_gravity_levels_where_there_is_no_topic() -> None:
    """No attitude topic: roll and pitch from the mean of the specific force, yaw zero at the start."""
    found = gyro_attitude(without_attitude(build(30.0, typical_errors(1), 1)), SETTINGS)
    assert found is not None
    assert found.reference == "gravity"
    true = rotation(seconds(found.stamp_ns)).as_euler("ZYX")
    made = Rotation.from_quat(found.quaternion).as_euler("ZYX")
    assert np.abs(made[:, 1:] - true[:, 1:]).max() < 0.02
    assert abs(made[0, 0]) < 0.01
    assert found.bias_sigma[2] > 4.0 * found.bias_sigma[0]


def test_a_gyro_alone_starts_level() -> None:
    """Neither topic nor accelerometer: it says so, and its sigma grows."""
    log = without_attitude(build(20.0))
    found = gyro_attitude(
        replace(log, imu=replace(log.imu, specific_force=np.full_like(log.imu.rate, np.nan))), SETTINGS
    )
    assert found is not None
    assert found.reference == "none"
    assert found.sigma[-1, 2] > found.sigma[0, 2] + 0.05


def test_without_gyro_there_is_none() -> None:
    """No IMU, no rates: None, not a guess."""
    log = build(5.0)
    assert gyro_attitude(replace(log, imu=None), SETTINGS) is None
    assert gyro_attitude(replace(log, imu=replace(log.imu, rate=np.full_like(log.imu.rate, np.nan))), SETTINGS) is None


def test_a_disturbed_compass_is_outvoted() -> None:
    """20 degrees for a quarter of the dive: flagged where it is, and without influence."""
    log = build(40.0, typical_errors(2), 2)
    t = seconds(log.imu.stamp_ns)
    twist = np.where((t > 10.0) & (t < 20.0), np.radians(20.0), 0.0)[:, None]
    attitude = (Rotation.from_euler("z", twist) * Rotation.from_quat(log.imu.attitude)).as_quat()
    found = gyro_attitude(replace(log, imu=replace(log.imu, attitude=attitude)), SETTINGS)
    assert found is not None
    assert np.array_equal(found.disturbed, (t > 10.0) & (t < 20.0))
    clean = gyro_attitude(log, SETTINGS)
    assert np.abs(error(found)[:, 2]).max() < np.abs(error(clean)[:, 2]).max() + np.radians(1.0)


def test_the_inertial_series_is_in_base_link_axes() -> None:
    """A turned IMU's rates and forces come out along base_link; gaps and missing samples are flagged."""
    log = build(5.0)
    rate = log.imu.rate.copy()
    rate[100] = np.nan
    series = prepare_inertial(replace(log, imu=replace(log.imu, rate=rate)), SETTINGS)
    assert series is not None
    from synthetic_navigation import body_rate

    assert np.abs(series.rate - body_rate(seconds(series.stamp_ns))).max() < 1e-4
    assert np.flatnonzero(~series.rate_known).tolist() == [99, 100, len(rate) - 1]
    assert np.allclose(series.lever_arm, log.mount("imu_link").translation)


def test_rates_come_from_the_topic_where_there_is_no_gyro() -> None:
    """Differences of a perfect attitude are the body rates."""
    log = build(5.0)
    series = prepare_inertial(replace(log, imu=replace(log.imu, rate=np.full_like(log.imu.rate, np.nan))), SETTINGS)
    assert series is not None
    from synthetic_navigation import body_rate

    assert series.rate_derived
    assert np.abs(series.rate - body_rate(seconds(series.stamp_ns)))[2:-2].max() < 1e-3
