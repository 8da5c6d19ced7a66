"""A long dive is judged stretch by stretch, so that memory does not grow with its length."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed.builder import Posed, SeabedBuilder
from garbi_map.seabed.types import JudgedPoints
from garbi_map.sweep.types import Sweep

SHARED = 8
"""Sweeps beyond either end of a stretch that have a say in it: what moves is mostly seen through within seconds."""


def judge_in_stretches(
    posed: Callable[[int, int], Iterable[Posed]], sweeps: int, make: Callable[[], SeabedBuilder], shared: int = SHARED
) -> Iterator[tuple[Sweep, Trajectory, JudgedPoints]]:
    """Every sweep with its poses and the points that are seabed by all that its stretch of the dive has seen.

    posed(begin, end): sweeps by number, readable again and again, with the poses that SeabedBuilder wants; make: a new
    judge. A stretch ends when its judge is full: most dives are one stretch.
    """
    begin = done = 0
    while done < sweeps:
        judge, end = make(), begin
        for sweep, poses in posed(begin, sweeps):
            judge.observe(sweep, poses)
            end += 1
            if judge.is_full and end > done + 2 * shared:
                break
        for sweep, poses in posed(begin, end):
            judge.see_through(sweep, poses)
        last = sweeps if end == sweeps else end - shared
        for sweep, poses in posed(done, last):
            yield sweep, poses, judge.judge(sweep, poses)
        begin, done = max(last - shared, 0), last
