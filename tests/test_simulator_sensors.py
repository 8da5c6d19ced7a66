"""The simulated instruments measure the simulated motion."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tools.simulator.scan import laser_angle
from tools.simulator.scenario import DvlErrors, ImuErrors, Laser, PressureErrors, Scenario, Sensors, Sway
from tools.simulator.sensors import ATMOSPHERE, DENSITY, GRAVITY, MOUNTS, START_NS, Suite
from tools.simulator.vehicle import Command, Vehicle

QUIET = Sensors(
    imu=ImuErrors(
        gyro_noise=0, gyro_bias=0, accelerometer_noise=0, accelerometer_bias=0,
        tilt_bias=0, tilt_wander=0, heading_bias=0, heading_wander=0,
    ),
    pressure=PressureErrors(noise=0, bias=0),
    dvl=DvlErrors(noise=0, scale=0),
)  # fmt: skip


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    """Six seconds of lively motion."""
    scenario = Scenario(sway=Sway(translation=0.05, rotation=0.05))
    vehicle = Vehicle(scenario, np.array([0.0, 0.0, 1.3]), 0.3)
    for second in range(6):
        vehicle.step(Command(0.2, 0.05, 0.3 * (-1) ** second, 0.05), 1.0)
    return vehicle


def seconds(stamps: np.ndarray) -> np.ndarray:
    """Stamps as seconds since the start."""
    return (stamps - START_NS) * 1e-9


def test_a_noise_free_imu_integrates_to_the_truth(vehicle: Vehicle) -> None:
    """Rates to attitude and specific force to position, 5 s: 0.01 degrees and 2 mm."""
    imu = Suite(Scenario(sensors=QUIET)).imu.between(vehicle.motion, 0.0, 5.0)
    time = seconds(imu.stamp_ns)
    truth = vehicle.motion.at(time)
    step = np.diff(time)[:, None]
    middle = Rotation.from_rotvec(0.5 * (imu.rate[1:] + imu.rate[:-1]) * step)
    attitude = [truth.rotation[0] * Rotation.from_quat(MOUNTS["imu_link"].quaternion)]
    for turn in middle:
        attitude.append(attitude[-1] * turn)
    attitude = Rotation.concatenate(attitude)
    assert np.degrees((attitude.inv() * truth.rotation).magnitude().max()) < 0.01
    acceleration = attitude.apply(imu.specific_force) - [0, 0, GRAVITY]
    arm = MOUNTS["imu_link"].translation
    velocity = (
        truth.velocity_at(arm)[0]
        + np.r_[np.zeros((1, 3)), np.cumsum(0.5 * (acceleration[1:] + acceleration[:-1]) * step, axis=0)]
    )
    position = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * step, axis=0)
    moved = truth.position + truth.rotation.apply(arm)
    assert np.abs(position - (moved[1:] - moved[0])).max() < 0.002


def test_the_dvl_feels_its_lever_arm(vehicle: Vehicle) -> None:
    """Its velocity is the derivative of where its own frame is, seen in its own turned frame."""
    dvl = Suite(Scenario(sensors=QUIET)).dvl.between(vehicle.motion, 0.0, 5.0)
    time = seconds(dvl.stamp_ns)
    mount, half = MOUNTS["dvl_link"], 0.002

    def place(at: np.ndarray) -> np.ndarray:
        now = vehicle.motion.at(at)
        return now.position + now.rotation.apply(mount.translation)

    expected = (place(time + half) - place(time - half)) / (2 * half)
    turned = vehicle.motion.at(time).rotation * Rotation.from_quat(mount.quaternion)
    inside = time > half
    assert np.abs(turned.apply(dvl.velocity) - expected)[inside].max() < 1e-4
    assert np.abs(dvl.velocity - vehicle.motion.at(time).velocity).max() > 0.05


def test_pressure_is_that_of_the_sensors_depth(vehicle: Vehicle) -> None:
    """Atmosphere and water above the sensor, not above base_link."""
    pressure = Suite(Scenario(sensors=QUIET)).pressure.between(vehicle.motion, 0.0, 5.0)
    truth = vehicle.motion.at(seconds(pressure.stamp_ns))
    height = (truth.position + truth.rotation.apply(MOUNTS["pressure_link"].translation))[:, 2]
    assert np.allclose(pressure.pressure, ATMOSPHERE + DENSITY * GRAVITY * (12.0 - height), atol=1e-6)


def test_the_encoder_tells_whole_counts() -> None:
    """Within half a count of the angle, at its own rate, later than measured."""
    laser = Laser()
    encoder = Suite(Scenario()).encoder.between(0.0, 9.0)
    counts = encoder.angle / laser.count
    assert len(counts) == 900
    assert np.abs(counts - np.round(counts)).max() < 1e-6
    assert np.abs(encoder.angle - laser_angle(laser, seconds(encoder.stamp_ns))).max() <= laser.count / 2 + 1e-12
    assert (encoder.arrival_ns > encoder.stamp_ns).all()


def test_the_motor_turns_smoothly_at_the_ends_of_its_range() -> None:
    """The saw-tooth reaches both ends, never jumps in speed, and turns once per sweep."""
    laser = Laser(round=0.1)
    time = np.linspace(0, 16, 16001)
    angle = laser_angle(laser, time)
    assert angle.min() == pytest.approx(laser.range[0], abs=1e-5)
    assert angle.max() == pytest.approx(laser.range[1], abs=1e-5)
    speed = np.diff(angle) / np.diff(time)
    top = np.abs(speed).max()
    assert np.abs(np.diff(speed)).max() < 0.01 * top
    assert (np.diff(np.sign(speed)) != 0).sum() == 4


def test_silence_and_clocks() -> None:
    """A gap is empty; a clock offset moves the stamp, not what was measured."""
    gaps = Scenario(sensors=Sensors(imu=ImuErrors(gaps=((1.0, 2.5),), clock_offset=0.05)))
    vehicle = Vehicle(gaps, np.array([0.0, 0.0, 1.3]), 0.0)
    vehicle.step(Command(), 4.0)
    imu = Suite(gaps).imu.between(vehicle.motion, 0.0, 3.0)
    time = seconds(imu.stamp_ns)
    assert not ((time > 1.05) & (time < 2.54)).any()
    assert len(time) == 150
    assert time[0] == pytest.approx(0.05)


def test_sensors_do_not_disturb_each_other(vehicle: Vehicle) -> None:
    """Leaving out the DVL changes no other reading; a cheap suite is four times as wrong; stretches join seamlessly."""
    whole = Suite(Scenario()).imu.between(vehicle.motion, 0.0, 5.0)
    without = Suite(Scenario(sensors=Sensors(dvl=None))).imu.between(vehicle.motion, 0.0, 5.0)
    assert np.array_equal(whole.rate, without.rate)
    truth = vehicle.motion.at(seconds(whole.stamp_ns)).rate
    cheap = Suite(Scenario(sensors=Sensors(suite="cheap"))).imu.between(vehicle.motion, 0.0, 5.0)
    assert np.allclose(cheap.rate - truth, 4 * (whole.rate - truth))
    pieces = Suite(Scenario()).imu
    stamps = np.concatenate([pieces.between(vehicle.motion, a, a + 0.25).stamp_ns for a in np.arange(0, 5, 0.25)])
    assert np.array_equal(stamps, whole.stamp_ns)
