"""The rules that `tools.bench.mutants` breaks are there to be broken."""

from __future__ import annotations

import pytest

from tools.bench.mutants import MUTANTS, ROOT, Mutant


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda one: one.rule)
def test_every_mutant_changes_one_place_of_the_sources(mutant: Mutant) -> None:
    """What it replaces stands in its file, once, and its tests exist."""
    assert (ROOT / mutant.file).read_text().count(mutant.right) == 1
    assert mutant.right != mutant.wrong
    assert (ROOT / f"tests/test_behaviours_{mutant.tests}.py").is_file()
