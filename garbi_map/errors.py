"""The one family of errors that a user is meant to read."""


class GarbiError(Exception):
    """Bad input: one line that says what is wrong, where, and what to do. Ends the command with exit status 1."""
