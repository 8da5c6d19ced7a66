"""The files of a map are replaced all at once: written beside, and only when the last of them is there moved into place."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from garbi_map.config import Config
from garbi_map.db import Database
from garbi_map.keys import code_key, digest_of
from garbi_map.outputs import OUTPUTS

_FRESH = "files"
_STATE = "files"
_MOVING, _THERE = "being moved: ", "in place: "


def is_published(database: Database, out: Path, config: Config) -> bool:
    """Whether the files in a folder are those of its database as it is, and complete."""
    in_place = database.state(_STATE) == _THERE + _key(database, config)
    return in_place and all((out / name).exists() for name in OUTPUTS)


@contextmanager
def published(database: Database, out: Path, config: Config) -> Iterator[Path]:
    """A folder to write the files into; when the block ends well they replace those in `out`."""
    fresh = out / ".work" / _FRESH
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    yield fresh
    moving = _MOVING + _key(database, config)
    database.catalogue.set_state(_STATE, moving, {"files": sorted(file.name for file in fresh.iterdir())})
    roll_forward(database, out)


def roll_forward(database: Database, out: Path) -> None:
    """Move what is complete and not yet in place; a run that was killed meanwhile is finished by the next."""
    state = database.state(_STATE)
    if state is None or not state.startswith(_MOVING):
        return
    fresh = out / ".work" / _FRESH
    if fresh.is_dir():
        for file in sorted(fresh.iterdir()):
            file.replace(out / file.name)
    database.catalogue.set_state(_STATE, _THERE + state.removeprefix(_MOVING), {})


def _key(database: Database, config: Config) -> str:
    poses = [
        part
        for submap in database.submaps
        for part in (submap.written.name, submap.pose.translation.tobytes(), submap.pose.quaternion.tobytes())
    ]
    settings = [section.model_dump_json() for section in (config.seabed, config.export, config.view)]
    return digest_of(code_key(), *poses, *settings)
