"""How the screen is laid out: the map first, the camera and the curves beside it, words last."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from garbi_map.view import style
from garbi_map.view.style import TIMELINE, Thing

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint, Spatial3DView

BACKGROUND = (14, 20, 28)
_EVERYWHERE = [f"+ /{style.WORLD}/**", f"- /{style.IMAGE}/**"]


def map_blueprint(centre: np.ndarray, extent: float) -> Blueprint:
    """The layout of a map's recording; centre (3,) m and extent m of the seabed, for the first look at it."""
    import rerun.blueprint as rrb

    def seen(name: str, shown: Thing) -> Spatial3DView:
        others = [thing for thing in (*style.COLOURINGS, style.MESH) if thing is not shown]
        return rrb.Spatial3DView(
            origin=style.WORLD,
            name=name,
            contents=[*_EVERYWHERE, *(f"- /{thing.path}/**" for thing in others)],
            background=BACKGROUND,
            line_grid=False,
            overrides=_growing([shown.path] if shown is not style.MESH else []),
            eye_controls=rrb.EyeControls3D(
                position=centre + extent * np.array([-0.45, -0.75, 0.75]), look_target=centre, eye_up=(0, 0, 1)
            ),
        )

    camera = rrb.Spatial2DView(origin=style.IMAGE, name="Camera and stripe", background=BACKGROUND)
    curves = rrb.Tabs(
        rrb.Vertical(
            _plot(style.DRIFT_POSITION, "Drift found, mm"),
            _plot(style.DRIFT_ATTITUDE, "Drift found, degrees"),
            name="Drift",
        ),
        rrb.Vertical(
            _plot(style.MISFIT, "Sweep to map, mm"),
            rrb.BarChartView(origin=style.ROUNDS, name="Rounds"),
            name="Residual",
        ),
        rrb.Vertical(
            _plot(style.ENCODER, "Laser angle, degrees"),
            _plot(style.DEPTH, "Depth, m"),
            _plot(style.SPEED, "Speed, m/s"),
            name="Vehicle",
        ),
        name="Curves",
    )
    words = rrb.Tabs(
        rrb.TextDocumentView(origin=style.ABOUT, name="What is this"),
        rrb.TextLogView(origin=style.LOSSES, name="Left out"),
        name="Words",
    )
    scenes = rrb.Tabs(*(seen(thing.name, thing) for thing in style.COLOURINGS), seen("Surface", style.MESH), name="Map")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scenes, words, row_shares=[3, 1]), rrb.Vertical(camera, curves, row_shares=[1, 1]),
            column_shares=[2, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
    )  # fmt: skip


def _plot(path: str, name: str) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(origin=path, name=name, plot_legend=rrb.Corner2D.RightTop)


def _growing(paths: list[str]) -> dict[str, Any]:
    """Entities of which everything up to the cursor is shown, not only the last."""
    import rerun.blueprint as rrb

    until_now = rrb.VisibleTimeRange(
        TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    return {f"/{path}": rrb.VisibleTimeRanges([until_now]) for path in paths}
