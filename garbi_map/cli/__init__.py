"""The `garbi` command. Each command is a file of its own here, thin, and imports what is heavy only when it runs."""

from __future__ import annotations

import sys

import typer

from garbi_map.errors import GarbiError

app = typer.Typer(
    name="garbi",
    help="Seabed maps and vehicle behaviours from a camera and a swept laser sheet.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line; a GarbiError becomes one line on stderr and exit status 1."""
    try:
        app()
    except GarbiError as error:
        print(f"garbi: {error}", file=sys.stderr)
        sys.exit(1)
    except KeyboardInterrupt:
        print("garbi: interrupted; run the same command again to go on", file=sys.stderr)
        sys.exit(130)
