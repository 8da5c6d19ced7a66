"""Sensors that fail: gaps, clipping, outliers, lies and a compass near iron. The map degrades, the report says why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_navigation import build, pose_errors, seconds, stamps, typical_errors

from garbi_map.log.records import Imu, Navigation
from garbi_map.navigate import navigate, prepare_inertial
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.navigate.span import main_span

AT = stamps(30.0, 10.0)


def noisy(seed: int = 11) -> Navigation:
    return build(30.0, typical_errors(seed), seed)


def cut(imu: Imu, keep: np.ndarray) -> Imu:
    return Imu(
        *(
            getattr(imu, name)[keep]
            for name in ("stamp_ns", "arrival_ns", "rate", "specific_force", "attitude", "attitude_covariance")
        )
    )


def worst(log: Navigation) -> float:
    """Largest position error, m."""
    return float(np.linalg.norm(pose_errors(navigate(log).trajectory, AT)[0], axis=1).max())


def test_a_gap_of_seconds_in_the_imu_is_bridged_and_named() -> None:
    """3 s without IMU: the DVL carries on; poses stay dense; the covariance inside is larger than outside."""
    log = noisy()
    t = seconds(log.imu.stamp_ns)
    result = navigate(replace(log, imu=cut(log.imu, (t < 10.0) | (t > 13.0))))
    assert np.linalg.norm(pose_errors(result.trajectory, AT)[0], axis=1).max() < 0.15
    assert np.diff(result.trajectory.stamp_ns).max() <= 20_000_001
    sigma = np.sqrt(np.trace(result.trajectory.covariance[:, 3:, 3:], axis1=1, axis2=2))
    at = seconds(result.trajectory.stamp_ns)
    assert sigma[np.searchsorted(at, 11.5)] > 2.0 * sigma[np.searchsorted(at, 20.0)]
    assert result.report["imu"]["gaps"] == 1
    assert result.report["imu"]["gap_seconds"] == pytest.approx(3.0, abs=0.05)


def test_clipped_rates_are_found_and_left_out() -> None:
    """A gyro at the end of its range is not integrated as if it were right."""
    log = noisy()
    limit = 0.6 * np.abs(log.imu.rate).max()
    clipped = replace(log, imu=replace(log.imu, rate=np.clip(log.imu.rate, -limit, limit)))
    share = (np.abs(log.imu.rate) > limit).any(axis=1).sum()
    series = prepare_inertial(clipped, NavigateSettings())
    assert series is not None
    assert 0 < series.clipped <= share + 10
    assert series.clipped > 0.5 * share
    assert any("end of its range" in note for note in navigate(clipped).report["notes"])


def test_a_clean_series_is_not_called_clipped() -> None:
    """Neither noise nor a noiseless simulation is mistaken for clipping."""
    for log in (noisy(), build(10.0)):
        series = prepare_inertial(log, NavigateSettings())
        assert series is not None
        assert series.clipped == 0


def test_dvl_outliers_are_rejected_and_counted() -> None:
    """One ping in ten is off by up to 2 m/s: the path hardly notices."""
    log = noisy()
    random = np.random.default_rng(1)
    bad = random.random(len(log.dvl.stamp_ns)) < 0.1
    velocity = log.dvl.velocity + bad[:, None] * random.uniform(-2.0, 2.0, (len(bad), 3))
    broken = replace(log, dvl=replace(log.dvl, velocity=velocity))
    assert worst(broken) < worst(log) + 0.03
    report = navigate(broken).report
    assert report["sensors"]["dvl"]["accepted"] <= (~bad).sum() + 3
    assert any("DVL" in note for note in report["notes"])


def test_a_dvl_that_loses_the_bottom_is_bridged_by_the_imu() -> None:
    """5 s of invalid pings cost centimetres, and the pings after them are accepted again."""
    log = noisy()
    t = seconds(log.dvl.stamp_ns)
    velocity = np.where(((t > 12.0) & (t < 17.0))[:, None], np.nan, log.dvl.velocity)
    broken = replace(log, dvl=replace(log.dvl, velocity=velocity))
    assert worst(broken) < 0.15
    assert navigate(broken).report["sensors"]["dvl"]["rejected"] <= 2


@pytest.mark.parametrize("begin", [0.0, 12.0, 20.0])
def test_a_disturbed_compass_is_not_believed(begin: float) -> None:
    """20 degrees of yaw for 8 s, at the start, in the middle or at the end: the gyro wins."""
    log = noisy()
    t = seconds(log.imu.stamp_ns)
    twist = np.where((t >= begin) & (t < begin + 8.0), np.radians(20.0), 0.0)[:, None]
    attitude = Rotation.from_euler("z", twist) * Rotation.from_quat(log.imu.attitude)
    broken = replace(log, imu=replace(log.imu, attitude=attitude.as_quat()))
    result = navigate(broken)
    before = np.abs(pose_errors(navigate(log).trajectory, AT)[1][:, 2]).max()
    assert np.abs(pose_errors(result.trajectory, AT)[1][:, 2]).max() < before + np.radians(1.5)
    assert result.report["imu"]["attitude_disturbed_samples"] > 700
    assert any("yaw" in note for note in result.report["notes"])


def test_a_covariance_that_lies_is_corrected_by_the_innovations() -> None:
    """A DVL that claims 0.4 mm/s but has 20 mm/s is weighted by what it does."""
    errors = replace(typical_errors(2), dvl=0.02)
    log = build(20.0, errors, 2)
    lying = replace(log, dvl=replace(log.dvl, covariance=log.dvl.covariance * 0.02**2))
    report = navigate(lying).report
    assert report["sensors"]["dvl"]["variance_scaled_by"] > 10.0
    assert 0.5 < report["sensors"]["dvl"]["innovation_ratio"] < 2.0


def test_a_jumping_clock_does_not_stretch_the_dive() -> None:
    """A few stamps years away are left out; the others make the dive."""
    log = build(5.0)
    stamp_ns = log.imu.stamp_ns.copy()
    stamp_ns[100:103] = 5
    trajectory = navigate(replace(log, imu=replace(log.imu, stamp_ns=stamp_ns))).trajectory
    assert (trajectory.stamp_ns[-1] - trajectory.stamp_ns[0]) * 1e-9 < 6.0


def test_stamps_out_of_order_and_doubled_are_sorted() -> None:
    """The same samples in another order, some of them twice, give the same trajectory."""
    log = build(5.0)
    order = np.random.default_rng(0).permutation(len(log.imu.stamp_ns))
    order = np.concatenate([order, order[:50]])
    mixed = replace(log, imu=cut(log.imu, order))
    assert np.allclose(navigate(mixed).trajectory.position, navigate(log).trajectory.position, atol=1e-12)


def test_the_longest_populated_stretch_is_the_dive() -> None:
    """Two stamps an hour before the rest are not part of it."""
    dive = np.arange(0, 100) * 1_000_000_000 + 3_600_000_000_000
    assert main_span([np.array([0, 1]), dive], 600.0) == (dive[0], dive[-1])


def test_lone_spikes_are_not_integrated() -> None:
    """An accelerometer that jumps by 200 m/s^2 for single samples, a pressure that jumps by 5 m: nothing is lost."""
    log = noisy()
    hit = (np.arange(len(log.imu.stamp_ns)) % 500 == 250)[:, None]
    wet = np.arange(len(log.pressure.stamp_ns)) % 17 == 0
    broken = replace(
        log,
        imu=replace(log.imu, specific_force=log.imu.specific_force + 200.0 * hit),
        pressure=replace(log.pressure, pressure=log.pressure.pressure + 5e4 * wet),
    )
    assert worst(broken) < worst(log) + 0.01
    assert navigate(broken).report["imu"]["spikes"] == hit.sum()


def test_a_filter_contradicted_for_long_gives_in() -> None:
    """A step of 1 m in the depth, for good: refused for a while, then believed."""
    log = noisy()
    late = seconds(log.pressure.stamp_ns) > 8.0
    stepped = replace(log, pressure=replace(log.pressure, pressure=log.pressure.pressure + late * 1025.0 * 9.80665))
    result = navigate(stepped)
    end = pose_errors(result.trajectory, AT[-1:])[0][0, 2]
    assert end == pytest.approx(1.0, abs=0.02)
    assert result.report["sensors"]["pressure"]["rejected"] > 50


def test_a_few_pings_do_not_let_the_path_run_away() -> None:
    """A DVL that answers for one second of thirty: the slow-vehicle assumption takes over where it is silent."""
    log = noisy()
    early = seconds(log.dvl.stamp_ns) < 1.0
    velocity = np.where(early[:, None], log.dvl.velocity, np.nan)
    result = navigate(replace(log, dvl=replace(log.dvl, velocity=velocity)))
    assert np.linalg.norm(pose_errors(result.trajectory, AT)[0], axis=1).max() < 4.0
    assert result.report["sensors"]["speed"]["accepted"] > 10


@pytest.mark.parametrize("sensor", ["imu", "dvl", "pressure"])
@pytest.mark.parametrize("count", [0, 1, 3])
def test_hardly_any_message_of_a_sensor_is_no_reason_to_fail(sensor: str, count: int) -> None:
    """None, one or three messages: finite poses and positive covariances."""
    log = build(5.0, typical_errors(1), 1)
    series = getattr(log, sensor)
    few = type(series)(**{name: value[:count] for name, value in vars(series).items()})
    trajectory = navigate(replace(log, **{sensor: few})).trajectory
    assert np.isfinite(trajectory.position).all()
    assert np.linalg.eigvalsh(trajectory.covariance).min() > 0.0


@pytest.mark.parametrize("sensor", ["imu", "dvl", "pressure"])
def test_a_clock_fifty_milliseconds_off_costs_centimetres(sensor: str) -> None:
    """One sensor's stamps are 50 ms late: the path degrades, and does not break."""
    log = noisy()
    series = getattr(log, sensor)
    late = replace(log, **{sensor: replace(series, stamp_ns=series.stamp_ns + 50_000_000)})
    assert worst(late) < worst(log) + 0.05
