"""The trials' two levels show the same: rendered and searched images, and profiles cast directly."""

from __future__ import annotations

import pytest

from tools.trials.agreement import run


@pytest.mark.parametrize("seed", [3])
def test_both_levels_show_the_same_of_a_world_drawn_at_random(seed: int) -> None:
    """Of the rows that either shows both show four fifths, at columns that differ by what they state; flown on either, the
    vehicle is within 10 cm."""
    found = run(seed, 4.0)
    assert found.rows > 300
    assert found.both > 0.8
    assert abs(found.bias) < 0.15 and found.sigma < 2.0
    assert found.apart < 0.1 and abs(found.gap_cast - found.gap_rendered) < 0.1
