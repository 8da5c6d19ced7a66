"""Out of unseen water that the vehicle was carried into.

Close before the bow the camera does not show all that the hull would meet, and abeam it shows nothing: where water has
carried the hull beside what was seen, neither surge nor looking about helps. What is known is the way it came, which the
hull itself has found free: the stern is turned to the longest known stretch, and backing off along it brings what is before
the bow into view. So it does where the way leads round, into water that a turn towards it would enter unseen: of stretches
as long the one is taken that has the bow towards the way."""

from __future__ import annotations

import numpy as np

from behaviours.settings import Vehicle
from behaviours.situation import Situation
from behaviours.types import within_half_turn
from garbi_map.log.records import Floats

PATIENCE = 5.0  # s for which unseen water shuts the bow in; a second in which it does not makes up for half a one
HALF_SHUT = 0.5  # of a second, that one counts in which the way leads into unseen water
TOUCHED = 0.05  # m from the hull, where the unseen lets it make no way
ENOUGH, BACKED = 0.7, 0.4  # m of known water before the bow, and m backed off, that end it
BACK, LEAST = 0.8, 0.15  # m astern that are looked for, and that are worth turning for
HEADINGS = 24
TURN, HABIT = 0.25, 0.15  # m of way astern that a radian of turning, and another heading than before, cost
LONG, TOWARDS = 0.35, 0.5  # m astern, from which on it is worth as much, m, to have the bow on the way as abeam of it
ALIGNED = 0.25  # rad
SPEED, RATE = 0.12, 0.3  # m/s, rad/s


class Retreat:
    """Remembers for how long nothing has been known before the bow, and which way it backs off."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._speed = min(SPEED, vehicle.astern)
        self._blocked, self._last_ns = 0.0, 0
        self._heading: float | None = None
        self._from: Floats = np.zeros(3)

    def propose(self, situation: Situation, way: float, blind: bool) -> tuple[float, float, str] | None:
        """Surge m/s, yaw rad/s and why in words; None where there is known water ahead, or none astern either.

        way: rad, heading in which it leads; blind: it would lead into unseen water now."""
        seconds = float(np.clip((situation.now_ns - self._last_ns) * 1e-9, 0.0, 1.0))
        self._last_ns = situation.now_ns
        shut, corridor = self._shut(situation), situation.corridor
        share = 1.0 if shut else HALF_SHUT if blind else -0.5
        self._blocked = float(np.clip(self._blocked + share * seconds, 0.0, PATIENCE))
        backed = float(np.linalg.norm(situation.pose.position - self._from))
        shows = not shut and (corridor.length > ENOUGH or corridor.end != "unseen")
        if self._heading is not None and (backed > BACK or (backed > BACKED and shows)):
            self._blocked, self._heading = 0.0, None
        if self._heading is None:
            if self._blocked < PATIENCE:
                return None
            self._from = situation.pose.position
        self._heading, astern = self._way_back(situation, way)
        if astern < LEAST:
            self._blocked, self._heading = 0.0, None
            return None
        off = within_half_turn(self._heading - situation.pose.heading)
        words = (
            f"carried into unseen water: {astern:.1f} m are known astern at heading {np.degrees(self._heading):.0f} deg"
        )
        if abs(off) > ALIGNED:  # what it is carried while it turns does not count
            self._from = situation.pose.position
        surge = -self._speed if abs(off) < ALIGNED else 0.0
        return surge, float(np.clip(0.8 * off, -RATE, RATE)), words

    @staticmethod
    def _shut(situation: Situation) -> bool:
        """Whether unseen water at the bow lets the vehicle make no way."""
        corridor, nearby = situation.corridor, situation.nearby
        touched = nearby.unknown & (nearby.normal[:, 0] > 0.3) & (nearby.distance < TOUCHED)
        return bool(touched.any() or (corridor.end == "unseen" and corridor.length < LEAST))

    def _way_back(self, situation: Situation, way: float) -> tuple[float, float]:
        """The heading, rad, with the longest known way astern for the turning it takes and for where it has the bow; that
        way, m."""
        headings = 2 * np.pi * np.arange(HEADINGS) / HEADINGS
        space, pose, drift = situation.space, situation.pose, situation.current / self._speed
        known = np.array([space.known_astern(pose, heading, BACK, drift) for heading in headings])
        worth = known - TURN * np.abs(within_half_turn(headings - situation.pose.heading))
        worth += TOWARDS * np.cos(headings - way) * (known > LONG)
        if self._heading is not None:
            worth -= HABIT * (np.abs(within_half_turn(headings - self._heading)) > 0.01)
        best = int(np.argmax(worth))
        return float(headings[best]), float(known[best])
