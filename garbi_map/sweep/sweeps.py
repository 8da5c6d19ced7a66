"""Stripes become points, and points of one pass of the laser a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from garbi_map.rig import Rig
from garbi_map.stripe.types import Stripe
from garbi_map.sweep import kernels
from garbi_map.sweep.angle import Angle
from garbi_map.sweep.settings import SweepSettings
from garbi_map.sweep.types import Sweep
from garbi_map.words import many


@dataclass
class SweepLosses:
    """What was left out on the way from stripes to sweeps, counted."""

    profiles_without_angle: int = 0
    profiles_out_of_order: int = 0
    points_out_of_range: int = 0
    points_alone: int = 0
    sweeps_too_small: int = 0

    def lines(self) -> list[str]:
        """The losses that count as such, one line each. Points are rejected in every dive and are none."""
        named = (
            (self.profiles_without_angle, "profile", "without a laser angle (gaps in the encoder)"),
            (self.profiles_out_of_order, "profile", "with a stamp that is not after the one before"),
            (self.sweeps_too_small, "sweep", "with too few points, left out as a whole"),
        )
        return [f"{many(count, thing)} {why}" for count, thing, why in named if count]


class _Profile(NamedTuple):
    stripe: Stripe
    alpha: float
    alpha_sigma: float


def make_sweeps(
    stripes: Iterable[Stripe], rig: Rig, angle: Angle, settings: SweepSettings, losses: SweepLosses | None = None
) -> Iterator[Sweep]:
    """The sweeps of a stream of stripes, one in memory at a time.

    Cut at the laser's turning points; while the laser stands still (no motor, or a stopped one) each `window` seconds;
    and in any case after `longest` seconds. What is left out is counted in `losses`.
    """
    losses = SweepLosses() if losses is None else losses
    index = 0
    for profiles in _passes(stripes, angle, settings, losses):
        sweep = _sweep(index, profiles, rig, settings, losses)
        if len(sweep.points) < settings.least_points:
            losses.sweeps_too_small += 1
            continue
        yield sweep
        index += 1


def _passes(
    stripes: Iterable[Stripe], angle: Angle, settings: SweepSettings, losses: SweepLosses
) -> Iterator[list[_Profile]]:
    """Profiles between two cuts."""
    window_ns, longest_ns = round(settings.window * 1e9), round(settings.longest * 1e9)
    profiles: list[_Profile] = []
    lowest = highest = 0.0
    last_ns = between_turns = -1
    for stripe in stripes:
        stamp_ns = stripe.stamp_ns
        if stamp_ns <= last_ns:
            losses.profiles_out_of_order += 1
            continue
        last_ns = stamp_ns
        alpha, sigma = (float(value[0]) for value in angle.at(np.array([stamp_ns])))
        if np.isnan(alpha):
            losses.profiles_without_angle += 1
            continue
        stretch = int(np.searchsorted(angle.turns_ns, stamp_ns, side="right"))
        if profiles:
            length_ns = stamp_ns - profiles[0].stripe.stamp_ns
            still = max(highest, alpha) - min(lowest, alpha) < settings.least_turn
            if stretch != between_turns or length_ns >= longest_ns or (still and length_ns >= window_ns):
                yield profiles
                profiles = []
        if not profiles:
            lowest, highest, between_turns = alpha, alpha, stretch
        lowest, highest = min(lowest, alpha), max(highest, alpha)
        profiles.append(_Profile(stripe, alpha, sigma))
    if profiles:
        yield profiles


def _sweep(index: int, profiles: list[_Profile], rig: Rig, settings: SweepSettings, losses: SweepLosses) -> Sweep:
    stripes = [profile.stripe for profile in profiles]
    alpha = np.array([profile.alpha for profile in profiles])
    alpha_sigma = np.array([profile.alpha_sigma for profile in profiles])
    which = np.repeat(np.arange(len(stripes), dtype=np.int32), [len(stripe.row) for stripe in stripes])
    row = np.concatenate([stripe.row for stripe in stripes])
    u = np.concatenate([stripe.u for stripe in stripes])
    u_sigma = np.concatenate([stripe.sigma for stripe in stripes]).astype(float)
    intensity = np.concatenate([stripe.intensity for stripe in stripes])

    points, d_du, d_dalpha = rig.triangulate(u, row, alpha[which])
    depth = rig.depth(points)
    per_pixel = np.linalg.norm(d_du, axis=1)
    by_angle = np.linalg.norm(d_dalpha, axis=1) * alpha_sigma[which]
    kept = (depth >= settings.min_range) & (depth <= settings.max_range)
    losses.points_out_of_range += int((~kept).sum())

    place = np.flatnonzero(kept)
    alone, mixed = kernels.profile_edges(
        which[place],
        row[place],
        depth[place],
        per_pixel[place] * u_sigma[place],
        1.0 / rig.camera.alpha_v,
        settings.edge_slope,
        settings.row_gap,
        settings.least_run,
        settings.least_extent,
        settings.edge_rows,
    )
    losses.points_alone += int(alone.sum())
    u_sigma[place[mixed]] = np.hypot(u_sigma[place[mixed]], settings.edge_sigma)
    place = place[~alone]
    sigma = np.hypot(per_pixel * u_sigma, by_angle)
    return Sweep(
        index=index,
        stamp_ns=np.array([stripe.stamp_ns for stripe in stripes], np.int64),
        alpha=alpha,
        points=points[place],
        sigma=sigma[place].astype(np.float32),
        intensity=intensity[place].astype(np.float32),
        profile=which[place],
        row=row[place].astype(np.int32),
    )
