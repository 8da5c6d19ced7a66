"""A whole simulated dive: a scenario in, a log and its truth out, the same again from the same seed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import simplejpeg

from garbi_map.errors import GarbiError
from garbi_map.log import open_log
from garbi_map.rig import parse_rig
from tools.simulator import shapes
from tools.simulator.dive import Dive, cast_profiles
from tools.simulator.record import write_log, write_truth
from tools.simulator.scan import laser_angle
from tools.simulator.scenario import Camera, Laser, Mover, Route, Scenario, Seabed, load_scenario
from tools.simulator.seabed import mover_centre
from tools.simulator.vehicle import Command

SCENARIOS = sorted((Path(__file__).parents[1] / "tools" / "simulator" / "scenarios").glob("*.yaml"))
SMALL = Scenario(
    duration=0.5,
    route=Route(kind="straight"),
    seabed=Seabed(margin=0.8, stones=3, block=True),
    camera=Camera(width=192, height=144, focal=200, psf=0.8, rate=10),
)


@pytest.fixture(scope="module")
def dive() -> Dive:
    """Half a second with a small camera."""
    return Dive(SMALL).fly()


def test_the_log_opens_and_is_complete(dive: Dive, tmp_path: Path) -> None:
    """Every topic, the rig as attachment, images that decode, stamps before arrivals."""
    write_log(dive, tmp_path / "dive.mcap", workers=0)
    log = open_log([tmp_path / "dive.mcap"])
    assert log.image_count == 5
    assert log.rig_text is not None
    assert parse_rig(log.rig_text, "attachment") == dive.rig
    images = list(log.images())
    assert simplejpeg.decode_jpeg(images[0].data).shape == (144, 192, 3)
    assert all(image.arrival_ns > image.stamp_ns for image in images)
    navigation = log.navigation()
    for sensor in (navigation.encoder, navigation.imu, navigation.pressure, navigation.dvl):
        assert sensor is not None
        assert (sensor.arrival_ns > sensor.stamp_ns).all()
    assert set(navigation.mounts) == set(dive.mounts)
    assert "/truth/odometry" in log.topics
    assert not log.losses


def test_the_truth_lies_beside_the_log(dive: Dive, tmp_path: Path) -> None:
    """Poses at 100 Hz, the surface, and points on it that the scanner saw."""
    write_truth(dive, tmp_path)
    poses = np.loadtxt(tmp_path / "truth_trajectory.tum")
    assert poses.shape == (50, 8)
    assert np.allclose(np.diff(poses[:, 0]), 0.01, atol=1e-5)
    seen = np.load(tmp_path / "truth_seen.npy")
    down = np.tile([0.0, 0.0, -1.0], (len(seen), 1))
    distance, _ = dive.scene.cast(seen + np.array([0.0, 0.0, 0.01]), down, 0.0)
    assert np.median(distance) == pytest.approx(0.01, abs=1e-4)
    assert (tmp_path / "truth_seabed.ply").stat().st_size > 1e5


def test_the_seed_decides_everything(dive: Dive) -> None:
    """The same seed gives the same bytes in whatever order images are asked for; another seed another dive."""
    again = Dive(SMALL).fly()
    assert again.image(3).data == dive.image(3).data
    assert again.image(1).data == dive.image(1).data
    assert np.array_equal(again.navigation().imu.rate, Dive(SMALL).fly().navigation().imu.rate)
    other = Dive(SMALL.model_copy(update={"seed": 2})).fly()
    assert other.image(3).data != dive.image(3).data
    assert other.rig != dive.rig


def test_worker_processes_render_the_same_images(dive: Dive) -> None:
    """Rendered elsewhere, in order, bit for bit."""
    assert [image.data for image in dive.images(workers=1)] == [dive.image(number).data for number in range(5)]


def test_the_loop_can_be_closed() -> None:
    """A command in, the next image out: what the vehicle does changes what is seen."""
    stay, rise = Dive(SMALL), Dive(SMALL)
    with pytest.raises(ValueError, match="has moved"):
        stay.image(0)
    stay.step(Command(), 0.1)
    rise.step(Command(), 0.1)
    assert stay.image(0).data == rise.image(0).data
    stay.step(Command(), 0.5)
    rise.step(Command(heave=0.3, yaw=0.3), 0.5)
    assert stay.image(4).data != rise.image(4).data
    assert len(rise.navigation(0.0, 0.2).imu.stamp_ns) == 20
    assert len(rise.navigation(0.2, 0.5).imu.stamp_ns) == 30


def test_profiles_lie_on_the_seabed(dive: Dive) -> None:
    """Cast stripes, triangulated at the true angle and pose, are millimetres from the surface."""
    survey = cast_profiles(SMALL, workers=0)
    stripes = list(survey.stripes)
    assert len(stripes) == 5
    assert survey.navigation.encoder is not None
    number = 2
    position, rotation = dive.rig_pose(0.02 + number / 10)
    alpha = laser_angle(SMALL.laser, 0.02 + number / 10)[0]
    stripe = stripes[number]
    points = survey.rig.triangulate(stripe.u.astype(float), stripe.row.astype(float), alpha).points
    there = rotation.apply(points) + position
    sight = (there - position) / np.linalg.norm(there - position, axis=1, keepdims=True)
    distance, _ = dive.scene.cast(there - 0.05 * sight, sight, 0.0)
    assert len(there) > 100
    assert np.percentile(np.abs(distance - 0.05), 90) < 0.003


def test_bodies_move_through_the_scene() -> None:
    """A sphere that comes nearer is hit where it is at the time, and is not part of the true seabed."""
    mover = Mover(kind="sphere", size=0.2, start=(0.0, 0.0, 0.5), velocity=(0.1, 0.0, 0.0))
    dive = Dive(SMALL.model_copy(update={"movers": (mover,)}))
    above = np.array([[0.0, 0.0, 1.0], [0.2, 0.0, 1.0]])
    down = np.tile([0.0, 0.0, -1.0], (2, 1))
    first, _ = dive.scene.cast(above, down, 0.0)
    later, _ = dive.scene.cast(above, down, 2.0)
    assert first[0] == pytest.approx(0.4, abs=2e-3)
    assert first[1] > 0.8
    assert later[1] == pytest.approx(0.4, abs=2e-3)
    assert later[0] > 0.8
    assert np.allclose(mover_centre(mover, 2.0), [0.2, 0.0, 0.5])


def test_without_a_motor_the_rig_says_the_angle() -> None:
    """No encoder, a fixed angle in the rig file."""
    dive = Dive(SMALL.model_copy(update={"laser": Laser(motor=False, range=(0.3, 0.3))})).fly()
    assert dive.navigation().encoder is None
    assert dive.rig.laser.fixed_angle == pytest.approx(0.3)


def test_the_slanting_side_of_the_block_is_82_mm() -> None:
    """The paper's parallelepiped."""
    points, _ = shapes.block()
    assert np.linalg.norm(points[4] - points[0]) == pytest.approx(0.082)


def test_spheres_and_stones_are_closed() -> None:
    """Every edge belongs to two triangles, and the sphere's volume is a sphere's."""
    trimesh = pytest.importorskip("trimesh")
    ball = trimesh.Trimesh(*shapes.sphere(4), process=False)
    assert ball.is_watertight
    assert ball.volume == pytest.approx(4 / 3 * np.pi, rel=0.01)
    assert trimesh.Trimesh(*shapes.stone(0.08, np.random.default_rng(1)), process=False).is_watertight


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_the_scenarios_that_come_along_are_valid(path: Path) -> None:
    """Each loads and says what it is."""
    assert load_scenario(path).title


@pytest.mark.parametrize("text", ["duration: -1", "colour: green", "route: {kind: spiral}", "[1, 2", "water: 3"])
def test_a_bad_scenario_ends_in_one_line(text: str, tmp_path: Path) -> None:
    """It names the file and what is wrong."""
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(GarbiError, match=r"bad\.yaml") as caught:
        load_scenario(path)
    assert "\n" not in str(caught.value)
