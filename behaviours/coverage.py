"""What of a bounded area has been seen, how wide the view is, and where the holes are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from behaviours.settings import SurveySettings
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats

HOLE = 6  # cells that are worth going back for


class Coverage:
    """Counts points per cell of the area (west, south, east, north), m, odom; learns the footprint from real ranges."""

    def __init__(self, settings: SurveySettings, area: tuple[float, float, float, float]) -> None:
        self.settings = settings
        west, south, east, north = area
        self.low = np.array([west, south])
        self.cell = settings.cell
        self.count = np.zeros(
            (max(round((east - west) / self.cell), 1), max(round((north - south) / self.cell), 1)), np.int32
        )
        self._sides: list[tuple[float, float]] = []
        self._heights: list[float] = []

    def see(self, profile: Profile) -> None:
        """Take in the ground that a profile shows."""
        points = profile.points[profile.solid & np.isfinite(profile.points).all(1)]
        if len(points) < 5:
            return
        index, inside = self._cells(points[:, :2])
        np.add.at(self.count, tuple(index[inside].T), 1)
        aside = profile.pose.to_base(points)[:, 1]
        self._sides = [*self._sides[-199:], (float(aside.min()), float(aside.max()))]
        self._heights = [*self._heights[-199:], float(np.percentile(points[:, 2], 90))]

    def _cells(self, points: Floats) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        index = np.floor((points - self.low) / self.cell).astype(np.int64)
        return index, ((index >= 0) & (index < self.count.shape)).all(1)

    def unseen(self, points: Floats) -> NDArray[np.bool_]:
        """Whether points (n, 2), odom, lie in cells of the area that nothing has shown."""
        index, inside = self._cells(points)
        found = np.zeros(len(points), bool)
        found[inside] = self.count[tuple(index[inside].T)] == 0
        return found

    @property
    def share(self) -> float:
        """Of the area's cells that have been seen."""
        return float((self.count > 0).mean())

    @property
    def width(self) -> tuple[float, float] | None:
        """How far the view reaches to starboard (negative) and port, m, lately; None: it has shown no ground yet."""
        if len(self._sides) < 25:
            return None
        sides = np.array(self._sides)
        return float(np.percentile(sides[:, 0], 10)), float(np.percentile(sides[:, 1], 90))

    def ground(self, newest: int = 60) -> float | None:
        """Height, m, of the ground lately, its higher parts."""
        return float(np.max(self._heights[-newest:])) if self._heights else None

    def climb(self, pose: Pose, altitude: float) -> float:
        """Heave, m/s, to an altitude (m) over the higher parts of the ground lately; 0: it has shown none yet."""
        ground = self.ground()
        return 0.0 if ground is None else float(np.clip(0.5 * (ground + altitude - pose.position[2]), -0.1, 0.1))

    def nearest_hole(self, pose: Pose) -> Floats | None:
        """Middle (2,) of the nearest patch of unseen cells; None: there is none worth the way."""
        labels, _ = label(self.count == 0)
        best, least = None, np.inf
        for one, box in enumerate(find_objects(labels), 1):
            cells = np.argwhere(labels[box] == one) + [side.start for side in box]
            if len(cells) < HOLE:
                continue
            places = self.low + (cells + 0.5) * self.cell
            middle = places.mean(0)
            distance = float(np.linalg.norm(middle - pose.position[:2]))
            if distance < least:
                best, least = places[np.linalg.norm(places - middle, axis=1).argmin()], distance
        return best
