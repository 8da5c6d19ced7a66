"""What a newcomer reads beside the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from garbi_map.view import style

if TYPE_CHECKING:
    from garbi_map.pipeline import Dive, Map


def about_map(dive: Dive, built: Map) -> str:
    """Markdown: what the screen shows and what the map is worth."""
    before, after = built.registered.disagreement
    seabed = built.seabed
    shown = (style.ROUTE, style.ROUTE_NAVIGATION, style.POSE_SIGMA, style.PROFILE, style.STRIPE)
    legend = "\n".join(f"- **{thing.name}**: {thing.meaning}" for thing in shown)
    tabs = "\n".join(f"- **{thing.name}**: {thing.meaning}" for thing in style.COLOURINGS)
    seconds = (dive.log.end_ns - dive.log.begin_ns) * 1e-9
    return f"""# {dive.paths[0].stem}

An underwater vehicle turns a laser sheet over the seabed and sees with a camera where it falls. Press play: the map grows
as the vehicle moves. **{seabed.area:.1f} m²** in {seconds:.0f} s, {built.registered.loops} loop closures;
overlapping sweeps lie **{1e3 * after:.2f} mm** apart, {1e3 * before:.1f} mm with navigation alone.

{legend}

The tabs over the map colour it:

{tabs}
- **Surface**: {style.MESH.meaning}

*Drift found* is this trajectory minus that of navigation alone. *Residual* is how far each sweep lies from the finished map.
"""
