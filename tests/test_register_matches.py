"""What matched surfels say of the motion, against finite differences of their distance."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from test_register_factors import END, UP, Rows, by_differences, some_motion

from garbi_map.register.drift import Belief, matched
from garbi_map.register.motion import Motion
from garbi_map.register.surfels import Surfels, match_surfels


def added(rows: Rows, *what: Any, **how: Any) -> tuple[int, float]:
    """Matches, put into rows: how many there are, and their median distance."""
    found = matched(*what, **how)
    if found is None:
        return 0, 0.0
    found.add_to(rows)  # type: ignore[arg-type]
    return len(found.residual), found.distance


def placed_surfels(motion: Motion) -> tuple[np.ndarray, np.ndarray, Callable[[], np.ndarray], Callable[[], np.ndarray]]:
    """Forty places seen by two sweeps each, a few millimetres apart: times, sweeps, their means and their normals as the
    motion has them."""
    random = np.random.default_rng(9)
    time = random.uniform(0.1, END - 0.1, 80)
    sweep = np.repeat([0, 1], 40)
    place = np.tile(random.uniform(-1.0, 1.0, (40, 3)) - [0.0, 0.0, 1.5], (2, 1)) + random.normal(0, 0.003, (80, 3))
    body = motion.rotation(time).inv().apply(place - motion.position(time))
    normal = np.tile(random.normal(0, 0.3, (40, 3)) + UP, (2, 1))
    across = motion.rotation(time).inv().apply(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    return (
        time,
        sweep,
        lambda: motion.rotation(time).apply(body) + motion.position(time),
        lambda: motion.rotation(time).apply(across),
    )


def along_the_normal(normal: np.ndarray, other: np.ndarray, between: np.ndarray) -> np.ndarray:
    """How far apart two surfels are along the mean of their normals."""
    mean = normal + other
    return np.einsum("nk,nk->n", mean / np.linalg.norm(mean, axis=1, keepdims=True), between)


def surfels_of(time: np.ndarray, sweep: np.ndarray, mean: np.ndarray, normal: np.ndarray) -> Surfels:
    return Surfels(mean, normal, time, sweep, np.zeros(len(time)))


def test_the_derivatives_of_matches_are_those_of_the_distance_along_the_normal():
    """Both poses move and both normals turn: each row is d/dx of n . (m_i - m_j) in every unknown."""
    motion = some_motion(0.0)
    time, sweep, means, normals = placed_surfels(motion)
    surfels, rows = surfels_of(time, sweep, means(), normals()), Rows(motion.size)
    count, distance = added(rows, motion, surfels, 0.05, np.inf, Belief(1e-3))  # type: ignore[arg-type]
    first, second = match_surfels(surfels, 0.05, np.inf)

    def residual() -> np.ndarray:
        moved, normal = means(), normals()
        return along_the_normal(normal[first], normal[second], moved[first] - moved[second])

    assert count == len(first) >= 40
    assert rows.residual == pytest.approx(residual())
    assert distance == pytest.approx(np.median(np.abs(residual())))
    assert rows.matrix == pytest.approx(by_differences(motion, residual), abs=1e-7)


def test_a_turn_of_the_whole_map_changes_no_match():
    """Sweeps say nothing of north: what turns everything rigidly is in the null space of the matches."""
    motion = some_motion(0.0)
    time, sweep, means, normals = placed_surfels(motion)
    rows = Rows(motion.size)
    added(rows, motion, surfels_of(time, sweep, means(), normals()), 0.05, np.inf, Belief(1e-3))  # type: ignore[arg-type]
    turn = np.array([0.2, -0.3, 1.0])
    whole = np.zeros(motion.size)
    whole[: motion.attitude_offset] = np.cross(turn, motion.position_control).ravel()
    whole[motion.attitude_offset :][: motion.attitude_control.size] = np.tile(turn, len(motion.attitude_control))
    assert np.abs(rows.matrix).max() > 0.1
    assert np.abs(rows.matrix @ whole).max() < 1e-9


def test_matches_of_many_views_share_what_they_know():
    """Five views of one place make ten matches; their weights sum to that of the squares about the views' mean."""
    motion, views = some_motion(0.0), 5
    time, sweep = np.linspace(0.2, 1.0, views), np.arange(views)
    surfels = surfels_of(time, sweep, np.zeros((views, 3)), np.tile(UP, (views, 1)))
    once, twice = Rows(motion.size), Rows(motion.size)
    added(once, motion, surfels, 0.05, np.inf, Belief(1e-3))  # type: ignore[arg-type]
    added(twice, motion, surfels, 0.05, np.inf, Belief(1e-3, looks=2))  # type: ignore[arg-type]
    assert once.sigmas[0] == pytest.approx(np.full(10, 1e-3 * np.sqrt(views / 2.0)))
    assert twice.sigmas[0] == pytest.approx(once.sigmas[0] * np.sqrt(2.0))


def test_a_match_is_less_sure_the_farther_apart_its_surfels_are_along_the_surface():
    """A surface leaves its tangent plane: three per cent of the lateral offset."""
    motion = some_motion(0.0)
    time, sweep, means, normals = placed_surfels(motion)
    surfels, rows = surfels_of(time, sweep, means(), normals()), Rows(motion.size)
    added(rows, motion, surfels, 0.05, np.inf, Belief(1e-3))  # type: ignore[arg-type]
    first, second = match_surfels(surfels, 0.05, np.inf)
    between = surfels.mean[first] - surfels.mean[second]
    away = np.sum(between**2, axis=1) - along_the_normal(surfels.normal[first], surfels.normal[second], between) ** 2
    alone = np.bincount(np.r_[first, second])
    lonely = (alone[first] == 1) & (alone[second] == 1)
    assert lonely.sum() > 20
    assert rows.sigmas[0][lonely] == pytest.approx(np.sqrt(1e-6 + 0.03**2 * away)[lonely], rel=1e-6)


def test_a_settled_surfel_stays_where_it_is():
    """Only the moving one of a pair has derivatives, and two settled ones are not matched at all."""
    motion = some_motion(0.0)
    time, sweep, means, normals = placed_surfels(motion)
    everything = surfels_of(time, sweep, means(), normals())
    moving, settled = everything.select(sweep == 0), everything.select(sweep == 1)
    rows = Rows(motion.size)
    count, _ = added(rows, motion, moving, 0.05, np.inf, Belief(1e-3), settled)  # type: ignore[arg-type]
    first, second = match_surfels(everything, 0.05, np.inf)
    there = everything.mean[second], everything.normal[second]
    expected = by_differences(motion, lambda: along_the_normal(normals()[first], there[1], means()[first] - there[0]))
    assert count == len(first)
    assert rows.matrix == pytest.approx(expected, abs=1e-7)
    nothing = everything.select(np.zeros(len(time), bool))
    twice = Surfels(everything.mean, everything.normal, everything.time, everything.sweep, everything.thickness)
    assert added(Rows(motion.size), motion, nothing, 0.05, np.inf, Belief(1e-3), twice) == (0, 0.0)  # type: ignore[arg-type]
