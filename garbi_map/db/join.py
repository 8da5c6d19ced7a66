"""A dive that has been estimated joins the map: its place is found, then all dives are laid on each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from garbi_map.db.catalogue import StoredDive, StoredSubmap
from garbi_map.db.database import Database
from garbi_map.db.graph import settle
from garbi_map.db.place import place, surfels_of
from garbi_map.db.settings import PlaceSettings
from garbi_map.db.submaps import Pose, SubmapFile, read_submap
from garbi_map.errors import GarbiError
from garbi_map.register.surfels import Surfels, join

Item = TypeVar("Item")
Laid = TypeVar("Laid")


class Unplaced(GarbiError):
    """A dive whose place among the others is not sure."""


def lay_all(items: Sequence[Item], lay: Callable[[Item], Laid]) -> Laid:
    """`lay` each, those that are refused again after others that may lie between; returns what the last was laid as.

    Raises the first Unplaced of those that are left when nothing more can be laid.
    """
    waiting = list(items)
    while True:
        refused: list[tuple[Item, Unplaced]] = []
        for item in waiting:
            try:
                laid = lay(item)
            except Unplaced as error:
                refused.append((item, error))
        if not refused:
            return laid
        if len(refused) == len(waiting):
            raise refused[0][1]
        waiting = [item for item, _ in refused]


def join_map(
    database: Database,
    dive: StoredDive,
    written: list[SubmapFile],
    settings: PlaceSettings,
    first: NDArray[np.float64] | None = None,
) -> None:
    """Lay a dive on the others and commit it, with what moved in them.

    first: map <- dive (4, 4) of the one with which a map begins; without it, that dive's frame is the map's.

    Raises Unplaced, and the map stays as it is, where the dive's place in it is not sure.
    """
    others = [known for known in database.dives if known.recording != dive.recording]
    known = [submap for other in others for submap in other.submaps]
    own = [StoredSubmap(one, Pose.of(np.eye(4), one.frame)) for one in written]
    surfels = _surfels(database.folder, own, settings)
    detail: dict[str, Any] = {}
    if not known:
        laid = _moved(own, np.tile(np.eye(4) if first is None else first, (len(own), 1, 1)))
    else:
        ground = _surfels(database.folder, known, settings)
        found = place(ground, surfels, settings)
        if isinstance(found, str):
            raise Unplaced(
                f"{dive.title}: cannot be laid on the map in {database.folder.parent}: {found}; "
                "choose another folder for it"
            )
        placed = _moved(own, np.tile(found.transform, (len(own), 1, 1)))
        # made anew where they lie: patches on the grid of the map's own have the same curvature in them
        surfels = _surfels(database.folder, placed, settings, len(known))
        number = np.repeat(np.arange(len(others) + 1), [*(len(other.submaps) for other in others), len(own)])
        laid = _settled(known + placed, join(ground, surfels), number, settings)
        detail = {"overlap_m2": found.overlap, "agreement": found.agreement, "residual_m": found.residual}
        detail["sigma"] = found.sigma.tolist()
    moved = [new for new, old in zip(laid, known, strict=False) if new is not old]
    detail["submaps moved"] = len(moved)
    database.join(replace(dive, submaps=tuple(laid[len(known) :])), moved, detail)


def _settled(
    submaps: list[StoredSubmap], surfels: Surfels, dive: NDArray[np.int64], settings: PlaceSettings
) -> list[StoredSubmap]:
    """The submaps of all dives where they agree best; one that would hardly move is left, as it is, where it is."""
    transforms = settle(surfels, dive)
    step = np.linalg.norm(surfels.moved(transforms).mean - surfels.mean, axis=1)
    far = [k for k in range(len(submaps)) if np.median(np.r_[step[surfels.sweep == k], 0.0]) > settings.least_move]
    new = dict(zip(far, _moved([submaps[k] for k in far], transforms[far]), strict=True))
    return [new.get(k, submap) for k, submap in enumerate(submaps)]


def _moved(submaps: list[StoredSubmap], transforms: NDArray[np.float64]) -> list[StoredSubmap]:
    return [replace(one, pose=one.pose.after(transform)) for one, transform in zip(submaps, transforms, strict=True)]


def _surfels(folder: Path, submaps: list[StoredSubmap], settings: PlaceSettings, first: int = 0) -> Surfels:
    """The patches of submaps, numbered from `first`."""
    parts = [
        surfels_of(read_submap(folder / one.written.file), one.pose, k, settings)
        for k, one in enumerate(submaps, first)
    ]
    return Surfels(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Surfels)))
