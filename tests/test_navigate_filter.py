"""The navigation filter against analytic paths: what perfect sensors give, and what each one is worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2
from synthetic_navigation import BEGIN_NS, build, pose_errors, position, rotation, seconds, stamps, typical_errors

from garbi_map.errors import GarbiError
from garbi_map.log.records import Fixes, Navigation, Odometry
from garbi_map.navigate import NavigateSettings, navigate


def without_attitude(log: Navigation) -> Navigation:
    return replace(log, imu=replace(log.imu, attitude=np.full_like(log.imu.attitude, np.nan)))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).sum(axis=1).mean()))


def aligned_errors(trajectory, at) -> tuple[np.ndarray, np.ndarray]:
    """Position and rotation errors after the rigid motion that the attitudes and the mean position ask for."""
    found, t = trajectory.at(at), seconds(at)
    turn = (rotation(t) * found.rotation.inv()).mean()
    left = position(t) - turn.apply(found.position)
    return left - left.mean(axis=0), (rotation(t) * (turn * found.rotation).inv()).as_rotvec()


def test_perfect_sensors_give_back_the_path() -> None:
    """Noiseless sensors with lever arms and turned mounts: a tenth of a millimetre, 0.1 mrad."""
    result = navigate(build(30.0))
    moved, turned = pose_errors(result.trajectory, stamps(29.9, 20.0))
    assert np.abs(moved).max() < 1e-4
    assert np.abs(turned).max() < 1e-4


def test_velocity_is_that_of_base_link() -> None:
    """The velocity that comes with the trajectory is its derivative."""
    result = navigate(build(20.0))
    t = seconds(result.trajectory.stamp_ns)
    slope = np.gradient(result.trajectory.position, t, axis=0)
    assert np.abs(slope - result.velocity)[5:-5].max() < 2e-3


def test_poses_come_at_the_imu_rate_and_at_asked_stamps() -> None:
    """Every IMU stamp and every asked one, between samples or outside of them, has its pose."""
    log = build(5.0)
    asked = np.array([BEGIN_NS - 200_000_000, BEGIN_NS + 1_234_567_891, BEGIN_NS + 5_200_000_000])
    trajectory = navigate(log, stamps_ns=asked).trajectory
    assert np.isin(asked, trajectory.stamp_ns).all()
    assert np.isin(log.imu.stamp_ns, trajectory.stamp_ns).all()
    assert (np.diff(trajectory.stamp_ns) > 0).all()
    assert np.diff(trajectory.stamp_ns).max() <= 20_000_000


def test_a_slow_imu_still_gives_fifty_poses_per_second() -> None:
    """An IMU of 20 Hz is filled up to 50 Hz."""
    trajectory = navigate(build(10.0, imu_rate=20.0)).trajectory
    assert np.diff(trajectory.stamp_ns).max() <= 20_000_001


def test_height_is_minus_depth_and_the_first_pose_is_the_origin() -> None:
    """x = y = 0 at the first pose; z is measured from the surface."""
    trajectory = navigate(build(10.0, typical_errors(3), 3)).trajectory
    assert np.allclose(trajectory.position[0, :2], 0.0, atol=1e-12)
    assert trajectory.position[0, 2] == pytest.approx(position(np.zeros(1))[0, 2], abs=0.01)


def test_covariance_is_consistent_with_the_truth() -> None:
    """Normalised estimation error squared of position and attitude: 24 dives, in the 95 % band early, mid and late."""
    picked = stamps(15.0, 1.0)[[3, 8, 14]]
    total = np.zeros(3)
    dives = 24
    for seed in range(dives):
        trajectory = navigate(build(15.0, typical_errors(seed), seed)).trajectory.at(picked)
        error = np.concatenate(pose_errors(trajectory, picked), axis=1)
        total += np.einsum("ni,nij,nj->n", error, np.linalg.inv(trajectory.covariance), error)
    low, high = chi2.ppf([0.025, 0.975], 6 * dives)
    assert ((total > low) & (total < high)).all(), total / (6 * dives)


@pytest.mark.parametrize(
    ("missing", "bound"),
    [("pressure", 0.03), ("attitude", 0.03), ("specific_force", 0.03), ("rate", 0.05), ("imu", 0.25)],
)
def test_one_sensor_less_still_gives_a_path(missing: str, bound: float) -> None:
    """Without one of the sensors the shape of the path stays, to a bound that says what the sensor was worth."""
    log = build(20.0, typical_errors(5), 5)
    if missing == "attitude":
        log = without_attitude(log)
    elif missing in ("specific_force", "rate"):
        log = replace(log, imu=replace(log.imu, **{missing: np.full_like(log.imu.rate, np.nan)}))
    else:
        log = replace(log, **{missing: None})
    moved, _ = aligned_errors(navigate(log).trajectory, stamps(20.0, 10.0))
    assert rms(moved) < bound


def test_without_dvl_the_covariance_says_so() -> None:
    """No velocity sensor: the position wanders, within four of its stated sigmas."""
    trajectory = navigate(replace(build(20.0, typical_errors(2), 2), dvl=None)).trajectory
    at = stamps(20.0, 1.0)[1:]
    moved, _ = pose_errors(trajectory, at)
    sigma = np.sqrt(np.diagonal(trajectory.at(at).covariance, axis1=1, axis2=2))[:, :2]
    assert (np.abs(moved[:, :2]) < 4.0 * sigma).all()
    assert sigma[-1].min() > 0.1


def test_an_encoder_alone_means_standing_still_and_not_knowing() -> None:
    """Images and encoder only: a pose that stands, decimetres of stated uncertainty, a note for the report."""
    result = navigate(replace(Navigation(), encoder=build(20.0).encoder))
    assert np.abs(result.trajectory.position).max() < 1e-9
    sigma = np.sqrt(np.diagonal(result.trajectory.covariance, axis1=1, axis2=2))
    assert sigma[-1, 0] > 0.3
    assert sigma[-1, 3] > 0.02
    assert any("no IMU" in note for note in result.report["notes"])


def test_asked_stamps_alone_are_enough() -> None:
    """A log of images only: poses at their stamps."""
    asked = stamps(3.0, 25.0)
    assert np.isin(asked, navigate(Navigation(), stamps_ns=asked).trajectory.stamp_ns).all()


def test_nothing_at_all_is_one_clear_line() -> None:
    """No stamp anywhere ends in a GarbiError."""
    with pytest.raises(GarbiError, match="stamp"):
        navigate(Navigation())


def test_absolute_fixes_stop_the_drift() -> None:
    """Fixes of 5 cm without a DVL keep the path within a decimetre; the origin is the first pose all the same."""
    log = replace(build(30.0, typical_errors(4), 4), dvl=None)
    at = stamps(30.0, 2.0)
    noise = np.random.default_rng(4).normal(0.0, 0.05, (len(at), 3))
    fixes = Fixes(
        at,
        at,
        position(seconds(at)) + np.array([500.0, -300.0, 0.0]) + noise,
        np.tile(np.eye(3) * 0.05**2, (len(at), 1, 1)),
    )
    result = navigate(replace(log, fixes=fixes))
    assert np.allclose(result.trajectory.position[0, :2], 0.0)
    assert rms(aligned_errors(result.trajectory, at)[0]) < 0.1
    assert result.report["sensors"]["fixes"]["accepted"] > 50


def test_odometry_is_the_trajectory_where_it_is_the_only_one() -> None:
    """Somebody else's poses come back at their stamps, with a covariance that grows."""
    at = stamps(10.0, 20.0)
    t = seconds(at)
    odometry = Odometry(at, at, position(t) + np.array([3.0, 4.0, 0.0]), rotation(t).as_quat())
    result = navigate(Navigation(odometry=odometry, encoder=build(10.0).encoder))
    moved, turned = pose_errors(result.trajectory, at)
    assert np.abs(moved).max() < 1e-9
    assert np.abs(turned).max() < 1e-9
    assert result.report["source"] == "odometry"
    assert np.trace(result.trajectory.covariance[-1]) > np.trace(result.trajectory.covariance[0])


def test_odometry_steps_back_where_there_is_a_dvl() -> None:
    """Own sensors of velocity win over a foreign trajectory."""
    log = build(5.0)
    at = stamps(5.0, 20.0)
    wrong = Odometry(at, at, np.zeros((len(at), 3)), np.tile([0.0, 0.0, 0.0, 1.0], (len(at), 1)))
    assert navigate(replace(log, odometry=wrong)).report["source"] == "filter"


def test_biases_are_found_with_an_honest_sigma() -> None:
    """Gyro and accelerometer bias and the DVL's scale: within four sigmas of the truth, and tighter than before."""
    errors = typical_errors(7)
    biases = navigate(build(40.0, errors, 7)).report["biases"]
    for name, true in (("gyro", errors.gyro_bias), ("accelerometer", errors.accelerometer_bias)):
        value, sigma = np.array(biases[name]["value"]), np.array(biases[name]["sigma"])
        assert (np.abs(value - true) < 4.0 * sigma).all()
    assert abs(biases["dvl_scale"]["value"] - errors.dvl_scale) < 4.0 * biases["dvl_scale"]["sigma"]
    assert max(biases["gyro"]["sigma"]) < NavigateSettings().gyro_bias
