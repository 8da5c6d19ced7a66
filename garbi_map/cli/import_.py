"""`garbi import`: what others recorded becomes a log."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app


class Stamps(StrEnum):
    """Where the stamps of images come from."""

    CSV = "csv"
    RATE = "rate"
    EXIF = "exif"
    MTIME = "mtime"
    NAME_NS = "name-ns"
    NAME_S = "name-s"


@app.command("import")
def import_(
    source: Annotated[
        Path, typer.Argument(help="Folder of images, or a log: MCAP, rosbag2 directory, ROS 1 bag.", show_default=False)
    ],
    angles: Annotated[
        Path | None, typer.Argument(help="CSV of angles, for a folder of images.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option("--output", "-o", help="Log to write (MCAP).")] = None,
    rig: Annotated[Path | None, typer.Option(help="rig.yaml to attach.")] = None,
    topics: Annotated[
        Path | None, typer.Option(help="Topic map (garbi check --suggest-topics prints one); else it is guessed.")
    ] = None,
    stamps: Annotated[Stamps | None, typer.Option(help="Where the stamps of images come from.")] = None,
    rate: Annotated[float | None, typer.Option(min=1e-3, help="Hz of images that are numbered.")] = None,
    offset: Annotated[float, typer.Option(help="Seconds added to the stamps of images.")] = 0.0,
    imu: Annotated[Path | None, typer.Option(help="CSV of rates and specific forces.")] = None,
    attitude: Annotated[Path | None, typer.Option(help="CSV of attitudes.")] = None,
    pressure: Annotated[Path | None, typer.Option(help="CSV of pressures or depths.")] = None,
    dvl: Annotated[Path | None, typer.Option(help="CSV of velocities in the DVL's frame.")] = None,
    odometry: Annotated[Path | None, typer.Option(help="CSV of poses of base_link.")] = None,
    mounts: Annotated[Path | None, typer.Option(help="YAML of the sensors' poses in base_link.")] = None,
) -> None:
    """Make a log of a folder of images and tables, or of another program's log (exit 3: some of it was left out)."""
    from garbi_map.importing.folder import Tables, import_folder
    from garbi_map.rig import load_rig

    if out is None:
        raise typer.BadParameter("say with -o LOG where to write")
    calibration = None if rig is None else load_rig(rig)
    if angles is not None:
        given = Tables(angles, imu, attitude, pressure, dvl, odometry, mounts)
        way = stamps or (Stamps.CSV if rate is None else Stamps.RATE)
        remarks, losses = import_folder(source, given, out, calibration, way.value, rate, offset)
    elif source.is_dir() and not (source / "metadata.yaml").exists():
        raise typer.BadParameter(f"{source} is a folder of images; give the CSV of angles too")
    else:
        from garbi_map.config import load_config
        from garbi_map.importing import import_log, suggest_topics
        from garbi_map.log import open_log

        if topics is None:
            suggestion = suggest_topics(open_log([source]))
            typer.echo(suggestion.to_yaml(), nl=False)
            settings = suggestion.settings()
        else:
            settings = load_config(topics).log
        log = open_log([source], settings)
        left = import_log(log, out, calibration)
        remarks, losses = [*log.remarks, *left], log.losses
    for line in remarks:
        typer.echo(line)
    typer.echo(f"{out}: written; garbi check {out} says how good it is")
    for line in losses:
        typer.echo(f"left out: {line}", err=True)
    if losses:
        raise typer.Exit(3)
