"""The table of voxels finds each of them at once, wherever they lie."""

from __future__ import annotations

import numpy as np
import pytest

from garbi_map.seabed.evidence_kernels import key_of, mixed


@pytest.mark.parametrize("still", [0, 1, 2])
@pytest.mark.parametrize("bits", [12, 16, 20])
def test_voxels_of_a_plane_spread_over_the_table(still: int, bits: int) -> None:
    """Whichever axis it stands across, as evenly as chance would spread them: else every look-up walks past all others."""
    side = 1 << bits // 2
    index = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2) - side // 3
    index = np.insert(index, still, 7, axis=1)[:4096]
    keys = np.array([mixed(key_of(*row)) for row in index.tolist()])
    slots, count = np.unique(keys & ((1 << bits) - 1), return_counts=True)
    by_chance = (1 << bits) * -np.expm1(-len(index) / (1 << bits))
    assert keys.min() >= 0 and len(slots) > 0.9 * by_chance and count.max() < 10
