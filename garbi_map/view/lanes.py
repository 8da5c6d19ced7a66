"""Bands on the timeline: who acts, what safety does, what was expected."""

from __future__ import annotations

from typing import TYPE_CHECKING

from garbi_map.view import style
from garbi_map.view.stream import set_time

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.view.decisions import Said, Tick

_BEHAVIOUR = "behaviour/"


class Lanes:
    """One lane per behaviour, one for safety, one for the input, one per expectation; only changes are sent."""

    def __init__(self, recording: RecordingStream) -> None:
        self.recording = recording
        self._last: dict[str, str] = {}

    @property
    def any(self) -> bool:
        """Whether there is a lane."""
        return bool(self._last)

    def tick(self, tick: Tick) -> None:
        """What the parts do at a tick."""
        winner = tick.parts["coordinator"].values.get("winner") if "coordinator" in tick.parts else None
        for name, said in tick.named(_BEHAVIOUR).items():
            acts = said.number("activation") > 0.0
            self._change(f"{style.LANES}/{name}", _act(acts, name == winner), tick.stamp_ns)
        if "safety" in tick.parts:
            changes = tick.parts["safety"].level > 0
            self._change(f"{style.LANES}/safety", style.CHANGES if changes else "", tick.stamp_ns)
        if "feed" in tick.parts:
            trouble = tick.parts["feed"].level > 0
            self._change(f"{style.LANES}/input", style.TROUBLE if trouble else "", tick.stamp_ns)

    def verdict(
        self,
        name: str,
        said: Said,
        begin_ns: int,
        end_ns: int,
        span: tuple[float, float] | None,
        moments: list[tuple[float, float, bool]] | None,
    ) -> None:
        """What became of an expectation: when it was met and when not, or, where it never was either or the log does not
        tell, its verdict over the seconds that it speaks of; span None: all of the log."""
        lane = f"expected/{name}".replace(" ", "_")
        for begin, end, met in moments or []:
            state = style.MET if met else style.MISSED
            self.span(lane, state, *(begin_ns + round(second * 1e9) for second in (begin, end)))
        if not moments:
            begin, end = span or (0.0, (end_ns - begin_ns) * 1e-9)
            stop_ns = min(begin_ns + round(end * 1e9), end_ns)
            self.span(lane, said.values.get("verdict", ""), begin_ns + round(begin * 1e9), stop_ns)

    def span(self, name: str, state: str, begin_ns: int, end_ns: int) -> None:
        """A band of one lane."""
        self._change(f"{style.LANES}/{name}", state, begin_ns)
        self._change(f"{style.LANES}/{name}", "", end_ns)

    def finish(self, end_ns: int) -> None:
        """Bands end where the log ends."""
        for path in list(self._last):
            self._change(path, "", end_ns)

    def _change(self, path: str, state: str, stamp_ns: int) -> None:
        import rerun as rr

        before = self._last.get(path)
        if before is None:
            values, colours = zip(*style.STATES.items(), strict=True)
            looks = rr.StateConfiguration(values=list(values), colors=[list(colour) for colour in colours])
            self.recording.log(path, looks, static=True)
        if state != before:
            self._last[path] = state
            set_time(self.recording, stamp_ns)
            self.recording.log(path, rr.StateChange(state=[state]))
            self.recording.reset_time()


def _act(acts: bool, leads: bool) -> str:
    return (style.LEADS if leads else style.ACTS) if acts else ""
