"""The tables of tools.bench.field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import chi2

from garbi_map.calibrate.scanner import LATENCY

if TYPE_CHECKING:
    from tools.bench.field import Row

_DELTA = "laser.delta"
HEAD = """# The rig checked on ordinary dives

Median distance of the map to the true surface after one rigid alignment, mm, registered as `garbi map` does with the rig
as given, as `garbi calibrate field` leaves it, and with the right one; ratio: corrected to right. NEES: error of
the parameters squared over what their covariance expects, per parameter, all of them free. CPU: of the check beside that of
navigation and registration, which it needs too; images and files come on top of both.
"""


def markdown(rows: Sequence[Row]) -> str:
    """Everything measured so far."""
    cases = list(dict.fromkeys(row.case for row in rows))
    return "\n".join([HEAD, *_summary(rows, cases), "", *_parameters(rows), "", *_all(rows), ""])


def _summary(rows: Sequence[Row], cases: Sequence[str]) -> list[str]:
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
        "| parameter | dives that tell | error, rms | largest | error over sigma, rms |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name in dict.fromkeys(name for row in rows for name in row.names):
        told = [(row.error[k], row.sigma[k]) for row in rows for k in _place(row, name) if row.seen[k]]
        if not told:
            lines.append(f"| {name} | 0 | | | |")
            continue
        error, sigma = np.array(told).T
        factor, unit = (1e3, "mm") if name in ("laser.x", "laser.y", "laser.z") else (np.rad2deg(1.0), "deg")
        factor, unit = (1e3, "ms") if name == LATENCY else (factor, unit)
        lines.append(
            f"| {name} | {len(told)} of {len(rows)} | {factor * np.sqrt(np.mean(error**2)):.4f} {unit} | "
            f"{factor * np.abs(error).max():.4f} {unit} | {np.sqrt(np.mean((error / sigma) ** 2)):.2f} |"
        )
    freedom = sum(len(row.names) for row in rows)
    low, high = chi2.ppf([0.025, 0.975], freedom) / freedom
    mean = sum(row.nees * len(row.names) for row in rows) / freedom
    sure = [row.error[k] for row in rows for k in _place(row, _DELTA) if row.sigma[k] < np.deg2rad(0.01)]
    within = int((np.abs(sure) < np.deg2rad(0.01)).sum()) if sure else 0
    ratio = [1.0 + row.field_cpu_s / row.map_cpu_s for row in rows]
    return [
        *lines,
        "",
        f"NEES {mean:.2f}, 95 % band [{low:.2f} {high:.2f}] if rows were independent (rows of one dive share its noise).",
        f"delta where its sigma is below 0.01 degrees: within 0.01 degrees in {within} of {len(sure)}.",
        f"CPU, registration and check over registration alone: median {np.median(ratio):.2f}, most {max(ratio):.2f}.",
    ]


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
