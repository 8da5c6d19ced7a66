"""`garbi stripe`: the laser line in every image of a log, pictures of it, and the colour gate learnt from it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from collections.abc import Iterator

    from garbi_map.log import Image, Log


@app.command("stripe")
def stripe(
    logs: Annotated[list[Path], typer.Argument(help="MCAP files or rosbag2 directories.", show_default=False)],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Parquet file for the stripes.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file, instead of the one in the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration, YAML.")] = None,
    overlay: Annotated[Path | None, typer.Option(help="Folder for pictures of what was found.")] = None,
    learn: Annotated[Path | None, typer.Option(help="Learn the laser's colour; write it as configuration.")] = None,
    pictures: Annotated[int, typer.Option(min=1, help="Images to draw or to learn from, evenly spaced.")] = 20,
    workers: Annotated[int, typer.Option(min=1, help="Threads that decode and detect.")] = 2,
) -> None:
    """Find the laser line (Parquet: stamp_ns, row, u, sigma, intensity), draw it, or learn its colour.

    Without a rig or an encoder the whole width of each image is searched.
    """
    from garbi_map.config import load_config
    from garbi_map.errors import GarbiError
    from garbi_map.export import written_aside
    from garbi_map.log import open_log
    from garbi_map.rig import load_rig, parse_rig
    from garbi_map.stripe import ImageLosses, StripeDetector, detect_all
    from garbi_map.stripe.learn import learn_settings, settings_yaml
    from garbi_map.stripe.overlay import write_overlays
    from garbi_map.stripe.table import write_stripes
    from garbi_map.sweep import laser_angle
    from garbi_map.words import many

    if output is None and overlay is None and learn is None:
        raise typer.BadParameter("nothing to do: give -o FILE, --overlay DIR or --learn OUT.yaml")
    settings = load_config(config)
    log = open_log(logs, settings.log)
    if log.image_count == 0:
        raise GarbiError(f"{logs[0]}: no images on {settings.log.topics.image}; set log.topics.image")
    calibration = None
    if rig is not None:
        calibration = load_rig(rig)
    elif log.rig_text is not None:
        calibration = parse_rig(log.rig_text, f"{logs[0]}: attachment rig.yaml")
    alpha_of = None
    if calibration is not None:
        encoder = log.navigation(joint=calibration.laser.joint).encoder
        if encoder is not None or calibration.laser.fixed_angle is not None:
            alpha_of = laser_angle(encoder, calibration, settings.sweep).alpha
    losses = ImageLosses()
    found = settings.stripe
    if learn is not None:
        found = learn_settings(_spaced(log, pictures), found, losses)
        with written_aside(learn) as aside:
            aside.write_text(settings_yaml(found), encoding="utf-8")
        typer.echo(f"{learn}: a {found.laser} laser")
    detector = StripeDetector(found, calibration)
    if overlay is not None:
        count = write_overlays(overlay, _spaced(log, pictures), detector, alpha_of)
        typer.echo(f"{overlay}: {count} pictures")
    if output is not None:
        losses = ImageLosses()
        with written_aside(output) as aside:
            images, rows = write_stripes(aside, detect_all(log.images(), detector, alpha_of, workers, losses))
        typer.echo(f"{output}: {many(rows, 'row')} of {many(images, 'image')}")
    left_out = [*log.losses, *losses.lines()]
    for line in left_out:
        typer.echo(f"left out: {line}", err=True)
    if left_out:
        raise typer.Exit(3)


def _spaced(log: Log, count: int) -> Iterator[Image]:
    """About `count` images, evenly spaced over the log."""
    step = max(log.image_count // count, 1)
    for number, image in enumerate(log.images()):
        if number % step == step // 2:
            yield image
