"""The drift estimate while the dive lasts: a window that slides with the newest sweep, by the code of the batch."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.errors import GarbiError
from garbi_map.log.records import Mount, Navigation
from garbi_map.navigate import NavigateSettings, NavigationResult, Trajectory, navigate
from garbi_map.register.scanner import Scanner
from garbi_map.register.sensors import Sensors
from garbi_map.register.settings import DriftSettings
from garbi_map.register.windows import Path, Solution, extend, make_scans
from garbi_map.sweep.types import Sweep

_SETTLED = 0.35
"""Share of the window that stays where it was found: by then many sweeps have seen it."""
_LEAD_NS = 2_000_000_000
"""Navigation before the window's first profile, for the filter to settle."""
_KEPT = 2
"""Windows whose rounds and constants are remembered."""


class LiveDrift:
    """Sweeps in, poses out. What is older than the window is settled; memory follows the area, but for the path's poses.

    Each sweep solves the last `live_window` seconds anew, their oldest part anchored to what was found before, and laid on
    the settled surfels of any earlier time, so that a revisit closes the loop within the matches' reach. A dive that is
    no longer than that is solved from its beginning. Clocks are those of the log: they are for the batch to find.
    """

    def __init__(
        self, mount: Mount, settings: DriftSettings, navigate: NavigateSettings, scanner: Scanner | None = None
    ) -> None:
        self._mount, self._settings, self._navigate, self._scanner = mount, settings, navigate, scanner
        self._sweeps: list[Sweep] = []
        self.epoch_ns = 0
        """Stamp of the first profile of all, from which the path's times count."""
        self.solution: Solution | None = None

    def add(self, sweep: Sweep, log: Navigation) -> Path:
        """The path so far, the profiles of this sweep included.

        sweep: the newest, its index one more than that of the sweep before; log: what has been measured of at least the
        last `live_window` seconds, of which nothing after the sweep's end is looked at.
        Raises GarbiError where the sweep does not span any time or is not newer.
        """
        newest = int(sweep.stamp_ns[-1]) if len(sweep.stamp_ns) else 0
        if len(sweep.stamp_ns) < 2 or (self._sweeps and newest <= self._sweeps[-1].stamp_ns[-1]):
            raise GarbiError(f"sweep {sweep.index}: not newer than the one before; give sweeps in the order of time")
        if not self._sweeps:
            self.epoch_ns = int(sweep.stamp_ns[0])
        oldest = newest - round(self._settings.live_window * 1e9)
        self._sweeps = [one for one in self._sweeps if one.stamp_ns[0] >= oldest] + [sweep]
        first = int(self._sweeps[0].stamp_ns[0])
        log = log.between(first - _LEAD_NS, newest)
        stamps = np.concatenate([one.stamp_ns for one in self._sweeps])
        navigated = navigate(log, self._navigate, stamps)
        prior = navigated.trajectory if log.fixes is not None else self._continued(navigated)
        sensors = Sensors(
            log, prior, navigated.inertial, navigated.attitude, self._navigate, self.epoch_ns, self._scanner
        )
        begin, end = (float((stamp - self.epoch_ns) * 1e-9) for stamp in (first, newest))
        scans = make_scans(self._sweeps, self._mount, sensors, begin, end)
        before = self.solution if begin > 0.0 else None
        settled = begin + _SETTLED * self._settings.live_window
        self.solution = extend(before, scans, sensors, (begin, end), self._settings, settled=settled)
        for history in (self.solution.rounds, self.solution.constants, self.solution.sigmas):
            del history[:-_KEPT]
        return self.solution.path

    def _continued(self, navigated: NavigationResult) -> Trajectory:
        """The filter's trajectory, which begins anew with each window, turned and moved to where the path has got to."""
        made = navigated.trajectory
        if self.solution is None:
            return made
        last = np.array([self.solution.path.time[-1]])
        position, rotation = self.solution.path.at(last)
        there = made.at(np.array([self.epoch_ns + round(float(last[0]) * 1e9)], np.int64))
        heading = (rotation * there.rotation.inv()).as_euler("ZYX")[0, 0]
        onto = np.eye(4)
        onto[:3, :3] = Rotation.from_euler("z", heading).as_matrix()
        onto[:3, 3] = position[0] - onto[:3, :3] @ there.position[0]
        return made.moved(onto)
