"""A dive that is too long for one judge is judged in stretches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from seabed_scene import plane, scan, snowed

from garbi_map.seabed import OutlierSettings, SeabedBuilder, SeabedSettings, judge_in_stretches
from garbi_map.seabed.builder import Posed

SWEEPS = 40
SHARED = 3


def verdicts(posed: list[Posed], most: int) -> tuple[list[np.ndarray], int]:
    """Of every sweep, and how many judges there were when none may hold more than so many voxels."""
    judges = []
    settings = SeabedSettings(outliers=OutlierSettings(max_voxels=most))

    def make() -> SeabedBuilder:
        judges.append(SeabedBuilder(settings))
        return judges[-1]

    def these(begin: int, end: int) -> Iterator[Posed]:
        return iter(posed[begin:end])

    found = list(judge_in_stretches(these, len(posed), make, SHARED))
    assert [sweep.index for sweep, _, _ in found] == list(range(len(posed)))
    return [points.verdict for _, _, points in found], len(judges)


def test_stretches_judge_as_the_whole_dive_does() -> None:
    """Forty sweeps along eight metres, with snow: a dozen judges, every sweep once and in order, the same verdicts."""
    posed = []
    for k in range(SWEEPS):
        sweep, poses = scan(plane, k, begin=0.2 * k)
        posed.append((snowed(sweep, 50, k)[0], poses))
    whole, one = verdicts(posed, 10**9)
    parts, several = verdicts(posed, 10_000)
    assert one == 1 and several > 4
    same = np.concatenate([a == b for a, b in zip(whole, parts, strict=True)])
    assert same.mean() > 0.9995


def test_a_place_that_alone_is_too_much_is_judged_all_the_same() -> None:
    """Sweeps of which one fills a judge: each stretch goes on a little, and it comes to an end."""
    posed = [scan(plane, k, length=1.5, width=1.5, begin=1.4 * k, profiles=40) for k in range(9)]
    found, judges = verdicts(posed, 10_000)
    assert len(found) == 9 and 1 < judges < 9
