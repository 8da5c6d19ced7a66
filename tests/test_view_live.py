"""A live view never holds up the work that it shows."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from garbi_map.errors import GarbiError
from garbi_map.seabed import AcceptedPoints
from garbi_map.view import style
from garbi_map.view.blueprint import work_blueprint
from garbi_map.view.live import Live
from garbi_map.view.live_map import WorkSender
from garbi_map.view.stream import new_recording, recording_file
from tests.view_scene import IMAGES, SEABED_Z, make_scene, recorded


def test_a_slow_viewer_is_not_waited_for() -> None:
    """While the first thing is being sent a hundred others come: a few wait, the rest is dropped, none blocks."""
    begun, go_on, sent = threading.Event(), threading.Event(), []

    def send(_: Any, thing: int) -> None:
        begun.set()
        go_on.wait()
        sent.append(thing)

    shown = Live(new_recording("log", "test"), send)
    shown.show(0)
    begun.wait()
    for thing in range(1, 101):
        shown.show(thing)
    assert sent == []
    go_on.set()
    shown.close()
    assert len(sent) + shown.dropped == 101
    assert sent == [0, 1, 2, 3, 4]


def test_a_view_that_fails_does_not_stop_the_work() -> None:
    """What cannot be sent is dropped."""

    def send(_: Any, thing: int) -> None:
        raise RuntimeError("the viewer is gone")

    shown = Live(new_recording("log", "test"), send)
    for thing in range(50):
        shown.show(thing)
    shown.close()
    assert shown.dropped == 50


def test_sweeps_path_and_points_are_drawn(tmp_path: Path) -> None:
    """Each in its place, thinned."""
    scene = make_scene(tmp_path)
    points = np.tile([0.0, 0.0, SEABED_Z], (40_000, 1))
    accepted = AcceptedPoints(
        np.full(40_000, 7),
        points,
        np.zeros(40_000, np.float32),
        np.zeros(40_000, np.float32),
        np.zeros(40_000, np.uint8),
    )
    send = WorkSender()
    with recording_file(tmp_path / "work.rrd", "work", "work", work_blueprint()) as recording:
        for thing in (*scene.store, scene.built.registered.trajectory, accepted):
            send(recording, thing)
    content = recorded(tmp_path / "work.rrd")
    assert [row[0].split("**")[1] for row in content[style.ABOUT]["TextDocument:text"] if row] == [
        "The log is read.", "The path is found", "The map grows"
    ]  # fmt: skip
    profiles = [row for row in content[style.PROFILE.path]["Points3D:positions"] if row]
    assert len(profiles) == 2
    assert len([row for row in content[style.VEHICLE]["Transform3D:translation"] if row]) == IMAGES
    (cloud,) = [row for row in content[f"{style.POINTS.path}/7"]["Points3D:positions"] if row]
    assert len(cloud) == 15_000


@pytest.mark.parametrize("command", [["map", "LOG", "-o", "OUT"], ["replay", "LOG"]])
def test_without_a_display_nothing_is_begun(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One clear line before the work, not after it."""
    import behaviours.cli
    import garbi_map.cli.map  # noqa: F401
    from garbi_map.cli.app import app

    assert behaviours.cli
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    log = Path(__file__).resolve().parents[1] / "logs" / "behaviour_wall.mcap"
    names = {"LOG": str(log), "OUT": str(tmp_path / "out")}
    done = CliRunner().invoke(app, [*(names.get(word, word) for word in command), "--view"])
    assert isinstance(done.exception, GarbiError)
    assert "there is no display here" in str(done.exception)
    assert not (tmp_path / "out").exists()
