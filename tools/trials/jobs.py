"""One trial as a job that another process can take."""

from __future__ import annotations

from typing import Any

from tools.trials.agreement import Agreed
from tools.trials.agreement import run as agreement
from tools.trials.avoidance import LONGEST, Outcome, fly
from tools.trials.moving import Found
from tools.trials.moving import run as moving
from tools.trials.stabilisation import Held
from tools.trials.stabilisation import run as hold
from tools.trials.survey import Surveyed
from tools.trials.survey import run as survey
from tools.trials.wandering import Wandered
from tools.trials.wandering import run as wandering


def avoid(job: tuple[int, Any, Any, Any]) -> Outcome:
    """(seed, controller, level, vehicle)"""
    seed, controller, level, vehicle = job
    return fly(seed, controller, level, LONGEST, vehicle).outcome


def stay(job: tuple[int, Any, Any]) -> Held:
    """(seed, object, way of the current)"""
    seed, thing, way = job
    return hold(thing, seed, way)


def cover(job: tuple[int, Any]) -> Surveyed:
    """(seed, how)"""
    return survey(*job)


def find(job: tuple[int]) -> Found:
    """(seed,)"""
    return moving(*job)


def roam(job: tuple[int]) -> Wandered:
    """(seed,)"""
    return wandering(*job)


def agree(job: tuple[int]) -> Agreed:
    """(seed,)"""
    return agreement(*job)
