"""Sweeps on disk, so that memory does not grow with the length of the dive."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.aside import make_folder, write_text
from garbi_map.errors import GarbiError
from garbi_map.sweep.types import Sweep

_ARRAYS = ("stamp_ns", "alpha", "points", "sigma", "intensity", "profile", "row")
_CATALOGUE = "sweeps.json"


@dataclass(frozen=True)
class StoredSweep:
    """What is known of a sweep without opening its file: first and last stamp (ns), number of profiles, of those
    among them that hold no point, and of points."""

    index: int
    begin_ns: int
    end_ns: int
    profiles: int
    blank: int
    points: int


class SweepStore:
    """A folder with one file per sweep and a catalogue, which is written last: without it the folder is unfinished."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.entries: list[StoredSweep] = []
        self.losses: list[str] = []
        self.latency = 0.0
        """s by which the encoder's stamps were taken to be late, beside what the log says."""

    @classmethod
    def open(cls, folder: Path) -> SweepStore | None:
        """The finished store in a folder, or None."""
        store = cls(folder)
        try:
            catalogue = json.loads((folder / _CATALOGUE).read_text())
            store.entries = [StoredSweep(**entry) for entry in catalogue["sweeps"]]
            store.losses, store.latency = catalogue["losses"], float(catalogue["latency"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return store

    def linked(self, folder: Path) -> SweepStore:
        """The same sweeps in a new folder, to be changed there; what does not change takes no room."""
        make_folder(folder)
        store = SweepStore(folder)
        store.entries, store.latency = list(self.entries), self.latency
        for entry in self.entries:
            own = store._file(entry.index)
            try:
                own.hardlink_to(self._file(entry.index))
            except OSError:  # a file system without links
                shutil.copyfile(self._file(entry.index), own)
        store.finish(self.losses)
        return store

    def add(self, sweep: Sweep) -> None:
        """Writes a sweep; points as float32, which resolves a micrometre at ten metres. Raises GarbiError."""
        make_folder(self.folder)
        self.entries.append(self._write(len(self.entries), sweep))

    def _write(self, index: int, sweep: Sweep) -> StoredSweep:
        arrays = {name: getattr(sweep, name) for name in _ARRAYS}
        arrays["points"] = sweep.points.astype(np.float32)
        try:
            self._file(index).unlink(missing_ok=True)  # it may be shared with the folder this one was linked from
            np.savez(self._file(index), **arrays)
        except OSError as error:
            raise GarbiError(f"{self._file(index)}: cannot be written: {error.strerror or error}") from error
        stamps = sweep.stamp_ns
        blank = len(stamps) - len(np.unique(sweep.profile))
        return StoredSweep(index, int(stamps[0]), int(stamps[-1]), len(stamps), blank, len(sweep.points))

    def finish(self, losses: list[str]) -> None:
        """Writes the catalogue, with what was left out on the way; from now on the store can be opened again."""
        self.losses = losses
        make_folder(self.folder)
        entries = [asdict(entry) for entry in self.entries]
        catalogue = {"sweeps": entries, "losses": losses, "latency": self.latency}
        write_text(self.folder / _CATALOGUE, json.dumps(catalogue))

    def retime(self, retimed: Callable[[Sweep], Sweep], latency: float) -> None:
        """Replaces every sweep by what it is with an encoder whose stamps are late by so many seconds in all."""
        (self.folder / _CATALOGUE).unlink(missing_ok=True)
        self.latency = latency
        self.entries = [self._write(index, retimed(self.load(index))) for index in range(len(self))]
        self.finish(self.losses)

    def load(self, index: int) -> Sweep:
        """One sweep, points as float64."""
        with np.load(self._file(index)) as file:
            arrays = {name: file[name] for name in _ARRAYS}
        arrays["points"] = arrays["points"].astype(np.float64)
        return Sweep(index=index, **arrays)

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Sweep]:
        for entry in self.entries:
            yield self.load(entry.index)

    def stamps(self) -> NDArray[np.int64]:
        """The stamps (m,) of all profiles, in order of the sweeps."""
        stamps = []
        for entry in self.entries:
            with np.load(self._file(entry.index)) as file:
                stamps.append(file["stamp_ns"])
        return np.concatenate(stamps) if stamps else np.empty(0, np.int64)

    def _file(self, index: int) -> Path:
        return self.folder / f"{index:06d}.npz"
