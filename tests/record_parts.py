"""What the tests of the recorder drive it with: a serial port that is a pty, UDP on loopback, images in a folder."""

from __future__ import annotations

import os
import socket
import threading
import time
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from dive_logs import SAMPLE

from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.record.disk import Target
from garbi_map.record.frames import frames_of
from garbi_map.record.lines import Kind, nmea
from garbi_map.record.ports import port_of
from garbi_map.record.recorder import Inputs, Recorder
from garbi_map.record.subscribers import Subscriber


class Serial:
    """A pty; `path` is what the recorder opens."""

    def __init__(self) -> None:
        self._ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.path = os.ttyname(theirs)
        self._theirs = theirs

    def send(self, data: bytes) -> None:
        os.write(self._ours, data)

    def unplug(self) -> None:
        os.close(self._ours)
        os.close(self._theirs)


class Udp:
    """A socket that sends to a port on loopback that was free a moment ago."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]

    @property
    def url(self) -> str:
        return f"udp://127.0.0.1:{self.port}"

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, ("127.0.0.1", self.port))


class Sending:
    """Sends make(k) for k = 0, 1, ... at a rate, in a thread, for the length of a block; `sent` lines in all."""

    def __init__(self, send: Callable[[bytes], None], make: Callable[[int], bytes], rate: float = 100.0) -> None:
        self._send, self._make, self._period = send, make, 1.0 / rate
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.sent = 0

    def _run(self) -> None:
        begin = time.monotonic()
        while not self._over.wait(max(begin + self.sent * self._period - time.monotonic(), 0.0)):
            self._send(self._make(self.sent))
            self.sent += 1

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()


def encoder_line(k: int) -> bytes:
    """The k-th reading of an encoder at 100 Hz without a clock; the angle tells k."""
    return nmea(f"PGRB,ENC,,{k * 1e-4:.4f}")


def imu_line(k: int) -> bytes:
    """The k-th reading of an IMU at rest, at 100 Hz by its own clock."""
    return nmea(f"PGRB,IMU,{5 + k * 0.01:.3f},0,0,0,0,0,9.80665,0,0,0,1")


def sample_images(folder: Path, count: int = 25, source: Path = SAMPLE) -> Path:
    """The first images of a log as files."""
    folder.mkdir(exist_ok=True)
    for number, image in enumerate(open_log([source]).images()):
        if number == count:
            break
        (folder / f"{number:04d}.jpg").write_bytes(bytes(image.data))
    return folder


class Said(list[str]):
    """The lines that a recorder told, joined by `text`."""

    @property
    def text(self) -> str:
        return "\n".join(self)

    def wait_for(self, words: str) -> None:
        """Until they are said."""
        wait_for(lambda: words in self.text, lambda: f"{words!r} was never said, but: {self.text}")


def wait_for(what: Callable[[], bool], complaint: Callable[[], str] = lambda: "it never came") -> None:
    """Until it is so; a minute at most."""
    end = time.monotonic() + 60
    while not what():
        assert time.monotonic() < end, complaint()
        time.sleep(0.02)


def recorder(
    out: Path | Target,
    said: list[str],
    camera: Path | str | None = None,
    rate: float | None = None,
    ports: dict[str, tuple[Kind, ...]] | None = None,
    config: Config | None = None,
    subscribers: Sequence[Subscriber] = (),
    rig_text: str | None = None,
) -> Recorder:
    """A recorder of a camera that plays again and again, and of some ports."""
    frames = None if camera is None else frames_of(str(camera), rate, loop=True)
    opened = [(port_of(text), kinds) for text, kinds in (ports or {}).items()]
    target = out if isinstance(out, Target) else Target(out)
    return Recorder(Inputs(frames, opened), target, config or Config(), said.append, rig_text, subscribers)
