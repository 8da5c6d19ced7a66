"""A second dive over the same site: what is declared has changed, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from tools.simulator.dive import Dive
from tools.simulator.movers import moved
from tools.simulator.scenario import Mover, Route, Scenario, Seabed, Thing


def site(seed: int, *things: Thing) -> Dive:
    seabed = Seabed(seed=5, stones=4.0, cell=0.02, margin=0.6, things=things)
    return Dive(Scenario(seed=seed, duration=1.0, route=Route(kind="station"), seabed=seabed))


def test_another_dive_over_the_same_site_differs_where_a_thing_was_moved() -> None:
    """Another seed gives other sensors and the same seabed; a ball that moved is the only difference."""
    ball = Thing(kind="sphere", size=0.05, at=(0.1, 0.0))
    first, second = site(1, ball), site(2, ball.model_copy(update={"at": (0.2, 0.0)}))
    here, there = (dive.scene.mesh[0] for dive in (first, second))
    assert here.shape == there.shape
    changed = np.abs(here - there).max(axis=1) > 1e-12
    assert 0 < changed.sum() < 0.2 * len(here)
    np.testing.assert_allclose((there - here)[changed, 0], 0.1, atol=1e-9)
    assert first.rig.to_yaml() != second.rig.to_yaml()


@pytest.mark.parametrize("kind", ["stone", "block", "sphere"])
def test_things_stand_on_the_ground(kind: str) -> None:
    """Not buried, not in the water."""
    bare, laid = site(1), site(1, Thing(kind=kind, size=0.06, at=(0.0, 0.0)))  # type: ignore[arg-type]
    above = laid.scene.mesh[0][len(bare.scene.mesh[0]) :]
    ground, _ = bare.scene.distances(above, 0.0)
    assert ground.min() < 0.02
    assert 0.02 < ground.max() < 0.15


def test_points_on_what_moves_are_told_from_the_seabed() -> None:
    """By the distance of a point from either, at the moment it was seen."""
    from garbi_map.sweep import laser_angle, make_sweeps
    from garbi_map.sweep.settings import SweepSettings

    ball = Mover(kind="sphere", size=0.2, start=(0.25, 0.0, 0.4))
    scenario = site(1).scenario.model_copy(update={"movers": (ball,), "duration": 3.0})
    dive = Dive(scenario).fly()
    angle = laser_angle(dive.navigation().encoder, dive.rig, SweepSettings())
    sweeps = list(make_sweeps(dive.stripes(workers=0), dive.rig, angle, SweepSettings()))
    mover, still = (np.concatenate(part) for part in zip(*(moved(dive, sweep) for sweep in sweeps), strict=True))
    assert not (mover & still).any()
    assert mover.sum() > 50
    assert (mover | still).mean() > 0.99
