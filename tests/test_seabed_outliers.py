"""Marine snow and reflections go; stones, cables and vertical faces stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from seabed_scene import Floats, Height, plane, scan, snowed

from garbi_map.seabed import AcceptedPoints, SeabedBuilder, SeabedSettings, Verdict
from garbi_map.seabed.builder import Posed


def judged(posed: list[Posed]) -> list[AcceptedPoints]:
    """All passes."""
    builder = SeabedBuilder(SeabedSettings())
    for every in posed:
        builder.observe(*every)
    for every in posed:
        builder.see_through(*every)
    return [builder.add(*every) for every in posed]


def kept(height: Height, special: Height, sweeps: int = 4, **scene: float) -> float:
    """Share of the points where `special` is true that are accepted."""
    posed = [scan(height, k, **scene) for k in range(sweeps)]  # type: ignore[arg-type]
    good = total = 0
    for (sweep, poses), points in zip(posed, judged(posed), strict=True):
        placed = poses.rotation[0].apply(sweep.points) + poses.position[0]
        mine = special(placed[:, 0], placed[:, 1]).astype(bool)
        good += int(points.mask[mine].sum())
        total += int(mine.sum())
    assert total > 20
    return good / total


@pytest.mark.parametrize("sweeps", [1, 2, 6])
def test_marine_snow_is_rejected_and_the_floor_is_not(sweeps: int) -> None:
    """150 flakes a sweep in the water: nearly all go, with less than one in a thousand points of the floor."""
    snowy, flakes = [], []
    for k in range(sweeps):
        sweep, poses = scan(plane, k)
        sweep, flake = snowed(sweep, 150, k)
        snowy.append((sweep, poses))
        flakes.append(flake)
    verdicts = judged(snowy)
    flake = np.concatenate(flakes)
    mask = np.concatenate([points.mask for points in verdicts])
    assert flake.sum() > 300 * sweeps
    assert 1 - mask[flake].mean() > 0.97
    assert mask[~flake].mean() > 0.999


def test_a_reflection_that_one_sweep_of_many_shows_is_rejected() -> None:
    """A ghost line of 60 rows, 20 cm above the floor, in one profile of one of 14 sweeps."""
    posed = [scan(plane, k, profiles=120) for k in range(14)]
    sweep, poses = posed[5]
    ghost = (sweep.profile == 50) & (sweep.row >= 100) & (sweep.row < 160)
    points = np.where(ghost[:, None], sweep.points * 0.87, sweep.points)
    posed[5] = (replace(sweep, points=points), poses)
    verdict = judged(posed)[5].verdict
    assert (verdict[ghost] == Verdict.SEEN_THROUGH).mean() > 0.9
    assert (verdict[~ghost] == Verdict.ACCEPTED).all()


def test_small_stones_stay() -> None:
    """Stones of 2 cm, seen by a handful of rows in each of two profiles."""

    def on_stone(x: Floats, y: Floats) -> Floats:
        return np.hypot((x % 0.1) - 0.05, (y % 0.1) - 0.05) < 0.01

    def stones(x: Floats, y: Floats) -> Floats:
        return np.where(on_stone(x, y), 0.012, 0.0)

    assert kept(stones, on_stone, sweeps=1) > 0.99
    assert kept(stones, on_stone, sweeps=4) > 0.99


@pytest.mark.parametrize("along", ["across the profiles", "along the profiles"])
def test_a_thin_cable_in_the_water_stays(along: str) -> None:
    """4 mm thick, 6 cm above the floor, seen by two rows of each profile, or by a profile now and then."""

    def on_cable(x: Floats, y: Floats) -> Floats:
        return np.abs((y if along == "across the profiles" else x) - 0.301) < 0.002

    def cable(x: Floats, y: Floats) -> Floats:
        return np.where(on_cable(x, y), 0.06, 0.0)

    assert kept(cable, on_cable, sweeps=6) > 0.97


def test_vertical_faces_stay() -> None:
    """Points all the way up a vertical wall at y = 0.52 m, which hides 5 cm of the floor behind it."""
    rng = np.random.default_rng(0)
    posed, faces = [], []
    for k in range(3):
        sweep, poses = scan(plane, k)
        eye, turn = poses.position[0], poses.rotation[0]
        ray = turn.apply(sweep.points)
        behind = eye[1] + ray[:, 1]
        wall = (behind > 0.52) & (behind < 0.575)
        short = np.where(wall, (0.52 - eye[1] + 0.0005 * rng.standard_normal(len(ray))) / ray[:, 1], 1.0)
        posed.append((replace(sweep, points=turn.inv().apply(ray * short[:, None])), poses))
        faces.append(wall)
    for points, wall in zip(judged(posed), faces, strict=True):
        assert wall.sum() > 1000
        assert points.mask[wall].mean() > 0.995


def test_what_swims_by_is_kept_apart_and_the_floor_under_it_stays() -> None:
    """A plate of 12 by 6 cm, 25 cm above the floor, elsewhere in each of five sweeps; many rows of many profiles."""
    posed, fish = [], []
    for k in range(5):

        def swimming(x: Floats, y: Floats, k: int = k) -> Floats:
            return (np.abs(x - 0.1 - 0.1 * k) < 0.06) & (np.abs(y - 0.3) < 0.03)

        def scene(x: Floats, y: Floats) -> Floats:
            return np.where(swimming(x, y), 0.25, plane(x, y))

        posed.append(scan(scene, k))
        sweep, poses = posed[-1]
        placed = poses.rotation[0].apply(sweep.points) + poses.position[0]
        fish.append(placed[:, 2] > 0.2)
    everything = judged(posed)
    verdict = np.concatenate([points.verdict for points in everything])
    swims = np.concatenate(fish)
    assert swims.sum() > 1000
    assert (verdict[swims] == Verdict.SEEN_THROUGH).mean() > 0.9
    assert (verdict[~swims] == Verdict.ACCEPTED).mean() > 0.995
    apart = np.concatenate([points.moving.points for points in everything if points.moving is not None])
    assert len(apart) == (verdict == Verdict.SEEN_THROUGH).sum()
    assert (apart[:, 2] > 0.2).mean() > 0.99


def test_broken_points_are_left_out_and_counted() -> None:
    """Not finite, without sigma, kilometres away, or hopelessly uncertain."""
    sweep, poses = scan(plane, 0)
    points, sigma = sweep.points.copy(), sweep.sigma.copy()
    points[10] = np.nan
    points[11] = np.inf
    points[12] = 1e7
    sigma[13] = np.nan
    sigma[14] = 0.0
    sigma[15] = 0.2
    (verdict,) = judged([(replace(sweep, points=points, sigma=sigma), poses)])
    assert verdict.rejected == {"invalid": 5, "uncertain": 1, "isolated": 0, "seen through": 0, "off surface": 0}


def test_a_sweep_without_points_is_no_trouble() -> None:
    """Nothing in, nothing out, and the others are not disturbed."""
    sweep, poses = scan(plane, 0)
    empty = replace(
        sweep,
        points=sweep.points[:0],
        sigma=sweep.sigma[:0],
        intensity=sweep.intensity[:0],
        profile=sweep.profile[:0],
        row=sweep.row[:0],
    )
    nothing, whole = judged([(empty, poses), (sweep, poses)])
    assert len(nothing.points) == 0
    assert whole.mask.all()


def plate_kept(views: list[tuple[float, bool]], side: float, height: float) -> float:
    """Share of the points of a plate, so wide about x = y = 0.3 m, that is kept; views: where each sweep begins, m, and
    whether the plate was there."""
    posed, on = [], []
    for k, (begin, there) in enumerate(views):

        def plate(x: Floats, y: Floats, there: bool = there) -> Floats:
            return there & (np.abs(x - 0.3) < side / 2) & (np.abs(y - 0.3) < side / 2)

        def scene(x: Floats, y: Floats, plate: Height = plate) -> Floats:
            return np.where(plate(x, y), height, 0.0)

        sweep, poses = scan(scene, k, begin=begin)
        ray, eye = poses.rotation[0].apply(sweep.points), poses.position[0]
        hit = eye[2] + ray[:, 2] > 0.5 * height
        higher = eye[:2] + ray[:, :2] * (eye[2] - height) / eye[2]
        lit = hit | ~plate(higher[:, 0], higher[:, 1])  # the rest of the floor lies in the plate's shadow
        kept_of = {name: getattr(sweep, name)[lit] for name in ("points", "sigma", "intensity", "profile", "row")}
        posed.append((replace(sweep, **kept_of), poses))
        on.append(hit[lit])
    mask = np.concatenate([points.mask for points in judged(posed)])
    plate_points = np.concatenate(on)
    assert plate_points.sum() > 50
    assert mask[~plate_points].mean() > 0.999
    return float(mask[plate_points].mean())


def test_the_part_of_a_body_that_was_looked_at_again_speaks_for_the_rest() -> None:
    """Of a plate of 20 cm later sweeps see through a half; all of it goes. Where they see it again, all of it stays."""
    assert plate_kept([(0.0, True), (0.25, False), (0.25, False)], side=0.2, height=0.25) < 0.02
    assert plate_kept([(0.0, True), (0.25, True), (0.25, True)], side=0.2, height=0.25) > 0.99


def test_what_floats_over_the_seabed_is_none_of_it_unless_it_is_seen_again() -> None:
    """No ray passes through a plate 70 cm up, but two sweeps see the floor under it from the side."""
    beside = [(-0.25, False), (-0.25, False)]
    assert plate_kept([(0.0, True), *beside], side=0.04, height=0.7) < 0.02
    assert plate_kept([(0.0, True), *beside, (0.0, True)], side=0.04, height=0.7) > 0.99


def test_what_stands_on_the_seabed_stays_although_it_was_seen_once() -> None:
    """The top of a box, 10 cm above the floor on all sides, in a single sweep."""
    assert plate_kept([(0.0, True)], side=0.2, height=0.1) > 0.99
