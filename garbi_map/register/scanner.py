"""What the scanner's own constants do to its points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount, Stamps
from garbi_map.register.constants import Constant
from garbi_map.rig import Rig
from garbi_map.sweep import Angle, Sweep
from garbi_map.sweep.retime import retimed

Floats = NDArray[np.float64]

Changes = Callable[[Floats, Floats], dict[str, Floats]]
"""By how much points (n, 3) in base_link, seen at n times (s), move with a unit of each constant: name -> (n, 3).

Or (n, 4): the last is the share by which their noise grows with it. A constant that made the whole scene smaller would make
every distance between two sweeps smaller too, right or wrong; what counts is the distance in units of its noise."""

ENCODER = "encoder_latency"
"""The constant by which the encoder's stamps are late against the images', s."""
LATENCY_SIGMA = 0.025
"""s; encoders and cameras that nothing synchronises differ by tens of milliseconds."""
_MOMENT_NS = 10_000_000
"""To either side, over which the laser's rate is taken."""
_SAME_NS = 4_000_000
"""Within which the laser's rate and the derivatives by its angle hardly change."""


@dataclass(frozen=True)
class Scanner:
    """A camera and a laser, mounted on base_link, and the encoder's record."""

    rig: Rig
    angle: Angle
    mount: Mount

    def constants(self) -> list[Constant]:
        """What is unknown of it: a laser that never turns back hides the encoder's latency in the vehicle's motion."""
        return [Constant(ENCODER, LATENCY_SIGMA, "s", patient=True)] if len(self.angle.turns_ns) else []

    def changes(self, points: Floats, stamp_ns: Stamps) -> dict[str, Floats]:
        """By how much points (n, 3) in base_link, seen at stamps (n,), move with a unit of each constant."""
        turn = Rotation.from_quat(self.mount.quaternion)
        seen = turn.inv().apply(points - self.mount.translation)
        pixels = self.rig.project(seen)
        times, which = np.unique(stamp_ns // _SAME_NS, return_inverse=True)
        alpha, before, after = (self.angle.at(times * _SAME_NS + k * _MOMENT_NS)[0][which] for k in (0, -1, 1))
        rate = (after - before) / (2e-9 * _MOMENT_NS)
        by_angle = self.rig.triangulate(pixels[:, 0], pixels[:, 1], alpha).d_dalpha
        return {ENCODER: turn.apply(np.nan_to_num(by_angle * rate[:, None]))}

    def retimed(self, sweep: Sweep, latency: float) -> Sweep:
        """The sweep as it is with an encoder whose stamps are late by so many seconds."""
        return retimed(sweep, self.rig, self.angle, latency)
