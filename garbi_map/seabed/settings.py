"""Settings of the seabed room."""

from garbi_map.settings import Settings


class SeabedSettings(Settings):
    """Every field says its unit."""
