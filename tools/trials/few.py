"""Trials that are told one by one: station keeping, surveys, wandering, moving things, both levels."""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from tools.trials.jobs import agree, cover, find, roam, stay

FEW: dict[str, tuple[Callable[[Any], Any], list[tuple[str, ...]]]] = {
    "hold": (stay, [(thing, way) for way in ("along", "across") for thing in ("wall", "pipe", "rock")]),
    "survey": (cover, [("adaptive",), ("fixed",), ("oblique",)]),
    "wander": (roam, [()]),
    "moving": (find, [()]),
    "agreement": (agree, [()]),
}


def few(what: str, seeds: range, workers: int, output: Path | None) -> int:
    """Every way of that kind of trial with every seed, one line each; to `output` as JSON."""
    job, ways = FEW[what]
    found = []
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        for outcome in pool.map(job, [(seed, *way) for way in ways for seed in seeds]):
            found.append({key: _rounded(value) for key, value in outcome.as_dict().items()})
            print("  ".join(f"{key} {value}" for key, value in found[-1].items()), flush=True)
    if output:
        output.write_text(json.dumps(found, indent=1) + "\n")
    return 0


def _rounded(value: object) -> object:
    if isinstance(value, list):
        return [_rounded(one) for one in value]
    return float(f"{value:.3g}") if isinstance(value, float) else value
