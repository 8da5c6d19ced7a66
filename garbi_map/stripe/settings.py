"""Settings of the stripe room."""

from garbi_map.settings import Settings


class StripeSettings(Settings):
    """Every field says its unit."""
