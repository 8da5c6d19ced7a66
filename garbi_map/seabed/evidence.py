"""What all sweeps together say about where the seabed is: the judge of marine snow, reflections and strays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.seabed.bodies import columns, moving_bodies
from garbi_map.seabed.cells import SURROUNDING, VOXEL
from garbi_map.seabed.settings import OutlierSettings

_AT_ONCE = 1 << 17
"""Voxels whose surroundings' covariances are in memory at once."""


class Evidence:
    """A sparse grid of voxels that counts points and the profiles they came from.

    The seabed is hit again and again by neighbouring profiles and by later sweeps; a flake of snow only once, however
    many rows it covers. Relative to how often its surroundings and its column were seen, a thin cable still
    has a share that a flake never reaches. Memory grows with the area seen, not with time.
    """

    def __init__(self, settings: OutlierSettings) -> None:
        self._settings = settings
        self._voxels = _table(1 << 16)
        self._used = 0
        self._profiles = 0
        self._passed = 0
        self._longest = 0
        self._blocks: NDArray[np.int64] | None = None
        self._surrounding: NDArray[np.void] | None = None

    @property
    def is_full(self) -> bool:
        """Whether there are as many voxels as there may be; more can still be observed."""
        return self._used >= self._settings.max_voxels

    def observe(
        self, placed: NDArray[np.float64], sigma: NDArray[np.float32], profile: NDArray[np.int32], profiles: int
    ) -> None:
        """Count the points (n, 3) in `map` of one sweep of so many profiles, ordered by profile (n,)."""
        from garbi_map.seabed import evidence_kernels as kernels

        verdict = self._first_verdicts(placed, sigma)
        done = 0
        while True:
            self._used, done = kernels.observe_points(
                self._voxels, self._used, done, placed, verdict, profile, self._profiles, self._settings.voxel
            )
            if done == len(placed):
                break
            larger = _table(2 * len(self._voxels))
            kernels.rehash(self._voxels, larger)
            self._voxels = larger
        self._profiles += profiles
        self._longest = max(self._longest, profiles)
        self._surrounding = self._blocks = None

    def pass_through(
        self,
        placed: NDArray[np.float64],
        sigma: NDArray[np.float32],
        profile: NDArray[np.int32],
        row: NDArray[np.int32],
        eyes: NDArray[np.float64],
    ) -> None:
        """Let the light and the view of one sweep pass: what is on their way to the points (n, 3) was not there then.

        eyes (e, profiles, 3): where camera and laser were, in `map`. Once for every sweep, after all were observed.
        """
        from garbi_map.seabed import free_space_kernels as kernels

        if self._blocks is None:
            self._blocks = _occupied(self._voxels)
        own = self._settings
        verdict = self._first_verdicts(placed, sigma)
        kernels.pass_rays(
            self._voxels, self._blocks, placed, verdict, profile, row, self._passed, eyes,
            own.voxel, own.gap, own.beam, own.thin_beam, own.every,
        )  # fmt: skip
        self._passed += eyes.shape[1]
        self._surrounding = None

    def judge(
        self,
        placed: NDArray[np.float64],
        points: NDArray[np.float64],
        sigma: NDArray[np.float32],
        profile: NDArray[np.int32],
        row: NDArray[np.int32],
    ) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """The verdict (n,) on each point and the slope (n, 2) of the surface at it.

        placed (n, 3) are the points in `map`, points (n, 3) in the rig frame.
        """
        from garbi_map.seabed import evidence_kernels as kernels

        if self._surrounding is None:
            self._surrounding = _surroundings(self._voxels, self._longest, self._settings)
        verdict = self._first_verdicts(placed, sigma)
        gradient = np.zeros((len(placed), 2))
        own = self._settings
        kernels.judge_points(
            self._voxels,
            self._surrounding,
            placed,
            sigma,
            kernels.run_lengths(points, profile, row),
            own.voxel,
            own.min_points,
            own.min_run,
            own.gate,
            verdict,
            gradient,
        )
        return verdict, gradient

    def _first_verdicts(self, placed: NDArray[np.float64], sigma: NDArray[np.float32]) -> NDArray[np.uint8]:
        from garbi_map.seabed import evidence_kernels as kernels

        limit = 0.5 * kernels.HALF * self._settings.voxel
        return kernels.first_verdicts(placed, sigma, limit, self._settings.max_sigma)


def _table(length: int) -> NDArray[np.void]:
    table = np.zeros(length, VOXEL)
    table["key"] = -1
    return table


def _occupied(voxels: NDArray[np.void]) -> NDArray[np.int64]:
    """The table of blocks that hold a voxel."""
    from garbi_map.seabed import free_space_kernels as kernels

    length = 1 << 10
    while True:
        blocks = np.full(length, -1, np.int64)
        if kernels.occupied_blocks(voxels, blocks) >= 0:
            return blocks
        length *= 2


def _surroundings(voxels: NDArray[np.void], longest: int, settings: OutlierSettings) -> NDArray[np.void]:
    """SURROUNDING of every voxel, in the order of the table; longest: profiles of the longest sweep."""
    from garbi_map.seabed import evidence_kernels as kernels

    surrounding = np.zeros(len(voxels), SURROUNDING)
    for begin in range(0, len(voxels), _AT_ONCE):
        covariance = np.zeros((min(_AT_ONCE, len(voxels) - begin), 3, 3))
        pierced = np.zeros(len(covariance), np.int32)
        kernels.surroundings(voxels, settings.voxel, begin, surrounding, covariance, pierced)
        here = np.flatnonzero(voxels["key"][begin : begin + _AT_ONCE] != -1)
        value, vector = np.linalg.eigh(covariance[here])
        normal = vector[:, :, 0] * np.where(vector[:, 2:, 0] < 0, -1.0, 1.0)
        for k, axis in enumerate("xyz"):
            surrounding[f"normal_{axis}"][begin + here] = normal[:, k]
        surrounding["thickness"][begin + here] = np.maximum(value[:, 0], 0.0)
        # what passes beside a thin cable proves nothing; what would have hit it is seldom, the more so the thinner
        thin = here[value[:, 1] < settings.beam**2]
        surrounding["through"][begin + thin] = pierced[thin] * (settings.beam / settings.thin_beam)
    # fewer points than a plane needs with some to spare do not say how thick the surface is
    surrounding["thickness"][surrounding["count"] < 10] = np.inf
    full = np.flatnonzero(voxels["key"] != -1)
    full = full[np.argsort(voxels["key"][full])]
    key = voxels["key"][full]
    moved = _seen_through(key, surrounding["support"][full], surrounding["through"][full], settings)
    again = (voxels["last"] - voxels["first"])[full] > longest
    surrounding["moved"][full] = moved | moving_bodies(key, voxels["count"][full], moved, again, settings)
    return surrounding


def _seen_through(
    key: NDArray[np.int64], support: NDArray[np.int32], through: NDArray[np.float32], settings: OutlierSettings
) -> NDArray[np.bool_]:
    """Where nearly all profiles that passed saw something else (n,), of voxels in the order of their keys."""
    starts, lengths = columns(key)
    if len(starts) == 0:
        return np.zeros(0, bool)
    best = np.maximum.reduceat(support, starts)
    share = support / np.repeat(best, lengths)
    passed = settings.every * through  # one ray in so many was followed
    return (share < settings.min_share) | (passed > settings.max_through * (passed + support))
