"""One trial as a job that another process can take."""

from __future__ import annotations

from typing import Any

from tools.trials.avoidance import Outcome, run
from tools.trials.stabilisation import Held
from tools.trials.stabilisation import run as hold
from tools.trials.survey import Surveyed
from tools.trials.survey import run as survey


def avoid(job: tuple[int, Any, Any]) -> Outcome:
    """(seed, controller, level)"""
    return run(*job)


def stay(job: tuple[Any, int]) -> Held:
    """(object, seed)"""
    return hold(*job)


def cover(seed: int) -> Surveyed:
    """seed"""
    return survey(seed)
