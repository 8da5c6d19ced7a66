"""Clocks that differ: found by the sweeps, applied to what was recorded, and told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from garbi_map.log.records import Navigation
from garbi_map.register.constants import Learnt

_SURE = 5.0
"""Times its sigma that an offset must be from zero to be applied: a right clock is set wrong by any other."""
_SIGNIFICANT = 3.0
"""The same for what is left of it in the end, which is small."""
_WORTH = 5e-4
"""s; a smaller offset moves nothing that can be seen."""
_SEEN = 0.3
"""Share of the prior's sigma above which the dive has not told anything."""

NAMES = {
    "imu_clock": "the IMU's stamps",
    "dvl_clock": "the DVL's stamps",
    "pressure_clock": "the pressure's stamps",
    "encoder_latency": "the encoder's stamps",
}


@dataclass(frozen=True)
class Offset:
    """By how many seconds the stamps of a sensor are late against the camera's, 1 sigma, and what was done about it.

    `kept`: the stamps may be right, or differ too little to matter; `unseen`: the dive does not tell; both leave them as
    they are.
    """

    name: str
    value: float
    sigma: float
    state: Literal["applied", "kept", "unseen"]

    @property
    def notable(self) -> bool:
        """Whether it was corrected and is more than what any two devices differ by."""
        return self.state == "applied" and abs(self.value) >= _WORTH

    def __str__(self) -> str:
        late = f"{1e3 * abs(self.value):.2f} ± {1e3 * self.sigma:.2f} ms {'late' if self.value > 0 else 'early'}"
        told = {
            "applied": f"are {late} against the camera's: corrected",
            "kept": f"agree with the camera's: {1e3 * self.value:.1f} ± {1e3 * self.sigma:.1f} ms",
            "unseen": "cannot be checked against the camera's on this dive: kept",
        }
        return f"{NAMES[self.name]} {told[self.state]}"


def judged(found: dict[str, Learnt], applied: dict[str, float]) -> list[Offset]:
    """The clocks among the constants that a dive has told of, on top of what is already applied, s."""
    out = []
    for name in (name for name in found if name in NAMES):
        more, sigma = float(found[name].value[0]), float(found[name].sigma[0])
        before = applied.get(name, 0.0)
        if abs(more) > max(_SURE * sigma, _WORTH):
            out.append(Offset(name, before + more, sigma, "applied"))
        elif sigma > _SEEN * found[name].prior:
            out.append(Offset(name, before, sigma, "applied" if before else "unseen"))
        else:
            out.append(Offset(name, before or more, sigma, "applied" if before else "kept"))
    return out


def refined(offset: Offset, more: Learnt) -> Offset:
    """An offset after a finer estimate of what is left of it, which is applied however small it is, if it is sure."""
    value, sigma = float(more.value[0]), float(more.sigma[0])
    if abs(value) <= _SIGNIFICANT * sigma:
        return replace(offset, sigma=min(sigma, offset.sigma))
    before = offset.value if offset.state == "applied" else 0.0
    return Offset(offset.name, before + value, sigma, "applied")


def restamped(log: Navigation, offsets: Sequence[Offset]) -> Navigation:
    """The navigation as it was recorded, with the stamps of IMU, DVL and pressure as the offsets say they should be."""
    changed = {}
    for offset in offsets:
        sensor, _, what = offset.name.partition("_")
        record = getattr(log, sensor) if what == "clock" else None
        if record is not None and offset.state == "applied":
            changed[sensor] = replace(record, stamp_ns=record.stamp_ns - round(offset.value * 1e9))
    return replace(log, **changed)
