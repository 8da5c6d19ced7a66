"""Settings of the export room."""

from garbi_map.settings import Settings


class ExportSettings(Settings):
    """Every field says its unit."""
