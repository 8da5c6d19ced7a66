"""What may be wrong with a rig that was right once, and how far it may be off before a dive has been looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from garbi_map.calibrate.scanner import LATENCY, Scanner
from garbi_map.log.records import Floats
from garbi_map.rig import Rig

FOCAL = "camera.focal"
"""Share by which both focal lengths change."""
INDEX = "water.index"
"""By which the water's refractive index changes, before every window there is."""

SLIP = {
    "laser.delta": np.deg2rad(0.5),
    "laser.theta": np.deg2rad(0.2),
    "laser.gamma": np.deg2rad(0.2),
    "laser.beta": np.deg2rad(0.1),
    "laser.x": 0.002,
    "laser.y": 0.002,
    "laser.z": 0.002,
    LATENCY: 0.025,
    FOCAL: 0.005,
    INDEX: 0.003,
}
"""1 sigma by which each may have changed since the rig file was made: rad, m, s and plain numbers. A motor's zero slips
more easily than a sheet bends; what nothing synchronises differs by tens of milliseconds."""
_HELD = 2e-4
"""m, 1 sigma of the baseline where nothing but the rig file tells the metric scale."""


@dataclass(frozen=True)
class RigUnknowns:
    """k corrections of a rig in units of what is expected of them: root (k, k) times z (k,) is what is added to `names`.

    root @ root.T is the prior's covariance, so that z is standard normal before the dive.
    """

    rig: Rig
    names: tuple[str, ...]
    root: Floats

    @property
    def scale(self) -> tuple[str, ...]:
        """Those that are held, for they are the metric scale."""
        return tuple(name for name, sigma in zip(self.names, self.sigma, strict=True) if sigma < 0.5 * SLIP[name])

    @property
    def sigma(self) -> Floats:
        """(k,) 1 sigma of each parameter beforehand, in its unit."""
        return np.sqrt(np.einsum("ij,ij->i", self.root, self.root))

    def offsets(self, z: Floats) -> dict[str, float]:
        """What is added to each parameter."""
        return dict(zip(self.names, (self.root @ z).tolist(), strict=True))

    def at(self, z: Floats) -> Rig:
        """The corrected rig."""
        return self.changed(self.offsets(z))

    def changed(self, offsets: dict[str, float]) -> Rig:
        """The rig with something added to some of its parameters."""
        named = Scanner(self.rig.camera, self.rig.laser)
        values = named.values()
        new: dict[str, float] = {}
        for name, offset in offsets.items():
            if name == FOCAL:
                new |= {key: values[key] * (1.0 + offset) for key in ("camera.alpha_u", "camera.alpha_v")}
            elif name == INDEX:
                keys = ("camera.port.index_water", "laser.window.index_water")
                new |= {key: values[key] + offset for key in keys if key in values}
            elif name != LATENCY:
                new[name] = values[name] + offset
        found = named.changed(new)
        assert found.laser is not None
        return Rig(found.camera, found.laser, self.rig.extra)


def unknowns(
    rig: Rig, motor: bool, focal: bool = False, index: bool = False, baseline_held: bool = True
) -> RigUnknowns:
    """What is unknown of a rig: what may have slipped, and what its file says that it never knew.

    baseline_held: the distance between camera and laser is the metric scale, and stays.
    """
    names = tuple(
        name for name in SLIP if (motor or name != LATENCY) and (focal or name != FOCAL) and (index or name != INDEX)
    )
    covariance = np.diag([SLIP[name] ** 2 for name in names]) + known_covariance(rig, names)
    if baseline_held:
        place = [names.index(f"laser.{axis}") for axis in "xyz"]
        along = np.zeros(len(names))
        along[place] = rig.laser.apex - rig.camera.centre
        along /= np.linalg.norm(along)
        across = np.eye(len(names)) - np.outer(along, along)
        covariance = across @ covariance @ across + _HELD**2 * np.outer(along, along)
    return RigUnknowns(rig, names, np.asarray(np.linalg.cholesky(covariance), np.float64))


def known_covariance(rig: Rig, names: Sequence[str]) -> Floats:
    """What the rig file says of its own uncertainty, (k, k) in the order of names; zero for what it does not tell."""
    out = np.zeros((len(names), len(names)))
    entries: Any = (rig.extra.get("laser") or {}).get("calibration")
    if not isinstance(entries, dict):
        return out
    free = [str(name) for name in entries.get("free") or []]
    try:
        covariance = np.array(entries.get("covariance"), float)
        sound = covariance.shape == (len(free),) * 2 and bool(np.linalg.eigvalsh(covariance).min() > 0)
    except (TypeError, ValueError, np.linalg.LinAlgError):
        sound = False
    shared = [name for name in names if name in free] if sound else []
    here, there = [list(names).index(name) for name in shared], [free.index(name) for name in shared]
    out[np.ix_(here, here)] = covariance[np.ix_(there, there)] if shared else 0.0
    return out
