"""`garbi view`: a log, a map or a recording, in Rerun."""

from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app


@app.command("view")
def view(
    what: Annotated[
        Path, typer.Argument(help="A log, the folder of a map, or a recording (.rrd).", show_default=False)
    ],
    web: Annotated[bool, typer.Option("--web", help="Serve it to a browser instead of opening a window.")] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port of the page, with --web.")] = 9090,
    save: Annotated[Path | None, typer.Option(help="Write a recording of the log, and open nothing.")] = None,
    every: Annotated[int | None, typer.Option(min=1, help="Take every so-manieth image of a log.")] = None,
    images: Annotated[bool, typer.Option("--images/--no-images", help="Show the images of a log.")] = True,
    rig: Annotated[Path | None, typer.Option(help="rig.yaml; wins over the one attached to the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration (YAML).")] = None,
) -> None:
    """Look at a log as it was recorded, or at a finished map."""
    from garbi_map.view.viewer import Viewer, recording_of

    recording = recording_of(what)
    if save is not None:
        if recording is not None:
            raise typer.BadParameter(f"{recording} is a recording already", param_hint="--save")
        from garbi_map.view.watch import save_log

        save_log(what, save, rig, config, every, images)
        typer.echo(f"{save}: open it with garbi view {save}")
        return

    with Viewer([] if recording is None else [recording], port if web else None) as viewer:
        if web:
            typer.echo(f"open {viewer.page} in a browser; Ctrl-C ends it")
        if recording is None:  # the viewer starts up while the log is being opened
            from garbi_map.view.watch import watch_log

            watch_log(what, viewer, rig, config, every, images)
        viewer.wait()
