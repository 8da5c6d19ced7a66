"""The report of a map, served beside the viewer: it learns where the recording is shown, and nothing else is given away."""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError

import pytest

from garbi_map.view.report_server import report_server

PAGE = "http://127.0.0.1:9090/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A9876%2Fproxy"


@pytest.fixture
def address(tmp_path: Path) -> Iterator[str]:
    """A folder with a report and a folder in it, served."""
    (tmp_path / "secret").write_text("beside the map")
    folder = tmp_path / "map"
    (folder / ".work").mkdir(parents=True)
    (folder / ".work" / "sweeps.json").write_text("{}")
    (folder / "report.html").write_text("<h1>a map</h1>")
    with report_server(folder, PAGE) as report:
        yield report


def get(address: str) -> bytes:
    """What a server says."""
    with urllib.request.urlopen(address, timeout=10) as reply:
        return bytes(reply.read())


def test_the_report_and_the_viewer_are_found(address: str) -> None:
    """The page itself, and beside it where the recording is shown."""
    assert address.startswith("http://127.0.0.1:")
    assert get(address) == b"<h1>a map</h1>"
    assert json.loads(get(address.replace("report.html", "viewer.json"))) == {"page": PAGE}


@pytest.mark.parametrize("path", ["", ".work/sweeps.json", "../secret", "%2e%2e/secret", "nothing.png", "/etc/passwd"])
def test_nothing_else_is_served(address: str, path: str) -> None:
    """No listing, no folder inside, nothing outside."""
    with pytest.raises(HTTPError, match="404"):
        get(address.replace("report.html", path))
