"""A dive that has been estimated joins the map: its place among the other dives is found."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.db.catalogue import StoredDive, StoredSubmap
from garbi_map.db.database import Database
from garbi_map.db.place import place, surfels_of
from garbi_map.db.settings import PlaceSettings
from garbi_map.db.submaps import Pose, SubmapFile, read_submap
from garbi_map.errors import GarbiError
from garbi_map.register.surfels import Surfels, join


def join_map(
    database: Database, dive: StoredDive, written: list[SubmapFile], settings: PlaceSettings, first: np.ndarray
) -> None:
    """Lay a dive on the others and commit it; `first`: map <- dive (4, 4) of the one with which a map begins.

    Raises GarbiError, and the map stays as it is, where the dive's place in it is not sure.
    """
    transform, detail = _place(database, dive, written, settings, first)
    submaps = tuple(StoredSubmap(one, Pose.of(transform, one.frame)) for one in written)
    database.join(replace(dive, submaps=submaps), detail)


def _place(
    database: Database, dive: StoredDive, written: list[SubmapFile], settings: PlaceSettings, first: np.ndarray
) -> tuple[np.ndarray, dict[str, Any]]:
    others = database.others(dive.recording)
    if not others:
        return first, {}
    known = _surfels(database.folder, [one.written for one in others], [one.pose for one in others], settings)
    own = _surfels(database.folder, written, [Pose.of(np.eye(4), one.frame) for one in written], settings)
    found = place(known, own, settings)
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


def _surfels(folder: Path, files: list[SubmapFile], poses: list[Pose], settings: PlaceSettings) -> Surfels:
    return reduce(
        join,
        (
            surfels_of(read_submap(folder / one.file), pose, k, settings)
            for k, (one, pose) in enumerate(zip(files, poses, strict=True))
        ),
    )
