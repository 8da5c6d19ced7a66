"""Which log files are one dive: the parts that a recorder made of one recording, and not the next dive's."""

from __future__ import annotations

from pathlib import Path

import pytest
from dive_logs import IMAGE, later_part, rewrite

from garbi_map.log import LogSettings, open_log
from garbi_map.recordings import split_recordings

SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def parts(dive: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Stretches of one log, as they are and shifted in time."""
    folder = tmp_path_factory.mktemp("parts")

    def part(name: str, begin: float, end: float, shift: float = 0.0, rig: str | None = None) -> Path:
        return rewrite(
            dive,
            folder / f"{name}.mcap",
            seconds=end,
            change=later_part(begin),
            restamp=lambda topic, at, stamp: stamp + round(shift * SECOND),
            rig=rig,
        )

    text = open_log([dive]).rig_text or ""
    return {
        "first": part("first", 0, 1),
        "next": part("next", 1, 2, rig=""),
        "soon": part("soon", 0, 1, shift=40),
        "later": part("later", 0, 1, shift=400),
        "after": part("after", 1, 2, shift=400),
        "elsewhere": part("elsewhere", 0, 1, shift=5, rig=text.replace("beta: 0.017", "beta: 0.018")),
        "same": part("same", 0, 1.5),
    }


def split(parts: dict[str, Path], *names: str) -> list[list[str]]:
    """By names."""
    found = split_recordings([parts[name] for name in names], LogSettings(), gap=60.0)
    return [[path.stem for path in recording] for recording in found]


def test_parts_without_a_long_pause_are_one_dive(parts: dict[str, Path]) -> None:
    """Whatever the order in which they are given, and with the rig in the first of them only."""
    assert split(parts, "first", "next") == [["first", "next"]]
    assert split(parts, "soon", "next", "first") == [["soon", "next", "first"]]


def test_pause_of_minutes_begins_another_dive(parts: dict[str, Path]) -> None:
    """Dives come in the order of their first file."""
    assert split(parts, "first", "later", "next", "after") == [["first", "next"], ["later", "after"]]
    assert split(parts, "later", "first") == [["later"], ["first"]]


def test_another_rig_is_another_dive(parts: dict[str, Path]) -> None:
    """Even seconds later."""
    assert split(parts, "first", "elsewhere") == [["first"], ["elsewhere"]]


def test_images_at_the_same_time_are_of_different_dives(parts: dict[str, Path], dive: Path, tmp_path: Path) -> None:
    """One camera takes no two images at once; a file with other topics of the same time belongs to the dive."""
    nearly = rewrite(dive, tmp_path / "nearly.mcap", seconds=2, restamp=lambda topic, at, stamp: stamp + SECOND // 10)
    sensors = rewrite(
        dive, tmp_path / "sensors.mcap", seconds=2, change=lambda topic, at, m: None if topic == IMAGE else m
    )
    longer = rewrite(dive, tmp_path / "longer.mcap", seconds=2)
    assert len(split_recordings([longer, nearly], LogSettings(), 60.0)) == 2
    assert len(split_recordings([longer, sensors], LogSettings(), 60.0)) == 1
