"""`garbi evaluate`: a map against a known truth."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from garbi_map.evaluate import Evaluation


@app.command("evaluate")
def evaluate(
    directory: Annotated[Path, typer.Argument(help="what `garbi map` wrote: trajectory.tum and cloud.laz")],
    truth: Annotated[
        list[Path],
        typer.Option(help="folder of truth_trajectory.tum, truth_seabed.ply, truth_seen.npy; or such files; or a log"),
    ],
    json_file: Annotated[Path | None, typer.Option("--json", help="write the figures there, too")] = None,
) -> None:
    """Compare a map with a known truth: trajectory (ATE, RPE) and cloud to surface, after one rigid alignment."""
    import json

    from garbi_map.evaluate import evaluate as compare
    from garbi_map.evaluate import read_truth
    from garbi_map.export import write_text

    found = compare(directory, read_truth(truth))
    if json_file is not None:
        write_text(json_file, json.dumps(found.as_dict(), indent=2) + "\n")
    _print(found)


def _print(found: Evaluation) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for heading in ("", "figure", ""):
        table.add_column(heading, justify="right" if heading else "left")
    rows: list[tuple[str, float | None, str]] = []
    if found.trajectory is not None:
        path = found.trajectory
        rows += [
            ("absolute trajectory error, rms", path.ate_rmse_mm, "mm"),
            ("absolute attitude error, rms", path.ate_attitude_deg, "deg"),
            ("relative pose error over 1 s, rms", path.rpe_mm, "mm"),
            ("relative attitude error over 1 s, rms", path.rpe_attitude_deg, "deg"),
        ]
    if found.cloud is not None:
        cloud = found.cloud
        rows += [
            ("cloud to surface, median", cloud.median_mm, "mm"),
            ("root mean square", cloud.rms_mm, "mm"),
            ("root mean square of the best 99 %", cloud.rms99_mm, "mm"),
            ("95th percentile", cloud.p95_mm, "mm"),
            ("beyond 10 mm", cloud.beyond10_percent, "%"),
            ("complete: seen places with a point within 5 mm", cloud.complete_percent, "%"),
        ]
    for name, value, unit in rows:
        table.add_row(name, "–" if value is None else f"{value:.3f}", unit)
    Console().print(table)
