"""Stamps that jump are sorted out, and the frames of sensors are chained."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from garbi_map.log import Mount
from garbi_map.log.frames import east_north_up, mounts_in
from garbi_map.log.stamps import believable, in_order

SECOND = 10**9


@given(st.lists(st.integers(0, 100 * SECOND), max_size=200))
def test_what_stays_ascends(values: list[int]) -> None:
    """Whatever comes in, strictly ascending stamps come out, and nothing is invented."""
    stamps = np.array(values, np.int64)
    order = in_order(stamps, SECOND // 10)
    assert np.all(np.diff(stamps[order]) > 0)
    assert len(set(order.tolist())) == len(order)


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=60, unique=True))
def test_sound_stamps_all_stay(values: list[int]) -> None:
    """Ascending stamps pass untouched."""
    stamps = np.sort(np.array(values, np.int64))
    np.testing.assert_array_equal(in_order(stamps, 0), np.arange(len(stamps)))


def test_longest_run_wins_against_brute_force() -> None:
    """Without tolerance as many stamps stay as the longest ascending subsequence has distinct values."""
    random = np.random.default_rng(4)
    for _ in range(50):
        stamps = random.permutation(9).astype(np.int64) * SECOND
        best = max(
            sum(mask >> i & 1 for i in range(9))
            for mask in range(512)
            if np.all(np.diff(stamps[[i for i in range(9) if mask >> i & 1]]) > 0)
        )
        assert len(in_order(stamps, 0)) == best


def test_neighbours_are_sorted_and_repeats_dropped() -> None:
    """Two messages that overtook each other are sorted, one that came twice stays once."""
    stamps = np.array([0, 20, 10, 30, 30, 40], np.int64) * 10**6
    assert stamps[in_order(stamps, 50 * 10**6)].tolist() == [0, 10 * 10**6, 20 * 10**6, 30 * 10**6, 40 * 10**6]


def test_clock_set_back_costs_the_shorter_side() -> None:
    """After a jump of 10 s back in a run of 60 s, the 10 s after the jump are left out and nothing else."""
    stamps = np.concatenate([np.arange(40), np.arange(30, 80)]).astype(np.int64) * SECOND
    order = in_order(stamps, SECOND // 10)
    np.testing.assert_array_equal(stamps[order], np.arange(80) * SECOND)
    assert len(order) == 80


def test_wild_stamps_are_far_from_their_arrival() -> None:
    """Clocks that differ by years are believed, one stamp that differs from the others is not."""
    arrival = np.arange(100, dtype=np.int64) * SECOND
    stamps = arrival + 10**18
    stamps[7] += 3600 * SECOND
    stamps[8] = 0
    keep = believable(stamps, arrival, 10 * SECOND)
    np.testing.assert_array_equal(np.flatnonzero(~keep), [7, 8])


def test_mounts_compose_along_chains() -> None:
    """base_link <- rig <- imu_link is the product, wherever the tree is entered; strangers are left out."""
    random = np.random.default_rng(5)
    rig, imu, base = (Mount(random.normal(size=3), Rotation.random(rng=random).as_quat()) for _ in range(3))
    chain = [
        ("rig", "imu_link", imu),
        ("footprint", "base_link", base),
        ("base_link", "rig", rig),
        ("moon", "sea", rig),
    ]
    found = mounts_in("base_link", chain)
    assert found.keys() == {"rig", "imu_link", "footprint"}
    point = random.normal(size=3)
    in_rig = Rotation.from_quat(imu.quaternion).apply(point) + imu.translation
    in_base = Rotation.from_quat(rig.quaternion).apply(in_rig) + rig.translation
    got = Rotation.from_quat(found["imu_link"].quaternion).apply(point) + found["imu_link"].translation
    np.testing.assert_allclose(got, in_base, atol=1e-12)
    back = Rotation.from_quat(base.quaternion).apply(found["footprint"].translation) + base.translation
    np.testing.assert_allclose(back, 0, atol=1e-12)


def test_local_metres_against_radii_of_curvature() -> None:
    """Small steps north, east and up are those of the ellipsoid's radii of curvature."""
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    for latitude in (-60.0, 0.0, 41.9, 89.0):
        s = np.sin(np.radians(latitude))
        meridian = a * (1 - e2) / (1 - e2 * s * s) ** 1.5
        prime = a / np.sqrt(1 - e2 * s * s)
        step = 1e-5
        geodetic = np.array([[latitude + step, 3, 0], [latitude, 3 + step, 0], [latitude, 3, 2.0]])
        expected = [
            [0, meridian * np.radians(step), 0],
            [prime * np.cos(np.radians(latitude)) * np.radians(step), 0, 0],
            [0, 0, 2],
        ]
        np.testing.assert_allclose(east_north_up(geodetic, (latitude, 3.0, 0.0)), expected, atol=1e-5)
