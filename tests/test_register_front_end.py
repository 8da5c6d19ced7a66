"""Sweeps against the map, loops, and the graph that settles them."""

from __future__ import annotations

import numpy as np
import pytest
from scanned_floor import MOUNTS, Floor, flat, sweep, true_trajectory, wavy
from scipy.spatial.transform import Rotation

from garbi_map.navigate.deskew import place
from garbi_map.register.front_end import (
    Constraint,
    ScanToMap,
    close_loops,
    information_of,
    onto_planes,
    remap,
    scan_to_map,
)
from garbi_map.register.pose_graph import optimise
from garbi_map.register.settings import FrontEndSettings
from garbi_map.register.surfels import Surfels, extract_surfels, join, match_surfels

SETTINGS = FrontEndSettings()
TRUSTING = FrontEndSettings(weakest=1e5)
"""So few surfels fix yaw and one axis only to a millimetre, which the usual settings call too little."""
FIRST, NEXT, LAST = 0, 1, 2
"""Three sweeps of nearly the same place."""


def stony(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Twice the relief."""
    return 2.0 * wavy(x, y) + 3.0


def points_in_map(number: int, floor: Floor, finer: int = 3) -> np.ndarray:
    """The points (n, 3) of a sweep placed by the true poses."""
    one = sweep(number, floor, np.random.default_rng(number), finer)
    return place(one, true_trajectory(one.stamp_ns).mounted(MOUNTS["rig"]))


def surfels_of(number: int, points: np.ndarray, size: float = 0.03) -> Surfels:
    n = len(points)
    camera = np.tile([0.2, 0.0, -1.6], (n, 1))
    when = np.full(n, 2.0 * number)
    return extract_surfels(points, np.full(n, 3e-4), np.arange(n), when, np.full(n, number, np.int64), camera, size, 8)


def moved_about(points: np.ndarray, shift: list[float], turn: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """The points turned about their centre and shifted, and the transform (4, 4) that undoes it."""
    centre, rotation = points.mean(axis=0), Rotation.from_rotvec(turn)
    undo = np.eye(4)
    undo[:3, :3] = rotation.inv().as_matrix()
    undo[:3, 3] = centre - rotation.inv().apply(centre + shift)
    return rotation.apply(points - centre) + centre + shift, undo


def applied(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ transform[:3, :3].T + transform[:3, 3]


def as_transform(shift: list[float], turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
    return out


def picked(surfels: Surfels, rows: np.ndarray) -> Surfels:
    return Surfels(
        surfels.mean[rows], surfels.normal[rows], surfels.time[rows], surfels.sweep[rows], surfels.thickness[rows]
    )


SHIFT, TURN = [0.008, -0.006, 0.005], [0.003, -0.002, 0.004]


def test_a_moved_sweep_is_brought_near_by_its_points():
    """kiss-icp, point to point, undoes most of a centimetre and all of a quarter of a degree; an empty map has no say."""
    first, second = points_in_map(FIRST, stony), points_in_map(NEXT, stony)
    front_end = ScanToMap(SETTINGS)
    assert front_end.align(second, np.eye(4)) == pytest.approx(np.eye(4))
    front_end.insert(first, np.eye(4))
    moved, _ = moved_about(second, SHIFT, TURN)
    found = front_end.align(moved, np.eye(4))
    off = applied(found, moved) - second
    assert np.linalg.norm(off.mean(axis=0)) < 0.35 * np.linalg.norm(SHIFT)
    assert (Rotation.from_matrix(found[:3, :3]) * Rotation.from_rotvec(TURN)).magnitude() < 1e-3


def test_a_moved_sweep_is_brought_back_by_its_planes():
    """What the points leave undone the planes undo, to half a millimetre, and the same from a near start or none."""
    first, second = surfels_of(FIRST, points_in_map(FIRST, stony)), surfels_of(NEXT, points_in_map(NEXT, stony))
    rows = match_surfels(join(first, second), 0.05, np.inf)
    moved, _ = moved_about(np.vstack([second.mean, second.mean + second.normal]), SHIFT, TURN)
    n = len(second.mean)
    off = Surfels(moved[:n], moved[n:] - moved[:n], second.time, second.sweep, second.thickness)
    pairs = rows[0], rows[1] - len(first.mean)
    near = as_transform([-0.006, 0.004, -0.005])
    for start in (np.eye(4), near):
        found = onto_planes(picked(off, pairs[1]), picked(first, pairs[0]), start, TRUSTING)
        assert np.linalg.norm(applied(found, off.mean) - second.mean, axis=1).max() < 1e-3


def test_the_correction_of_a_moved_sweep_is_found_and_handed_on():
    """Scan to map over surfels: the second sweep is brought back, the third, moved likewise, too; constraints say so."""
    pieces, true = [surfels_of(FIRST, points_in_map(FIRST, stony))], []
    for number in (NEXT, LAST):
        points = points_in_map(number, stony)
        moved, _ = moved_about(points, SHIFT, [0.0, 0.0, 0.0])
        pieces.append(surfels_of(number, moved))
        true.append(points.mean(axis=0))
    surfels = join(join(*pieces[:2]), pieces[2])
    corrections, constraints = scan_to_map(surfels, TRUSTING)
    assert len(corrections) == 3
    assert corrections[0] == pytest.approx(np.eye(4))
    for correction, centre in zip(corrections[1:], true, strict=True):
        assert applied(correction, centre + SHIFT) == pytest.approx(centre, abs=1e-3)
    assert [constraint.second for constraint in constraints] == [1, 2]
    for constraint in constraints:
        expected = np.linalg.inv(corrections[constraint.first]) @ corrections[constraint.second]
        assert constraint.transform == pytest.approx(expected)
        assert not constraint.uncertain


def test_over_a_flat_floor_a_sweep_is_not_slid():
    """Height and tilt are corrected, x, y and yaw are left alone: nothing tells of them."""
    pieces = [surfels_of(FIRST, points_in_map(FIRST, flat))]
    moved, _ = moved_about(points_in_map(NEXT, flat), [0.012, 0.009, 0.004], [0.0, 0.0, 0.01])
    surfels = join(pieces[0], surfels_of(NEXT, moved))
    corrections, _ = scan_to_map(surfels, SETTINGS)
    centre = moved.mean(axis=0)
    change = applied(corrections[1], centre) - centre
    assert change[2] == pytest.approx(-0.004, abs=3e-4)
    assert np.abs(change[:2]).max() < 1e-3
    assert abs(Rotation.from_matrix(corrections[1][:3, :3]).as_rotvec()[2]) < 1e-3


def test_remapping_keeps_only_what_the_geometry_fixes():
    """On a plane: x, y and yaw go, z, roll and pitch stay; on enough slopes everything stays."""
    random = np.random.default_rng(0)
    mean = random.uniform(-0.5, 0.5, (900, 3)) + np.array([3.0, -2.0, -4.0])
    level = np.tile([0.0, 0.0, 1.0], (900, 1))
    sloped = level + random.normal(0, 0.4, (900, 3))
    sloped /= np.linalg.norm(sloped, axis=1, keepdims=True)
    nothing = np.zeros(900)
    transform = about(mean.mean(axis=0), [0.005, 0.004, 0.003], [0.002, 0.001, 0.003])
    for normal, shift, kept_turn in (
        (level, [0.0, 0.0, 0.003], [0.002, 0.001, 0.0]),
        (sloped, [0.005, 0.004, 0.003], [0.002, 0.001, 0.003]),
    ):
        surfels = Surfels(mean, normal, nothing, nothing.astype(int), nothing)
        information, middle = information_of(surfels, np.arange(900))
        kept = remap(transform, information, middle, 1e7)
        assert applied(kept, middle) - middle == pytest.approx(shift, abs=6e-5)
        assert Rotation.from_matrix(kept[:3, :3]).as_rotvec() == pytest.approx(kept_turn, abs=6e-5)


def test_a_loop_is_closed_and_says_how_far_it_was_off():
    """Sweeps 0 and 2 see the same stones, the second 6 mm away: one loop, which undoes it."""
    first = surfels_of(FIRST, points_in_map(FIRST, stony))
    points = points_in_map(LAST, stony)
    moved, _ = moved_about(points, [0.004, -0.003, 0.003], [0.0, 0.0, 0.0])
    (loop,) = close_loops(join(first, surfels_of(LAST, moved)), [np.eye(4)] * 3, SETTINGS)
    assert (loop.first, loop.second, loop.uncertain) == (0, 2, True)
    assert applied(loop.transform, moved.mean(axis=0)) == pytest.approx(points.mean(axis=0), abs=1e-3)
    assert np.linalg.eigvalsh(loop.information).min() > 0


def test_a_wrong_overlap_is_no_loop():
    """Another stretch of floor, taken for the same one: it matches here and there, but does not agree."""
    first = surfels_of(FIRST, points_in_map(FIRST, stony))
    elsewhere = points_in_map(LAST, lambda x, y: stony(x + 0.7, y - 0.4) + 0.01 * np.sin(25.0 * x))
    wrong = join(first, surfels_of(LAST, elsewhere))
    assert close_loops(wrong, [np.eye(4)] * 3, SETTINGS) == []


def test_too_few_matches_are_no_loop():
    """A corner that both see is not enough to close a loop on."""
    first = surfels_of(FIRST, points_in_map(FIRST, stony))
    points = points_in_map(LAST, stony)
    corner = points[np.argsort(points[:, 0])[:400]]
    assert close_loops(join(first, surfels_of(LAST, corner)), [np.eye(4)] * 3, SETTINGS) == []


NEIGHBOUR = np.array([0.004, 0.004, 0.004, 0.002, 0.002, 0.002])


def sure(first: int, second: int, transform: np.ndarray, centre: np.ndarray, uncertain: bool = False) -> Constraint:
    return Constraint(first, second, transform, np.diag([1e9] * 3 + [1e8] * 3), centre, uncertain)


def about(centre: np.ndarray, shift: list[float], turn: list[float]) -> np.ndarray:
    """A motion about a centre, as a transform (4, 4)."""
    out = np.eye(4)
    rotation = Rotation.from_rotvec(turn)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), centre + shift - rotation.apply(centre)
    return out


def test_consistent_constraints_are_kept_and_the_first_sweep_stays():
    """Constraints made from known corrections give those corrections, ten metres from the origin too."""
    centre = np.array([9.0, -4.0, -12.0])
    random = np.random.default_rng(3)
    true = [np.eye(4)] + [about(centre, random.normal(0, 2e-3, 3), random.normal(0, 1e-3, 3)) for _ in range(5)]
    pairs = [(k, k + 1) for k in range(5)] + [(0, 3), (1, 5)]
    constraints = [sure(i, j, np.linalg.inv(true[i]) @ true[j], centre, j - i > 1) for i, j in pairs]
    found = optimise([np.eye(4)] * 6, constraints, NEIGHBOUR)
    assert found[0] == pytest.approx(np.eye(4), abs=1e-12)
    for one, other in zip(found, true, strict=True):
        assert applied(one, centre) == pytest.approx(applied(other, centre), abs=2e-4)


def test_a_false_loop_is_switched_off():
    """Half a metre that nothing else supports does not move anything by a millimetre."""
    centre = np.array([1.0, 0.5, -3.0])
    honest = [sure(k, k + 1, np.eye(4), centre) for k in range(5)]
    honest += [sure(0, 2, np.eye(4), centre, True), sure(1, 4, np.eye(4), centre, True)]
    false = sure(0, 5, about(centre, [0.5, 0.0, 0.1], [0.0, 0.0, 0.05]), centre, True)
    for transform in optimise([np.eye(4)] * 6, [*honest, false], NEIGHBOUR):
        assert applied(transform, centre) == pytest.approx(centre, abs=1e-3)


def test_one_sweep_needs_no_graph():
    """Nothing to settle."""
    assert optimise([np.eye(4)], [], NEIGHBOUR)[0] == pytest.approx(np.eye(4))
    assert optimise([], [], NEIGHBOUR) == []
