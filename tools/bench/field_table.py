"""The tables of tools.bench.field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from garbi_map.calibrate.scanner import LATENCY

if TYPE_CHECKING:
    from tools.bench.field import Row

_DELTA = "laser.delta"
_OBSERVED = 0.01
"""1 sigma, degrees, below which a dive is said to observe delta."""
HEAD = """# The rig checked on ordinary dives

Median distance of the map to the true surface after one rigid alignment, mm, registered as `garbi map` does with the rig
as given, as `garbi calibrate field` leaves it, and with the right one; ratio: corrected to right. NEES: error of the
parameters squared over what their covariance expects, all of them free, per parameter that the dive tells (about six of
eight: what only the prior tells is right by the benchmark's making). CPU: of the check beside that of navigation and
registration, which it needs too; images and files come on top of both.
"""


def markdown(rows: Sequence[Row]) -> str:
    """Everything measured so far; flat bottoms apart."""
    flat = [row for row in rows if row.dive.startswith("flat")]
    rows = [row for row in rows if row not in flat]
    parts = [HEAD, *_summary(rows), "", *_parameters(rows), "", *_flat(flat), *_all(rows), ""]
    return "\n".join(parts)


def _summary(rows: Sequence[Row]) -> list[str]:
    cases = dict.fromkeys(row.case for row in rows)
    lines = [
        "## By what is wrong",
        "",
        "| wrong | dives | given | corrected | right | ratio, median | worst | within 1.3 |",
    ]
    lines.append("| --- " * 8 + "|")
    for case in cases:
        own = [row for row in rows if row.case == case]
        ratio = np.array([row.corrected_mm / row.right_mm for row in own])
        maps = [np.median([getattr(row, name) for row in own]) for name in ("given_mm", "corrected_mm", "right_mm")]
        lines.append(
            f"| {case} | {len(own)} | {maps[0]:.3f} | {maps[1]:.3f} | {maps[2]:.3f} | {np.median(ratio):.2f} | "
            f"{ratio.max():.2f} | {int((ratio <= 1.3).sum())} of {len(own)} |"
        )
    right = [row for row in rows if row.case == "right"]
    alone = sum(not row.offered for row in right)
    return [*lines, "", f"A right rig is left alone in {alone} of {len(right)}."]


def _parameters(rows: Sequence[Row]) -> list[str]:
    lines = ["## Parameters, all cases together", ""]
    lines += [
        "| parameter | dives that tell | error, rms | largest | sigma, median | error over sigma, rms |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name in dict.fromkeys(name for row in rows for name in row.names):
        factor, unit = (1e3, "mm") if name in ("laser.x", "laser.y", "laser.z") else (np.rad2deg(1.0), "deg")
        factor, unit = (1e3, "ms") if name == LATENCY else (factor, unit)
        told = [(row.error[k], row.sigma[k]) for row in rows for k in _place(row, name) if row.seen[k]]
        lines.append(_line(f"{name}, {unit}", factor * np.array(told).reshape(-1, 2), len(rows)))
    delta = np.rad2deg([(row.error[k], row.sigma[k]) for row in rows for k in _place(row, _DELTA)]).reshape(-1, 2)
    lines.append(_line(f"laser.delta where its sigma is below {_OBSERVED}", delta[delta[:, 1] < _OBSERVED], len(rows)))
    ratio = [1.0 + row.field_cpu_s / row.map_cpu_s for row in rows]
    return [
        *lines,
        "",
        *_consistency(rows),
        f"CPU, registration and check over registration alone: median {np.median(ratio):.2f}, most {max(ratio):.2f}.",
    ]


def _line(name: str, told: NDArray[np.float64], count: int) -> str:
    """A line for what `told` (n, 2), errors and sigmas, says."""
    if not len(told):
        return f"| {name} | 0 of {count} | | | | |"
    error, sigma = told.T
    return (
        f"| {name} | {len(told)} of {count} | {np.sqrt(np.mean(error**2)):.4f} | {np.abs(error).max():.4f} | "
        f"{np.median(sigma):.4f} | {np.sqrt(np.mean((error / sigma) ** 2)):.2f} |"
    )


def _consistency(rows: Sequence[Row]) -> list[str]:
    """NEES in its band; one row of each dive, for all of a dive share its noise."""
    dives = list(dict.fromkeys(row.dive for row in rows))
    own = [[row for row in rows if row.dive == dive] for dive in dives]
    freedom = sum(float(np.mean([row.told for row in group])) for group in own)
    squares = sum(float(np.mean([row.nees * row.told for row in group])) for group in own)
    low, high = chi2.ppf([0.025, 0.975], freedom) / freedom
    return [
        f"NEES {squares / freedom:.2f}, rows of one dive averaged, for they share its noise; 95 % band of {len(dives)} "
        f"dives [{low:.2f} {high:.2f}]."
    ]


def _flat(rows: Sequence[Row]) -> list[str]:
    if not rows:
        return []
    lines = ["## A flat bottom without any feature", "", "| dive | wrong | given | corrected | right | it says |"]
    lines.append("| --- " * 6 + "|")
    for row in rows:
        maps = f"{row.given_mm:.3f} | {row.corrected_mm:.3f} | {row.right_mm:.3f}"
        lines.append(f"| {row.dive} | {row.case} | {maps} | {row.why} |")
    return [*lines, ""]


def _all(rows: Sequence[Row]) -> list[str]:
    lines = [
        "## All",
        "",
        "| dive | wrong | given | corrected | right | ratio | changed | held out, mm | NEES | CPU s |",
    ]
    lines.append("| --- " * 10 + "|")
    for row in rows:
        changed = ", ".join(name.removeprefix("laser.") for name in row.changed) if row.offered else ""
        given, corrected = row.held_out_mm
        lines.append(
            f"| {row.dive} | {row.case} | {row.given_mm:.3f} | {row.corrected_mm:.3f} | {row.right_mm:.3f} | "
            f"{row.corrected_mm / row.right_mm:.2f} | {changed} | {given:.3f} to {corrected:.3f} | {row.nees:.2f} | "
            f"{row.map_cpu_s:.1f} + {row.field_cpu_s:.1f} |"
        )
    return lines


def _place(row: Row, name: str) -> list[int]:
    return [k for k, own in enumerate(row.names) if own == name]
