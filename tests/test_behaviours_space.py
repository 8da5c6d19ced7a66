"""The local volume: free, occupied, unknown; clear water has to be proved; movement; bounded memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from behaviours import kernels
from behaviours.moving import Movers
from tests.behaviour_parts import pose, profile, space, wall

FAR_AHEAD = np.array([[2.2, 0.0, 0.0]])


def sweep(volume, points: np.ndarray, at: float, number: int, seconds: float = 3.0) -> list:
    """A pass over points as the sheet passes them, 30 profiles; what was surprising in each."""
    surprises = []
    for n, alpha in enumerate(np.linspace(-0.4, 0.65, 30)):
        here = pose(at + n * seconds / 30)
        bearing = np.arctan2(points[:, 1] + 0.4, points[:, 0] - 0.47)
        lit = points[np.abs(bearing - alpha) < 0.02]
        one = profile(lit, here, alpha, number)
        surprises.append((one, volume.see(one)))
    return surprises


def test_what_nobody_saw_is_unknown() -> None:
    """Beyond the operator's word about the launch, and without a profile, everything is unknown."""
    volume = space()
    volume.be_at(pose(0))
    assert volume.state(np.array([[0.0, 0.0, 0.0], [1.5, 0.0, 0.0]])).tolist() == [kernels.FREE] * 2
    assert volume.state(np.array([[2.5, 0.0, 0.0], [0.0, 2.5, 0.0]])).tolist() == [kernels.UNKNOWN] * 2


def test_a_wall_is_occupied_and_what_is_before_it_free() -> None:
    """One pass is enough, and behind the wall nothing becomes known."""
    volume = space()
    sweep(volume, wall(2.65), 0.0, 0)
    assert volume.state(np.array([[2.65, 0.1, 0.0]]))[0] == kernels.OCCUPIED
    assert volume.state(FAR_AHEAD)[0] == kernels.FREE
    assert volume.state(np.array([[3.2, 0.1, 0.0]]))[0] == kernels.UNKNOWN
    seen = volume.corridor(pose(3.0), 3.0, np.zeros(2))
    assert seen.end in ("obstacle", "unseen") and seen.length < 2.1


def test_murky_water_proves_nothing() -> None:
    """Profiles without a single return leave unknown what is unknown, and say so by a clear range of nought."""
    volume = space()
    sweep(volume, np.empty((0, 3)), 0.0, 0)
    assert volume.state(FAR_AHEAD)[0] == kernels.UNKNOWN
    assert volume.clear_range(pose(3.0).stamp_ns) == 0.0


def test_clear_water_has_to_be_proved_and_the_proof_expires() -> None:
    """Bright returns prove how far a dark thing would show; dim ones less; old ones nothing."""
    bright, dim = space(), space()
    for volume, level in ((bright, 200.0), (dim, 12.0)):
        for n in range(10):
            volume.see(profile(wall(2.0), pose(0.04 * n), intensity=level))
    now = pose(1.0).stamp_ns
    assert bright.clear_range(now) > 2.0 > dim.clear_range(now)
    assert bright.clear_range(pose(30.0).stamp_ns) == 0.0


def test_a_flake_of_snow_is_no_obstacle_but_two_in_one_place_are() -> None:
    """A dot counts only when it is seen again."""
    volume = space()
    volume.be_at(pose(0))
    dot = np.array([[1.4, 0.0, z] for z in np.arange(0.0, 0.02, 0.004)])
    volume.see(profile(dot, pose(0.1)))
    assert volume.state(dot[:1])[0] == kernels.FREE
    volume.see(profile(dot, pose(0.14)))
    assert volume.state(dot[:1])[0] == kernels.OCCUPIED


def test_what_was_hit_stays_until_it_is_seen_free_for_long() -> None:
    """A thing that is gone is forgotten only after passes that see through it, and not before the hold is over."""
    volume = space()
    sweep(volume, wall(2.0), 0.0, 0)
    sweep(volume, wall(2.8), 3.0, 1)
    assert volume.state(np.array([[2.0, 0.1, 0.0]]))[0] == kernels.OCCUPIED
    for number in range(2, 6):
        sweep(volume, wall(2.8), 3.0 * number, number)
    assert volume.state(np.array([[2.0, 0.1, 0.0]]))[0] == kernels.FREE


def test_something_that_comes_into_free_water_moves_and_has_a_velocity() -> None:
    """A ball that crosses is found, with its velocity to 4 cm/s; the wall behind it is never called moving."""
    volume, movers = space(), Movers()
    false = 0
    for number in range(8):
        ball = np.empty((0, 3))
        if number >= 3:
            y = 0.55 - 0.1 * 3.0 * (number - 3)
            yy, zz = np.meshgrid(np.linspace(-0.15, 0.15, 30), np.linspace(-0.15, 0.15, 90))
            ball = np.stack([np.full(yy.size, 1.7), y + yy.ravel(), zz.ravel()], 1)
        for one, (surprising, newly) in sweep(volume, np.concatenate([wall(2.8), ball]), 3.0 * number, number):
            movers.see(one, surprising, newly)
            false += int((surprising & (one.points[:, 0] > 2.4)).sum())
    assert false == 0
    found = max(movers.now(), key=lambda mover: mover.passes)
    assert found.passes >= 2
    assert found.centre[0] == pytest.approx(1.7, abs=0.1)
    assert found.velocity[1] == pytest.approx(-0.1, abs=0.04)


def test_the_volume_follows_the_vehicle_and_does_not_grow() -> None:
    """After a hundred metres the memory is what it was, and what left the volume is unknown when it comes back."""
    volume = space()
    size = sum(layer.nbytes for layer in volume.layers)
    for metre in range(0, 101, 2):
        volume.be_at(pose(metre, (float(metre), 0.0, 0.0)))
    assert sum(layer.nbytes for layer in volume.layers) == size
    assert volume.state(np.array([[100.0, 0.0, 0.0], [50.0, 0.0, 0.0]])).tolist() == [kernels.FREE, kernels.UNKNOWN]
    volume.be_at(pose(200, (0.0, 0.0, 0.0)))
    assert volume.state(np.array([[3.0, 0.0, 0.0]]))[0] == kernels.UNKNOWN


def test_nearest_agrees_with_plain_geometry() -> None:
    """The kernel's distance to a wall is the wall's, less half a voxel."""
    volume = space()
    sweep(volume, wall(2.05), 0.0, 0)
    nearby = volume.nearby(pose(3.0), 1.8)
    ahead = nearby.distance[~nearby.unknown & (nearby.normal[:, 0] > 0.95)]
    assert ahead.min() == pytest.approx(2.05 - 0.65 - 0.05, abs=0.06)


def test_unseen_water_is_near_where_it_begins() -> None:
    """A hull launched with 0.5 m of known water about it has the unseen at that distance on every side."""
    volume = space(launch_clearance=0.5)
    volume.be_at(pose(0))
    nearby = volume.nearby(pose(0), 1.3)
    for axis in range(3):
        for side in (1.0, -1.0):
            there = nearby.unknown & (side * nearby.normal[:, axis] > 0.95)
            assert nearby.distance[there].min() == pytest.approx(0.5, abs=0.11)


def test_a_wave_abeam_does_not_make_the_way_ahead_old_but_a_current_does() -> None:
    """What a wave pushes the vehicle aside it takes back: the way ahead stays the one in view. A current carries it on."""
    volume = space()
    volume.be_at(pose(0.0))
    sweep(volume, wall(2.65), 6.0, 0)
    at = replace(pose(9.0), velocity=np.array([0.0, 0.12, 0.0]))
    fresh = volume.corridor(replace(at, velocity=np.zeros(3)), 3.0, np.zeros(2))
    wave, current = (volume.corridor(at, 3.0, np.array([0.0, speed])) for speed in (0.0, 0.12))
    assert wave.age < fresh.age + 0.5 and wave.length > 0.8 * fresh.length
    assert current.age > 5.0
