"""report.html: one file without anything from outside, made to be read and printed."""

from __future__ import annotations

from base64 import b64encode
from datetime import UTC, datetime
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from garbi_map.aside import write_text
from garbi_map.export import figures
from garbi_map.export.hillshade import fitted, hillshade, png
from garbi_map.export.report import Quantity, Report, checked
from garbi_map.export.settings import ExportSettings
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed.types import Seabed

_MOST_LINES = 200


def write_report_html(
    path: Path,
    report: Report | dict[str, Any],
    seabed: Seabed,
    trajectory: Trajectory,
    settings: ExportSettings | None = None,
) -> None:
    """Write report.html, complete or not at all; every string of the report is escaped.

    Figures: the map, coverage and uncertainty as maps, the uncertainty's histogram, depth along the path, timeline.

    Raises GarbiError where the report does not fit its model or the file cannot be written.
    """
    own = checked(report)
    settings = settings or ExportSettings()
    begin = datetime.fromtimestamp(own.source.begin_ns / 1e9, UTC)
    page = Template((files("garbi_map.export") / "report_template.html").read_text(encoding="utf-8"))
    text = page.substitute(
        title=escape(own.title),
        subtitle=escape(f"{begin:%Y-%m-%d %H:%M:%S} UTC, {own.source.duration_s:.1f} s"),
        paths="".join(f"<code>{escape(name)}</code> " for name in own.source.paths),
        tiles=_tiles(own, seabed),
        left_out=_left_out(own.left_out),
        hillshade=_image(hillshade(seabed, settings, own.title), "Relief, shaded, coloured by depth"),
        coverage=_image(_tinted(seabed.density, seabed, settings), "Points per cell"),
        most_points=f"{_strong(seabed.density, seabed):.0f}",
        doubt=_image(_tinted(1e3 * seabed.uncertainty, seabed, settings), "Uncertainty per cell"),
        most_doubt=f"{_strong(1e3 * seabed.uncertainty, seabed):.2g}",
        depth=_depth(seabed, trajectory),
        uncertainty=figures.histogram("Uncertainty", 1e3 * seabed.uncertainty[seabed.known], "1 sigma of a cell, mm"),
        timeline=figures.timeline("Timeline", [(s.lane, s.begin_s, s.end_s, s.state) for s in own.timeline]),
        counts=_table(own.counts),
        rejected=_table(own.rejected),
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


def _tiles(report: Report, seabed: Seabed) -> str:
    median = 1e3 * float(np.median(seabed.uncertainty[seabed.known]))
    shown = (
        (f"{seabed.area:.3g} m²", f"mapped, in cells of {1e3 * seabed.cell:g} mm"),
        (f"{int(seabed.density.sum()):,}", "points of the seabed"),
        (f"{median:.2g} mm", "median uncertainty of a cell, 1 sigma"),
        (f"{report.source.images:,}", f"images in {report.source.duration_s:.0f} s"),
    )
    return "".join(f"<div class=tile><b>{escape(value)}</b><span>{escape(what)}</span></div>" for value, what in shown)


def _left_out(lines: list[str]) -> str:
    if not lines:
        return "<p class=fine>Nothing that was in the log was left out.</p>"
    items = "".join(f"<li>{escape(line)}</li>" for line in lines[:_MOST_LINES])
    more = f"<p>and {len(lines) - _MOST_LINES} more, see report.json</p>" if len(lines) > _MOST_LINES else ""
    return f"<div class=lost><h2>Left out</h2><ul>{items}</ul>{more}</div>"


def _image(picture: NDArray[np.uint8], caption: str) -> str:
    data = b64encode(png(picture)).decode()
    return f'<img alt="{escape(caption)}" src="data:image/png;base64,{data}">'


def _strong(band: NDArray, seabed: Seabed) -> float:
    """The value that is drawn at full strength: the 95th percentile."""
    return float(np.percentile(band[seabed.known], 95))


def _tinted(band: NDArray, seabed: Seabed, settings: ExportSettings) -> NDArray[np.uint8]:
    """A band as a picture, blue, green, red, north up: the darker the more."""
    values, _ = fitted(
        np.where(seabed.known, band, np.nan).astype(np.float32), seabed.cell, settings.hillshade_pixels // 2
    )
    share = np.clip(np.nan_to_num(values) / max(_strong(band, seabed), 1e-9), 0.0, 1.0)[..., None]
    ink, paper, void = np.array([[100.0, 60.0, 15.0], [236.0, 240.0, 226.0], [228.0, 226.0, 224.0]])
    picture = np.where(np.isfinite(values)[..., None], paper + share * (ink - paper), void)
    return np.ascontiguousarray(picture[::-1].astype(np.uint8))


def _depth(seabed: Seabed, trajectory: Trajectory) -> str:
    """Depth of the vehicle, with 1 sigma, and of the seabed straight below it, over time."""
    seconds = (trajectory.stamp_ns - trajectory.stamp_ns[0]) * 1e-9
    index = np.floor((trajectory.position[:, :2] - seabed.origin) / seabed.cell).astype(int)[:, ::-1]
    inside = ((index >= 0) & (index < seabed.elevation.shape)).all(1)
    below = np.full(len(seconds), np.nan)
    below[inside] = -seabed.elevation[tuple(index[inside].T)]
    sigma = np.sqrt(np.maximum(trajectory.covariance[:, 2, 2], 0.0))
    lines = [figures.Line("vehicle, 1 sigma", seconds, -trajectory.position[:, 2], "a", sigma)]
    if np.isfinite(below).any():
        lines.append(figures.Line("seabed below", seconds, below, "s"))
    return figures.chart("Depth along the path", lines, "s", "depth, m", flip=True)


def _table(entries: dict[str, int] | dict[str, str]) -> str:
    return "".join(
        f"<tr><td>{escape(name)}</td><td class=r>{f'{value:,}' if isinstance(value, int) else escape(value)}</td></tr>"
        for name, value in entries.items()
    )


def _quantities(quantities: list[Quantity]) -> str:
    return "".join(
        f"<tr><td>{escape(q.name)}</td><td class=r>{'–' if q.value is None else f'{q.value:.4g}'}</td>"
        f"<td>{escape(q.unit)}</td><td class=note>{escape(q.note)}</td></tr>"
        for q in quantities
    )


def _timings(seconds: dict[str, float]) -> str:
    longest = max(seconds.values(), default=0.0) or 1.0
    return "".join(
        f"<tr><td>{escape(name)}</td><td class=r>{value:.2f} s</td>"
        f'<td class=wide><i style="width:{100 * value / longest:.0f}%"></i></td></tr>'
        for name, value in seconds.items()
    )
