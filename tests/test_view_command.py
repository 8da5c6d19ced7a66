"""`garbi view` as a newcomer meets it: whatever is wrong is one line, and what can be shown is shown."""

from __future__ import annotations

import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from garbi_map.cli import main
from garbi_map.log import LogWriter
from tests.sample_log import START, write_sample

Run = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def garbi(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command; gives exit status and the lines on stderr."""

    def run(*words: object) -> tuple[int, list[str]]:
        monkeypatch.setattr(sys, "argv", ["garbi", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().err.splitlines()

    return run


def viewer_that_says(words: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Instead of Rerun's viewer a program that ends like it with an error, on a screen that seems to be there."""
    program = folder / "viewer"
    program.write_text(f"#!/bin/sh\necho '{words}' >&2\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr("garbi_map.view.viewer.viewer_binary", lambda: program)
    monkeypatch.setenv("DISPLAY", ":99")


@pytest.mark.parametrize("missing", ["image", "navigation", "encoder"])
def test_a_log_without_something_shows_the_rest(missing: str, tmp_path: Path, garbi: Run) -> None:
    """Each thing that is left out is a line; the recording is there."""
    log = write_sample(tmp_path / "log.mcap", skip=(missing,))
    status, lines = garbi("view", log, "--save", tmp_path / "log.rrd")
    assert status == 3 and all(line.startswith("left out: ") for line in lines)
    assert (tmp_path / "log.rrd").stat().st_size > 10_000


def test_unknown_topics_are_no_loss_of_their_own(tmp_path: Path, garbi: Run) -> None:
    """Only the missing rig.yaml is told."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write("/a", "std_msgs/msg/String", log.types.types["std_msgs/msg/String"](data="b"), START)
    status, lines = garbi("view", tmp_path / "log.mcap", "--save", tmp_path / "log.rrd")
    assert status == 3
    assert len(lines) == 1 and "no rig.yaml" in lines[0]


def test_a_damaged_log_is_shown_as_far_as_it_goes(tmp_path: Path, garbi: Run) -> None:
    """Cut in the middle: what was lost is told, nothing else goes wrong."""
    whole = write_sample(tmp_path / "whole.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    status, lines = garbi("view", tmp_path / "cut.mcap", "--save", tmp_path / "log.rrd")
    assert status == 3 and any("no index" in line for line in lines)
    assert (tmp_path / "log.rrd").exists()


def test_what_is_no_log_is_one_line(tmp_path: Path, garbi: Run) -> None:
    """Nothing there, an empty file, another file, an old recording, a half-built map."""
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "picture.mcap").write_bytes(b"\x89PNG" * 50)
    (tmp_path / "old.rrd").write_bytes(b"RRF1" + bytes(60))
    (tmp_path / "map").mkdir()
    said = {
        "nothing.mcap": "no such file",
        "empty.mcap": "the file is empty",
        "picture.mcap": "not an MCAP file",
        "old.rrd": "older Rerun",
        "map": "finish the map with garbi map",
    }
    for name, words in said.items():
        status, lines = garbi("view", tmp_path / name, "--save", tmp_path / "out.rrd")
        assert (status, len(lines)) == (1, 1) and words in lines[0], lines


def test_without_a_display_there_is_a_way_out(tmp_path: Path, garbi: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The browser, or a file."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    status, lines = garbi("view", write_sample(tmp_path / "log.mcap"))
    assert (status, len(lines)) == (1, 1) and "--web for a browser, or --save" in lines[0]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("Error: WGPU error: Failed to create surface for any enabled backend: {}", "no usable graphics here"),
        ("Error: winit EventLoopError: Failed to open connection to X server", "the display cannot be opened"),
        ("something else", "the viewer ended with status 1: something else"),
    ],
)
@pytest.mark.parametrize("shown", ["log.mcap", "a.rrd"])
def test_a_viewer_that_cannot_start_is_one_line(
    shown: str, words: str, told: str, tmp_path: Path, garbi: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No graphics, no screen where DISPLAY says: what Rerun says of it is told in our words, of a log and a recording."""
    viewer_that_says(words, tmp_path, monkeypatch)
    write_sample(tmp_path / "log.mcap")
    (tmp_path / "a.rrd").write_bytes(b"RRF2" + bytes(60))
    status, lines = garbi("view", tmp_path / shown)
    assert (status, len(lines)) == (1, 1) and told in lines[0], lines


def test_work_is_done_whatever_becomes_of_its_viewer(
    tmp_path: Path, garbi: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A replay whose viewer dies decides all the same, and says so at the end."""
    viewer_that_says("WGPU error", tmp_path, monkeypatch)
    log = Path(__file__).resolve().parents[1] / "logs" / "behaviour_survey_leg.mcap"
    status, lines = garbi("replay", log, "-o", tmp_path / "decisions.mcap", "--view")
    assert status == 0 and any("no usable graphics" in line for line in lines)
    assert (tmp_path / "decisions.mcap").exists()


def test_a_port_in_use_is_one_line(tmp_path: Path, garbi: Run) -> None:
    """And the option that chooses another one."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        status, lines = garbi("view", write_sample(tmp_path / "log.mcap"), "--web", "--port", port)
    assert (status, len(lines)) == (1, 1) and "choose another one with --port" in lines[0]
