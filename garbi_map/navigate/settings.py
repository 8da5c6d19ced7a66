"""Settings of the navigate room."""

from garbi_map.settings import Settings


class NavigateSettings(Settings):
    """Every field says its unit."""
