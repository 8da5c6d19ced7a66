"""`garbi view --web` in a real browser, by way of the map's report."""

from __future__ import annotations

import shutil
import socket
import time
from pathlib import Path
from string import Template

import cv2
import numpy as np
import pytest

import garbi_map.export
from garbi_map.view import record_map, style
from garbi_map.view.report_server import REPORT, report_server
from garbi_map.view.viewer import viewer
from tests.view_scene import make_scene
from tools.browser import browse

TEMPLATE = Path(garbi_map.export.__file__).with_name("report_template.html")
PATIENCE = 90.0
"""s: the page is 30 MB of compiled code, drawn by the processor."""


def yellow(path: Path) -> int:
    """Pixels of the hull's colour, lit or in shade."""
    picture = cv2.imread(str(path))
    assert picture is not None
    blue, green, red = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 140) & (green > 100) & (blue < 0.5 * red) & (green < red)).sum())


@pytest.mark.skipif(shutil.which("chromium") is None, reason="no chromium here")
def test_the_report_leads_to_the_map_in_the_browser(tmp_path: Path) -> None:
    """Its button opens the viewer's page, which has a canvas, and on it stands the vehicle over its map."""
    scene = make_scene(tmp_path)
    record_map(tmp_path / "map.rrd", scene.dive, scene.store, scene.built, scene.mesh)
    (tmp_path / REPORT).write_text(Template(TEMPLATE.read_text()).safe_substitute())
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with viewer(tmp_path / "map.rrd", web=True, port=port) as opened:
        assert opened.page is not None and opened.started()
        with report_server(tmp_path, opened.page) as report, browse(report) as page:
            link, end = "", time.monotonic() + PATIENCE
            while link != opened.page and time.monotonic() < end:
                time.sleep(0.2)
                link = page.value("(l => l.hidden ? '' : l.href)(document.getElementById('open'))")
            assert link == opened.page
            page.value("document.getElementById('open').href += '&renderer=webgl'")  # a machine without graphics
            page.value("document.getElementById('open').click()")
            seen = 0
            while seen < 2000 and time.monotonic() < end:
                time.sleep(2.0)
                page.picture(tmp_path / "page.png")
                seen = yellow(tmp_path / "page.png")
            assert page.value("document.querySelector('canvas').width") > 300
    assert seen >= 2000, f"the hull ({style.HULL}) is not to be seen"
