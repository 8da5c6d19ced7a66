"""Marine snow and reflections go; stones, cables and vertical faces stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from seabed_scene import Floats, Height, plane, scan, snowed

from garbi_map.seabed import AcceptedPoints, SeabedBuilder, SeabedSettings, Verdict
from garbi_map.seabed.builder import Posed


def judged(posed: list[Posed]) -> list[AcceptedPoints]:
    """Both passes."""
    builder = SeabedBuilder(SeabedSettings())
    for every in posed:
        builder.observe(*every)
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
    """Points all the way up a vertical wall of 20 cm."""
    rng = np.random.default_rng(0)
    posed = []
    for k in range(3):
        sweep, poses = scan(plane, k)
        wall = (sweep.row >= 140) & (sweep.row < 180)
        placed = poses.rotation[0].apply(sweep.points) + poses.position[0]
        placed[wall, 1] = 0.3 + 0.0005 * rng.standard_normal(wall.sum())
        placed[wall, 2] = 0.2 * placed[wall, 0] + (sweep.row[wall] - 140) * 0.005
        points = poses.rotation[0].inv().apply(placed - poses.position[0])
        posed.append((replace(sweep, points=points), poses))
    for (sweep, _), points in zip(posed, judged(posed), strict=True):
        assert points.mask[(sweep.row >= 140) & (sweep.row < 180)].mean() > 0.995


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
