"""A rig that is wrong, noticed by a map that is made with it: cheap, and without saying what to do but to look."""

from __future__ import annotations

import numpy as np

from garbi_map.calibrate.field import Registration, begin_joint
from garbi_map.calibrate.field_evidence import judge
from garbi_map.calibrate.field_rig import unknowns
from garbi_map.calibrate.field_words import amount

_LENGTH = 60.0
"""s of the dive that are looked at."""
_SURE = 60.0
"""Of the cost, by which it would have to fall: after one step only, the motion has not followed yet."""


def rig_notes(dive: Registration) -> list[str]:
    """One line where overlapping sweeps differ with the laser's angle and the range as a wrong rig makes them differ.

    One step of what `garbi calibrate field` does, about the finished registration; the encoder's latency is set right by
    that already. Nothing is said where there is no IMU or hardly any overlap.
    """
    if dive.log.imu is None or len(dive.store) < 2:
        return []
    unknown = unknowns(dive.rig, motor=False)
    begin = int(dive.store.entries[0].begin_ns)
    joint = begin_joint(dive, unknown, begin, begin + round(_LENGTH * 1e9), np.zeros(len(unknown.names)))
    found = judge(unknown, [joint.evidence()])
    if not found.offered or found.gain < _SURE:
        return []
    told = ", ".join(f"{name} by about {amount(name, value)}" for name, value in found.corrections.items())
    return [f"sweeps that overlap disagree as they do with a wrong rig ({told}): check it with garbi calibrate field"]
