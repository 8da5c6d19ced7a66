"""Rerun's own viewer as a process of its own: in a window, or served to a browser."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO

from garbi_map.errors import GarbiError

WAYS_OUT = "--web serves it to a browser, --save FILE.rrd writes a recording to look at elsewhere"
_MEMORY = "50%"


class Viewer:
    """A viewer that shows recordings, or waits at `url` for what is streamed to it.

    web_port    None: a window on this desk; else the port at which a browser finds it

    Raises GarbiError where there is neither screen nor a way to draw, or the port is taken.
    """

    def __init__(self, recordings: Sequence[Path] = (), web_port: int | None = None) -> None:
        if web_port is None and not has_screen():
            raise GarbiError(f"no display here: {WAYS_OUT}")
        if web_port is not None and not is_free(web_port):
            raise GarbiError(f"port {web_port} is in use: choose another one with --port")
        port = free_port()
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        self.page = f"http://127.0.0.1:{web_port}?url=rerun%2Bhttp%3A%2F%2Flocalhost%3A{port}%2Fproxy"
        web = [] if web_port is None else ["--serve-web", "--web-viewer-port", str(web_port)]
        self._words: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115, closed with the viewer
        command = [str(executable()), "--port", str(port), "--memory-limit", _MEMORY, "--hide-welcome-screen", *web]
        self._process = subprocess.Popen(
            [*command, *map(str, recordings)],
            stdin=subprocess.DEVNULL,
            stdout=self._words,
            stderr=self._words,
            env={**os.environ, "RERUN_ANALYTICS": "0"},
        )

    def wait(self) -> None:
        """Until it is closed. Raises GarbiError where it ended because it cannot draw."""
        self._process.wait()
        self.check()

    def check(self) -> bool:
        """Whether it is still there. Raises GarbiError where it ended because it cannot draw."""
        status = self._process.poll()
        if status is None or status == 0:
            return status is None
        self._words.seek(0)
        words = self._words.read().decode(errors="replace").lower()
        what = "no GPU or driver to draw with" if "adapter" in words else "the viewer could not open a window"
        raise GarbiError(f"{what}: {WAYS_OUT}")

    def close(self) -> None:
        """End it."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait(10)

    def __enter__(self) -> Viewer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def recording_of(what: Path) -> Path | None:
    """The recording that a path is or holds; None where it is a log.

    Raises GarbiError where there is nothing, the folder of a map is not finished, or a recording is none.
    """
    if not what.exists():
        raise GarbiError(f"{what}: no such file or directory")
    if what.is_dir():
        if (what / "metadata.yaml").exists():
            return None
        if not (what / "map.rrd").exists():
            raise GarbiError(f"{what}: no map.rrd here; run garbi map LOG -o {what}, again if it was interrupted")
        what = what / "map.rrd"
    if what.suffix != ".rrd":
        return None
    with what.open("rb") as file:
        if not file.read(4).startswith(b"RRF"):
            raise GarbiError(f"{what}: not a Rerun recording, or one of a very old version")
    return what


def executable() -> Path:
    """The viewer that comes with the installed rerun-sdk."""
    import importlib.util

    found = importlib.util.find_spec("rerun_cli")
    folder = Path(found.origin).parent if found is not None and found.origin else Path()
    name = {"win32": "rerun.exe", "darwin": "Rerun.app/Contents/MacOS/Rerun"}.get(sys.platform, "rerun")
    path = folder / name if (folder / name).exists() else folder / "rerun"
    if not path.exists():
        raise GarbiError("the Rerun viewer is not installed: pip install rerun-sdk")
    return path


def has_screen() -> bool:
    """Whether a window could be opened; only Linux can say no."""
    return not sys.platform.startswith("linux") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    )


def is_free(port: int) -> bool:
    """Whether nobody listens at a port of this machine."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("", port))
        except OSError:
            return False
        return True


def free_port() -> int:
    """A port that nobody listens at."""
    with socket.socket() as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])
