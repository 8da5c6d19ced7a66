"""Recording: a camera and the sensors' lines into a log, with nothing lost that can be kept."""

from garbi_map.record.settings import RecordSettings

__all__ = ["RecordSettings"]
