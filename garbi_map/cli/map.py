"""`garbi map`"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app


@app.command("map")
def map_(
    logs: Annotated[
        list[Path],
        typer.Argument(help="MCAP files or rosbag2 directories of one dive, or of several.", show_default=False),
    ],
    out: Annotated[
        Path, typer.Option("--output", "-o", help="Folder of the map; where it holds one, the dives join it.")
    ],
    rig: Annotated[Path | None, typer.Option(help="rig.yaml; wins over the one attached to the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration (YAML).")] = None,
    workers: Annotated[
        int, typer.Option(min=1, help="Threads that find stripes; with several dives, processes that take one each.")
    ] = 2,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler whose workers do it; they must see the same files."),
    ] = None,
    begin: Annotated[float | None, typer.Option("--from", help="Begin this many seconds into the log.")] = None,
    end: Annotated[float | None, typer.Option("--to", help="End this many seconds into the log.")] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON[,HEADING]",
            help="Where on Earth the dive begins (WGS 84, degrees) and where the map's x axis points.",
        ),
    ] = None,
    view: Annotated[
        bool, typer.Option("--view", help="Watch it grow in Rerun, then look at the finished map.")
    ] = False,
) -> None:
    """Build a seabed map from recorded dives, or make the map of earlier dives grow.

    Files without a pause between them are one dive; a minute without a message, or another rig, begins the next.
    """
    from garbi_map.cli.watch import Watch
    from garbi_map.config import load_config
    from garbi_map.pipeline import build_map
    from garbi_map.progress import unseen
    from garbi_map.view.live import watched

    settings = load_config(config)
    if origin is not None:
        settings = settings.model_copy(update={"export": settings.export.model_copy(update={"origin": _place(origin)})})
    with ExitStack() as opened:
        show = opened.enter_context(watched(logs[0].stem, out)) if view else unseen
        with Watch() as progress:
            losses = build_map(logs, out, settings, rig, (begin, end), workers, progress, show, dask)
        typer.echo(f"{out}: the map is finished; {out / 'report.html'} says how good it is")
    for line in losses:
        typer.echo(f"left out: {line}", err=True)
    if losses:
        raise typer.Exit(3)


def _place(origin: str) -> str:
    """The option as it is where it says a place."""
    from garbi_map.export import Origin

    try:
        Origin.parse(origin)
    except ValueError as error:
        raise typer.BadParameter(f"{error}", param_hint="--origin") from error
    return origin
