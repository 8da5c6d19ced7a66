"""The ROS 2 message types of a log: the standard ones, and the few that the log itself has to define."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache

from mcap.records import Schema
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

from garbi_map.errors import GarbiError
from garbi_map.log.foreign import WATER_LINKED

DVL_MESSAGE = "marine_acoustic_msgs/msg/Dvl"
DEFINED_BY_LOGS = (DVL_MESSAGE, WATER_LINKED)
MAX_DEFINITION = 1 << 16  # bytes
HUGE_ARRAY = re.compile(r"\[[^\]]*\d{4}")


def standard_types() -> Typestore:
    """A store of ROS 2's common message types; `store.types[name]` are the classes that LogWriter.write takes."""
    return get_typestore(Stores.ROS2_HUMBLE)


def log_types(schemas: Iterable[Schema]) -> Typestore:
    """The store for a log's messages: the standard types, and the DVL messages that the log defines.

    Code is generated from a definition, and a log is untrusted: nothing else is taken from it, and nothing huge.
    """
    defined = {schema.name: schema for schema in schemas if schema.name in DEFINED_BY_LOGS}
    if not defined:
        return _shared_types()
    store = standard_types()
    for schema in defined.values():
        _register(store, schema)
    return store


@cache
def _shared_types() -> Typestore:
    """One store for all logs, as generating its code takes longer than opening a log."""
    return standard_types()


def _register(store: Typestore, schema: Schema) -> None:
    try:
        text = schema.data.decode()
        if schema.encoding != "ros2msg" or len(text) > MAX_DEFINITION or HUGE_ARRAY.search(text):
            raise ValueError("not a usable ros2msg definition")
        store.register(get_types_from_msg(text, schema.name))
        store.get_msgdef(schema.name)
    except (TypesysError, ValueError, LookupError, SyntaxError, AssertionError, RecursionError) as error:
        why = " ".join(str(error).split())[:100]
        raise GarbiError(f"type {schema.name}: its definition in the log cannot be used: {why}") from error
