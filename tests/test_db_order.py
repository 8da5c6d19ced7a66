"""Dives find their place in whatever order they are given."""

from __future__ import annotations

import pytest

from garbi_map.db import lay_all
from garbi_map.db.join import Unplaced


class Chain:
    """Dives by number; the first begins the map, each further one is laid only beside one that lies."""

    def __init__(self) -> None:
        self.laid: list[int] = []

    def lay(self, dive: int) -> str:
        if self.laid and not {dive - 1, dive + 1} & set(self.laid):
            raise Unplaced(f"{dive}: fits nowhere")
        self.laid.append(dive)
        return f"laid {dive}"


def test_a_dive_that_only_fits_a_later_one_waits_for_it() -> None:
    """1, 4, 2, 3: four waits for three; what is returned is what came last."""
    chain = Chain()
    assert lay_all([1, 4, 2, 3], chain.lay) == "laid 4"
    assert chain.laid == [1, 2, 3, 4]


def test_what_fits_nowhere_is_told_after_all_others_were_laid() -> None:
    """The first of those that are left, by name."""
    chain = Chain()
    with pytest.raises(Unplaced, match="9: fits nowhere"):
        lay_all([1, 9, 7, 2], chain.lay)
    assert chain.laid == [1, 2]
