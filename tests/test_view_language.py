"""The documented visual language is the one that is drawn."""

from __future__ import annotations

from pathlib import Path

from garbi_map.view import style
from garbi_map.view.language import page

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "visual-language.md"


def test_the_table_is_that_of_the_code() -> None:
    """Made by `python -m garbi_map.view.language > docs/visual-language.md`."""
    assert DOCUMENT.read_text(encoding="utf-8") == page()


def test_no_two_things_share_a_path() -> None:
    """What is drawn at one path means one thing."""
    paths = [one.path for one in vars(style).values() if isinstance(one, style.Thing)]
    assert len(paths) == len(set(paths))


def test_truth_is_called_truth() -> None:
    """Nobody takes the true path of a simulation for a result."""
    assert "truth" in style.TRUTH_ROUTE.path.split("/")
