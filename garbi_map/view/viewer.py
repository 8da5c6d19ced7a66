"""Rerun's viewer as a process of its own: a window, or a page that a browser opens."""

from __future__ import annotations

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from garbi_map.errors import GarbiError

WEB_PORT = 9090
_HERE = "127.0.0.1"
_MAGIC, _OLD = b"RRF", (b"RRF0", b"RRF1")


@dataclass(frozen=True)
class Viewer:
    """A viewer that runs; data sent to `proxy` appears in it. page: what a browser opens, None for a window."""

    process: subprocess.Popen[bytes]
    port: int
    page: str | None

    @property
    def proxy(self) -> str:
        """Where it takes data."""
        return _proxy(self.port)

    @property
    def open(self) -> bool:
        """Whether it still runs."""
        return self.process.poll() is None

    def started(self) -> bool:
        """Wait until it takes data; False where it has ended before."""
        while self.open:
            try:
                socket.create_connection((_HERE, self.port), timeout=1.0).close()
                return True
            except OSError:
                time.sleep(0.01)
        return False


def viewer_binary() -> Path:
    """The viewer that came with the Rerun package, whatever PATH says. Raises GarbiError where it has none."""
    found = importlib.util.find_spec("rerun_cli")
    for folder in (found.submodule_search_locations or []) if found else []:
        for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
            if (Path(folder) / name).is_file():
                return Path(folder) / name
    raise GarbiError("Rerun's viewer is not installed: pip install rerun-sdk, or write a file with --save FILE.rrd")


@contextmanager
def viewer(file: Path | None, web: bool, port: int = WEB_PORT) -> Iterator[Viewer]:
    """A viewer, with a recording opened in it where there is one; it is closed with the block.

    port: where the browser's page is served, to this machine alone.
    Raises GarbiError where there is no display, no graphics, or the port is in use.
    """
    if (
        not web
        and sys.platform.startswith("linux")
        and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    ):
        raise GarbiError(
            "there is no display here: use --web for a browser, or --save FILE.rrd and open that elsewhere"
        )
    if web and not _free(port):
        raise GarbiError(f"port {port} is in use: choose another one with --port")
    data = _any_free()  # not Rerun's own: whoever finds another viewer there hands everything over to it, and ends
    page = f"http://{_HERE}:{port}/?url={quote(_proxy(data), safe='')}" if web else None
    command = [str(viewer_binary()), "--bind", _HERE, "--port", str(data), "--hide-welcome-screen"]
    command += ["--serve-web", "--web-viewer-port", str(port)] if web else []
    command += [str(file)] if file else ["--expect-data-soon"]
    with tempfile.TemporaryFile() as words, _terminated_in_order():
        quiet = {**os.environ, "RERUN_ANALYTICS": "0", "RUST_LOG": "error", "NO_COLOR": "1"}
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=words, env=quiet, start_new_session=True)
        try:
            yield Viewer(process, data, page)
            if process.poll():
                words.seek(0)
                raise GarbiError(_why(words.read().decode(errors="replace"), process.returncode))
        finally:
            if process.poll() is None:
                process.terminate()
                process.wait()


def open_in(opened: Viewer, file: Path) -> None:
    """A recording, in a viewer that runs already."""
    quiet = {**os.environ, "RERUN_ANALYTICS": "0", "RUST_LOG": "error"}
    command = [str(viewer_binary()), "--port", str(opened.port), str(file)]
    subprocess.run(command, env=quiet, check=False, capture_output=True)


def _proxy(port: int) -> str:
    return f"rerun+http://{_HERE}:{port}/proxy"


@contextmanager
def _terminated_in_order() -> Iterator[None]:
    """SIGTERM ends the block as an exception does, so that no viewer is left behind."""

    def leave(*_: object) -> None:
        raise SystemExit(128 + signal.SIGTERM)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, leave)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def check_recording(path: Path) -> Path:
    """The path of a Rerun recording. Raises GarbiError where there is none, or it is something else."""
    try:
        with path.open("rb") as file:
            magic = file.read(4)
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
    if not magic.startswith(_MAGIC):
        raise GarbiError(f"{path}: not a Rerun recording (.rrd)")
    if magic in _OLD:
        raise GarbiError(f"{path}: a recording of an older Rerun: make it again with garbi map or garbi view --save")
    return path


def _why(words: str, status: int) -> str:
    ways_out = "use --web for a browser, or --save FILE.rrd and open that elsewhere"
    if "winit" in words:
        return f"the display cannot be opened: {ways_out}"
    if "adapter" in words or "wgpu" in words.lower():
        return f"no usable graphics here (apt-get install mesa-vulkan-drivers gives a slow one): {ways_out}"
    lines = [line.strip() for line in words.splitlines() if line.strip()]
    return f"the viewer ended with status {status}: {lines[-1] if lines else 'it gives no reason'}"


def _free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((_HERE, port))
        except OSError:
            return False
    return True


def _any_free() -> int:
    with socket.socket() as probe:
        probe.bind((_HERE, 0))
        return int(probe.getsockname()[1])
