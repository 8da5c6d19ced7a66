"""What a newcomer reads beside the picture."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from garbi_map.view import style
from garbi_map.view.cloud import FinishedMap
from garbi_map.words import many

if TYPE_CHECKING:
    from garbi_map.dive import Dive, Map
    from garbi_map.log import Log
    from garbi_map.view.truth import Truth


def about_map(dive: Dive, built: Map, truth: Truth | None, larger: float) -> str:
    """Markdown: what the map is worth, and what the screen shows. truth: what is drawn of it; larger: how many times the
    ellipsoids of the path are enlarged."""
    before, after = (1e3 * distance for distance in built.registered.agreement.median)
    seconds = (dive.log.end_ns - dive.log.begin_ns) * 1e-9
    overlap = "No two sweeps of the laser overlap, so that nothing checks the path."
    if np.isfinite([before, after]).all():
        overlap = (
            f"Where sweeps of the laser overlap they lie **{after:.2f} mm** apart; "
            f"with the navigation sensors alone it would be {before:.1f} mm."
        )
    colours = "; ".join(f"*{one.name}*: {one.meaning}" for one in style.COLOURINGS)
    things = [style.ROUTE, style.ROUTE_NAVIGATION, style.PROFILE, style.SHEET, style.STRIPE]
    if truth is not None:
        things.append(style.TRUTH_ROUTE)
    finished = FinishedMap.of(built.seabed, (0, 1))
    sigma, off = 1e3 * finished.weakest, 1e3 * finished.off
    more = f"Yellow is 1 sigma of {sigma:.1f} mm and more, red and blue are {off:.1f} mm off. "
    more += f"*Sweep* also has {style.LOOPS.name}: {style.LOOPS.meaning}; and "
    more += f"{style.POSE_SIGMA.name}: {style.POSE_SIGMA.meaning}, {larger:g} x larger. "
    more += f"*Residual* has {style.REJECTED.name}: {style.REJECTED.meaning}"
    true_surface = ""
    if truth is not None and truth.surface is not None:
        true_surface = f"; *Truth*: {style.TRUTH_SURFACE.meaning}, in the same colours"
    return f"""\
**{built.seabed.area:.1f} m² of seabed in {seconds:.0f} s**, {many(built.registered.loops, "loop closure")}. {overlap}

An underwater vehicle swings a sheet of laser light over the seabed, and its camera sees where the light falls.
Press play, or drag the time below: the map grows as the vehicle scans. {legend(things)}

The tabs over the map: {colours}; *Surface*: {style.MESH.meaning}{true_surface}. {more}.

The tabs of curves: *Drift* and *Heading* are this path minus that of navigation alone; *Residual* is how far
each sweep lies from the finished map, and below how near matching surfaces came to each other in each round of the estimate.
"""


def about_log(log: Log) -> str:
    """Markdown: what the screen shows of a log."""
    seconds = (log.end_ns - log.begin_ns) * 1e-9
    things = (style.PROFILE, style.SHEET, style.STRIPE, style.CANDIDATES, style.STRIPE_SIGMA)
    topics = "\n".join(f"| {name} | {topic.count} |" for name, topic in sorted(log.topics.items()))
    return f"""\
**{seconds:.0f} s of recording, as it was recorded:** nothing is corrected, and the vehicle only turns and dives.
{legend(things)} The tab *Gaps* shows where sensors are silent. `garbi map` makes the seabed map of it.

| topic | messages |
| --- | --- |
{topics}
"""


def legend(things: Iterable[style.Thing]) -> str:
    """What is what, in one sentence."""
    return "; ".join(f"**{thing.name}**: {thing.meaning}" for thing in things) + "."
