"""Settings of the register room."""

from garbi_map.settings import Settings


class RegisterSettings(Settings):
    """Every field says its unit."""
