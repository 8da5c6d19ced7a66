"""`garbi calibrate`: camera, laser, and the target to print."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from garbi_map.cli.app import app

calibrate = typer.Typer(
    help="Calibrate camera and laser sheet with a target, or check them on a dive.", no_args_is_help=True
)
app.add_typer(calibrate, name="calibrate")

Target = Annotated[Path, typer.Option(help="target.yaml: what the target is")]
Output = Annotated[Path, typer.Option("--output", "-o", help="the rig file to write")]
Report = Annotated[Path | None, typer.Option(help="write report.html into this directory")]
Config = Annotated[Path | None, typer.Option(help="configuration, YAML")]


@calibrate.command("camera")
def camera(
    source: Annotated[list[Path], typer.Argument(help="images, directories of images, or one log")],
    target: Target,
    output: Output,
    rig: Annotated[Path | None, typer.Option(help="a rig file to begin with: pose in the rig, port, laser")] = None,
    camera_info: Annotated[Path | None, typer.Option(help="begin with this ROS camera_info file instead")] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(help="solve for this only (camera.alpha_u, camera.port.distance, ...); repeat it"),
    ] = None,
    write_camera_info: Annotated[Path | None, typer.Option(help="write a ROS camera_info file, too")] = None,
    report: Report = None,
    config: Config = None,
) -> None:
    """Intrinsics, distortion and port from views of a target; the rig file then lacks its laser."""
    from garbi_map.calibrate import run

    found, losses, advice = run.camera(
        source, target, output, rig, camera_info, free, write_camera_info, report, config
    )
    typer.echo(
        f"{len(found.views)} views: {found.in_sample:.3f} px rms per corner, {found.hold_out:.3f} on corners held out"
    )
    typer.echo(f"solved for: {', '.join(found.adjusted.free)}")
    held = [name for name in found.adjusted.scanner.values() if name not in found.adjusted.free]
    typer.echo(f"held: {', '.join(held) or 'nothing'}")
    _end(losses, advice, output)


@calibrate.command("laser")
def laser(
    log: Annotated[
        Path, typer.Argument(help="a log that shows target and stripe at several poses, still in each sweep")
    ],
    target: Target,
    rig: Annotated[Path, typer.Option(help="the rig file with the calibrated camera")],
    output: Output,
    free: Annotated[
        list[str] | None, typer.Option(help="solve for this, too (laser.window.distance, ...); repeat it")
    ] = None,
    method: Annotated[
        str, typer.Option(help="refined, linear (five columns) or paper (its equations, corrected)")
    ] = "refined",
    motor: Annotated[bool, typer.Option(help="whether a motor turns the laser")] = True,
    report: Report = None,
    config: Config = None,
) -> None:
    """The sheet's parameters from the stripe on a target, with what they leave uncertain."""
    from garbi_map.calibrate import run
    from garbi_map.calibrate.sheet_test import sheet_lines

    found, sheets, losses, advice = run.laser(log, target, rig, output, free or [], method, motor, report, config)
    typer.echo(
        f"{len(found.views)} poses of the target, {int(found.adjusted.stripe_good.sum())} points: "
        f"{1e3 * found.rms:.2f} mm rms off the sheet, {1e3 * found.hold_out:.2f} on images held out"
    )
    for spread in found.spreads:
        typer.echo(f"at {spread.depth:g} m: {1e3 * spread.rms:.2f} mm, 1 sigma over the image")
    for line in sheet_lines(sheets):
        typer.echo(line)
    held = [name for name in found.scanner.values() if name not in found.adjusted.free]
    typer.echo(f"held: {', '.join(held) or 'nothing'}")
    _end(losses, advice, output)


@calibrate.command("field")
def field(
    logs: Annotated[list[Path], typer.Argument(help="MCAP files or rosbag2 directories of one ordinary dive")],
    output: Output,
    rig: Annotated[
        Path | None, typer.Option(help="the rig file to check; wins over the one attached to the log")
    ] = None,
    focal: Annotated[bool, typer.Option("--focal", help="the focal length may be wrong, too")] = False,
    index: Annotated[bool, typer.Option("--index", help="the water's refractive index may be wrong, too")] = False,
    known: Annotated[Path | None, typer.Option(help="YAML: what in the scene is flat, and how high")] = None,
    begin: Annotated[float | None, typer.Option("--from", help="begin this many seconds into the log")] = None,
    end: Annotated[float | None, typer.Option("--to", help="end this many seconds into the log")] = None,
    workers: Annotated[int, typer.Option(min=1, help="threads that decode images and find stripes")] = 2,
    config: Config = None,
) -> None:
    """The rig checked, and corrected where it has to be, from sweeps of a dive that overlap."""
    from garbi_map.calibrate.field import calibrate_field
    from garbi_map.calibrate.field_words import sentences, table
    from garbi_map.cli.watch import Watch

    with Watch() as progress:
        found, losses = calibrate_field(logs, output, rig, focal, index, known, (begin, end), config, workers, progress)
    lines = [("parameter", "given", "found", "1 sigma", "before", "information", "verdict"), *table(found)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    for line in lines:
        typer.echo("  ".join(word.ljust(width) for word, width in zip(line, widths, strict=True)).rstrip())
    for sentence in sentences(found):
        typer.echo(sentence)
    _end(losses, [], output)


@calibrate.command("target")
def draw(
    target: Annotated[Path, typer.Argument(help="target.yaml: what the target is")],
    output: Annotated[Path, typer.Option("--output", "-o", help="a .pdf or .svg file")],
) -> None:
    """A target to print at 100 %."""
    from garbi_map.calibrate.drawing import write_drawing
    from garbi_map.calibrate.targets import load_target

    write_drawing(output, load_target(target))
    typer.echo(f"{output}: print at 100 % on something flat, then measure a square and correct {target}")


def _end(losses: list[str], advice: list[str], output: Path) -> None:
    for line in advice:
        typer.echo(f"advice: {line}")
    for line in losses:
        typer.echo(f"left out: {line}", err=True)
    typer.echo(f"written: {output}")
    if losses:
        raise typer.Exit(3)
