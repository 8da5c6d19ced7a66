"""How the screen of a log is laid out: the camera first, the vehicle with what it sees beside it, the curves below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from garbi_map.view import style
from garbi_map.view.style import TIMELINE

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint

BACKGROUND = (14, 20, 28)
TRAIL = 3.0
"""Seconds of profiles that the 3-D view shows: about one pass of the laser."""


def log_blueprint() -> Blueprint:
    """The layout of a log that is looked at as it is."""
    import rerun.blueprint as rrb

    trail = rrb.VisibleTimeRange(
        TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    camera = rrb.Spatial2DView(origin=style.IMAGE, name="Camera and stripe", background=BACKGROUND)
    scene = rrb.Spatial3DView(
        origin=style.WORLD,
        name=f"Profiles of the last {TRAIL:.0f} s, from the vehicle",
        background=BACKGROUND,
        line_grid=False,
        overrides={f"/{style.PROFILE.path}": rrb.VisibleTimeRanges([trail])},
        eye_controls=rrb.EyeControls3D(position=(-1.6, 2.2, 1.1), look_target=(0.9, 0, -0.5), eye_up=(0, 0, 1)),
    )
    words = rrb.Tabs(
        rrb.TextDocumentView(origin=style.ABOUT, name="What is this"),
        rrb.TextLogView(origin=style.LOSSES, name="Gaps and damage"),
        name="Words",
    )
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(camera, scene, name="Seen"),
            rrb.Horizontal(
                rrb.Vertical(
                    _plot(style.ENCODER, "Laser angle, degrees"),
                    _plot(style.STRIPE_ROWS, "Stripe: rows found, strength"),
                    name="Laser",
                ),
                rrb.Vertical(
                    _plot(style.ATTITUDE, "Attitude, degrees"),
                    _plot(style.VELOCITY, "Velocity, m/s"),
                    name="Motion",
                ),
                rrb.Vertical(_plot(style.DEPTH, "Depth, m"), words, name="Depth and words"),
                name="Curves",
            ),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _plot(path: str, name: str) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(origin=path, name=name, plot_legend=rrb.Corner2D.RightTop)
