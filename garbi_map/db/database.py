"""A map's database in a folder: a catalogue and immutable files. It grows dive by dive and is whole at every moment."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import make_folder, remove_leftovers
from garbi_map.db.catalogue import Catalogue, StoredDive, StoredSubmap
from garbi_map.db.submaps import read_moving, read_submap
from garbi_map.db.tiles import fuse_submap, memory_name, merge_memories
from garbi_map.db.trajectories import laid, read_poses
from garbi_map.errors import GarbiError
from garbi_map.executor import Workers
from garbi_map.navigate import Trajectory
from garbi_map.seabed import JudgedPoints, Points, SeabedSettings, SurfaceGrid

_CATALOGUE = "catalogue.sqlite"
_FOLDERS = ("submaps", "moving", "memories", "trajectories")


class Database:
    """A context manager over DIR/db. One process at a time writes: hold `aside.alone_in(DIR)`.

    Raises GarbiError where it is of a newer version, damaged, or where parts of it are missing.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __enter__(self) -> Self:
        path = self.folder / _CATALOGUE
        self._catalogue: Catalogue | None = None
        self.dives: list[StoredDive] = []
        if path.exists():
            self._catalogue = Catalogue(path)
            try:
                self.dives = self._catalogue.dives()
                self._verify()
            except BaseException:
                self._catalogue.close()
                raise
        elif any(self.folder.glob("memories/*.parquet")):
            raise GarbiError(
                f"{path}: missing, while parts of the map are there; put it back, or build the map anew in another folder"
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._catalogue is not None:
            self._catalogue.close()

    @property
    def catalogue(self) -> Catalogue:
        """The catalogue; the first time, it is made. Raises GarbiError where it cannot be written."""
        if self._catalogue is None:
            make_folder(self.folder)
            self._catalogue = Catalogue(self.folder / _CATALOGUE)
        return self._catalogue

    def state(self, name: str) -> str | None:
        """A fact about the folder, by name."""
        return None if self._catalogue is None else self._catalogue.state(name)

    def join(self, dive: StoredDive, moved: list[StoredSubmap], detail: dict[str, Any]) -> None:
        """A dive joins the map; see Catalogue.join."""
        self.catalogue.join(dive, moved, detail)
        self.dives = self.catalogue.dives()

    def fuse(self, settings: SeabedSettings, workers: Workers) -> None:
        """Fuse the submaps that are new, were moved, or were fused with other settings; the others stay as they are."""
        wanted = [
            replace(one, memory=f"memories/{memory_name(one.written.name, one.pose, settings)}") for one in self.submaps
        ]
        stale = [
            new
            for new, old in zip(wanted, self.submaps, strict=True)
            if new.memory != old.memory or not self.path(new.memory or "").is_file()
        ]
        jobs = [(self.path(one.written.file), one.pose, settings, self.path(one.memory or "")) for one in stale]
        tiles = workers.run(fuse_submap, jobs)
        if stale:
            fused = [replace(one, tiles=own) for one, own in zip(stale, tiles, strict=True)]
            self.catalogue.fused(fused)
            self.dives = self.catalogue.dives()

    def holds(self, recording: str, estimate: str) -> bool:
        """Whether this estimate of a recording is in the map."""
        return any(dive.recording == recording and dive.estimate == estimate for dive in self.dives)

    def dive(self, recording: str) -> StoredDive:
        """The dive made of a recording that is in the map."""
        return next(dive for dive in self.dives if dive.recording == recording)

    @property
    def submaps(self) -> list[StoredSubmap]:
        """Of all dives, in order."""
        return [submap for dive in self.dives for submap in dive.submaps]

    def path(self, file: str) -> Path:
        """A file that a row names."""
        return self.folder / file

    def points(self) -> Iterator[tuple[StoredDive, JudgedPoints]]:
        """All points in `map`, sweep by sweep, and the dive that each is of; a submap is in memory at a time."""
        for dive in self.dives:
            for submap in dive.submaps:
                for points in read_submap(self.path(submap.written.file)).sweeps(submap.pose):
                    yield dive, points

    def moving(self) -> Iterator[Points]:
        """The points of all dives that were seen through, in `map`."""
        for submap in self.submaps:
            yield read_moving(self.path(submap.written.moving), submap.pose)

    def surface(self, settings: SeabedSettings, most: int) -> SurfaceGrid:
        """What all dives together know of the seabed, in no more cells than `most`; they must have been fused."""
        fewer = settings.model_copy(update={"max_cells": min(settings.max_cells, most)})
        return merge_memories(((self.path(one.memory or ""), one.tiles) for one in self.submaps), fewer)

    def trajectory(self) -> Trajectory:
        """All dives' poses map <- base_link, in the order of their stamps."""
        parts = [laid(read_poses(self.path(dive.trajectory)), dive.submaps) for dive in self.dives]
        stamps = np.concatenate([part.stamp_ns for part in parts])
        order = np.argsort(stamps, kind="stable")
        return Trajectory(
            stamps[order],
            np.concatenate([part.position for part in parts])[order],
            np.concatenate([part.quaternion for part in parts])[order],
            np.concatenate([part.covariance for part in parts])[order],
        )

    def poses_at(self, stamp_ns: NDArray[np.int64]) -> Trajectory:
        """The poses map <- base_link at stamps (n,) of any of the dives, with their covariances."""
        position, quaternion = np.zeros((len(stamp_ns), 3)), np.zeros((len(stamp_ns), 4))
        covariance = np.zeros((len(stamp_ns), 6, 6), np.float32)
        for dive in self.dives:
            own = laid(read_poses(self.path(dive.trajectory)), dive.submaps)
            mine = (stamp_ns >= own.stamp_ns[0]) & (stamp_ns <= own.stamp_ns[-1])
            there = own.at(stamp_ns[mine])
            position[mine], quaternion[mine] = there.position, there.quaternion
            covariance[mine] = there.covariance
        return Trajectory(stamp_ns, position, quaternion, covariance)

    def remove_unnamed(self) -> None:
        """Remove what an interrupted run has written and no commit named, and what later commits replaced."""
        named = self._named() | {submap.memory for submap in self.submaps}
        for name in _FOLDERS:
            remove_leftovers(self.folder / name)
            for file in (self.folder / name).glob("*.parquet"):
                if f"{name}/{file.name}" not in named:
                    file.unlink(missing_ok=True)

    def _named(self) -> set[str]:
        return {file for submap in self.submaps for file in submap.written.files} | {
            dive.trajectory for dive in self.dives
        }

    def _verify(self) -> None:
        missing = sorted(file for file in self._named() if not self.path(file).is_file())
        if missing:
            more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
            raise GarbiError(
                f"{self.path(missing[0])}: missing{more}; put it back, or build the map anew in another folder"
            )
