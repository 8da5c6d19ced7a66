"""The tables of the field bench, from rows whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from garbi_map.calibrate.scanner import LATENCY
from tools.bench.field import Row
from tools.bench.field_table import markdown

NAMES = ["laser.delta", "laser.z", LATENCY]


def row(dive: str, error: np.ndarray, sigma: np.ndarray, told: float = 2.0) -> Row:
    """A right rig that was left alone; z is what the prior says, 2 mm."""
    nees = float(np.square(error / sigma).sum()) / told
    before = [0.01, 0.002, 0.025]
    numbers = error.tolist(), sigma.tolist(), before, [0.0] * 3
    return Row(dive, "right", 0.2, 0.2, 0.2, [], False, 0.0, (0.1, 0.1), NAMES, *numbers, told, nees, "why", 4.0, 2.0)


def dives(scale: float) -> list[Row]:
    """Forty, whose errors are `scale` times what their sigmas say; z is right, as the benchmark makes it."""
    rng = np.random.default_rng(4)
    sigma = np.array([2e-4, 2e-3, 6e-5])
    drawn = scale * sigma * rng.normal(size=(40, 3)) * [1.0, 0.0, 1.0]
    return [row(f"dive_{k}", error, sigma) for k, error in enumerate(drawn)]


def band(text: str) -> tuple[float, float, float]:
    """NEES and its band as they are written."""
    line = next(line for line in text.splitlines() if line.startswith("NEES") and "band" in line)
    low, high = line.split("[")[1].split("]")[0].split()
    return float(line.split()[1].rstrip(",")), float(low), float(high)


def test_the_band_holds_honest_sigmas_and_no_others() -> None:
    """What the prior alone tells does not count; twice or half the sigma falls out of the band."""
    nees, low, high = band(markdown(dives(1.0)))
    assert low < nees < high
    for wrong in (0.5, 2.0):
        nees, low, high = band(markdown(dives(wrong)))
        assert not low < nees < high


def test_rows_of_one_dive_count_once() -> None:
    """Each dive with seven rig files shares its noise: the band is that of the dives."""
    once, often = dives(1.0), dives(1.0) * 7
    assert band(markdown(once)) == band(markdown(often))


def test_delta_is_judged_where_it_is_observed() -> None:
    """By the dives whose sigma is below a hundredth of a degree, in a line of its own."""
    vague, sharp = np.array([4e-4, 2e-3, 6e-5]), np.array([1e-4, 2e-3, 6e-5])
    error = np.array([1e-4, 0.0, 0.0])
    rows = [row("vague", 4.0 * error, vague), row("sharp", error, sharp)]
    lines = markdown(rows).splitlines()
    every = next(line for line in lines if line.startswith("| laser.delta"))
    sure = next(line for line in lines if "sigma is below 0.01" in line)
    assert "| 2 of 2 |" in every and "| 1 of 2 |" in sure
    assert f"{np.rad2deg(1e-4):.4f}" in sure
    none = markdown([replace(rows[0], names=NAMES)]).splitlines()
    assert any("sigma is below 0.01 | 0 of 1" in line for line in none)


def test_a_flat_bottom_has_a_table_of_its_own() -> None:
    """With what the command says of it, and no part in the others."""
    text = markdown([*dives(1.0), row("flat_1", np.ones(3), np.full(3, 1e-3))])
    assert "| flat_1 | right | 0.200 | 0.200 | 0.200 | why |" in text
    assert "left alone in 40 of 40" in text
