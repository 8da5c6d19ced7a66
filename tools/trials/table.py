"""What became of avoidance trials: kept as CSV, told as a table, drawn as bars."""

from __future__ import annotations

import csv
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from statistics import median

from tools.trials.avoidance import BLIND, KINDS, Outcome

CONTROLLERS = ("garbi", "omniscient", "none", "potential", "stop")
KEYS = ("trials", "collided", "avoidable", "unseen", "feasible")
COLUMNS = [field.name for field in fields(Outcome)]
TOLD = 2  # passes that show what moves, from which on it can be told that it does
COLOURS = {"reached": "#4c9f70", "neither": "#d8d8d8", "unavoidable": "#e9b44c", "avoidable": "#c0392b"}


def append(path: Path, outcome: Outcome) -> None:
    """One line more; a run that is stopped loses nothing."""
    new = not path.exists()
    with path.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        writer.writerow([f"{value:.2f}" if isinstance(value, float) else value for value in outcome.as_dict().values()])


def read(path: Path) -> list[Outcome]:
    """What `append` left, by controller and seed; of two flights of one trial the later."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = [
        Outcome(
            int(row["seed"]), row["kind"], row["controller"], row["collided"] == "True", row["reached"] == "True",
            float(row["gap"]), float(row["seconds"]), float(row["length"]), int(row["passes"]),
            row["sources"],
        )
        for row in rows
    ]  # fmt: skip
    last = {(CONTROLLERS.index(one.controller), one.seed): one for one in found}
    return [last[key] for key in sorted(last)]


def judge(outcomes: Iterable[Outcome]) -> dict[tuple[str, str], dict[str, int]]:
    """Per controller and kind ("all" for all): trials, collided, avoidable (the omniscient controller did not collide), of
    those unseen (less than two passes showed what moves), feasible (it reached the goal), and of those how many were
    reached."""
    outcomes = list(outcomes)
    known = {one.seed: one for one in outcomes if one.controller == "omniscient"}
    found: dict[tuple[str, str], dict[str, int]] = defaultdict(
        lambda: {"trials": 0, "collided": 0, "avoidable": 0, "unseen": 0, "feasible": 0, "reached": 0}
    )
    for one in outcomes:
        best = known.get(one.seed)
        for kind in (one.kind, "all"):
            row = found[one.controller, kind]
            row["trials"] += 1
            row["collided"] += one.collided
            avoidable = bool(one.collided and best and not best.collided)
            row["avoidable"] += avoidable
            row["unseen"] += avoidable and one.kind == "moving" and one.passes < TOLD
            row["feasible"] += bool(best and best.reached)
            row["reached"] += bool(one.reached and best and best.reached)
    return found


def table(outcomes: Iterable[Outcome]) -> str:
    """Markdown: a row per controller and kind, the seeds that matter, and what the flights were flown with."""
    outcomes = list(outcomes)
    found = judge(outcomes)
    lines = [
        "| controller | kind | trials | collided | avoidable | of those shown by less than two passes | feasible "
        "| of these reached | median s to the goal |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for controller in CONTROLLERS:
        for kind in (*KINDS, "all"):
            row = found.get((controller, kind))
            if row:
                share = f"{row['reached']} ({100 * row['reached'] / row['feasible']:.0f} %)" if row["feasible"] else "-"
                counts = " | ".join("-" if key == "unseen" and controller in BLIND else str(row[key]) for key in KEYS)
                times = [one.seconds for one in _of(outcomes, controller, kind) if one.reached]
                lines.append(f"| {controller} | {kind} | {counts} | {share} | {_seconds(times)} |")
    return "\n".join([*lines, "", *_seeds(outcomes), *_sources(outcomes)])


def _of(outcomes: list[Outcome], controller: str, kind: str) -> list[Outcome]:
    return [one for one in outcomes if one.controller == controller and kind in (one.kind, "all")]


def _seconds(times: list[float]) -> str:
    return f"{median(times):.0f}" if times else "-"


def _seeds(outcomes: list[Outcome]) -> list[str]:
    """Which trials were not avoidable, not feasible, and what became of garbi elsewhere."""
    known = {one.seed: one for one in outcomes if one.controller == "omniscient"}
    own = [one for one in outcomes if one.controller == "garbi" and one.seed in known]
    told = {
        "Not avoidable (omniscient collided)": [seed for seed, one in known.items() if one.collided],
        "Not feasible (omniscient did not reach the goal)": [seed for seed, one in known.items() if not one.reached],
        "garbi collided although avoidable": [o.seed for o in own if o.collided and not known[o.seed].collided],
        "garbi neither collided nor reached a feasible goal": [
            o.seed for o in own if known[o.seed].reached and not o.reached and not o.collided
        ],
    }
    return [f"- {words}: {', '.join(map(str, seeds)) or 'none'}." for words, seeds in told.items()]


def _sources(outcomes: list[Outcome]) -> list[str]:
    counts = Counter((one.sources or "unknown", one.controller) for one in outcomes)
    return [f"- Flown with sources {sources}: {count} {controller}." for (sources, controller), count in counts.items()]


def draw(outcomes: list[Outcome], path: Path) -> None:
    """A bar per controller and kind, SVG: reached, neither, collided unavoidably, collided although avoidable."""
    found = judge(outcomes)
    width, height, left, gap = 760, 20, 170, 6
    parts, y = [], 40
    for name, at in zip(COLOURS, (170, 300, 430, 580), strict=True):
        parts.append(f'<rect x="{at}" y="12" width="12" height="12" fill="{COLOURS[name]}"/>')
        words = name if name in ("reached", "neither") else f"collided, {name}"
        parts.append(f'<text x="{at + 17}" y="22">{words}</text>')
    for controller in CONTROLLERS:
        for kind in (*KINDS, "all"):
            row = found.get((controller, kind))
            if not row:
                continue
            trials, x = row["trials"], float(left)
            reached = sum(one.reached for one in _of(outcomes, controller, kind))
            shares = {
                "reached": reached,
                "neither": trials - reached - row["collided"],
                "unavoidable": row["collided"] - row["avoidable"],
                "avoidable": row["avoidable"],
            }
            parts.append(f'<text x="{left - 8}" y="{y + 14}" text-anchor="end">{controller} {kind}</text>')
            for name, count in shares.items():
                wide = (width - left - 10) * count / trials
                if count:
                    parts.append(
                        f'<rect x="{x:.1f}" y="{y}" width="{wide:.1f}" height="{height - gap}" fill="{COLOURS[name]}"/>'
                        f'<text x="{x + wide / 2:.1f}" y="{y + 11}" text-anchor="middle" font-size="9">{count}</text>'
                    )
                x += wide
            y += height
        y += gap
    body = "\n".join(parts)
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{y + 10}" font-family="sans-serif" '
        f'font-size="12">\n<rect width="100%" height="100%" fill="white"/>\n{body}\n</svg>\n'
    )
