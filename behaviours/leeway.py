"""Room to leeward: water carries a vehicle without sway on to what stands downstream unless it turns in time.

Broadside to a current neither surge nor heave leads away; bow or stern has to be turned into it first, and while it turns it
is carried. So a command is let by only as long as afterwards some rehearsed escape (turn either end into the current, either
way round, ahead, astern or on the spot; or go on along the hull) still keeps clear of all that stands; else the best escape
is flown (a backup controller: Gurriet et al., A Scalable Safety Critical Control Framework for Nonlinear Systems, 2020)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from behaviours import kernels_charts
from behaviours.hull import discs, rollout_model
from behaviours.kernels_charts import FAR
from behaviours.kernels_leeway import TURNED, carried
from behaviours.settings import LeewaySettings, Vehicle
from behaviours.space import Space
from behaviours.types import Command, Pose, within_half_turn
from garbi_map.log.records import Floats

STEP, LEAD = 0.5, 2  # s; steps for which a command goes on before an escape begins
REACH = 3.0  # m to each side of the vehicle
ANSWER = 0.75  # of a yaw rate, that is reached for sure
HEAD = 0.1  # m/s against the current once turned
MEAN, OPEN = 0.2, 1.0  # m of gap that a metre of the mean one counts; m, more of which counts no more
STEADY = 0.15  # m of gap that going on with the escape that was begun is worth
WORSE = 0.02  # m of gap that an escape at once has to be worth more than one after the command
HOPELESS, BETTER = (
    0.05,
    0.15,
)  # m left, less than which an old view bounds no more; m more, for which it is gone against
Chart = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64], float]  # see `carried`


class Leeway:
    """Remembers the escape that is being flown."""

    def __init__(self, settings: LeewaySettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._half = np.array(vehicle.hull) / 2
        self._circles, self._radius = discs(vehicle)
        self._model = rollout_model(vehicle)
        self._slide = vehicle.skid * vehicle.sway_time
        self._speed, self._rate = min(0.2, vehicle.astern, vehicle.limits[0]), vehicle.limits[2]
        self._begun = -1

    def check(
        self,
        command: Command,
        pose: Pose,
        space: Space,
        current: Floats,
        fastest: float,
        bold: float = 0.0,
        shun_unseen: bool = True,
    ) -> tuple[Command, str, bool] | None:
        """The escape to fly instead of a command, why in words, and whether it is faster than the view ahead allows: to
        stop for what may have come since would be to be carried on to what is there. None where the command leaves room.

        current (2,) m/s, odom; fastest: m/s of surge that the view ahead allows; bold: that it would if it were fresh;
        shun_unseen: whether to be carried into unseen water counts as much as to be carried on to what stands."""
        escapes = self._escapes(current, fastest)
        chart = self._chart(pose, space)
        gaps = self._rehearse(command, escapes, pose, current, chart, shun_unseen)
        room, enough = self._room(gaps), self._settings.keep + self._settings.release
        dares = False
        if room.max() < HOPELESS and fastest < bold:
            bolder = self._escapes(current, bold)
            others = self._rehearse(command, bolder, pose, current, chart, shun_unseen)
            wider = self._room(others)
            if wider.max() > room.max() + BETTER:
                escapes, gaps, room, dares = bolder, others, wider, True
        if not dares and room.max() >= (enough if self._begun >= 0 else self._settings.keep):
            self._begun = -1
            return None
        now = self._rehearse(None, escapes, pose, current, chart, shun_unseen)
        left = self._room(now)
        worth = left + MEAN * now[:, 2]
        if not dares and self._begun < 0 and worth.max() < (room + MEAN * gaps[:, 2]).max() + WORSE:
            return None
        if self._begun >= 0:
            worth[self._begun] += STEADY
        self._begun = int(np.argmax(worth))
        surge, rate, heading, then = escapes[self._begun]
        rate /= ANSWER
        off = 0.0 if np.isnan(heading) else float(within_half_turn(heading - pose.heading))
        if not np.isnan(heading) and abs(off) <= TURNED:
            surge, rate = then, float(np.clip(0.8 * off, -self._rate, self._rate))
        words = (
            f"a current of {float(np.hypot(*current)):.2f} m/s leaves no room to turn in later: "
            f"{max(float(room.max()), 0.0):.2f} m are left, this way {max(float(left[self._begun]), 0.0):.2f} m"
        )
        words += ", faster than the view ahead allows" if dares else ""
        return Command(float(surge), command.heave, float(rate), command.pitch), words, dares

    def _room(self, found: Floats) -> Floats:
        """m (m,) from what stands; never more than is enough, less what the hull gets into the unseen."""
        enough = self._settings.keep + self._settings.release
        return np.minimum(found[:, 0], enough - found[:, 1])

    def _escapes(self, current: Floats, fastest: float) -> Floats:
        """(m, 4), see `carried`."""
        ahead = min(self._speed, fastest)
        up = float(np.arctan2(-current[1], -current[0]))
        found = [
            [surge, way * ANSWER * self._rate, heading, then]
            for heading, then in ((up, min(HEAD, fastest)), (up + np.pi, -HEAD))
            for way in (1.0, -1.0)
            for surge in (-self._speed, 0.0, ahead)
        ]
        return np.array(found + [[surge, 0.0, np.nan, 0.0] for surge in (0.0, ahead, -self._speed)])

    def _chart(self, pose: Pose, space: Space) -> Chart:
        low = np.floor(pose.position[:2] / space.voxel).astype(np.int64) - round(REACH / space.voxel)
        occupied, unseen, _ = kernels_charts.chart(
            pose.position[2:], float(self._half[2]), self._settings.above, low, 2 * round(REACH / space.voxel),
            space.voxel, space.low, space.shape, space.settings.hits, 0, space.assumed_free_above, space.layers,
        )  # fmt: skip
        near, dark = (
            kernels_charts.distance(one[0], FAR / space.voxel) * np.float32(space.voxel) for one in (occupied, unseen)
        )
        return near, dark, low, space.voxel

    def _rehearse(
        self, first: Command | None, escapes: Floats, pose: Pose, current: Floats, chart: Chart, shun_unseen: bool
    ) -> Floats:
        """See `carried`: the escapes, after the command that is flown first, if any."""
        surge, rate = float(pose.velocity[0]), float(pose.rate[2])
        # Waves come and go: what counts is the current abeam, and the skid of a turn.
        sway = float(np.array([-np.sin(pose.heading), np.cos(pose.heading)]) @ current) - self._slide * surge * rate
        state = np.array([*pose.position[:2], pose.heading, surge, sway, rate])
        begin = np.zeros(2) if first is None else np.array([first.surge, first.yaw])
        found = carried(
            state, current, begin, 0 if first is None else LEAD, escapes, STEP, round(self._settings.horizon / STEP),
            self._model, *chart, self._circles, self._radius, OPEN,
        )  # fmt: skip
        if not shun_unseen:
            found[:, 1] = 0.0
        return found
