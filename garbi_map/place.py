"""Where on Earth a map is, which the dive with which it begins decides for all that join it."""

from __future__ import annotations

from garbi_map.db import Database
from garbi_map.dive import Dive
from garbi_map.errors import GarbiError
from garbi_map.estimate import Estimate
from garbi_map.export import Located, check_origin, locate

_STATE = "place"


def check_place(database: Database, dive: Dive) -> None:
    """Raises GarbiError where a dive cannot lie where it is said to, before the work is done: the map is elsewhere
    already, or this dive begins it and its own log has no north."""
    settings = dive.config.export
    kept = database.state(_STATE)
    if kept is None or not database.dives:
        check_origin(dive.navigation, settings.place, settings.projection)
    elif settings.origin is not None and not Located.from_json(kept).is_at(settings.place):
        raise GarbiError(
            f"{database.folder.parent}: the map there was begun with another origin, or with none; choose another folder, "
            "or leave --origin out"
        )


def place_on_earth(database: Database, dive: Dive, made: Estimate) -> Located:
    """Where the map is: as it was found when it was begun, or now, where this dive begins it."""
    kept = database.state(_STATE)
    if kept is not None and database.dives:
        return Located.from_json(kept)
    settings = dive.config.export
    paths = (made.navigated.trajectory, made.registered.trajectory)
    located = locate(dive.navigation, paths, settings.place, settings.projection, settings.origin_sigma)
    database.catalogue.set_state(_STATE, located.to_json(), {"notes": located.notes})
    return located
