"""The `garbi` command. Each command is a file of its own here, thin, and imports what is heavy only when it runs."""

from __future__ import annotations

import importlib
import os
import pkgutil
import sys
from importlib.metadata import entry_points

from garbi_map.cli.app import app
from garbi_map.errors import GarbiError
from garbi_map.words import printable

# numpy reads this when it is first imported. On cores that are shared, two BLAS threads wait for each other a thousand times
# longer than the small systems of the registration take; one thread also gives the same map on any number of cores
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


INTERRUPTED = 130  # the exit status that typer makes of Ctrl-C


def main() -> None:
    """Run the command line; a GarbiError becomes one line on stderr and exit status 1.

    So does a fault of our own, which GARBI_TRACEBACK=1 shows whole.
    """
    for module in sorted(pkgutil.iter_modules(__path__), key=lambda found: found.name):
        importlib.import_module(f"{__name__}.{module.name}")
    for command in sorted(entry_points(group="garbi.commands"), key=lambda found: found.name):
        command.load()  # commands of packages that build on this one, which it does not know
    try:
        app()
    except GarbiError as error:
        _end(str(error), 1)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _end("interrupted; run the same command again to go on", INTERRUPTED)
        raise
    except MemoryError:
        _end("out of memory; lower registration.drift.window_points or seabed.max_cells in the configuration", 1)
    except OSError as error:
        _end(f"{error.filename or 'input or output'}: {error.strerror or error}", 1)
    except Exception as error:
        if os.environ.get("GARBI_TRACEBACK"):
            raise
        kind = type(error).__name__
        _end(f"a fault of garbi's own ({kind}: {error}); GARBI_TRACEBACK=1 shows where, please report it", 1)


def _end(line: str, status: int) -> None:
    print(f"garbi: {printable(' '.join(line.split()))}", file=sys.stderr)
    sys.exit(status)
