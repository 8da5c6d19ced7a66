"""What a dive knows of a rig, as a table and in sentences."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from garbi_map.calibrate.field_evidence import SEEN, Finding
from garbi_map.calibrate.field_rig import FOCAL, INDEX, RigUnknowns
from garbi_map.calibrate.scanner import LATENCY, Scanner, unit_of

_SCALES = {"rad": (np.rad2deg(1.0), "deg"), "m": (1e3, "mm"), "s": (1e3, "ms"), "": (1.0, "")}
_SCALES[FOCAL] = (100.0, "%")


class Line(NamedTuple):
    """One parameter: as given, as found with 1 sigma, what was known beforehand, all as written; and what follows."""

    name: str
    given: str
    found: str
    sigma: str
    before: str
    information: str
    verdict: str


def table(found: Finding) -> list[Line]:
    """A line for each parameter."""
    unknowns = found.unknowns
    given = _given(unknowns)
    lines = []
    for k, name in enumerate(unknowns.names):
        factor, unit = _SCALES.get(name) or _SCALES[unit_of(name)]
        changed = found.offered and found.changed[k]
        value = given[name] + (found.correction[k] if changed else found.estimate[k])
        share = found.sigma[k] / unknowns.sigma[k]
        digits = max(0, 1 - int(np.floor(np.log10(factor * found.sigma[k]))))
        lines.append(
            Line(
                f"{name} [{unit}]" if unit else name,
                f"{factor * given[name]:.{digits}f}",
                f"{factor * value:.{digits}f}",
                f"{factor * found.sigma[k]:.{digits}f}",
                f"{factor * unknowns.sigma[k]:.{digits}f}",
                "fixed by the dive" if share < SEEN else "weak" if share < 0.9 else "none",
                _verdict(found, k, changed),
            )
        )
    return lines


def _verdict(found: Finding, k: int, changed: bool) -> str:
    if changed:
        return "corrected"
    if found.changed[k]:
        return "not confirmed by places held out: kept"
    if found.unknowns.names[k] in found.unknowns.scale:
        return "held: metric scale"
    return "agrees: kept" if found.sigma[k] < SEEN * found.unknowns.sigma[k] else "not seen: kept"


def sentences(found: Finding) -> list[str]:
    """What the dive fixes, what it says nothing about, what tells the metric scale, and what was done and why."""
    unknowns = found.unknowns
    seen = found.sigma < SEEN * unknowns.sigma
    names = [name.removeprefix("laser.") for name in unknowns.names]
    fixed = [f"{name} to {amount(unknowns.names[k], found.sigma[k])}" for k, name in enumerate(names) if seen[k]]
    blind = [name for k, name in enumerate(names) if not seen[k]]
    lines = []
    if fixed:
        silent = f" and says nothing, or little, about {_list(blind)}" if blind else ""
        lines.append(f"this dive fixes {_list(fixed)}{silent}")
    else:
        lines.append("this dive fixes nothing of the rig: its overlapping sweeps are alike whatever the rig is")
    length = float(np.linalg.norm(unknowns.rig.laser.apex - unknowns.rig.camera.centre))
    told = f"the baseline of {1e3 * length:.1f} mm between camera and laser in the rig file, held"
    lines.append(f"metric scale: {told if unknowns.scale else 'the height of a known patch'}")
    before, after = (1e3 * value for value in found.held_out)
    apart = f"{before:.3f} mm apart with the given rig, {after:.3f} mm with the corrected one"
    if found.offered:
        lines.append(f"places held out lie {apart}, {found.better:.0f} standard errors better: corrected")
    elif any(found.changed):
        lines.append(f"places held out lie {apart}: no clear gain, so that nothing was changed")
    elif not fixed:
        lines.append("nothing was changed: on ground without features sweeps slide over one another")
    else:
        lines.append("nothing was changed: the given rig agrees with this dive")
    return lines


def _given(unknowns: RigUnknowns) -> dict[str, float]:
    values = Scanner(unknowns.rig.camera, unknowns.rig.laser).values() | {LATENCY: 0.0, FOCAL: 0.0}
    port, window = unknowns.rig.camera.port, unknowns.rig.laser.window
    values[INDEX] = port.index_water if port is not None else window.index_water if window is not None else 0.0
    return values


def amount(name: str, value: float) -> str:
    """A value of a parameter, two digits, with its unit."""
    factor, unit = _SCALES.get(name) or _SCALES[unit_of(name)]
    return f"{float(f'{factor * value:.2g}'):g} {'degrees' if unit == 'deg' else unit}".strip()


def _list(words: list[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
