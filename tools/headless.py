"""Rerun's viewer without a screen: open a recording, look at it, take pictures."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.view.style import TIMELINE
from garbi_map.view.viewer import check_recording, viewer_binary

SETTLED = 1.2
"""s in which a changed picture is drawn by a slow graphics driver."""


class HeadlessViewer:
    """One recording in a viewer that has no window; made by `headless`."""

    def __init__(self, client: Any) -> None:
        self.client = client

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp of the recording."""
        line = next(one for one in self.client.get_state().recordings[0].timelines if one.name == TIMELINE)
        return int(line.start), int(line.end)

    def reports(self) -> list[str]:
        """What the views complain about, one line each."""
        return [f"{view.name}: {report}" for view in self.client.get_state().views for report in view.reports]

    def frames(self) -> dict[str, bool]:
        """Entity path -> whether it has a path of transforms to the root."""
        known = self.client.get_transform_graph()["frames"]
        return {frame["id"].removeprefix("tf#"): bool(frame["has_transform"]) for frame in known}

    def show(self, tab: str) -> None:
        """Bring the view of this name to the front of its tabs. Raises KeyError where there is none."""
        names = {view.name: f"/view/{view.view_id}" for view in self.client.get_state().views}
        layout = self.client.get_blueprint("recording").blueprint
        boxes = {path: part["ContainerBlueprint"] for path, part in layout.items() if "ContainerBlueprint" in part}
        child: str | None = names[tab]
        while child is not None:
            parent = next((path for path, box in boxes.items() if child in box["contents"]), None)
            if parent is not None and boxes[parent]["container_kind"] == "Tabs":
                boxes[parent]["active_tab"] = child
            child = parent
        self.client.set_blueprint(layout, "recording")

    def picture(self, path: Path, stamp_ns: int, tab: str | None = None, alone: bool = False) -> None:
        """Write the screen at a moment, or the view of a tab alone, as PNG."""
        if tab is not None:
            self.show(tab)
        self.client.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"), play_state="paused")
        time.sleep(SETTLED)
        views = {view.name: view.view_id for view in self.client.get_state().views}
        self.client.save_screenshot(str(path.resolve()), views[tab] if alone and tab else None)


@contextmanager
def headless(recording: Path) -> Iterator[HeadlessViewer]:
    """A viewer with a recording in it, loaded.

    Raises GarbiError where there is no recording, RuntimeError where the machine has no graphics, not even slow ones.
    """
    check_recording(recording)
    os.environ.setdefault("RERUN_ANALYTICS", "0")
    from rerun.experimental import ViewerClient

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with ViewerClient.spawn(headless=True, port=port, executable_path=str(viewer_binary())) as client:
        client.open(str(recording.resolve()))
        for _ in range(120):
            time.sleep(0.25)
            state = client.get_state()
            if state.views and not state.loading:
                break
        time.sleep(SETTLED)
        yield HeadlessViewer(client)
