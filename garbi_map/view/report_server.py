"""The folder of a finished map for a browser, so that its report can open the recording in the viewer beside it."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

HERE = "127.0.0.1"
REPORT = "report.html"


class _Handler(SimpleHTTPRequestHandler):
    """The files that lie in the folder itself, and viewer.json: where the viewer's page is."""

    def __init__(self, *args: object, folder: Path, page: str, **kwargs: object) -> None:
        self._folder, self._page = folder, page
        super().__init__(*args, directory=str(folder), **kwargs)  # type: ignore[arg-type]

    def do_GET(self) -> None:
        if self.path == "/viewer.json":
            self._answer(json.dumps({"page": self._page}).encode())
        elif self.path.count("/") == 1 and (self._folder / self.path[1:]).is_file():
            super().do_GET()
        else:
            self.send_error(404)

    def log_message(self, *_: object) -> None:
        """Nothing: the terminal is for what the user asked."""

    def _answer(self, body: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)


@contextmanager
def report_server(folder: Path, page: str) -> Iterator[str]:
    """Serves a finished map's folder to this machine alone while the block lasts; gives the report's address.

    page: the viewer's address, which the report asks for.
    """
    with ThreadingHTTPServer((HERE, 0), partial(_Handler, folder=folder, page=page)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://{HERE}:{server.server_address[1]}/{REPORT}"
        finally:
            server.shutdown()
