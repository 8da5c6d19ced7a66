"""The map's database: dives as submaps in Parquet, a catalogue in SQLite, and how a further dive finds its place."""

from garbi_map.db.catalogue import StoredDive, StoredSubmap
from garbi_map.db.database import Database
from garbi_map.db.join import join_map, lay_all
from garbi_map.db.kept import keep, recall
from garbi_map.db.settings import DatabaseSettings, PlaceSettings
from garbi_map.db.submaps import Pose, SubmapFile, write_submap
from garbi_map.db.trajectories import laid, write_poses

__all__ = [
    "Database",
    "DatabaseSettings",
    "PlaceSettings",
    "Pose",
    "StoredDive",
    "StoredSubmap",
    "SubmapFile",
    "join_map",
    "keep",
    "laid",
    "lay_all",
    "recall",
    "write_poses",
    "write_submap",
]
