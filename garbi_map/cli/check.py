"""`garbi check`: what is in a log, what is missing, damaged or wrong, and what map to expect of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from rich.console import Console

    from garbi_map.health import Health
    from garbi_map.health.expected import Expected
    from garbi_map.log.check import LogCheck


_BARS = " ▁▂▃▄▅▆▇█"  # nothing to all of an image's rows with a stripe


@app.command("check")
def check(
    logs: Annotated[list[Path], typer.Argument(help="MCAP files, rosbag2 directories or a ROS 1 bag, read as one log")],
    config: Annotated[Path | None, typer.Option(help="configuration with the topic names")] = None,
    rig: Annotated[Path | None, typer.Option(help="rig.yaml; wins over the one attached to the log")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON (docs/check.md) instead of tables")] = False,
    full: Annotated[bool, typer.Option("--full", help="read the whole log, however large, for damage")] = False,
    suggest: Annotated[
        bool, typer.Option("--suggest-topics", help="guess the topics; print them as a configuration")
    ] = False,
) -> None:
    """Say how healthy a log is: what it holds, what is missing, damaged (exit 3) or wrong, and what map to expect.

    Seconds for any length: a long log is sampled. Exit 1: it cannot be mapped as it is configured.
    """
    import json

    from garbi_map.config import load_config
    from garbi_map.errors import GarbiError
    from garbi_map.health import check_health
    from garbi_map.log import open_log
    from garbi_map.rig import load_rig

    settings = load_config(config)
    log = open_log(logs, settings.log, quick=not full)
    if suggest:
        from garbi_map.importing import suggest_topics

        print(suggest_topics(log).to_yaml(), end="")
        return
    found = check_health(log, settings, None if rig is None else load_rig(rig), full or None)
    if as_json:
        print(json.dumps(found.as_dict(), indent=2))
    else:
        _print(found)
    if not found.log.mappable:
        raise GarbiError(f"{logs[0]}: {found.log.unusable[0]}")
    if found.log.damage:
        raise typer.Exit(3)


def _print(found: Health) -> None:
    from rich.console import Console
    from rich.text import Text

    console = Console()
    _print_topics(console, found.log)
    for missing in found.log.missing:
        console.print("[yellow]missing[/]", Text(f"{missing.what}: {missing.cost}"), highlight=False)
    for finding in found.findings:
        console.print("[yellow]wrong[/]", Text(finding.text), highlight=False)
    for line in found.remarks:
        console.print("note", Text(line), highlight=False)
    for line in found.log.damage:
        console.print("[red]damaged[/]", Text(line), highlight=False)
    for line in _figures(found):
        console.print(line, highlight=False)
    if not found.log.read_whole:
        console.print("Large log: damage inside of it was not looked for; --full reads all of it.", highlight=False)
    elif not found.log.checksums:
        console.print("Parts of this log carry no checksum: damage there cannot be seen.", highlight=False)
    elif not found.log.damage:
        console.print("Every checksum holds.", highlight=False)


def _print_topics(console: Console, found: LogCheck) -> None:
    from datetime import UTC, datetime

    from rich.table import Table
    from rich.text import Text

    from garbi_map.words import printable

    begin = datetime.fromtimestamp(found.begin_ns * 1e-9, UTC)
    console.print(f"{begin:%Y-%m-%d %H:%M:%S} UTC, {found.duration:.1f} s", highlight=False)
    table = Table()
    for heading in ("topic", "type", "used as", "messages", "rate", "gaps"):
        table.add_column(heading, overflow="fold")
    for topic in found.topics:
        gaps = ", ".join(f"{gap.begin:.1f} to {gap.end:.1f} s" for gap in topic.gaps[:3])
        more = f" and {len(topic.gaps) - 3} more" if len(topic.gaps) > 3 else ""
        rate = f"{topic.rate:.1f} Hz" if topic.rate else ""
        name, kind = (Text(printable(text)) for text in (topic.name, topic.type.rpartition("/")[2]))
        table.add_row(name, kind, topic.role, str(topic.count), rate, gaps + more)
    console.print(table)


def _figures(found: Health) -> list[str]:
    """What the samples show and promise, in words."""
    from garbi_map.words import percent

    sampling, pictures, motor = found.sampling, found.pictures, found.motor
    lines = [
        f"Sampled: {sampling.stretches} stretches of {sampling.length:.2g} s, {percent(sampling.share)} of the log."
        + _unseen_gaps(found.log)
    ]
    if pictures:
        where = "" if pictures.expected is None else f", {percent(pictures.expected)} of it where the rig expects it"
        lines.append(
            f"Stripe: seen in {percent(pictures.stripe_seen)} of {pictures.looked_at} images, in "
            f"{percent(pictures.stripe_rows)} of their rows, {pictures.stripe_sigma:.2f} px{where}."
        )
        lines.append(f"Over time: {''.join(_BARS[round(rows * (len(_BARS) - 1))] for _, rows in pictures.over_time)}")
    if motor and motor.speed:
        lines.append(f"Laser: {motor.first:.3f} to {motor.last:.3f} rad, {motor.sweep:.1f} s a sweep.")
    if found.expected:
        lines.append(_promise(found.expected))
    return lines


def _unseen_gaps(found: LogCheck) -> str:
    if not found.shortest_gap:
        return ""
    which = "Gaps" if found.shortest_gap >= found.duration else f"Gaps below {found.shortest_gap:.2g} s"
    return f" {which} are not looked for."


def _promise(expected: Expected) -> str:
    from garbi_map.words import length

    parts = [
        f"ground {length(expected.range_m)} away",
        f"point sigma {length(expected.point_sigma_m[0])} (95 %: {length(expected.point_sigma_m[1])}) without motion",
        f"swath {length(expected.swath_m)}",
    ]
    if expected.overlap is not None and expected.area_m2 is not None and expected.points_per_cm2 is not None:
        parts += [
            f"each place seen by {expected.overlap:.1f} sweeps",
            f"{expected.points_per_cm2:.1f} points per cm2",
            f"up to {expected.area_m2:.1f} m2",
        ]
    else:
        parts.append("overlap unknown: no speed in the log, or no sweeps")
    return f"To expect, roughly: {', '.join(parts)}."
