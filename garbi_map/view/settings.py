"""Settings of the view room."""

from garbi_map.settings import Settings


class ViewSettings(Settings):
    """Every field says its unit."""
