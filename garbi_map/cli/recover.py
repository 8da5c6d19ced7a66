"""`garbi recover`: everything that can be read of a damaged log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from garbi_map.recover import Recovery

MOST_LINES = 20


@app.command("recover")
def recover_(
    log: Annotated[Path, typer.Argument(help="A damaged or truncated MCAP file.", show_default=False)],
    out: Annotated[Path, typer.Option("--output", "-o", help="The new log; nothing is ever written over.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Write everything readable of a damaged log to a new one, and say what was lost (exit 3; nothing usable: 1)."""
    import json

    from garbi_map.cli.watch import Watch
    from garbi_map.recover import recover

    with Watch() as progress:
        found = recover(log, out, progress)
    if as_json:
        typer.echo(json.dumps(found.as_dict(), indent=2))
    else:
        _print(found)
    if not found.lossless:
        raise typer.Exit(3)


def _print(found: Recovery) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from garbi_map.words import many, printable

    console = Console(highlight=False)
    table = Table()
    for heading in ("topic", "type", "recovered", "unproven", "lost"):
        table.add_column(heading, overflow="fold", justify="left" if heading in ("topic", "type") else "right")
    for name, tally in found.topics.items():
        at_least = f"{tally.lost_at_least:,} or more" if tally.lost_at_least else "unknown"
        lost = at_least if tally.lost is None else f"{tally.lost:,}"
        words = (Text(printable(text)) for text in (name, tally.type.rpartition("/")[2]))
        table.add_row(*words, f"{tally.proven:,}", f"{tally.unproven:,}", lost)
    console.print(table)
    for style, word, lines in (
        ("red", "lost", [*(stretch.line() for stretch in found.stretches), *found.records_lost]),
        ("yellow", "repaired", found.repaired),
        ("dim", "note", found.notes),
    ):
        for line in lines[:MOST_LINES]:
            console.print(Text.assemble((word, style), f" {printable(line)}"), soft_wrap=True)
        if len(lines) > MOST_LINES:
            console.print(f"and {len(lines) - MOST_LINES} more; --json has them all")
    if any(tally.unproven for tally in found.topics.values()):
        console.print(
            "Unproven messages decode, but no checksum holds for them; they are on topics under /unproven.",
            soft_wrap=True,
        )
    attached = f", {many(len(found.attachments), 'attachment')}" if found.attachments else ""
    state = "nothing was lost" if found.lossless else "the rest is written"
    summary = f"{found.output}: {many(found.messages, 'message')}{attached}, read back and verified; {state}"
    console.print(Text(printable(summary)), soft_wrap=True)
