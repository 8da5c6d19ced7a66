"""What the behaviours exchange. Frames: `odom` is fixed, z up, its origin the first pose; `base_link` x forward, y left,
z up. Metres, radians, seconds; stamps int64 nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from garbi_map.log.records import Floats

AXES = ("surge", "heave", "yaw", "pitch")

Angle = TypeVar("Angle", float, Floats)


def within_half_turn(angle: Angle) -> Angle:
    """The same angle, or angles, from -pi to pi rad."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class Pose:
    """The vehicle at one moment.

    position   (3,) m of base_link in odom
    rotation   (3, 3) odom <- base_link
    velocity   (3,) m/s of base_link over ground, axes of base_link
    rate       (3,) rad/s, axes of base_link
    acceleration  (3,) m/s^2 over ground, axes of base_link; nought where nothing measures it
    """

    stamp_ns: int
    position: Floats
    rotation: Floats
    velocity: Floats
    rate: Floats
    acceleration: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def heading(self) -> float:
        """rad, from odom's x."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    @property
    def tilt(self) -> float:
        """rad, pitch of the bow: positive down."""
        return float(np.arcsin(np.clip(-self.rotation[2, 0], -1.0, 1.0)))

    def to_base(self, points: Floats) -> Floats:
        """Points (n, 3) in odom, seen from base_link."""
        return (points - self.position) @ self.rotation


@dataclass(frozen=True)
class Profile:
    """One image's stripe as points, as it became known.

    stamp_ns    mid-exposure; known_ns: when the behaviours have it
    alpha       rad, the laser's angle; sweep: number of the pass
    row         (n,) image rows; depth (n,) m along the optical axis
    points      (n, 3) m, odom
    intensity   (n,) grey levels
    solid       (n,) bool, the point belongs to a piece of line rather than to a dot
    piece       (n,) number of the piece
    pose        of the vehicle at stamp_ns, as navigation knew it at known_ns
    """

    stamp_ns: int
    known_ns: int
    alpha: float
    sweep: int
    row: NDArray[np.int32]
    depth: Floats
    points: Floats
    intensity: Floats
    solid: NDArray[np.bool_]
    piece: NDArray[np.int64]
    pose: Pose


@dataclass(frozen=True)
class Command:
    """Velocities asked for: surge, heave m/s, yaw, pitch rad/s, axes of base_link. GARBI has no sway."""

    surge: float = 0.0
    heave: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0

    def array(self) -> Floats:
        """(4,)"""
        return np.array([self.surge, self.heave, self.yaw, self.pitch])

    @staticmethod
    def of(values: Floats) -> Command:
        """From (4,)."""
        return Command(*(float(value) for value in values))


@dataclass(frozen=True)
class Proposal:
    """What one behaviour wants.

    activation  0..1: how much it matters now
    axes        the axes that it cares for; the others are left to whoever is asked next
    expires_ns  after that moment it is void
    faces       it is about the heading: no more than what stands may turn the vehicle out of it, though water carries it
                on to where nobody has looked
    dares       what comes would surely hit it elsewhere: unseen water is the lesser evil, only what was seen bounds it
    """

    name: str
    activation: float
    command: Command
    reason: str
    priority: int = 0
    axes: tuple[str, ...] = AXES
    expires_ns: int = 2**62
    facts: dict[str, float] = field(default_factory=dict)
    faces: bool = False
    dares: bool = False
