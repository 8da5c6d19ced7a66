"""Logs and decisions open in Foxglove: read by its own code (tools/foxglove), where that is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from behaviours.decisions import DecisionWriter
from garbi_map.log import Image, LogWriter
from tests.test_view_decisions import TICKS, decision
from tests.view_scene import IMAGES, START, make_log

ROOT = Path(__file__).resolve().parents[1]
TOOL = ROOT / "tools" / "foxglove"

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None or not (TOOL / "node_modules").is_dir(),
    reason="Foxglove's readers are not here: npm install --prefix tools/foxglove",
)


def read(*logs: Path) -> list[dict[str, Any]]:
    """What Foxglove's readers make of each log."""
    done = subprocess.run(["node", TOOL / "read.js", *logs], capture_output=True, text=True, timeout=120)
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == any(one["problems"] for one in found), done.stderr
    return found


def test_logs_and_decisions_are_decoded_whole(tmp_path: Path) -> None:
    """Every message, with what its panel needs; whatever is drawn has a place among the transforms."""
    with DecisionWriter(tmp_path / "decisions.mcap") as writer:
        for number in range(TICKS):
            writer.write(decision(number))
        writer.write_verdict(START, [("stops", "held", "in time")], [[(0.0, 1.0, True)]])
    log, decisions = read(make_log(tmp_path / "dive.mcap"), tmp_path / "decisions.mcap")
    assert log["counts"]["/camera/image/compressed"] == IMAGES
    assert decisions["counts"]["/behaviours/decisions"] == decisions["counts"]["/tf"] == TICKS
    assert decisions["counts"]["/behaviours/verdict"] == 1
    assert decisions["problems"] == []


def test_the_sample_logs_have_all_that_its_panels_want() -> None:
    """Images, frames, points and odometry of every log that comes with the project."""
    for found in read(*sorted((ROOT / "logs").glob("*.mcap"))):
        assert found["problems"] == [], found["path"]
        assert found["counts"]["/camera/image/compressed"] > 0


def test_what_a_panel_would_not_show_is_named(tmp_path: Path) -> None:
    """An image that is none, in a frame without a place."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_image(Image(START, START, "jpeg", b"no image"))
    (found,) = read(tmp_path / "log.mcap")
    assert len(found["problems"]) == 2
    assert "neither JPEG nor PNG" in found["problems"][0] and "no transform leads" in found["problems"][1]
