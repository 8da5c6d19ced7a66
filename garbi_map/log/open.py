"""Find the files of a log, and read their indexes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from garbi_map.errors import GarbiError
from garbi_map.log.chunks import DAMAGE, MAGIC, Unindexed, reason
from garbi_map.log.index import Index
from garbi_map.log.reader import Log
from garbi_map.log.settings import LogSettings
from garbi_map.log.summary import index_from_summary
from garbi_map.log.walk import index_by_seeking, index_by_walking
from garbi_map.plain_yaml import read_yaml

LISTING = "metadata.yaml"
WALKED = 1 << 28  # bytes; a smaller file is walked through however quick it shall be


def open_log(paths: Sequence[Path], settings: LogSettings | None = None, quick: bool = False) -> Log:
    """MCAP files and rosbag2 directories as one log; several are read one after the other in the order of their begin.
    A ROS 1 bag and a rosbag2 database are read too, one at a time.

    quick: of a large file without an index only stretches are known, instead of walking through it; told as a loss.

    Raises GarbiError on a missing file or directory, on what is no log, and on a log without a message.
    """
    settings = settings or LogSettings()
    bags = [path for path in map(Path, paths) if _is_bag(path)]
    if bags and len(paths) > 1:
        raise GarbiError(f"{bags[0]}: a bag is read by itself; turn each into a log with garbi import, and give those")
    if bags:
        from garbi_map.log.bags import Bag

        return Bag(bags[0], settings)
    files = [file for path in paths for file in _files_of(Path(path))]
    if not files:
        raise GarbiError("no log given")
    indexes = sorted((read_index(file, quick) for file in files), key=lambda index: index.begin)
    return Log(indexes, settings)


def _is_bag(path: Path) -> bool:
    if path.is_file():
        from garbi_map.log.bags import is_database, is_ros1

        return is_ros1(path) or is_database(path)
    if not (path / LISTING).exists():
        return False
    bag = _listing(path)
    return bag.get("storage_identifier") == "sqlite3" or str(bag.get("compression_mode", "")).lower() == "message"


def _files_of(path: Path) -> list[Path]:
    if not path.exists():
        raise GarbiError(f"{path}: no such file or directory")
    if not path.is_dir():
        return [path]
    listing = path / LISTING
    if not listing.exists():
        raise GarbiError(f"{path}: a directory without {LISTING} is no rosbag2 log; give its .mcap files by name")
    bag = _listing(path)
    storage, names = bag.get("storage_identifier", "mcap"), bag["relative_file_paths"]
    if storage != "mcap":
        raise GarbiError(f"{path}: rosbag2 storage {storage!r} is not read; convert it to mcap (ros2 bag convert)")
    if str(bag.get("compression_mode", "")).lower() == "file":
        raise GarbiError(f"{path}: files compressed as a whole are not read; convert the log (ros2 bag convert)")
    # only the file's name counts: a listing may carry the recorder's directory, and must not lead out of this one
    files = [path / Path(str(name)).name for name in names]
    for file in files:
        if not file.exists():
            raise GarbiError(f"{file}: listed in metadata.yaml but missing")
    if not files:
        raise GarbiError(f"{listing}: lists no files")
    return files


def _listing(path: Path) -> dict[str, Any]:
    """What a rosbag2 directory says about itself; relative_file_paths is a list."""
    listing = path / LISTING
    try:
        bag = read_yaml(listing)["rosbag2_bagfile_information"]
        return {**bag, "relative_file_paths": list(bag["relative_file_paths"])}
    except (GarbiError, LookupError, TypeError, AttributeError, ValueError) as error:
        raise GarbiError(f"{listing}: not the metadata of a rosbag2 log") from error


def read_index(path: Path, quick: bool = False) -> Index:
    """The index of a file. Damage goes into its losses; raises GarbiError where it is no MCAP or holds no message."""
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            if size == 0:
                raise GarbiError(f"{path}: the file is empty")
            sound_start = file.read(len(MAGIC)) == MAGIC
            try:
                index = index_from_summary(path, file, size)
            except DAMAGE as error:
                if not sound_start:
                    raise GarbiError(f"{path}: not an MCAP file") from error
                if quick and size > WALKED:
                    index = index_by_seeking(path, file, size)
                    how = "only stretches of it were looked at, and counts are theirs; --full reads all of it"
                else:
                    index = index_by_walking(path, file, size)
                    how = "read record by record"
                if index.sampled or not isinstance(error, Unindexed):
                    index.losses.insert(0, f"{path.name}: no index at its end ({reason(error)}); {how}")
            if not sound_start:
                index.losses.append(f"{path.name}: its first bytes are damaged")
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
    if not index.pieces or not index.counts.total():
        lost = f" that can be read ({index.losses[-1]})" if index.losses else ""
        raise GarbiError(f"{path}: the log holds no message{lost}")
    return index
