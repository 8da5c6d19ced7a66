"""The `garbi` command. Each command is a file of its own here, thin, and imports what is heavy only when it runs."""

from __future__ import annotations

import importlib
import pkgutil
import sys

from garbi_map.cli.app import app
from garbi_map.errors import GarbiError


def main() -> None:
    """Run the command line; a GarbiError becomes one line on stderr and exit status 1."""
    for module in sorted(pkgutil.iter_modules(__path__), key=lambda found: found.name):
        importlib.import_module(f"{__name__}.{module.name}")
    try:
        app()
    except GarbiError as error:
        print(f"garbi: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("garbi: interrupted; run the same command again to go on", file=sys.stderr)
        sys.exit(130)
