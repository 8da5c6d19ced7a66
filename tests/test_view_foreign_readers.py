"""Logs and decisions open in Rerun's own reader of MCAP: images, frames, readings and points mean something there."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path

from rerun.chunk import McapReader

from behaviours.decisions import DecisionWriter
from tests.test_view_decisions import TICKS, decision
from tests.view_scene import IMAGES, make_log


def read(path: Path) -> tuple[dict[str, set[str]], Counter[str]]:
    """Topic -> columns, and topic -> rows."""
    columns: dict[str, set[str]] = defaultdict(set)
    rows: Counter[str] = Counter()
    for chunk in McapReader(path).stream():
        batch = chunk.to_record_batch()
        columns[chunk.entity_path].update(batch.schema.names)
        rows[chunk.entity_path] += batch.num_rows
    return columns, rows


def test_a_log_is_images_frames_and_readings(tmp_path: Path) -> None:
    """Every image in its frame, the mounts as transforms, the encoder and the pressure as curves."""
    columns, rows = read(make_log(tmp_path / "dive.mcap"))
    image = "/camera/image/compressed"
    assert {"EncodedImage:blob", "CoordinateFrame:frame"} <= columns[image]
    assert rows[image] >= IMAGES
    assert {"Transform3D:translation", "Transform3D:child_frame"} <= columns["/tf_static"]
    assert "Scalars:scalars" in columns["/laser/joint_states/position"]


def test_decisions_are_a_moving_frame_and_points(tmp_path: Path) -> None:
    """The vehicle's pose on /tf at every tick, and the volume about it as a cloud of points."""
    with DecisionWriter(tmp_path / "decisions.mcap") as writer:
        for number in range(TICKS):
            writer.write(decision(number))
    columns, rows = read(tmp_path / "decisions.mcap")
    assert {"Transform3D:translation", "Transform3D:quaternion"} <= columns["/tf"]
    assert rows["/tf"] >= TICKS
    assert {"Points3D:positions", "CoordinateFrame:frame"} <= columns["/behaviours/volume"]
