"""What is known of the scene: patches that are flat, and how far apart two parallel ones are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from garbi_map.calibrate.field_views import Views
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats, Stamps
from garbi_map.plain_yaml import read_yaml
from garbi_map.register.motion import Motion
from garbi_map.register.normal_equations import NormalEquations
from garbi_map.settings import Settings

_MOST = 2000
"""Points of a patch: more of them say the same."""
_FEWEST = 200
_CAUCHY = 2.0
UNKNOWN = 0.1
"""1 sigma of a patch's plane about the first fit to it, rad and m."""


class Patch(Settings):
    """Where a flat patch is seen: seconds after the log's begin and image rows; on another patch's plane, or parallel."""

    begin: float = Field(alias="from", ge=0, description="s after the log's begin")
    end: float = Field(alias="to", gt=0, description="s after the log's begin")
    rows: tuple[int, int] = Field(description="first and last image row")
    flatness: float = Field(default=5e-4, gt=0, description="1 sigma of its surface, m")
    of: int | None = Field(default=None, ge=0, description="number, from 0, of an earlier patch that it is parallel to")
    height: float = Field(default=0.0, description="m, by which it is nearer to the camera than that one")

    @model_validator(mode="after")
    def _is_a_window(self) -> Self:
        if self.begin >= self.end or self.rows[0] >= self.rows[1]:
            raise ValueError("from must be before to, and the first row before the last")
        if self.height and self.of is None:
            raise ValueError("height needs of: the patch that it is measured from")
        return self


@dataclass(frozen=True)
class Known:
    """The patches of a dive whose log begins at begin_ns."""

    patches: tuple[Patch, ...] = ()
    begin_ns: int = 0

    @property
    def names(self) -> list[str]:
        """The constants of their planes."""
        return [f"plane_{number}" for number, patch in enumerate(self.patches) if patch.of is None]

    @property
    def tells_lengths(self) -> bool:
        """Whether a height is given, which then is the metric scale."""
        return any(patch.height for patch in self.patches)

    def within(self, begin_ns: int, end_ns: int) -> Known:
        """All of them if the first begins in a stretch, else none."""
        return self if self.patches and begin_ns <= self._first_ns < end_ns else Known()

    def refuse_beyond(self, begin_ns: int, end_ns: int) -> None:
        """Raises GarbiError where there are patches and the first does not begin within the sweeps of a dive."""
        if self.patches and not begin_ns <= self._first_ns < end_ns:
            first, last = ((stamp - self.begin_ns) * 1e-9 for stamp in (begin_ns, end_ns))
            raise GarbiError(
                f"known patch 0: begins {self.patches[0].begin:g} s after the log's begin, where there is no sweep: "
                f"they last from {first:.1f} to {last:.1f} s"
            )

    @property
    def _first_ns(self) -> int:
        return self.begin_ns + round(self.patches[0].begin * 1e9)


def load_known(path: Path) -> tuple[Patch, ...]:
    """The patches of a YAML list. Raises GarbiError that names the file, the entry and what is wrong with it."""
    try:
        patches = TypeAdapter(tuple[Patch, ...]).validate_python(read_yaml(path))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise GarbiError(f"{path}: {where or 'top level'}: {first['msg']}") from error
    for number, patch in enumerate(patches):
        if patch.of is not None and (patch.of >= number or patches[patch.of].of is not None):
            raise GarbiError(f"{path}: {number}.of: expected the number of an earlier patch that is of no other")
    return patches


@dataclass(frozen=True)
class Flat:
    """n points of a patch, all on the plane `name`: which of the views, and how far nearer to the camera, m.

    origin (3,), axes (3, 3): the plane as it was first fitted, its normal last, toward the camera; the constant `name` is
    what its two tilts and its height differ by.
    """

    name: str
    point: NDArray[np.int64]
    height: float
    flatness: float
    origin: Floats
    axes: Floats

    def add(
        self, problem: NormalEquations, motion: Motion, when: Floats, points: Floats, sigma: Floats, moved: Floats
    ) -> Floats:
        """Adds a row for each point; returns the residuals (n,) m.

        when (n,) s; points (n, 3) in base_link, their sigma (n,) m; moved (n, 4, k) as UnknownScanner.changes.
        """
        rotation = motion.rotation(when)
        arm = rotation.apply(points)
        away = (motion.position(when) + arm - self.origin) @ self.axes
        first, second, shift = motion.constants.vector(self.name)
        residual = away[:, 2] + first * away[:, 0] + second * away[:, 1] - shift - self.height
        normal = np.tile(self.axes @ np.array([first, second, 1.0]), (len(arm), 1))
        rows = motion.rows(when).position(normal).rotation(np.cross(arm, normal))
        rows.constant(self.name, np.column_stack([away[:, 0], away[:, 1], -np.ones(len(arm))]))
        body = rotation.inv().apply(normal)
        for k in range(moved.shape[2]):
            rows.constant(f"rig_{k}", np.einsum("nk,nk->n", body, moved[:, :3, k]) - residual * moved[:, 3, k])
        problem.add(residual, np.hypot(sigma, self.flatness), rows.runs, _CAUCHY, rows.tail)
        return residual


def flats(
    patches: tuple[Patch, ...], views: Views, begin_ns: int, place: Callable[[NDArray[np.int64]], tuple[Floats, Floats]]
) -> list[Flat]:
    """The patches that are seen among the views, their planes fitted to where the points are placed.

    begin_ns: of the log; place(which) gives the points (n, 3) and the cameras (n, 3), map frame, of views. Raises GarbiError
    where a patch is seen in fewer points than a plane is worth.
    """
    out: dict[int, Flat] = {}
    stamps: Stamps = views.stamp_ns[views.profile]
    for number, patch in enumerate(patches):
        seconds = (stamps - begin_ns) * 1e-9
        inside = (seconds >= patch.begin) & (seconds <= patch.end)
        inside &= (views.v >= patch.rows[0]) & (views.v <= patch.rows[1])
        which = np.flatnonzero(inside)
        if len(which) < _FEWEST:
            raise GarbiError(f"known patch {number}: {len(which)} points of it are seen, at least {_FEWEST} are needed")
        which = which[:: -(-len(which) // _MOST)]
        if patch.of is not None:
            first = out[patch.of]
            out[number] = Flat(first.name, which, patch.height, patch.flatness, first.origin, first.axes)
            continue
        points, cameras = place(which)
        origin = points.mean(axis=0)
        axes = np.linalg.svd(points - origin, full_matrices=False)[2].T
        if (cameras.mean(axis=0) - origin) @ axes[:, 2] < 0:
            axes = -axes
        out[number] = Flat(f"plane_{number}", which, 0.0, patch.flatness, origin, axes)
    return list(out.values())
