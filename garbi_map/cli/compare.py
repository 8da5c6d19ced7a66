"""`garbi compare`: what changed between two maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app


@app.command("compare")
def compare(
    first: Annotated[Path, typer.Argument(help="The earlier map: a folder that garbi map has written.")],
    second: Annotated[Path, typer.Argument(help="The later map.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for what changed.")],
    config: Annotated[Path | None, typer.Option(help="Configuration (YAML); its section compare.")] = None,
    as_is: Annotated[bool, typer.Option("--as-is", help="The maps have one origin: do not align them.")] = False,
) -> None:
    """Tell what changed between two maps of a site, and how sure that is; their origins need not agree."""
    from garbi_map.compare.report import verdict
    from garbi_map.compare.run import compare_maps
    from garbi_map.config import load_config

    found = compare_maps(first, second, out, load_config(config).compare, as_is, lambda step: typer.echo(f"{step} ..."))
    typer.echo(f"{verdict(found)}\n{out}: report.html, changes.csv; everything in Rerun: garbi view {out}")
