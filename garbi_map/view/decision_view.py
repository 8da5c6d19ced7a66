"""What behaviours decided, and why: the surroundings as they were known, who wanted what, what safety made of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.view import style
from garbi_map.view.decisions import AXES, Said, Tick, moments_of, read_ticks, read_verdicts, spans_of
from garbi_map.view.lanes import Lanes
from garbi_map.view.safe_set import AHEAD, START, bow_velocity, outlines
from garbi_map.view.stream import at, name_curves, send_curves, set_time
from garbi_map.view.vehicle import draw_body

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.log import Log

_BATCH = 100
"""Ticks that are sent at once, and held in memory."""
_HULL = 0.9
"""m about the vehicle's centre in which free water is not drawn."""
_LEVEL = 0.06
"""m above and below the vehicle's centre in which free water is drawn: one layer of the volume."""
_VOXEL = 0.1
"""m, of the volume that the behaviours keep."""
_ABOVE = np.array([0.0, 0.0, 0.4])
"""m from the arrow of the command to those of the proposals, which it would hide, and their names above the hull."""
_BEHAVIOUR = "behaviour/"


def stream_decisions(recording: RecordingStream, log: Log) -> Iterator[int]:
    """Send the decisions of a replay; yields the stamp, ns, up to which they have been sent. Memory: a batch of ticks."""
    import rerun as rr

    sender = begin(recording)
    first: int | None = None
    batch: list[Tick] = []
    end = log.end_ns
    for tick in read_ticks(log):
        first = tick.stamp_ns if first is None else first
        end = tick.stamp_ns
        batch.append(tick)
        if len(batch) == _BATCH:
            sender.send(batch)
            batch = []
            yield end
    if batch:
        sender.send(batch)
    verdicts, spans = read_verdicts(log), spans_of(log)
    for name, said in verdicts.items():
        sender.lanes.verdict(name, said, end if first is None else first, end, spans.get(name), moments_of(said))
    sender.lanes.finish(end)
    recording.log(style.ABOUT, rr.TextDocument(_about(verdicts), media_type="text/markdown"), static=True)
    yield end


def begin(recording: RecordingStream) -> Decisions:
    """What is drawn before the first tick."""
    import rerun as rr

    recording.log(style.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    draw_body(recording)
    return Decisions(recording)


class Decisions:
    """Sends ticks, in batches; what does not change is sent once."""

    def __init__(self, recording: RecordingStream) -> None:
        self.recording = recording
        self.lanes = Lanes(recording)
        self._known: set[str] = set()
        self._words = ""
        name_curves(recording, style.SURGE)
        self._draw_styles()

    def send(self, ticks: list[Tick]) -> None:
        """The ticks of a batch, ascending."""
        self._send_poses(ticks)
        self._send_surroundings(ticks)
        for tick in ticks:
            self._send_words(tick)
            self.lanes.tick(tick)
        stamps = np.array([tick.stamp_ns for tick in ticks], np.int64)
        surges = [[_said(tick, name).command()[0] for name in ("coordinator", "safety")] for tick in ticks]
        send_curves(self.recording, style.SURGE, stamps, surges)
        for name in sorted({name for tick in ticks for name in tick.named(_BEHAVIOUR)}):
            values = [_said(tick, _BEHAVIOUR + name).number("activation") for tick in ticks]
            self._name_activation(name)
            send_curves(self.recording, style.activation(name), stamps, np.nan_to_num(values))
        self._send_arrows(ticks)

    def _draw_styles(self) -> None:
        import rerun as rr

        occupied = rr.Boxes3D.from_fields(colors=[style.OCCUPIED.colour], fill_mode="solid")
        self.recording.log(style.OCCUPIED.path, occupied, static=True)
        free = rr.Points3D.from_fields(colors=[style.FREE.colour], radii=0.012)
        self.recording.log(style.FREE.path, free, static=True)
        safe = rr.LineStrips3D.from_fields(colors=[style.SAFE.colour], radii=0.006)
        self.recording.log(style.SAFE.path, safe, static=True)
        moving = rr.Ellipsoids3D.from_fields(colors=[style.MOVING.colour], fill_mode="solid")
        self.recording.log(style.MOVING.path, moving, static=True)
        heading = rr.Arrows3D.from_fields(colors=[style.MOVING.colour], radii=0.02)
        self.recording.log(style.MOVING_VELOCITY, heading, static=True)
        self._style_arrow(style.COMMAND.path, style.COMMAND.colour, 0.028)

    def _style_arrow(self, path: str, colour: style.Colour, radius: float, label: str | None = None) -> None:
        import rerun as rr

        labels = None if label is None else [label]
        arrow = rr.Arrows3D.from_fields(colors=[colour], radii=radius, labels=labels, show_labels=label is not None)
        self.recording.log(path, arrow, static=True)

    def _name_activation(self, name: str) -> None:
        if name not in self._known:
            self._known.add(name)
            name_curves(self.recording, style.activation(name))
            self._style_arrow(style.proposal(name).path, style.proposal(name).colour, 0.018, name)

    def _send_poses(self, ticks: list[Tick]) -> None:
        import rerun as rr

        found = [(tick.stamp_ns, *_pose(tick)) for tick in ticks if np.isfinite(_pose(tick)[0]).all()]
        if found:
            stamps, places, turns = (np.array(column) for column in zip(*found, strict=True))
            rows = rr.Transform3D.columns(translation=places.astype(np.float32), quaternion=turns.astype(np.float32))
            self.recording.send_columns(style.VEHICLE, at(stamps), rows)

    def _send_arrows(self, ticks: list[Tick]) -> None:
        """Of every behaviour that acts, and of the command; one that is silent has no arrow."""
        import rerun as rr

        stamps = np.array([tick.stamp_ns for tick in ticks], np.int64)
        names = sorted({name for tick in ticks for name in tick.named(_BEHAVIOUR)})
        paths = {_BEHAVIOUR + name: style.proposal(name).path for name in names} | {"safety": style.COMMAND.path}
        for part, path in paths.items():
            origin = START if part == "safety" else START + _ABOVE
            said = [_said(tick, part) for tick in ticks]
            tips = AHEAD * bow_velocity(np.array([one.command() for one in said]))
            acts = np.array([part == "safety" or one.number("activation") > 0.0 for one in said])
            acts &= np.linalg.norm(tips, axis=1) > 0.01
            rows = rr.Arrows3D.columns(
                vectors=tips[acts].astype(np.float32), origins=np.tile(origin, (int(acts.sum()), 1)).astype(np.float32)
            ).partition(acts.astype(int))
            self.recording.send_columns(path, at(stamps), rows)

    def _send_surroundings(self, ticks: list[Tick]) -> None:
        import rerun as rr

        for tick in ticks:
            set_time(self.recording, tick.stamp_ns)
            if tick.allowed is not None:
                lines = outlines(tick.allowed, _said(tick, "safety").command())
                self.recording.log(style.SAFE.path, rr.LineStrips3D.from_fields(strips=lines))
            if tick.volume is not None:
                full = tick.volume[:, 3] > 0.5
                half = np.full((int(full.sum()), 3), 0.45 * _VOXEL, np.float32)
                boxes = rr.Boxes3D.from_fields(centers=tick.volume[full, :3], half_sizes=half)
                self.recording.log(style.OCCUPIED.path, boxes)
                away = tick.volume[~full, :3] - _pose(tick)[0]
                shown = (np.abs(away[:, 2]) < _LEVEL) & (np.linalg.norm(away, axis=1) > _HULL)
                self.recording.log(style.FREE.path, rr.Points3D.from_fields(positions=tick.volume[~full, :3][shown]))
            self._send_moving(tick)
        self.recording.reset_time()

    def _send_moving(self, tick: Tick) -> None:
        import rerun as rr

        moving = list(tick.named("moving/").values())
        if not moving and "moving" not in self._known:
            return
        self._known.add("moving")
        centres = np.array([[one.number(axis) for axis in "xyz"] for one in moving]).reshape(-1, 3)
        speeds = np.array([[one.number("v" + axis) for axis in "xyz"] for one in moving]).reshape(-1, 3)
        radii = np.array([one.number("radius") for one in moving])
        balls = rr.Ellipsoids3D.from_fields(centers=centres, half_sizes=np.repeat(radii[:, None], 3, axis=1))
        self.recording.log(style.MOVING.path, balls)
        self.recording.log(style.MOVING_VELOCITY, rr.Arrows3D.from_fields(origins=centres, vectors=AHEAD * speeds))

    def _send_words(self, tick: Tick) -> None:
        """Why, in words: shown as a page whenever they change, and kept as lines."""
        import rerun as rr

        page = _page(tick)
        if page == self._words:
            return
        self._words = page
        set_time(self.recording, tick.stamp_ns)
        self.recording.log(style.WORDS, rr.TextDocument(page, media_type="text/markdown"))
        safety = _said(tick, "safety")
        if safety.level or _said(tick, "feed").level:
            said = safety.words if safety.level else _said(tick, "feed").words
            self.recording.log(style.LOSSES, rr.TextLog(said, level="WARN"))
        self.recording.reset_time()


def _said(tick: Tick, part: str) -> Said:
    return tick.parts.get(part, Said(0, "", {}))


def _pose(tick: Tick) -> tuple[np.ndarray, np.ndarray]:
    """Position and attitude; older logs tell the heading alone."""
    if tick.position is not None and tick.quaternion is not None:
        return tick.position, tick.quaternion
    feed = _said(tick, "feed")
    place = np.array([feed.number(axis) for axis in "xyz"])
    return place, Rotation.from_euler("z", np.nan_to_num(feed.number("heading"))).as_quat()


def _page(tick: Tick) -> str:
    safety, coordinator, feed = (_said(tick, name) for name in ("safety", "coordinator", "feed"))
    moves = ", ".join(f"{axis} {value:+.2f}" for axis, value in zip(AXES, safety.command(), strict=True))
    lines = [f"**{moves}** (m/s, rad/s)", "", "| who | how much | why |", "| --- | --- | --- |"]
    for name, said in tick.named(_BEHAVIOUR).items():
        lines.append(f"| {name} | {np.nan_to_num(said.number('activation')):.2f} | {said.words} |")
    lines += [
        f"| coordinator | | {coordinator.words} |",
        f"| safety | {'changes' if safety.level else 'passes'} | {safety.words} |",
        f"| view ahead | | {feed.values.get('view', '')} |",
    ]
    if feed.level:
        lines.append(f"| input | trouble | {feed.words} |")
    return "\n".join(lines)


def _about(verdicts: dict[str, Said]) -> str:
    from garbi_map.view.about import legend

    things = (style.COMMAND, style.PROPOSAL, style.SAFE, style.OCCUPIED, style.FREE, style.MOVING)
    lines = [f"| {name} | **{said.values.get('verdict', '?')}** | {said.words} |" for name, said in verdicts.items()]
    table = "\n".join(["| expected | came to | |", "| --- | --- | --- |", *lines]) if lines else "Nothing was expected."
    return f"""\
**What the vehicle would have done, and why.** {legend(things)} Arrows show where the bow would be in {AHEAD:.0f} s.

{table}
"""
