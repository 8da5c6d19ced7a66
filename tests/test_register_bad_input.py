"""Dives of which little can be made: the trajectory stays finite, or one line says why there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scanned_floor import Dive, dive, register_dive, sweep, wavy

from garbi_map.errors import GarbiError
from garbi_map.log.records import Navigation
from garbi_map.register import Registered
from garbi_map.sweep.store import SweepStore
from garbi_map.sweep.types import Sweep


def stored(folder: Path, sweeps: list[Sweep], log: Navigation) -> Dive:
    store = SweepStore(folder)
    for one in sweeps:
        store.add(one)
    store.finish([])
    return Dive(store, log, wavy)


def kept(one: Sweep, points: np.ndarray) -> Sweep:
    """The sweep with some of its points only."""
    return replace(
        one,
        points=one.points[points],
        sigma=one.sigma[points],
        intensity=one.intensity[points],
        profile=one.profile[points],
        row=one.row[points],
    )


def assert_finite(registered: Registered, one: Dive) -> None:
    for trajectory in (registered.trajectory, registered.inside):
        for array in (trajectory.position, trajectory.quaternion, trajectory.covariance):
            assert np.isfinite(array).all()
        assert np.isin(one.store.stamps(), trajectory.stamp_ns).all()
        assert (np.diff(trajectory.stamp_ns) > 0).all()
    assert np.isfinite(registered.graph_step).all()


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Navigation:
    return dive(tmp_path_factory.mktemp("log"), 10.0).log


@pytest.fixture(scope="module")
def sweeps() -> list[Sweep]:
    random = np.random.default_rng(0)
    return [sweep(number, wavy, random) for number in range(5)]


def apart(one: Sweep) -> Sweep:
    """Five metres of range farther: nothing that another sweep has seen."""
    return replace(one, points=one.points + 5.0 * one.points / np.linalg.norm(one.points, axis=1, keepdims=True))


CASES = {
    "one sweep": lambda s: s[:1],
    "two sweeps that share nothing": lambda s: [s[0], apart(s[1])],
    "a sweep of ten points": lambda s: [s[0], kept(s[1], np.arange(0, 3200, 320)), *s[2:]],
    "a sweep without points": lambda s: [s[0], kept(s[1], np.arange(0)), *s[2:]],
    "no point at all": lambda s: [kept(one, np.arange(0)) for one in s[:2]],
    "a pause between sweeps": lambda s: [s[0], s[4]],
    "two profiles": lambda s: [replace(kept(s[0], s[0].profile < 2), stamp_ns=s[0].stamp_ns[:2], alpha=s[0].alpha[:2])],
}


@pytest.mark.parametrize("name", CASES)
def test_the_trajectory_is_finite(name, tmp_path, sweeps, log):
    """Whatever the sweeps have to say, there is a pose with a covariance for each profile."""
    one = stored(tmp_path, CASES[name](sweeps), log)
    assert_finite(register_dive(one)[0], one)


def test_a_log_without_navigation_is_registered_by_its_sweeps(tmp_path, sweeps):
    """No IMU, no DVL, no pressure."""
    one = stored(tmp_path, sweeps[:3], Navigation(mounts={}))
    assert_finite(register_dive(one)[0], one)


@pytest.mark.parametrize("profiles", [0, 1])
def test_without_two_profiles_there_is_nothing_to_register(tmp_path, sweeps, log, profiles):
    """One clear line that says how many there are."""
    first = sweeps[0]
    single = replace(kept(first, first.profile < 1), stamp_ns=first.stamp_ns[:1], alpha=first.alpha[:1])
    one = stored(tmp_path, [single][:profiles], log)
    with pytest.raises(GarbiError, match=rf"hold {profiles} profile") as error:
        register_dive(one)
    assert "\n" not in str(error.value)
