"""What could not be used, in words on the timeline."""

from __future__ import annotations

from typing import TYPE_CHECKING

from garbi_map.view import style
from garbi_map.view.stream import set_time

if TYPE_CHECKING:
    from rerun import RecordingStream


def send_losses(recording: RecordingStream, lines: list[str], stamp_ns: int) -> None:
    """One entry per line, all at one stamp."""
    import rerun as rr

    set_time(recording, stamp_ns)
    for line in lines:
        recording.log(style.LOSSES, rr.TextLog(line, level="WARN"))
    recording.reset_time()
