"""report.html: one file without anything from outside, made to be read and printed."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from importlib.resources import files
from pathlib import Path
from shlex import quote
from string import Template
from typing import Any

import numpy as np
import yaml

from garbi_map.aside import write_text
from garbi_map.export import figures, maps
from garbi_map.export.axes import WIDTH
from garbi_map.export.drift import Correction, correction, draw_correction, draw_steps
from garbi_map.export.hillshade import fitted, hillshade, north_name, png
from garbi_map.export.report import Quantity, Report, checked
from garbi_map.export.settings import ExportSettings
from garbi_map.export.survey import place_line, place_list, survey_table
from garbi_map.export.verdict import numbers
from garbi_map.export.weak import holes_inside, outline, sweeps_about
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.register import ENTROPY_RADIUS, Agreement, Registered
from garbi_map.seabed import Seabed, fill_holes
from garbi_map.words import angle, length, many

_MOST_LINES = 200
_HILLSHADE_PIXELS = 1200
_DEPTH_PIXELS = 1000


def write_report_html(
    path: Path,
    report: Report | dict[str, Any],
    seabed: Seabed,
    registered: Registered,
    navigation: Trajectory,
    settings: ExportSettings | None = None,
    home: Path | None = None,
) -> None:
    """Write report.html, complete or not at all; every string of the report is escaped.

    navigation: the navigation filter's trajectory, against which the drift is told; home: the folder in which the page
    will lie with the other files, if it is not the one of `path`.
    The verdict comes first, then the map, where it is weak, the drift found, how well sweeps agree, and the rest.

    Raises GarbiError where the report does not fit its model or the file cannot be written.
    """
    own = checked(report)
    settings = settings or ExportSettings()
    begin = datetime.fromtimestamp(own.source.begin_ns / 1e9, UTC)
    found = correction(navigation, registered.trajectory)
    page = Template((files("garbi_map.export") / "report_template.html").read_text(encoding="utf-8"))
    text = page.substitute(
        title=escape(own.title),
        subtitle=escape(
            f"{begin:%Y-%m-%d %H:%M:%S} UTC, {own.source.duration_s:.1f} s, {many(own.source.images, 'image')}"
        ),
        paths="".join(f"<code>{escape(name)}</code> " for name in own.source.paths),
        verdict=escape(own.verdict),
        tiles=_tiles(numbers(seabed, registered.agreement, found)),
        folder=escape(quote(str(home or path.parent))),
        viewer=escape(own.versions.get("rerun-sdk", "")),
        left_out=_left_out(own.left_out),
        hillshade=_hillshade(seabed, settings, own),
        weak=_weak(own.weak),
        **_maps(seabed, settings),
        survey=survey_table(own.bathymetry),
        place=place_list(own.place),
        where=place_line(own.place, own.bathymetry),
        **_drift(found, registered, own),
        **_agreement(registered.agreement, seabed),
        depth=_depth(seabed, registered.trajectory, own.source.begin_ns, settings.widest_hole),
        uncertainty=figures.histogram(
            "Uncertainty",
            1e3 * seabed.uncertainty[seabed.known],
            "1 sigma of a cell, mm",
            WIDTH if maps.wide(seabed) else WIDTH // 2,
        ),
        timeline=figures.timeline("Timeline", [(s.lane, s.begin_s, s.end_s, s.state) for s in own.timeline]),
        counts=_table(own.counts),
        rejected=_table(own.rejected),
        entropy_radius=length(ENTROPY_RADIUS),
        residuals=_quantities(own.residuals),
        uncertainties=_quantities(own.uncertainties),
        timings=_timings(own.timings_s),
        topics="".join(
            f"<tr><td><code>{escape(t.name)}</code></td><td>{escape(t.type)}</td><td class=r>{t.count:,}</td></tr>"
            for t in own.source.topics
        ),
        outputs="".join(
            f"<tr><td><code>{escape(name)}</code></td><td>{escape(what)}</td></tr>"
            for name, what in own.outputs.items()
        ),
        versions=_table(own.versions),
        configuration=escape(yaml.safe_dump(own.model_dump(mode="json")["configuration"], sort_keys=False)),
        created=escape(own.created),
    )
    write_text(path, text)


def _tiles(shown: Sequence[tuple[str, str]]) -> str:
    return "".join(f"<div class=tile><b>{escape(value)}</b><span>{escape(what)}</span></div>" for value, what in shown)


def _items(lines: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(line)}</li>" for line in lines[:_MOST_LINES])
    more = f"<p>and {len(lines) - _MOST_LINES:,} more, see report.json</p>" if len(lines) > _MOST_LINES else ""
    return f"<ul>{items}</ul>{more}"


def _left_out(lines: list[str]) -> str:
    if not lines:
        return "<p class=fine>Nothing that was in the log was left out.</p>"
    return f"<div class=lost><h2>Left out or missing</h2>{_items(lines)}</div>"


def _weak(lines: list[str]) -> str:
    return _items(lines) if lines else "<p>Nowhere: it is evenly sure, seen more than once and without holes.</p>"


def _hillshade(seabed: Seabed, settings: ExportSettings, report: Report) -> str:
    fewer = settings.model_copy(update={"hillshade_pixels": min(settings.hillshade_pixels, _HILLSHADE_PIXELS)})
    placed = report.place is not None and report.place.origin is not None
    data = b64encode(png(hillshade(seabed, fewer, report.title, north_name(placed)))).decode()
    return f'<img alt="Relief, shaded, coloured by depth" src="data:image/png;base64,{data}">'


def _maps(seabed: Seabed, settings: ExportSettings) -> dict[str, str]:
    """Uncertainty, sweeps and points of each cell."""
    known, gap = seabed.known, settings.widest_hole
    inside = outline(seabed)
    holes = holes_inside(seabed, inside, gap)
    doubt = np.where(known, 1e3 * seabed.uncertainty, np.nan)
    sweeps = np.where(known, sweeps_about(seabed), np.float32(np.nan))
    density = np.where(inside & ~holes, seabed.density, np.float32(np.nan))
    least, most = np.percentile(doubt[known], [2, 98])
    points = maps.amount_scale(float(np.percentile(density[known], 98)))
    return {
        "doubt_map": maps.band_map(
            "Uncertainty", doubt, gap, seabed, maps.doubt_scale(least, most, True), "mm, 1 sigma"
        ),
        "sweeps_map": maps.sweeps_map("Sweeps that saw each cell", sweeps, gap, holes, seabed),
        "points_map": maps.band_map("Points per cell", density, 0.0, seabed, points, "points"),
        "columns": "one" if maps.wide(seabed) else "two",
    }


def _drift(found: Correction, registered: Registered, report: Report) -> dict[str, str]:
    """The correction over time, the pose graph's steps, and both in words."""
    sweeps = [(span.begin_s, span.end_s) for span in report.timeline if span.lane == "sweeps"]
    position, turn = (np.median(sigma, axis=0).max() for sigma in (found.position_sigma, found.attitude_sigma))
    largest = float(registered.graph_step.max(initial=0.0))
    loops = f"{many(registered.loops, 'loop was', 'loops were')} closed" if registered.loops else "no loop was closed"
    return {
        "drift": draw_correction(found, report.source.begin_ns),
        "heading": escape(angle(abs(np.rad2deg(found.heading)))),
        "heading_sigma": escape(angle(np.rad2deg(float(np.median(found.attitude_sigma[:, 2]))))),
        "drift_sigma": escape(f"{length(position)} and {angle(np.rad2deg(turn))}"),
        "steps": draw_steps(sweeps, registered.graph_step),
        "loops": escape(f"{loops.capitalize()}; the pose graph moved no sweep by more than {length(largest)}."),
    }


def _agreement(agreement: Agreement, seabed: Seabed) -> dict[str, str]:
    """The distance between overlapping sweeps before and after: maps on one scale, histograms, numbers."""
    before, after = 1e3 * agreement.before, 1e3 * agreement.after
    if not len(after):
        return {
            "agreement": "<p>No two sweeps overlap, so that there is nothing to compare.</p>",
            "histograms": "",
        }
    scale = maps.doubt_scale(float(np.percentile(after, 25)), float(np.percentile(before, 95)), logarithmic=True)
    rows = "".join(
        f"<tr><td>{name}</td><td class=r>{length(median)}</td><td class=r>{entropy:.2f}</td></tr>"
        for name, median, entropy in zip(
            ("Navigation filter alone", "This map"), agreement.median, agreement.entropy, strict=True
        )
    )
    drawn = (
        maps.scattered_map(f"Distance between sweeps, {name}", agreement.place, distance, seabed, scale, "mm")
        for name, distance in (("navigation filter alone", before), ("this map", after))
    )
    names = ("Navigation filter alone", "This map, same colours")
    figure = "".join(f"<figure><h3>{name}</h3>{svg}</figure>" for name, svg in zip(names, drawn, strict=True))
    return {
        "agreement": (
            f"<table class=narrow><tr><th></th><th class=r>sweep to sweep, median</th><th class=r>mean map entropy, nat"
            f"</th></tr>{rows}</table><div class={'one' if maps.wide(seabed) else 'two'}>{figure}</div>"
        ),
        "histograms": figures.histograms(
            "Distance between sweeps",
            [("navigation alone", before, "s"), ("this map", after, "a")],
            "distance between overlapping sweeps, mm",
        ),
    }


def _depth(seabed: Seabed, trajectory: Trajectory, begin_ns: int, widest_hole: float) -> str:
    """Depth of the vehicle, with 1 sigma, and of the seabed straight below it, over time."""
    seconds = (trajectory.stamp_ns - begin_ns).astype(np.float64) * 1e-9
    elevation, pixel = fitted(seabed.elevation, seabed.cell, _DEPTH_PIXELS)
    elevation, _ = fill_holes(elevation, round(widest_hole / pixel))
    index = np.floor((trajectory.position[:, :2] - seabed.origin) / pixel).astype(int)[:, ::-1]
    inside = ((index >= 0) & (index < elevation.shape)).all(1)
    below = np.full(len(seconds), np.nan)
    below[inside] = -elevation[tuple(index[inside].T)]
    sigma = np.sqrt(np.maximum(trajectory.covariance[:, 2, 2], 0.0))
    lines = [figures.Line("vehicle, 1 sigma", seconds, -trajectory.position[:, 2], "a", sigma)]
    if np.isfinite(below).any():
        lines.append(figures.Line("seabed below", seconds, below, "s"))
    return figures.chart("Depth along the path", lines, "s since the begin of the log", "depth, m", flip=True)


def _table(entries: dict[str, int] | dict[str, str]) -> str:
    return "".join(
        f"<tr><td>{escape(name)}</td><td class=r>{f'{value:,}' if isinstance(value, int) else escape(value)}</td></tr>"
        for name, value in entries.items()
    )


def _quantities(quantities: list[Quantity]) -> str:
    return "".join(
        f"<tr><td>{escape(q.name)}</td><td class=r>{_number(q.value)}</td>"
        f"<td class=unit>{escape(q.unit)}</td><td class=note>{escape(q.note)}</td></tr>"
        for q in quantities
    )


def _number(value: float | None) -> str:
    if value is None or not np.isfinite(value):
        return "–"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def _timings(seconds: dict[str, float]) -> str:
    longest = max(seconds.values(), default=0.0) or 1.0
    return "".join(
        f"<tr><td>{escape(name)}</td><td class=r>{value:.2f} s</td>"
        f'<td class=wide><i style="width:{100 * value / longest:.0f}%"></i></td></tr>'
        for name, value in seconds.items()
    )
