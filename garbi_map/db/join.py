"""A dive that has been estimated joins the map: its place is found, then all dives are laid on each other."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

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


def join_map(
    database: Database,
    dive: StoredDive,
    written: list[SubmapFile],
    settings: PlaceSettings,
    first: NDArray[np.float64] | None = None,
) -> None:
    """Lay a dive on the others and commit it, with what moved in them.

    first: map <- dive (4, 4) of the one with which a map begins; without it, that dive's frame is the map's.

    Raises GarbiError, and the map stays as it is, where the dive's place in it is not sure.
    """
    others = [known for known in database.dives if known.recording != dive.recording]
    transform = np.eye(4) if first is None else first
    detail: dict[str, Any] = {}
    known = [submap for other in others for submap in other.submaps]
    if known:
        transform, detail = _place(database, dive, known, written, settings)
    own = [StoredSubmap(one, Pose.of(transform, one.frame)) for one in written]
    number = np.repeat(np.arange(len(others) + 1), [*(len(other.submaps) for other in others), len(own)])
    settled = _settled(database.folder, known + own, number, settings) if known else own
    moved = [new for new, old in zip(settled, known, strict=False) if new is not old]
    detail["submaps moved"] = len(moved)
    database.join(replace(dive, submaps=tuple(settled[len(known) :])), moved, detail)


def _place(
    database: Database,
    dive: StoredDive,
    known: list[StoredSubmap],
    written: list[SubmapFile],
    settings: PlaceSettings,
) -> tuple[NDArray[np.float64], dict[str, Any]]:
    ground = _surfels(database.folder, known, settings)
    own = [StoredSubmap(one, Pose.of(np.eye(4), one.frame)) for one in written]
    found = place(ground, _surfels(database.folder, own, settings), settings)
    if isinstance(found, str):
        raise GarbiError(
            f"{dive.title}: cannot be laid on the map in {database.folder.parent}: {found}; choose another folder for it"
        )
    return found.transform, {
        "overlap_m2": found.overlap,
        "agreement": found.agreement,
        "residual_m": found.residual,
        "sigma": found.sigma.tolist(),
    }


def _settled(
    folder: Path, submaps: list[StoredSubmap], dive: NDArray[np.int64], settings: PlaceSettings
) -> list[StoredSubmap]:
    """The submaps of all dives where they agree best; one that would hardly move is left, as it is, where it is."""
    surfels = _surfels(folder, submaps, settings)
    transforms = settle(surfels, dive)
    step = np.linalg.norm(surfels.moved(transforms).mean - surfels.mean, axis=1)
    out = []
    for k, submap in enumerate(submaps):
        own = step[surfels.sweep == k]
        far = len(own) > 0 and float(np.median(own)) > settings.least_move
        out.append(replace(submap, pose=submap.pose.after(transforms[k])) if far else submap)
    return out


def _surfels(folder: Path, submaps: list[StoredSubmap], settings: PlaceSettings) -> Surfels:
    return reduce(
        join,
        (surfels_of(read_submap(folder / one.written.file), one.pose, k, settings) for k, one in enumerate(submaps)),
    )
