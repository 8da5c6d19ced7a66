"""What of a bounded area has been seen, how wide the view is, and where the holes are."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from behaviours.settings import SurveySettings
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats

HOLE = 6  # cells that are worth going back for


class Coverage:
    """Counts points per cell of the area (west, south, east, north), m, odom; learns the footprint from real ranges."""

    def __init__(self, settings: SurveySettings) -> None:
        assert settings.area is not None
        self.settings = settings
        west, south, east, north = settings.area
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
        index = np.floor((points[:, :2] - self.low) / self.cell).astype(np.int64)
        inside = ((index >= 0) & (index < self.count.shape)).all(1)
        np.add.at(self.count, tuple(index[inside].T), 1)
        aside = profile.pose.to_base(points)[:, 1]
        self._sides = [*self._sides[-199:], (float(aside.min()), float(aside.max()))]
        self._heights = [*self._heights[-199:], float(np.percentile(points[:, 2], 90))]

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

    def nearest_hole(self, pose: Pose) -> Floats | None:
        """Middle (2,) of the nearest patch of unseen cells; None: there is none worth the way."""
        labels, number = label(self.count == 0)
        best, least = None, np.inf
        for one in range(1, number + 1):
            cells = np.argwhere(labels == one)
            if len(cells) < HOLE:
                continue
            middle = self.low + (cells + 0.5).mean(0) * self.cell
            distance = float(np.linalg.norm(middle - pose.position[:2]))
            if distance < least:
                best, least = (
                    self.low
                    + (cells[np.linalg.norm((cells + 0.5) * self.cell + self.low - middle, axis=1).argmin()] + 0.5)
                    * self.cell,
                    distance,
                )
        return best
