"""The typer application that every command registers with."""

import typer

app = typer.Typer(
    name="garbi",
    help="Seabed maps and vehicle behaviours from a camera and a swept laser sheet.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
