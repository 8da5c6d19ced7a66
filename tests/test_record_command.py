"""`garbi record` as a user runs it: to its end, stopped by signals, and killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import Garbi
from record_parts import Sending, Udp, encoder_line, sample_images, wait_for

from garbi_map.log import open_log
from garbi_map.record.quality import Look, look_at
from garbi_map.record.screen import Screen, line
from garbi_map.record.status import SourceStatus, Status
from garbi_map.stripe import StripeDetector, StripeSettings

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of the sample log's images."""
    return sample_images(tmp_path_factory.mktemp("images") / "images")


def started(*arguments: object) -> subprocess.Popen[str]:
    """The command in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "garbi_map", "record", *map(str, arguments)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for_bytes(path: Path, least: int) -> None:
    """Until a file is that large."""
    wait_for(lambda: path.exists() and path.stat().st_size >= least)


def test_a_folder_is_recorded_to_its_end_and_not_overwritten(garbi: Garbi, images: Path, tmp_path: Path) -> None:
    """Exit status 0, the files named; a second time it is refused, and --force overwrites."""
    log = tmp_path / "dive.mcap"
    ended = garbi("record", "-o", log, "--camera", images, "--rate", 50)
    assert ended.status == 0, ended.err
    assert f"{log}: recorded" in ended.out and "25 of camera" in ended.out
    assert open_log([log]).image_count == 25
    again = garbi("record", "-o", log, "--camera", images)
    assert again.status == 1 and again.err.count("\n") == 1 and "is there already" in again.err
    assert garbi("record", "-o", log, "--camera", images, "--rate", 50, "--force").status == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "nothing to record"),
        (("--camera", "nowhere"), "no such camera"),
        (("--encoder", "udp://here"), "not an address"),
        (("--encoder", "/dev/ttyUSB0@fast"), "not a baud rate"),
        (("--encoder", "/dev/no-such-port", "--seconds", "0.3"), "nothing was recorded: encoder: cannot be opened"),
    ],
)
def test_bad_input_is_one_line(garbi: Garbi, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    """Exit status 1, and no file is left."""
    ended = garbi("record", "-o", tmp_path / "a.mcap", *arguments)
    assert ended.status == 1
    assert words in ended.err.splitlines()[-1]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_recording_cleanly(
    garbi: Garbi, images: Path, tmp_path: Path, number: signal.Signals
) -> None:
    """Ctrl-C, an init system, a terminal that is closed: the log is complete, and the handlers are as they were."""
    log, before = tmp_path / "a.mcap", signal.getsignal(number)

    def send() -> None:
        wait_for_bytes(log, 100_000)
        os.kill(os.getpid(), number)

    sender = threading.Thread(target=send)
    sender.start()
    ended = garbi("record", "-o", log, "--camera", images, "--loop")
    sender.join()
    assert ended.status == 0, ended.err
    assert f"{log}: recorded" in ended.out
    found = open_log([log])
    assert found.image_count > 5 and found.losses == []
    assert signal.getsignal(number) is before


def test_kill_9_leaves_a_log_that_lacks_less_than_a_second(images: Path, tmp_path: Path) -> None:
    """What the operating system was given is readable; the newest message is at most a second old."""
    log, udp = tmp_path / "a.mcap", Udp()
    with Sending(udp.send, encoder_line):
        process = started("-o", log, "--camera", images, "--loop", "--encoder", udp.url)
        wait_for_bytes(log, 300_000)
        time.sleep(0.37)
        os.kill(process.pid, signal.SIGKILL)
        killed_ns = time.time_ns()
        process.communicate()
    found = open_log([log])
    encoder = found.navigation().encoder
    newest = max(image.arrival_ns for image in found.images())
    assert encoder is not None
    assert killed_ns - newest < 1e9 and killed_ns - encoder.arrival_ns.max() < 1e9
    angles = np.round(encoder.angle * 1e4)
    assert np.all(np.diff(angles) == 1)


def test_the_screen_says_what_matters(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal as a table, elsewhere as a line: rates, queue, dropped, disk left, stripe, sharpness, saturation."""
    sources = [SourceStatus("camera", 24.96, 500, 3, None), SourceStatus("encoder", 0.0, 10, 0, "silent")]
    look = Look(0.42, 0.05, 0.001, 7.5, 33.0)
    status = Status(3725.0, "a.mcap", sources, 5_000_000, 10_000_000, 8_000_000, 2e6, 10**10, 0.0, look, ["helm: stop"])
    for words in ("camera 25.0 Hz", "encoder silent", "3 dropped", "10.0 GB free, 1:23:20 left", "42 % of the rows"):
        assert words in line(status)
    monkeypatch.setenv("COLUMNS", "160")
    with Screen(tty=True) as screen:
        screen.say("encoder: silent")
        screen._drawn -= 1
        screen.show(status)
    drawn = capsys.readouterr().err
    for words in (
        "a.mcap 1:02:05",
        "25.0",
        "silent",
        "queue 5.0 MB, 50 %",
        "sharpness 7.5",
        "5 % of it saturated",
        "helm",
    ):
        assert words in drawn


def test_an_image_is_judged(images: Path) -> None:
    """With the laser, without it, and out of focus."""
    import cv2
    import simplejpeg

    from garbi_map.log import Image

    detector = StripeDetector(StripeSettings())
    data = sorted(images.iterdir())[0].read_bytes()
    seen = look_at(Image(0, 0, "jpeg", data), detector)
    assert seen.stripe > 0.3 and seen.saturated < 0.5
    soft = cv2.GaussianBlur(simplejpeg.decode_jpeg(data, "BGR"), (0, 0), 3)
    blurred = look_at(Image(0, 0, "jpeg", simplejpeg.encode_jpeg(soft, colorspace="BGR")), detector)
    assert blurred.sharpness < 0.7 * seen.sharpness
    dark = simplejpeg.encode_jpeg(np.full((576, 768, 3), 4, np.uint8))
    assert look_at(Image(0, 0, "jpeg", dark), detector).words().startswith("no stripe")
