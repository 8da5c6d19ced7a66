"""What the drift benchmark measures, against cases whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from garbi_map.evaluate import Truth
from garbi_map.navigate import NavigateSettings
from tools.bench.dives import REMOVED, BenchDive, scenarios
from tools.bench.relief import find_stones, kept
from tools.bench.scores import honesty, together
from tools.simulator import shapes


def errors(seed: int, memory: float, n: int = 4000) -> np.ndarray:
    """Unit errors (n, 3) of which each is `memory` times the one before plus news."""
    news = np.random.default_rng(seed).normal(size=(n + 200, 3)) * np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], news, axis=0)[200:]


@pytest.mark.parametrize("memory", [0.0, 0.8, 0.95])
def test_independent_errors_are_counted(memory: float) -> None:
    """A first-order process of correlation a has n (1 - a) / (1 + a) independent values."""
    found = np.mean([honesty(errors(seed, memory), np.tile(np.eye(3), (4000, 1, 1))).independent for seed in range(8)])
    assert found == pytest.approx(3 * 4000 * (1 - memory) / (1 + memory), rel=0.25)


def test_honest_covariances_lie_in_the_band_and_others_do_not() -> None:
    """Nineteen of twenty honest dives, and all of them together; half or double the sigma is told."""
    turned = np.diag([1.0, 4.0, 0.25])
    parts = [honesty(errors(seed, 0.9) * [1.0, 2.0, 0.5], np.tile(turned, (4000, 1, 1))) for seed in range(40)]
    inside = [part.band[0] <= part.nees <= part.band[1] for part in parts]
    assert np.mean(inside) > 0.85
    whole = together(parts)
    assert whole.band[0] <= whole.nees <= whole.band[1]
    for wrong in (0.5, 2.0):
        part = honesty(wrong * errors(3, 0.9), np.tile(np.eye(3), (4000, 1, 1)))
        assert not part.band[0] <= part.nees <= part.band[1]


@pytest.fixture(scope="module")
def field() -> tuple[Truth, np.ndarray]:
    """Rippled ground with 25 domes of 2 cm and a long ridge, and the places of the domes."""
    x = np.arange(-0.6, 0.6, 0.004)
    xx, yy = np.meshgrid(x, x)
    heights = 0.008 * np.cos(2 * np.pi * xx / 0.2) + 0.02 * np.exp(-(((yy - 0.5) / 0.05) ** 2))
    grid = np.linspace(-0.4, 0.3, 5)
    places = np.array([(a, b) for a in grid for b in grid])
    for a, b in places:
        heights = np.maximum(heights, heights + 0.02 * np.maximum(1 - ((xx - a) ** 2 + (yy - b) ** 2) / 0.02**2, 0.0))
    mesh = shapes.grid(heights, x, x)
    return Truth(None, mesh, mesh[0]), places


def test_small_stones_are_found_and_nothing_else(field: tuple[Truth, np.ndarray]) -> None:
    """All domes, neither ripples nor the ridge."""
    truth, places = field
    stones = find_stones(truth)
    assert len(stones.summit) == len(places)
    off = np.linalg.norm(stones.summit[:, None] - places[None], axis=2).min(axis=1)
    assert off.max() < 0.006


def test_a_smoothed_map_loses_its_stones(field: tuple[Truth, np.ndarray]) -> None:
    """The surface's own points keep all of them, the same points with relief halved none; uncovered stones are lost."""
    truth, _ = field
    assert truth.surface is not None
    stones = find_stones(truth)
    points = truth.surface[0]
    whole = stones.heights_in(points)
    assert kept(stones, whole, whole) == (25, 100.0, pytest.approx(100.0))
    flattened = stones.heights_in(points * [1.0, 1.0, 0.5])
    count, share, relief = kept(stones, whole, flattened)
    assert (count, share) == (25, 0.0) and relief == pytest.approx(50, abs=2)
    half = stones.heights_in(points[points[:, 0] < -0.05])
    count, share, _ = kept(stones, whole, half)
    assert count == 25 and 0 < share < 60


def test_scenarios_are_valid_and_their_seeds_are_their_own() -> None:
    """At least six, each with a seed that no other has."""
    seeds = [scenario.seed for scenario in scenarios().values()]
    assert len(seeds) >= 6 and len(set(seeds)) == len(seeds)


def test_what_is_removed_is_gone() -> None:
    """Of measurements that hold every sensor, none of those removed is left, and the encoder always is."""
    from tools.simulator.dive import Dive
    from tools.simulator.scenario import Route, Scenario, Seabed

    small = Scenario(duration=1.0, route=Route(kind="station"), seabed=Seabed(margin=0.3, stones=0.0))
    dive = BenchDive("station", None, None, Dive(small).fly().navigation(), Truth(), 1.0)  # type: ignore[arg-type]
    for removed, gone in REMOVED.items():
        left, settings = dive.without(removed, NavigateSettings())
        assert left.encoder is not None
        for name in ("imu", "dvl", "pressure"):
            assert (getattr(left, name) is None) == (name in gone)
        assert settings.use_attitude == ("attitude" not in gone)
