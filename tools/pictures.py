"""The README's pictures of a map, taken by Rerun's viewer without a screen.

    python -m tools.pictures DIR -o docs/pictures

writes `map.png` (the whole screen with the finished map) and one picture per way of colouring (`depth.png`,
`uncertainty.png`, ...). Needs a Vulkan driver; Debian: mesa-vulkan-drivers libgl1-mesa-dri libxkbcommon-x11-0.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import os
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

TIMELINE = "stamp"
_MENU = 37
"""Pixels of the viewer's menu, which no picture needs."""
_PATIENCE = 60.0
_DRAWN = 1.5
"""Seconds after which a software renderer has drawn what it was told."""


class NoViewer(Exception):
    """The viewer does not start here; the text says why."""


@contextlib.contextmanager
def headless(recording: Path) -> Iterator[ViewerClient]:
    """A viewer without a screen in which a recording is open. Raises NoViewer where there is nothing to draw with."""
    os.environ["RERUN_ANALYTICS"] = "0"
    from rerun.experimental import ViewerClient

    found = importlib.util.find_spec("rerun_cli")
    if found is None or found.origin is None:
        raise NoViewer("rerun-sdk has no viewer here")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    try:  # the binary itself: ending the command `rerun`, which only starts it, would leave the viewer behind
        viewer = ViewerClient.spawn(headless=True, port=port, executable_path=str(Path(found.origin).parent / "rerun"))
    except Exception as error:
        raise NoViewer(f"the headless viewer does not start: {error}") from error
    with viewer:
        viewer.open(str(recording.resolve()))
        until = time.monotonic() + _PATIENCE
        while viewer.get_state().loading:
            if time.monotonic() > until:
                raise NoViewer(f"{recording} was not loaded within {_PATIENCE:.0f} s")
            time.sleep(0.2)
        time.sleep(_DRAWN)
        yield viewer


def span_of(viewer: ViewerClient) -> tuple[int, int]:
    """First and last stamp, ns, of the recording that is open."""
    for timeline in viewer.get_state().recordings[0].timelines:
        if timeline.name == TIMELINE and timeline.start is not None and timeline.end is not None:
            return timeline.start, timeline.end
    raise NoViewer(f"the recording has no timeline {TIMELINE}")


def go_to(viewer: ViewerClient, stamp_ns: int) -> None:
    """Put the cursor at a stamp and wait until that is drawn."""
    import numpy as np

    viewer.set_time(TIMELINE, timestamp=np.datetime64(stamp_ns, "ns"), play_state="paused")
    time.sleep(_DRAWN)


def open_tab(viewer: ViewerClient, view_id: str) -> None:
    """Bring a view to the front of the tabs that it is one of, and wait until it is drawn."""
    read = viewer.get_blueprint()
    wanted = f"/view/{view_id}"
    for part in read.blueprint.values():
        container = part.get("ContainerBlueprint", {})
        if container.get("container_kind") == "Tabs" and wanted in container.get("contents", []):
            container["active_tab"] = wanted
    viewer.set_blueprint(read.blueprint, "recording", store_id=read.store_id)
    time.sleep(_DRAWN)


def take_pictures(recording: Path, folder: Path) -> list[Path]:
    """The pictures of a finished map; returns their files."""
    import cv2

    folder.mkdir(parents=True, exist_ok=True)
    taken = [folder / "map.png"]
    with headless(recording) as viewer:
        go_to(viewer, span_of(viewer)[1])
        viewer.save_screenshot(str(taken[0].resolve()))
        for view in viewer.get_state().views:
            if view.view_class == "3D":
                taken.append(folder / f"{view.name.lower().replace(' ', '_')}.png")
                open_tab(viewer, view.view_id)
                viewer.save_screenshot(str(taken[-1].resolve()), view.view_id)
    whole = cv2.imread(str(taken[0]))
    if whole is not None:
        cv2.imwrite(str(taken[0]), whole[_MENU:])
    return taken


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Pictures of a finished map, for the README.")
    parser.add_argument("map", type=Path, help="folder of a map, or its recording")
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/pictures"), help="folder of the pictures")
    given = parser.parse_args()
    recording = given.map / "map.rrd" if given.map.is_dir() else given.map
    if not recording.is_file():
        print(f"{recording}: no such file; build the map first", file=sys.stderr)
        return 1
    try:
        for file in take_pictures(recording, given.output):
            print(file)
    except NoViewer as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
