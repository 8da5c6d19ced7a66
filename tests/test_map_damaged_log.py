"""`garbi map` on a log that was cut short: the map of what is left of it, what is missing is named, nothing is run."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

import pytest
from conftest import Ended, Garbi
from dive_logs import TRUTH, rewrite

SCRIPT = "<script>alert(1)</script>"
TEMPLATE = Path(__file__).parents[1] / "garbi_map" / "export" / "report_template.html"


class Tags(HTMLParser):
    """The scripts and event handlers of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.scripts = 0
        self.handlers: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.scripts += tag == "script"
        self.handlers += [name for name, _ in attrs if name.startswith("on")]


@pytest.fixture
def cut(dive: Path, tmp_path: Path) -> Path:
    """The first two thirds of the bytes of a dive of five seconds; file and topic have hostile names."""
    whole = rewrite(dive, tmp_path / "whole.mcap", 5.0, rename={TRUTH: f"/{SCRIPT}"}).read_bytes()
    log = tmp_path / "dive<img src=x onerror=alert(1)>.mcap"
    log.write_bytes(whole[: len(whole) * 2 // 3])
    return log


def test_the_map_is_that_of_the_undamaged_part(cut: Path, tmp_path: Path, garbi: Garbi) -> None:
    """The same trajectory, to the last digit, as the map of the log that `garbi recover` makes of it."""
    assert garbi("recover", cut, "-o", tmp_path / "recovered.mcap").status == 3
    damaged: Ended = garbi("map", cut, "-o", tmp_path / "damaged")
    recovered: Ended = garbi("map", tmp_path / "recovered.mcap", "-o", tmp_path / "recovered")
    assert damaged.status == 3 and "no index at its end" in damaged.err
    maps = [tmp_path / name for name in ("damaged", "recovered")]
    one, other = ((folder / "trajectory.tum").read_bytes() for folder in maps)
    assert one == other and len(one.splitlines()) > 100
    counts = [json.loads((folder / "report.json").read_text())["counts"] for folder in maps]
    assert counts[0] == counts[1]
    page = (tmp_path / "damaged" / "report.html").read_text()
    shown, own = Tags(page), Tags(TEMPLATE.read_text())
    assert (shown.scripts, shown.handlers) == (own.scripts, own.handlers) and not own.handlers
    assert "&lt;script&gt;alert(1)" in page and "&lt;img src=x onerror" in page
    assert recovered.status == 0, recovered.err
