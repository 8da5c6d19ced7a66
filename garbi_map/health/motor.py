"""Whether the laser's encoder turns, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from garbi_map.health.findings import Finding, spans, told
from garbi_map.health.sample import Stretch, of_role
from garbi_map.rig import Rig

LEAST = 5  # readings of a stretch that say something
STILL = 1e-6  # rad
LEAST_SEEN = 0.5


@dataclass(frozen=True)
class Motor:
    """first, last: rad, smallest and largest angle in the samples; speed: rad/s, median while it turns; sweep: s from
    one turn to the next; stuck: share of the samples in which it stands still; in_view: share of those angles at which
    the sheet can be seen by the camera, None without a rig."""

    first: float
    last: float
    speed: float
    sweep: float
    stuck: float
    in_view: float | None


def check_motor(
    found: list[Stretch], rig: Rig | None, ranges: tuple[float, float]
) -> tuple[Motor | None, list[Finding]]:
    """The motor as the samples show it; ranges: nearest and farthest bottom, m. None where there is no encoder."""
    places = list(of_role(found, "encoder", LEAST))
    if not places:
        return None, []
    times, moved, speeds, lows, highs = [], [], [], [], []
    for stretch, said in places:
        angle, stamps = said.values[:, 0], said.stamp_ns
        times.append(stretch.time)
        moved.append(float(angle.max() - angle.min()))
        seconds = np.diff(stamps)[np.diff(stamps) > 0] * 1e-9
        travelled = np.abs(np.diff(angle))[np.diff(stamps) > 0]
        speeds.append(float(travelled.sum() / seconds.sum()) if len(seconds) else 0.0)
        lows.append(float(angle.min()))
        highs.append(float(angle.max()))
    still = np.array(moved) < STILL
    speed = float(np.median(np.array(speeds)[~still])) if not still.all() else 0.0
    first, last = min(lows), max(highs)
    in_view = None if rig is None else _in_view(rig, first, last, ranges)
    motor = Motor(first, last, speed, (last - first) / speed if speed else 0.0, float(still.mean()), in_view)
    findings = []
    if still.any():
        runs = spans(times, still.tolist())
        where = "throughout" if still.all() else told(runs)
        text = f"encoder: stands still {where}; is the motor on, the encoder connected?"
        findings.append(Finding("encoder_stuck", text, runs[0][0], runs[-1][1]))
    if last - first > 2 * np.pi:
        text = (
            f"encoder: from {first:.3g} to {last:.3g} rad, more than a turn: degrees or counts? set log.scale.encoder"
        )
        findings.append(Finding("encoder_range", text, times[0], times[-1]))
    elif in_view is not None and in_view < LEAST_SEEN:
        text = (
            f"encoder: turns from {np.degrees(first):.1f} to {np.degrees(last):.1f} degrees, but the camera sees the "
            f"sheet at {in_view:.0%} of these angles only, says the rig file: wrong zero, direction, unit or rig?"
        )
        findings.append(Finding("encoder_out_of_view", text, times[0], times[-1]))
    return motor, findings


def _in_view(rig: Rig, first: float, last: float, ranges: tuple[float, float]) -> float:
    seen = []
    for alpha in np.linspace(first, last, 21):
        left, right = rig.column_window(float(alpha), *ranges)
        seen.append(bool((left <= right).mean() > 0.1))
    return float(np.mean(seen))
