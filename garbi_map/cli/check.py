"""`garbi check`: what is in a log, what is missing, what is damaged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from garbi_map.log.check import LogCheck


@app.command("check")
def check(
    logs: Annotated[list[Path], typer.Argument(help="MCAP files or rosbag2 directories, read as one log")],
    config: Annotated[Path | None, typer.Option(help="configuration with the topic names")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON instead of a table")] = False,
    full: Annotated[bool, typer.Option("--full", help="read the whole log, however large")] = False,
    suggest: Annotated[
        bool, typer.Option("--suggest-topics", help="guess the topics; print them as a configuration")
    ] = False,
) -> None:
    """Say what is in a log, what is missing and what that costs, and what is damaged (exit 3; unusable: 1)."""
    import json

    from garbi_map.config import load_config
    from garbi_map.errors import GarbiError
    from garbi_map.log import open_log
    from garbi_map.log.check import check_log

    if suggest:
        from garbi_map.importing import suggest_topics

        print(suggest_topics(open_log(logs, load_config(config).log)).to_yaml(), end="")
        return
    found = check_log(open_log(logs, load_config(config).log), whole=full or None)
    if as_json:
        print(json.dumps(found.as_dict(), indent=2))
    else:
        _print(found)
    if not found.mappable:
        raise GarbiError(f"{logs[0]}: {found.unusable[0]}")
    if found.damage:
        raise typer.Exit(3)


def _print(found: LogCheck) -> None:
    from datetime import UTC, datetime

    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    begin = datetime.fromtimestamp(found.begin_ns * 1e-9, UTC)
    console.print(f"{begin:%Y-%m-%d %H:%M:%S} UTC, {found.duration:.1f} s", highlight=False)
    table = Table()
    for heading in ("topic", "type", "used as", "messages", "rate", "gaps"):
        table.add_column(heading, overflow="fold")
    for topic in found.topics:
        gaps = ", ".join(f"{gap.begin:.1f} to {gap.end:.1f} s" for gap in topic.gaps[:3])
        more = f" and {len(topic.gaps) - 3} more" if len(topic.gaps) > 3 else ""
        rate = f"{topic.rate:.1f} Hz" if topic.rate else ""
        table.add_row(topic.name, topic.type.rpartition("/")[2], topic.role, str(topic.count), rate, gaps + more)
    console.print(table)
    for missing in found.missing:
        console.print(f"[yellow]missing[/] {missing.what}: {missing.cost}", highlight=False)
    for line in found.damage:
        console.print("[red]damaged[/]", Text(line), highlight=False)
    if not found.read_whole:
        console.print("Large log: only its index was read; --full reads and verifies every message.", highlight=False)
    elif not found.checksums:
        console.print("Parts of this log carry no checksum: damage there cannot be seen.", highlight=False)
    elif not found.damage:
        console.print("Every checksum holds.", highlight=False)
