"""`garbi sweep`: the profiles of each pass of the laser as a cloud, before anything moves them."""

from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app


@app.command("sweep")
def sweep(
    log: Annotated[list[Path], typer.Argument(help="MCAP files or rosbag2 directories.", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder for the clouds.", show_default=False)],
    rig: Annotated[Path | None, typer.Option(help="Rig file, instead of the one in the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration, YAML.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Threads that decode and detect.")] = 2,
) -> None:
    """Per-sweep clouds (LAZ, rig frame, unregistered), and sweeps.json, which lists them."""
    from garbi_map.config import load_config
    from garbi_map.errors import GarbiError
    from garbi_map.log import open_log
    from garbi_map.rig import load_rig, parse_rig
    from garbi_map.stripe import ImageLosses, StripeDetector, detect_all
    from garbi_map.sweep import SweepLosses, laser_angle, make_sweeps, write_sweeps
    from garbi_map.words import many

    settings = load_config(config)
    source = open_log(log, settings.log)
    if rig is None and source.rig_text is None:
        raise GarbiError(f"{log[0]}: no rig file is attached; give one with --rig")
    calibration = load_rig(rig) if rig is not None else parse_rig(source.rig_text or "", f"{log[0]}: attached rig.yaml")
    angle = laser_angle(source.navigation().encoder, calibration, settings.sweep)
    image_losses, sweep_losses = ImageLosses(), SweepLosses()
    detector = StripeDetector(settings.stripe, calibration)
    stripes = detect_all(source.images(), detector, angle.alpha, workers, image_losses)
    sweeps = make_sweeps(stripes, calibration, angle, settings.sweep, sweep_losses)
    written = write_sweeps(output, sweeps)
    if written == 0:
        raise GarbiError(f"{log[0]}: no sweep: the laser was not found in any image with a known angle")
    losses = [*source.losses, *image_losses.lines(), *sweep_losses.lines()]
    for line in losses:
        typer.echo(f"left out: {line}", err=True)
    typer.echo(f"{many(written, 'sweep')} in {output}")
    if losses:
        raise typer.Exit(3)
