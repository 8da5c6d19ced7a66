"""A rig that is wrong, noticed by a map that is made with it: cheap, and without saying what to do but to look."""

from __future__ import annotations

import numpy as np

from garbi_map.calibrate.field import Registration, begin_joint
from garbi_map.calibrate.field_evidence import judge
from garbi_map.calibrate.field_joint import ROUNDS
from garbi_map.calibrate.field_known import Known
from garbi_map.calibrate.field_rig import unknowns
from garbi_map.calibrate.field_words import amount

_LENGTH = 40.0
"""s of the dive that are looked at."""
_ROUNDS = (0, 1, 6, ROUNDS - 1)
"""Of those of `garbi calibrate field`: enough to see that something is wrong, not to say how much."""
_SURE = 60.0
"""Of the cost, by which it has to fall: so few rounds leave a right rig further from zero than all of them."""


def rig_notes(dive: Registration) -> list[str]:
    """One line where overlapping sweeps differ with the laser's angle and the range as a wrong rig makes them differ.

    A few rounds of what `garbi calibrate field` does, about the finished registration, which has set the encoder's latency
    right already. Nothing is said where there is no IMU or hardly any overlap.
    """
    if dive.log.imu is None or len(dive.store) < 2:
        return []
    unknown = unknowns(dive.rig, motor=False)
    begin = int(dive.store.entries[0].begin_ns)
    joint = begin_joint(dive, unknown, begin, begin + round(_LENGTH * 1e9), np.zeros(len(unknown.names)), Known())
    joint.solve(_ROUNDS)
    found = judge(unknown, [joint.evidence()])
    if not found.offered or found.gain < _SURE:
        return []
    told = ", ".join(f"{name} by about {amount(name, value)}" for name, value in found.corrections.items())
    return [f"sweeps that overlap disagree as they do with a wrong rig ({told}): check it with garbi calibrate field"]
