"""Dives that cannot tell of a rig, and rigs that are beyond a small correction: refused in one line."""

from __future__ import annotations

import numpy as np

from garbi_map.calibrate.field_evidence import Finding
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats, Navigation
from garbi_map.navigate import Trajectory
from garbi_map.register import Registered
from garbi_map.sweep.store import SweepStore
from garbi_map.words import many

_FEWEST_MATCHES = 300
_STILL = 0.01
"""m rms about its mean, and rad likewise, that a vehicle has to move: sweeps from one place are bent alike."""
_APART = 6e-4
"""m between matched surfels, six times what is usual, where a small correction of the rig is not what is missing."""
_FAR = 4.0
"""Times the sigma beforehand from which a correction is no small one."""


def refuse_dive(where: str, store: SweepStore, log: Navigation) -> None:
    """Raises GarbiError for what is known to be too little before any of it is registered."""
    if len(store) < 2:
        raise GarbiError(f"{where}: {many(len(store), 'sweep')}: a rig is checked by sweeps that overlap, two or more")
    if log.imu is None:
        raise GarbiError(f"{where}: no IMU: a turning that no sensor tells can pass for anything that a rig does")


def refuse_rig(where: str, registered: Registered, found: Finding) -> None:
    """Raises GarbiError for what turns out to be too little, or too wrong."""
    evidence = found.stretches
    matches = sum(one.matches for one in evidence)
    if matches < _FEWEST_MATCHES:
        raise GarbiError(
            f"{where}: sweeps agree in {many(matches, 'place')}, at least {_FEWEST_MATCHES} are needed: they do not "
            "overlap, the scene moves, or the rig is another"
        )
    if _stillness(registered.trajectory) < _STILL:
        raise GarbiError(
            f"{where}: the vehicle hardly moves: sweeps from one place agree with any rig; use a dive with some sway"
        )
    apart = max(one.distance for one in evidence)
    if not apart < _APART:
        raise GarbiError(
            f"{where}: sweeps lie {1e3 * apart:.1f} mm apart with the best rig that is near the given one: the scene "
            "moves, or the rig is another; calibrate with a target (garbi calibrate laser)"
        )
    far = np.abs(found.correction) / found.unknowns.sigma
    if far.max() > _FAR:
        name = found.unknowns.names[int(np.argmax(far))]
        raise GarbiError(
            f"{where}: {name} would have to change by {far.max():.0f} times what may have slipped: the rig is another; "
            "calibrate with a target (garbi calibrate laser)"
        )


def _stillness(path: Trajectory) -> float:
    """How much the vehicle moves, rms, m or rad, whichever is more."""
    away = path.position - path.position.mean(axis=0)
    turned: Floats = (path.rotation * path.rotation.mean().inv()).as_rotvec()
    return float(np.sqrt(max(np.square(away).sum(axis=1).mean(), np.square(turned).sum(axis=1).mean())))
