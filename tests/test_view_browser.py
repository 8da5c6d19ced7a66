"""`garbi view --web` in a real browser."""

from __future__ import annotations

import shutil
import socket
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from garbi_map.view import record_map, style
from garbi_map.view.viewer import viewer
from tests.view_scene import make_scene
from tools.browser import browse

PATIENCE = 90.0
"""s: the page is 30 MB of compiled code, drawn by the processor."""


def yellow(path: Path) -> int:
    """Pixels of the hull's colour, lit or in shade."""
    picture = cv2.imread(str(path))
    assert picture is not None
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 140) & (green > 100) & (blue < 0.5 * red) & (green < red)).sum())


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium here")
def test_the_browser_shows_the_map(tmp_path: Path) -> None:
    """The page has a canvas, and on it stands the vehicle over its map."""
    scene = make_scene(tmp_path)
    record_map(tmp_path / "map.rrd", scene.dive, scene.store, scene.built, scene.mesh)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with viewer(tmp_path / "map.rrd", web=True, port=port) as opened:
        assert opened.page is not None
        _wait_for(port)
        with browse(opened.page + "&renderer=webgl") as page:
            seen, end = 0, time.monotonic() + PATIENCE
            while seen < 2000 and time.monotonic() < end:
                time.sleep(2.0)
                page.picture(tmp_path / "page.png")
                seen = yellow(tmp_path / "page.png")
            assert page.value("document.querySelector('canvas').width") > 300
    assert seen >= 2000, f"the hull ({style.HULL}) is not to be seen"


def _wait_for(port: int) -> None:
    for _ in range(100):
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1.0).close()
            return
        except OSError:
            time.sleep(0.1)
