"""Long dives in windows: their layout, their seams, their memory."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scanned_floor import MOUNTS, PROFILES, RAYS, dive, floor_error, register_dive, true_trajectory

from garbi_map.evaluate import rigid_alignment
from garbi_map.navigate import navigate
from garbi_map.navigate.kernels import place_points
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.register.motion import Motion, PriorAttitude
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import DriftSettings
from garbi_map.register.windows import load_scans, solve_near, split

LEVEL = PriorAttitude(np.array([0.0]), np.array([[0.0, 0.0, 0.0, 1.0]]))


@settings(deadline=None, max_examples=100)
@given(st.floats(-50, 50), st.floats(0, 4000), st.floats(20.5, 300), st.floats(0.05, 0.8))
def test_windows_cover_the_dive_and_overlap(begin, length, window, share):
    """From the first instant to the last, each at most `window` long, neighbours sharing at least `overlap`."""
    chosen = DriftSettings(window=window, overlap=max(share * window, 4.01))
    windows = split(begin, begin + length, chosen)
    assert windows[0][0] == begin
    assert windows[-1][1] == pytest.approx(begin + length)
    for first, last in windows:
        assert last - first <= window + 1e-6
    for (_, end), (start, _) in pairwise(windows):
        assert end - start == pytest.approx(chosen.overlap)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 10**7), st.integers(0, 10**6), st.sampled_from([0.02, 0.1]))
def test_instants_begin_and_end_where_they_should_and_ascend(begin_ms, length_ms, step):
    """However the step divides the span: strictly ascending, never farther apart than the step."""
    begin, end = begin_ms * 1e-3, (begin_ms + length_ms % 30_000) * 1e-3
    t = Motion(begin, end, LEVEL, 0.2, 1.0).instants(step)
    assert t[0] == begin and t[-1] == end
    assert (np.diff(t) > 0).all() or len(t) == 1
    assert np.diff(t).max(initial=0.0) <= step * (1 + 1e-9)


@pytest.fixture(scope="module")
def long_dive(tmp_path_factory):
    return dive(tmp_path_factory.mktemp("long"), 26.0, sensors=("attitude", "pressure"), seed=3)


def test_a_dive_in_two_windows_is_the_dive_in_one(long_dive):
    """Cut where nothing asks for it, the path differs by less than a millimetre inside the map, and the points lie on
    the floor as well."""
    whole, _ = register_dive(long_dive)
    cut, _ = register_dive(long_dive, window=20.5, overlap=6.0)
    assert (len(whole.rounds), len(cut.rounds)) == (2, 4)
    stamps = long_dive.store.stamps()
    one, two = whole.trajectory.at(stamps), cut.trajectory.at(stamps)
    turn, shift = rigid_alignment(two, one)
    apart = np.linalg.norm(turn.apply(two.position) + shift - one.position, axis=1)
    assert np.median(apart) < 1e-3
    assert np.linalg.norm(two.position - one.position, axis=1).max() < 0.02
    assert floor_error(long_dive, cut.trajectory) < 1.5 * floor_error(long_dive, true_trajectory(stamps))
    assert (np.diff(cut.trajectory.stamp_ns) > 0).all()
    ends = [np.sqrt(np.diagonal(each.trajectory.covariance[-1])) for each in (whole, cut)]
    assert (ends[1] > 0.7 * ends[0]).all(), "a later window inherits what the earlier one is unsure of"


def test_a_sweep_that_a_window_cuts_keeps_its_surfels(long_dive):
    """Whatever sweep a window ends or begins in, as many surfels of each are handed on as of one window."""
    settings = NavigateSettings()
    navigated = navigate(long_dive.log, settings, long_dive.store.stamps())
    epoch = int(long_dive.store.stamps()[0])
    sensors = Sensors(long_dive.log, navigated.trajectory, navigated.inertial, navigated.attitude, settings, epoch)
    span = (0.0, float(long_dive.store.stamps()[-1] - epoch) * 1e-9)
    counts = []
    for window in (40.0, 20.5):
        chosen = DriftSettings(window=window, overlap=6.3, surfel_size=0.06, coarse_surfel_size=0.08, surfel_points=6)
        near = solve_near(long_dive.store, MOUNTS["rig"], sensors, span, chosen, lambda _: None)
        counts.append(np.bincount(near.surfels.sweep, minlength=len(long_dive.store)))
    assert counts[0].min() > 30
    assert counts[1] == pytest.approx(counts[0], rel=0.1)


def test_scans_are_thinned_evenly(long_dive):
    """No more points than asked for, of every sweep in the window, each still of its own profile and in base_link."""
    stamps = long_dive.store.stamps()
    sensors = Sensors(long_dive.log, true_trajectory(stamps), None, None, NavigateSettings(), int(stamps[0]))
    everything = load_scans(long_dive.store, MOUNTS["rig"], sensors, 3.0, 9.0, 10**9)
    thinned = load_scans(long_dive.store, MOUNTS["rig"], sensors, 3.0, 9.0, 3000)
    assert len(everything.points) == pytest.approx(6 * PROFILES * RAYS, abs=2 * RAYS)
    assert len(thinned.points) <= 3000
    counts = np.bincount(thinned.sweep[thinned.profile], minlength=13)
    assert (counts[1:5] > 0).all() and counts[6:].sum() == 0
    time = thinned.time[thinned.profile]
    assert time.min() >= 3.0 and time.max() <= 9.0
    known = {tuple(point) for point in np.round(everything.points, 9)}
    assert all(tuple(point) in known for point in np.round(thinned.points, 9))


def test_placed_points_are_those_of_rotation_and_position(long_dive):
    """The compiled loop against scipy."""
    stamps = long_dive.store.stamps()
    sensors = Sensors(long_dive.log, true_trajectory(stamps), None, None, NavigateSettings(), int(stamps[0]))
    scans = load_scans(long_dive.store, MOUNTS["rig"], sensors, 0.0, 4.0, 2000)
    motion = Motion(0.0, 4.0, LEVEL, 0.2, 1.0)
    random = np.random.default_rng(0)
    motion.position_control[:] = random.normal(0, 1, motion.position_control.shape)
    motion.attitude_control[:] = random.normal(0, 0.5, motion.attitude_control.shape)
    time = scans.time[scans.profile]
    expected = motion.rotation(time).apply(scans.points) + motion.position(time)
    matrix, position = motion.rotation(scans.time).as_matrix(), motion.position(scans.time)
    assert place_points(scans.points, scans.profile, matrix, position) == pytest.approx(expected, abs=1e-12)
