"""The drift estimate while the dive lasts: what is settled is as good as the batch, and nothing comes from the future."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scanned_floor import MOUNTS, Dive, dive, floor_error, register_dive, true_trajectory

from garbi_map.errors import GarbiError
from garbi_map.navigate import NavigateSettings, Trajectory
from garbi_map.register import RegisterSettings, register
from garbi_map.register.live import LiveDrift
from garbi_map.register.settings import DriftSettings
from garbi_map.sweep.store import SweepStore

CHOSEN = DriftSettings(surfel_size=0.06, coarse_surfel_size=0.08, surfel_points=6, live_window=10.0)


@pytest.fixture(scope="module")
def one(tmp_path_factory) -> Dive:
    return dive(tmp_path_factory.mktemp("live"), 20.0)


def ended(one: Dive, until: int | None = None) -> tuple[LiveDrift, list[Trajectory]]:
    """All sweeps given one by one, and where each was when it ended; `until`: navigation is there to that stamp only."""
    live = LiveDrift(MOUNTS["rig"], CHOSEN, NavigateSettings())
    found = []
    for sweep in one.store:
        last = int(sweep.stamp_ns[-1])
        path = live.add(sweep, one.log if until is None else one.log.between(0, min(last, until)))
        t = (sweep.stamp_ns - one.store.entries[0].begin_ns) * 1e-9
        position, rotation = path.at(t)
        found.append(Trajectory(sweep.stamp_ns, position, rotation.as_quat(), np.zeros((len(t), 6, 6))))
    return live, found


def test_the_settled_path_is_as_good_as_the_batch(one):
    """Points on the floor to within half as much again as with the true poses, though no window holds the dive."""
    settings = RegisterSettings(drift=CHOSEN, live=True)
    _, navigated = register_dive(one)
    stamps = one.store.stamps()
    made = register(one.store, one.log, navigated, settings, NavigateSettings())
    assert floor_error(one, made.trajectory) < 1.5 * floor_error(one, true_trajectory(stamps))
    assert made.agreement.median[1] < 5e-4
    assert (np.diff(made.trajectory.stamp_ns) > 0).all()
    assert np.isfinite(made.inside.covariance).all()


def test_nothing_comes_from_the_future(one):
    """Poses when a sweep ended are those of a log that ended there: what is measured later changes nothing."""
    last = int(one.store.load(len(one.store) - 1).stamp_ns[-1])
    _, whole = ended(one)
    _, cut = ended(one, last)
    for with_future, without in zip(whole, cut, strict=True):
        assert np.array_equal(with_future.position, without.position)
        assert np.array_equal(with_future.quaternion, without.quaternion)


def test_only_the_window_moves(one):
    """A new sweep leaves what is older than the window where it was, to the bit, and memory holds the window's sweeps."""
    live = LiveDrift(MOUNTS["rig"], CHOSEN, NavigateSettings())
    for sweep in one.store:
        before = None if live.solution is None else live.solution.path
        path = live.add(sweep, one.log)
    assert before is not None
    begin = path.time[-1] - CHOSEN.live_window - 2.5
    old = before.time < begin
    assert old.sum() > 50
    assert np.array_equal(path.position[: old.sum()], before.position[old])
    assert len(live._sweeps) <= 7
    assert len(live.solution.rounds) == 2


def test_a_first_sweep_of_one_profile_shifts_nothing_in_time(one, tmp_path):
    """It cannot be estimated; the others' poses are theirs, at their stamps."""
    store = SweepStore(tmp_path / "short")
    whole = one.store.load(0)
    only = whole.profile == len(whole.stamp_ns) - 1
    columns = {name: getattr(whole, name)[only] for name in ("points", "sigma", "intensity", "row")}
    last = {"stamp_ns": whole.stamp_ns[-1:], "alpha": whole.alpha[-1:], "profile": np.zeros(only.sum(), np.int32)}
    store.add(replace(whole, **columns, **last))
    for sweep in list(one.store)[1:]:
        store.add(sweep)
    store.finish([])
    _, navigated = register_dive(one)
    made = register(store, one.log, navigated, RegisterSettings(drift=CHOSEN, live=True), NavigateSettings())
    assert floor_error(one, made.trajectory) < 1.5 * floor_error(one, true_trajectory(one.store.stamps()))


def test_sweeps_that_hold_nothing_to_go_on_are_refused_in_one_line(one, tmp_path):
    """Two sweeps of one profile each."""
    store = SweepStore(tmp_path / "nothing")
    for index in (0, 1):
        whole = one.store.load(index)
        only = whole.profile == 0
        columns = {name: getattr(whole, name)[only] for name in ("points", "sigma", "intensity", "row", "profile")}
        store.add(replace(whole, **columns, stamp_ns=whole.stamp_ns[:1], alpha=whole.alpha[:1]))
    store.finish([])
    _, navigated = register_dive(one)
    with pytest.raises(GarbiError, match="no sweep holds two profiles"):
        register(store, one.log, navigated, RegisterSettings(drift=CHOSEN, live=True), NavigateSettings())


def test_sweeps_out_of_order_are_refused(one):
    """One line, and what was found stays."""
    live = LiveDrift(MOUNTS["rig"], CHOSEN, NavigateSettings())
    live.add(one.store.load(1), one.log)
    with pytest.raises(GarbiError, match="sweep 0: not newer"):
        live.add(one.store.load(0), one.log)
    assert live.solution is not None
