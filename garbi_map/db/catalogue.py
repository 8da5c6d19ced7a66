"""The catalogue of a map's database: which dives, submaps, poses and tiles it is made of. SQLite, one writer.

A rollback journal, synced at each commit: whatever kills the process, the next one finds the last commit. The files that
rows name are written, synced and renamed before the commit that names them, and never changed.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.db.submaps import Pose, SubmapFile
from garbi_map.db.tiles import Tiles
from garbi_map.errors import GarbiError
from garbi_map.keys import digest_of
from garbi_map.log.records import Mount

SCHEMA = 2
"""Of the tables below and the Parquet files; another one is refused. 2: dives have a mount."""
_APPLICATION = 0x67617262  # "garb"

_TABLES = """
create table rigs (hash text primary key, yaml text not null);
create table configurations (hash text primary key, yaml text not null);
create table dives (
    number integer primary key,          -- order in which they joined the map
    recording text unique not null,      -- hash of the log's content
    estimate text not null,              -- hash of recording, rig, configuration, seconds used and code
    title text not null,
    begin_ns integer not null, end_ns integer not null,
    rig text not null references rigs, mount text not null,  -- base_link <- rig
    configuration text not null references configurations,
    trajectory text not null,            -- file
    accepted integer not null, rejected text not null, left_out text not null
);
create table submaps (
    name text primary key,
    dive integer not null references dives on delete cascade,
    points integer not null, begin_ns integer not null, end_ns integer not null,
    x real not null, y real not null, z real not null  -- origin of its frame in the dive's
);
create table poses (                     -- map <- submap; the highest version holds
    submap text not null references submaps on delete cascade,
    version integer not null,
    x real not null, y real not null, z real not null,
    qx real not null, qy real not null, qz real not null, qw real not null,
    primary key (submap, version)
);
create table memories (                  -- file of what the cells of a submap remember at the pose it was fused at
    submap text primary key references submaps on delete cascade,
    file text not null
);
create table tiles (                     -- which tiles of the elevation grid are in it
    submap text not null references submaps on delete cascade,
    a integer not null, b integer not null, cells integer not null,
    primary key (submap, a, b)
);
create table provenance (at text not null, what text not null, detail text not null);
create table state (name text primary key, value text not null);
"""


@dataclass(frozen=True)
class StoredSubmap:
    """A submap at the pose that holds; memory: file of what its cells remember, and the tiles that these are in; None and
    empty where it has not been fused yet."""

    written: SubmapFile
    pose: Pose
    memory: str | None = None
    tiles: Tiles = ()

    @property
    def transform(self) -> NDArray[np.float64]:
        """map <- dive (4, 4), as this submap has it."""
        return self.pose.transform(self.written.frame)


@dataclass(frozen=True)
class StoredDive:
    """A dive of the map; see the table of that name."""

    recording: str
    estimate: str
    title: str
    begin_ns: int
    end_ns: int
    rig: str
    mount: Mount
    configuration: str
    trajectory: str
    accepted: int
    rejected: dict[str, int]
    left_out: list[str]
    submaps: tuple[StoredSubmap, ...] = ()


class Catalogue:
    """The tables as objects. Every method that changes something is one transaction: all of it, or nothing."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with self._clear():
            self._db = sqlite3.connect(path, isolation_level=None)
            try:
                self._open()
            except BaseException:
                self._db.close()
                raise

    def close(self) -> None:
        """Let go of the file."""
        self._db.close()

    def dives(self) -> list[StoredDive]:
        """In the order in which they joined."""
        with self._clear():
            rows = self._db.execute(
                "select number, recording, estimate, title, begin_ns, end_ns, rigs.yaml, mount, configurations.yaml, "
                "trajectory, accepted, rejected, left_out from dives join rigs on rig = rigs.hash "
                "join configurations on configuration = configurations.hash order by number"
            ).fetchall()
            return [
                StoredDive(*(*row[1:7], _mount(row[7]), *row[8:11], *map(json.loads, row[11:]), self._submaps(row[0])))
                for row in rows
            ]

    def join(self, dive: StoredDive, moved: Sequence[StoredSubmap], detail: dict[str, Any]) -> None:
        """A dive joins, instead of an earlier estimate of the same recording where there is one; submaps of other dives
        that were `moved` meanwhile get the next version of their pose."""
        with self._transaction() as db:
            number = db.execute("select number from dives where recording = ?", [dive.recording]).fetchone()
            if number is None:
                number = db.execute("select ifnull(max(number), 0) + 1 from dives").fetchone()
            db.execute("delete from dives where recording = ?", [dive.recording])
            for table, text in (("rigs", dive.rig), ("configurations", dive.configuration)):
                db.execute(f"insert or ignore into {table} values (?, ?)", [digest_of(text), text])
            db.execute(
                "insert into dives values (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                [
                    number[0],
                    *(dive.recording, dive.estimate, dive.title, dive.begin_ns, dive.end_ns),
                    *(digest_of(dive.rig), json.dumps([part.tolist() for part in astuple(dive.mount)])),
                    *(digest_of(dive.configuration), dive.trajectory, dive.accepted),
                    *(json.dumps(dive.rejected), json.dumps(dive.left_out)),
                ],
            )
            for submap in dive.submaps:
                own = submap.written
                row = [own.name, number[0], own.points, own.begin_ns, own.end_ns, *own.frame.tolist()]
                db.execute("insert into submaps values (?, ?, ?, ?, ?, ?, ?, ?)", row)
            for submap in (*dive.submaps, *moved):
                self._lay(submap)
            self._remember("joined", {"dive": dive.title, "estimate": dive.estimate, **detail})

    def provenance(self) -> list[tuple[str, str, dict[str, Any]]]:
        """When what was done, with what result, in order."""
        with self._clear():
            rows = self._db.execute("select at, what, detail from provenance order by rowid").fetchall()
        return [(at, what, json.loads(detail)) for at, what, detail in rows]

    def state(self, name: str) -> str | None:
        """A fact about the folder, by name."""
        with self._clear():
            row = self._db.execute("select value from state where name = ?", [name]).fetchone()
        return None if row is None else str(row[0])

    def set_state(self, name: str, value: str, detail: dict[str, Any]) -> None:
        """Change a fact about the folder, and remember why."""
        with self._transaction() as db:
            db.execute("insert or replace into state values (?, ?)", [name, value])
            self._remember(name, detail)

    def fused(self, submaps: Sequence[StoredSubmap]) -> None:
        """Submaps have been fused: their memories and tiles replace those before."""
        with self._transaction() as db:
            for submap in submaps:
                name = submap.written.name
                db.execute("insert or replace into memories values (?, ?)", [name, submap.memory])
                db.execute("delete from tiles where submap = ?", [name])
                db.executemany("insert into tiles values (?, ?, ?, ?)", [(name, *tile) for tile in submap.tiles])

    def _lay(self, submap: StoredSubmap) -> None:
        """A new version of a submap's pose."""
        query = "select ifnull(max(version), 0) + 1 from poses where submap = ?"
        version = self._db.execute(query, [submap.written.name]).fetchone()[0]
        pose = [*submap.pose.translation.tolist(), *submap.pose.quaternion.tolist()]
        row = [submap.written.name, version, *pose]
        self._db.execute("insert into poses values (?, ?, ?, ?, ?, ?, ?, ?, ?)", row)

    def _submaps(self, dive: int) -> tuple[StoredSubmap, ...]:
        rows = self._db.execute(
            "select name, points, begin_ns, end_ns, s.x, s.y, s.z, file, p.x, p.y, p.z, qx, qy, qz, qw "
            "from submaps s left join memories m on m.submap = name join poses p on p.submap = name "
            "where dive = ? and version = (select max(version) from poses where submap = name) order by name",
            [dive],
        ).fetchall()
        tiles = "select a, b, cells from tiles where submap = ? order by a, b"
        return tuple(
            StoredSubmap(
                SubmapFile(row[0], np.array(row[4:7]), *row[1:4]),
                Pose(np.array(row[8:11]), np.array(row[11:15])),
                row[7],
                tuple(self._db.execute(tiles, [row[0]]).fetchall()),
            )
            for row in rows
        )

    def _open(self) -> None:
        db = self._db
        db.execute("pragma foreign_keys = on")
        db.execute("pragma synchronous = full")
        application = db.execute("pragma application_id").fetchone()[0]
        version = db.execute("pragma user_version").fetchone()[0]
        if application == 0 and not db.execute("select * from sqlite_master").fetchall():
            db.executescript(
                f"begin immediate; {_TABLES} pragma application_id = {_APPLICATION}; "
                f"pragma user_version = {SCHEMA}; commit;"
            )
        elif application != _APPLICATION:
            raise GarbiError(f"{self._path}: not a garbi map's catalogue; choose another folder")
        elif version != SCHEMA:
            newer = version > SCHEMA
            raise GarbiError(
                f"{self._path}: written by {'a newer' if newer else 'an older'} garbi (format {version}, this one knows "
                f"{SCHEMA}); {'update garbi' if newer else 'build the map anew from its logs'} or choose another folder"
            )

    def _remember(self, what: str, detail: dict[str, Any]) -> None:
        row = [datetime.now(UTC).isoformat(timespec="seconds"), what, json.dumps(detail)]
        self._db.execute("insert into provenance values (?, ?, ?)", row)

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        with self._clear():
            self._db.execute("begin immediate")
            try:
                yield self._db
                self._db.execute("commit")
            except BaseException:
                if self._db.in_transaction:
                    self._db.execute("rollback")
                raise

    @contextmanager
    def _clear(self) -> Iterator[None]:
        """SQLite's complaints as one line."""
        try:
            yield
        except sqlite3.Error as error:
            raise GarbiError(f"{self._path}: {error}; nothing was changed") from error


def _mount(text: str) -> Mount:
    """What json.dumps made of translation and quaternion."""
    translation, quaternion = json.loads(text)
    return Mount(np.array(translation), np.array(quaternion))
