"""How the screen of a log is laid out: the camera first, the vehicle with what it sees beside it, the curves below."""

from __future__ import annotations

from typing import TYPE_CHECKING

from garbi_map.view import style

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint, View

TRAIL = 3.0
"""Seconds of profiles that the 3-D view shows: about one pass of the laser."""


def log_blueprint() -> Blueprint:
    """The layout of a log that is looked at as it is."""
    import rerun.blueprint as rrb

    trail = rrb.VisibleTimeRange(
        style.TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    camera = rrb.Spatial2DView(origin=style.IMAGE, name="Camera, with the stripe as found", background=style.BACKGROUND)
    scene = rrb.Spatial3DView(
        origin=style.WORLD,
        contents=[f"+ /{style.WORLD}/**", f"- /{style.STRIPE.path}"],
        name=f"Profiles of the last {TRAIL:.0f} s, from the vehicle",
        background=style.BACKGROUND,
        line_grid=False,
        overrides={f"/{style.PROFILE.path}": rrb.VisibleTimeRanges([trail])},
        eye_controls=rrb.EyeControls3D(position=(-1.55, 1.9, 0.75), look_target=(0.25, 0.0, -0.45), eye_up=(0, 0, 1)),
    )
    words = rrb.Tabs(
        rrb.TextDocumentView(origin=style.ABOUT, name="What is this?"),
        rrb.TextLogView(origin=style.LOSSES, name="Gaps and damage"),
    )
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(camera, scene),
            rrb.Horizontal(
                rrb.Vertical(_plot(style.ENCODER), _plot(style.STRENGTH)),
                rrb.Vertical(_plot(style.ATTITUDE), _plot(style.VELOCITY)),
                rrb.Vertical(_plot(style.DEPTH), words),
            ),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=style.TIMELINE, play_state="following"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )


def _plot(plot: style.Plot) -> View:
    import rerun.blueprint as rrb

    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=len(plot.curves) > 1)
    return rrb.TimeSeriesView(origin=plot.path, name=plot.title, plot_legend=legend)
