"""How the screen is laid out: the scene first, the camera and the curves beside it, words below."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.view import style
from garbi_map.view.thin import thinned

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rerun.blueprint import Blueprint, EyeControls3D, View
    from rerun.encodings import EntityPathLike

SURFACE, TRUTH = "Surface", "Truth"
_FROM = np.array([-0.42, -0.58, 0.46])
"""Where the first look comes from: astern, from starboard, above."""
_FIELD = np.tan(np.deg2rad(55.0 / 2)) * np.array([1.5, 1.0])
"""Half of what the viewer's eye sees at 1 m, across and up, m; as wide as on a narrow screen."""
_FILLED = 0.9
"""Share of that which the scene fills at first."""
_VEHICLE = np.array([0.65, 0.45, 0.35])
"""m from the vehicle's centre to its outside."""
_LOOKED_AT = 4000
"""Points that the first look is made for."""
_OF_THE_MAP = ("Uncertainty", "Residual")
"""Colourings that are seen without the vehicle: it would hide what they are for."""
_LATELY = 4.0
"""s of profiles that are seen at once in a log."""


def map_blueprint(seabed: NDArray, route: NDArray, speed: float, truth: NDArray | None = None) -> Blueprint:
    """The layout of a map's recording.

    seabed (n, 3) and route (m, 3), m: what the first look must hold; speed: how many times faster than it was recorded
    it plays, at least 1; truth: the true surface (k, 3) m, None where there is none.
    """
    import rerun.blueprint as rrb

    eye = _first_look(seabed, _vehicle_on(route))
    near = _first_look(seabed)
    scenes = [_coloured(one, near if one.name in _OF_THE_MAP else eye) for one in style.COLOURINGS]
    hidden = [style.POINTS, style.PROFILE, style.SHEET, style.POSE_SIGMA, style.REJECTED, style.LOOPS]
    scenes.append(_scene(SURFACE, [f"- /{thing.path}" for thing in (*hidden, style.TRUTH_SURFACE)], eye, {}))
    if truth is not None:
        eye = _first_look(truth, _vehicle_on(route))
        scenes.append(_scene(TRUTH, [f"- /{thing.path}" for thing in (*hidden, style.MESH)], eye, {}))
    curves = rrb.Tabs(
        rrb.Vertical(_plot(style.DRIFT_POSITION), _plot(style.DRIFT_TILT), name="Drift"),
        rrb.Vertical(_plot(style.DRIFT_YAW), name="Heading"),
        rrb.Vertical(
            _plot(style.MISFIT),
            rrb.BarChartView(origin=style.ROUNDS, name="Distance of matches by round, mm", plot_legend=_no_legend()),
            name="Residual",
        ),
        rrb.Vertical(_plot(style.ENCODER), _plot(style.DEPTH), _plot(style.SPEED), name="Vehicle"),
    )
    return _screen(rrb.Tabs(*scenes), curves, speed)


def log_blueprint(depth: float) -> Blueprint:
    """The layout of a log as it was recorded; depth m at which the vehicle is first seen."""
    import rerun.blueprint as rrb

    target = np.array([0.3, 0.0, -depth - 0.7])
    eye = rrb.EyeControls3D(position=target + 3.4 * _FROM, look_target=target, eye_up=(0, 0, 1))
    lately = rrb.VisibleTimeRange(
        style.TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_LATELY),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    scene = _scene("Vehicle", [], eye, {f"/{style.PROFILE.path}": rrb.VisibleTimeRanges([lately])})
    curves = rrb.Tabs(
        rrb.Vertical(_plot(style.ENCODER), _plot(style.STRENGTH), _plot(style.BACKSCATTER), name="Scanner"),
        rrb.Vertical(_plot(style.ATTITUDE), _plot(style.DEPTH), _plot(style.VELOCITY), name="Vehicle"),
        rrb.StateTimelineView(origin=style.LANES, name="Gaps"),
    )
    return _screen(rrb.Tabs(scene), curves, 1.0)


def decision_blueprint() -> Blueprint:
    """The layout of what behaviours decided: seen from starboard, in the vehicle's frame."""
    import rerun.blueprint as rrb

    eye = rrb.EyeControls3D(position=(0.1, -3.9, 1.6), look_target=(0.8, 0.0, 0.0), eye_up=(0, 0, 1))
    scene = rrb.Spatial3DView(
        origin=style.VEHICLE,
        name="Surroundings, the vehicle stands still",
        contents=[f"+ /{style.WORLD}/**"],
        background=style.BACKGROUND,
        line_grid=False,
        eye_controls=eye,
    )
    words = rrb.Tabs(
        rrb.TextDocumentView(origin=style.WORDS, name="Why"),
        rrb.TextDocumentView(origin=style.ABOUT, name="What is this?"),
        rrb.TextLogView(origin=style.LOSSES, name="What safety changed"),
    )
    lanes = rrb.StateTimelineView(origin=style.LANES, name="Who acts, what safety does, what was expected")
    activation = rrb.TimeSeriesView(origin=style.ACTIVATION, name="Activation, 0 to 1")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, words, row_shares=[0.7, 0.3]),
            rrb.Vertical(lanes, _plot(style.SURGE), activation, row_shares=[0.44, 0.28, 0.28]),
            column_shares=[0.62, 0.38],
        ),
        *_panels(1.0),
    )


def change_blueprint(seabed: NDArray) -> Blueprint:
    """The layout of two maps that are compared; seabed (n, 3) m: what the first look must hold."""
    import rerun.blueprint as rrb

    eye = _first_look(seabed)
    scenes = [
        _scene("What changed", [f"- /{style.AFTER.path}"], eye, {}),
        _scene("Before", [f"- /{style.AFTER.path}", "- /map/changes/**"], eye, {}),
        _scene("After", [f"- /{style.BEFORE.path}", "- /map/changes/**"], eye, {}),
    ]
    words = rrb.TextDocumentView(origin=style.ABOUT, name="What is this?")
    screen = rrb.Vertical(rrb.Tabs(*scenes), words, row_shares=[0.82, 0.18])
    return rrb.Blueprint(screen, rrb.TimePanel(state="hidden"), *_panels(1.0)[1:])


def work_blueprint() -> Blueprint:
    """The layout of a map while it is built."""
    import rerun.blueprint as rrb

    scene = rrb.Spatial3DView(
        origin=style.WORLD, name="The map as it grows", background=style.BACKGROUND, line_grid=False
    )
    words = rrb.TextDocumentView(origin=style.ABOUT, name="What is this?")
    return rrb.Blueprint(rrb.Vertical(scene, words, row_shares=[0.88, 0.12]), *_panels(1.0))


def _screen(scene: Any, curves: Any, speed: float) -> Blueprint:
    import rerun.blueprint as rrb

    camera = rrb.Spatial2DView(origin=style.IMAGE, name="Camera, with the stripe as found", background=style.BACKGROUND)
    words = rrb.Tabs(
        rrb.TextDocumentView(origin=style.ABOUT, name="What is this?"),
        rrb.TextLogView(origin=style.LOSSES, name="Left out"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, words, row_shares=[0.74, 0.26]),
            rrb.Vertical(camera, curves, row_shares=[0.5, 0.5]),
            column_shares=[0.66, 0.34],
        ),
        *_panels(speed),
    )


def _panels(speed: float) -> list[Any]:
    import rerun.blueprint as rrb

    time = rrb.TimePanel(
        state="collapsed", timeline=style.TIMELINE, playback_speed=max(speed, 1.0), play_state="playing"
    )
    return [time, rrb.SelectionPanel(state="hidden"), rrb.BlueprintPanel(state="hidden")]


def _coloured(colouring: style.Colouring, eye: EyeControls3D) -> View:
    import rerun as rr
    from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

    source = VisualizerComponentMapping(
        "Points3D:colors", ComponentSourceKind.SourceComponent, source_component=colouring.component
    )
    shown = [rr.Points3D.from_fields().visualizer(mappings=[source]), _until_now()]
    hidden = [style.MESH, style.TRUTH_SURFACE]
    if colouring.name not in ("Uncertainty", "Sweep"):
        hidden.append(style.POSE_SIGMA)
    if colouring.name != "Residual":
        hidden.append(style.REJECTED)
    if colouring.name != "Sweep":
        hidden.append(style.LOOPS)
    without = [f"- /{thing.path}" for thing in hidden]
    if colouring.name in _OF_THE_MAP:
        without.append(f"- /{style.VEHICLE}/**")
    return _scene(colouring.name, without, eye, {f"/{style.POINTS.path}": shown})


def _scene(name: str, without: list[str], eye: EyeControls3D, overrides: Mapping[EntityPathLike, Any]) -> View:
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin=style.WORLD,
        name=name,
        contents=[f"+ /{style.WORLD}/**", f"- /{style.STRIPE.path}", *without],
        background=style.BACKGROUND,
        line_grid=False,
        overrides=overrides,
        eye_controls=eye,
    )


def _first_look(*shown: NDArray) -> EyeControls3D:
    """An eye that sees all of some points (n, 3) m, and little else."""
    import rerun.blueprint as rrb

    points = np.concatenate([part[thinned(len(part), _LOOKED_AT)] for part in shown])
    back = _FROM / np.linalg.norm(_FROM)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])
    target, distance = points.mean(axis=0), 1.0
    for _ in range(10):  # what is near looks larger, so that the middle of the picture depends on the distance
        across, towards = np.hsplit((points - target) @ axes.T, [2])
        distance = float((np.abs(across) / (_FILLED * _FIELD) + towards).max())
        seen = across / (distance - towards)
        target = target + distance * (seen.max(axis=0) + seen.min(axis=0)) / 2 @ axes[:2]
    return rrb.EyeControls3D(position=target + distance * back, look_target=target, eye_up=(0, 0, 1))


def _vehicle_on(route: NDArray) -> NDArray:
    """The corners of boxes about the vehicle on its route (m, 3), (8 m, 3) m."""
    corners = _VEHICLE * (np.array(list(np.ndindex(2, 2, 2))) * 2 - 1)
    return (route[thinned(len(route), _LOOKED_AT // 8), None] + corners).reshape(-1, 3)


def _plot(plot: style.Plot) -> View:
    import rerun.blueprint as rrb

    legend = rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=len(plot.curves) > 1)
    return rrb.TimeSeriesView(origin=plot.path, name=plot.title, plot_legend=legend)


def _no_legend() -> Any:
    import rerun.blueprint as rrb

    return rrb.PlotLegend(visible=False)


def _until_now() -> Any:
    """Everything up to the cursor is shown, not only the last."""
    import rerun.blueprint as rrb

    span = rrb.VisibleTimeRange(
        style.TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    return rrb.VisibleTimeRanges([span])
