"""The drift benchmark's table."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from tools.bench.scores import Honesty, together

if TYPE_CHECKING:
    from tools.bench.drift import Row

HEADS = (
    "dive", "without", "method", "median", "95 %", "> 10 mm, %", "complete, %", "ratio", "ATE", "attitude, deg",
    "NEES position", "NEES attitude", "stones", "kept, %", "relief, %", "CPU s", "of length",
)  # fmt: skip
ABOUT = """\
Cloud to true surface after one rigid alignment, mm: median, 95th percentile; per cent beyond 10 mm; per cent of the places
seen that have a point within 5 mm; ratio of the median to that of the true poses; ATE of the trajectory, mm rms, and its
attitude, aligned rigidly by positions and attitudes. NEES: error squared over what the covariance inside the map expects,
per degree of freedom, 1 is honest; in brackets where 95 % of honest estimates are. Stones: about 2 cm high, narrower
than 6 cm, that the map of the true poses covers; kept: per cent of them whose height is that of the true surface
within 2 mm; relief: per cent of the height they have with the true poses. CPU seconds of navigation and registration, and
as a share of the dive's length.
"""


def columns(row: Row) -> list[str]:
    """A row as text."""
    score, cloud = row.score, row.score.cloud
    return [
        row.dive, row.without, row.method,
        f"{cloud.median_mm:.3f}", f"{cloud.p95_mm:.3f}", f"{cloud.beyond10_percent:.3f}", _maybe(cloud.complete_percent),
        f"{row.ratio:.2f}", f"{score.ate_mm:.2f}", f"{score.attitude_deg:.3f}",
        with_band(score.position), with_band(score.attitude),
        str(score.stones), _maybe(score.kept_percent), _maybe(score.relief_percent),
        f"{row.cpu_s:.1f}", f"{row.cpu_s / row.length_s:.2f}",
    ]  # fmt: skip


def markdown(rows: list[Row]) -> str:
    """The whole table, after this map's figures in short and its honesty over all dives."""
    ours = [row for row in rows if row.method == "this map"]
    removals = list(dict.fromkeys(row.without for row in ours))
    short = [
        [dive, *(_short([row for row in ours if (row.dive, row.without) == (dive, without)]) for without in removals)]
        for dive in dict.fromkeys(row.dive for row in ours)
    ]
    honest = [
        [without, *(with_band(together(parts)) for parts in _parts(ours, without)), str(_out_of_band(ours, without))]
        for without in removals
    ]
    return "\n".join([
        "# Drift\n", ABOUT,
        "## This map without ...: median / 95 % (ratio to true poses)\n", *_table(["dive", *removals], short), "",
        "## Is it honest? All dives together\n",
        *_table(["without", "NEES position", "NEES attitude", "dives out of their band"], honest), "",
        "## All\n", *_table(HEADS, map(columns, rows)), "",
    ])  # fmt: skip


def _parts(ours: list[Row], without: str) -> tuple[list[Honesty], list[Honesty]]:
    scores = [row.score for row in ours if row.without == without]
    return [s.position for s in scores if s.position], [s.attitude for s in scores if s.attitude]


def _out_of_band(ours: list[Row], without: str) -> int:
    """Dives whose position's or attitude's error is not within its own band."""
    return sum(
        any(not part.band[0] <= part.nees <= part.band[1] for part in pair)
        for pair in zip(*_parts(ours, without), strict=True)
    )


def _short(rows: list[Row]) -> str:
    return "".join(f"{r.score.cloud.median_mm:.2f} / {r.score.cloud.p95_mm:.2f} ({r.ratio:.2f})" for r in rows)


def _maybe(value: float | None) -> str:
    return "" if value is None else f"{value:.1f}"


def with_band(value: Honesty | None) -> str:
    """A normalised error squared and, in brackets, where honest ones are."""
    return "" if value is None else f"{value.nees:.2f} [{value.band[0]:.2f} {value.band[1]:.2f}]"


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> list[str]:
    heads = list(heads)
    lines = [heads, ["---"] * len(heads), *(list(row) for row in rows)]
    return ["| " + " | ".join(line) + " |" for line in lines]
