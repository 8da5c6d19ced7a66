"""`garbi view`"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app


@app.command("view")
def view(
    path: Annotated[
        Path,
        typer.Argument(help="A log, the decisions of a replay, a finished map, or a recording.", show_default=False),
    ],
    web: Annotated[bool, typer.Option("--web", help="Serve a page for a browser instead of opening a window.")] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Where --web serves it, to this machine.")] = 9090,
    save: Annotated[Path | None, typer.Option(help="Write a log as a recording instead of showing it.")] = None,
    every: Annotated[int | None, typer.Option(min=1, help="Of so many images of a log one is shown.")] = None,
    no_images: Annotated[bool, typer.Option("--no-images", help="Leave the images of a log out.")] = False,
    rig: Annotated[Path | None, typer.Option(help="rig.yaml; wins over the one attached to the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration (YAML).")] = None,
) -> None:
    """Look at a log, at what behaviours decided, or at a finished map in Rerun."""
    from garbi_map.view.show import Wishes, recording_of, save_log, show_log, show_recording

    recording = recording_of(path)
    if recording is not None:
        if save or every or no_images:
            raise typer.BadParameter(
                f"--save, --every and --no-images are for logs; {recording} is a recording already"
            )
        show_recording(recording, web, port)
        return
    wishes = Wishes(config, rig, every, no_images)
    lost = save_log(path, wishes, save) if save else show_log(path, wishes, web, port)
    for line in lost:
        typer.echo(f"left out: {line}", err=True)
    if save:
        typer.echo(f"{save}: open it with garbi view {save}")
    if lost:
        raise typer.Exit(3)
