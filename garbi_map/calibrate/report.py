"""report.html of a calibration: residual vectors, coverage, uncertainty, advice; one file, nothing from outside."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from garbi_map.calibrate.advice import CELLS, coverage
from garbi_map.calibrate.bundle import Adjusted
from garbi_map.calibrate.camera import CameraCalibration
from garbi_map.calibrate.files import write_aside
from garbi_map.calibrate.laser import LaserCalibration
from garbi_map.calibrate.scanner import unit_of
from garbi_map.calibrate.sheet_test import SheetAt, sheet_lines
from garbi_map.log.records import Floats

MAGNIFIED = 40.0  # residual vectors, times
MOST = 4000  # of them

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;max-width:900px;margin:2em auto;padding:0 1em;color:#222}
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse}
td,th{padding:.2em .8em .2em 0;text-align:left;border-bottom:1px solid #ddd}td.r{text-align:right}
svg{width:100%;background:#f7f7f5;border:1px solid #ddd}.advice{background:#fff6d8;padding:.6em 1em}
.a{stroke:#1463a5;fill:none}.b{stroke:#c2410c;fill:none}.g{stroke:#ccc;fill:none}text{font-size:12px;fill:#555}
"""


def write_camera_report(folder: Path, found: CameraCalibration, losses: Sequence[str], advice: Sequence[str]) -> None:
    """Write report.html into a folder, complete or not at all. Raises GarbiError."""
    size = found.camera.width, found.camera.height
    pixel = np.concatenate([view.pixel for view in found.views])
    parts = [
        f"<p>{len(found.views)} views, {len(pixel)} corners: <b>{found.in_sample:.3f} px</b> rms per corner, "
        f"<b>{found.hold_out:.3f} px</b> on corners that were not fitted.</p>",
        _advice(advice, losses),
        f"<h2>Residuals, magnified {MAGNIFIED:g} times</h2>",
        _vectors(pixel, found.adjusted.corner, found.adjusted.corner_good, size),
        "<h2>Coverage: corners per part of the image</h2>",
        _cells(coverage(found), "{:.0f}"),
        "<h2>Distances of the target</h2>",
        _ticks(found.distances),
        "<h2>Parameters</h2>",
        _parameters(found.adjusted),
        "<h2>Views</h2>",
        _views(found),
    ]
    _write(folder, "Camera calibration", parts)


def write_laser_report(
    folder: Path, found: LaserCalibration, sheets: list[SheetAt], losses: Sequence[str], advice: Sequence[str]
) -> None:
    """Write report.html into a folder, complete or not at all. Raises GarbiError."""
    stripes, adjusted = found.stripes, found.adjusted
    size = found.scanner.camera.width, found.scanner.camera.height
    place = np.column_stack([stripes.u, stripes.v])
    columns, rows = CELLS
    counts, _, _ = np.histogram2d(stripes.v, stripes.u, bins=(rows, columns), range=[[0, size[1]], [0, size[0]]])
    along = np.column_stack([adjusted.stripe, np.zeros(len(place))])
    parts = [
        f"<p>{len(found.views)} poses of the target, {len(place)} points of the stripe: "
        f"<b>{1e3 * found.rms:.2f} mm</b> rms off the sheet, "
        f"<b>{1e3 * found.hold_out:.2f} mm</b> on images that were not fitted.</p>",
        _advice(advice, losses),
        f"<h2>Residuals, columns, magnified {MAGNIFIED:g} times</h2>",
        _vectors(place, along, adjusted.stripe_good, size),
        "<h2>Coverage: points of the stripe per part of the image</h2>",
        _cells(counts, "{:.0f}"),
        "<h2>Distances of the stripe</h2>",
        _ticks(found.distances),
        "<h2>Uncertainty of a point across the image, mm, 1 sigma</h2>",
    ]
    for spread in found.spreads:
        parts += [f"<h3>At {spread.depth:g} m: {1e3 * spread.rms:.2f} mm</h3>", _cells(1e3 * spread.sigma, "{:.2f}")]
    parts += ["<h2>Is the sheet a plane?</h2>", *(f"<p>{escape(line)}</p>" for line in sheet_lines(sheets))]
    parts += ["<h2>Parameters</h2>", _parameters(adjusted)]
    _write(folder, "Laser calibration", parts)


def _write(folder: Path, title: str, parts: Sequence[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    page = (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{title}</title><style>{STYLE}</style>"
        f"<h1>{title}</h1>{''.join(parts)}</html>\n"
    )
    write_aside(folder / "report.html", page.encode())


def _advice(advice: Sequence[str], losses: Sequence[str]) -> str:
    lines = "".join(f"<li>{escape(line)}</li>" for line in advice) or "<li>None: nothing stands out.</li>"
    lost = "".join(f"<li>{escape(line)}</li>" for line in losses)
    return f"<div class=advice><h2>Advice</h2><ul>{lines}</ul></div>" + (
        f"<h2>Left out</h2><ul>{lost}</ul>" if lost else ""
    )


def _vectors(place: Floats, residual: Floats, good: np.ndarray, size: tuple[int, int]) -> str:
    step = max(len(place) // MOST, 1)
    ends = place + MAGNIFIED * np.clip(residual, -5.0, 5.0)
    drawn = {"a": "", "b": ""}
    for (x, y), (u, v), kept in zip(place[::step].tolist(), ends[::step].tolist(), good[::step].tolist(), strict=True):
        drawn["a" if kept else "b"] += f"M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}"
    paths = "".join(f'<path class="{style}" d="{path}"/>' for style, path in drawn.items() if path)
    return f'<svg viewBox="0 0 {size[0]} {size[1]}" role="img">{paths}</svg><p>Orange: left out as wrong.</p>'


def _cells(values: Floats, form: str) -> str:
    most = max(float(np.nanmax(values)), 1e-12) if np.isfinite(values).any() else 1.0
    rows = ""
    for line in values.tolist():
        cells = "".join(
            f'<td class=r style="background:rgba(20,99,165,{0.5 * value / most:.2f})">{form.format(value)}</td>'
            if np.isfinite(value)
            else "<td class=r>–</td>"
            for value in line
        )
        rows += f"<tr>{cells}</tr>"
    return f"<table>{rows}</table>"


def _ticks(distances: Floats) -> str:
    far = 1.1 * float(np.max(distances))
    marks = "".join(f'<path class="a" d="M{20 + 760 * d / far:.1f} 10V34"/>' for d in distances.tolist())
    labels = "".join(
        f'<path class="g" d="M{20 + 760 * k / 5:.1f} 34V40"/><text x="{20 + 760 * k / 5:.1f}" y="54" '
        f'text-anchor="middle">{far * k / 5:.2f} m</text>'
        for k in range(6)
    )
    return f'<svg viewBox="0 0 800 60" role="img">{marks}{labels}</svg>'


def _parameters(adjusted: Adjusted) -> str:
    rows = ""
    for name, value in adjusted.scanner.values().items():
        free = name in adjusted.free
        sigma = f"{adjusted.sigma(name):.3g}" if free else "held"
        numbers = f"<td class=r>{value:.7g}</td><td class=r>{sigma}</td>"
        rows += f"<tr><td>{escape(name)}</td>{numbers}<td>{unit_of(name)}</td></tr>"
    return f"<table><tr><th>name</th><th>value</th><th>1 sigma</th><th></th></tr>{rows}</table>"


def _views(found: CameraCalibration) -> str:
    rows, begin = "", 0
    for view, distance in zip(found.views, found.distances.tolist(), strict=True):
        part = found.adjusted.corner[begin : begin + len(view.number)]
        begin += len(view.number)
        rms = float(np.sqrt((part**2).sum(axis=1).mean()))
        rows += (
            f"<tr><td>{escape(view.name)}</td><td class=r>{len(part)}</td><td class=r>{rms:.3f} px</td>"
            f"<td class=r>{distance:.3f} m</td><td class=r>{view.blur:.1f} px</td></tr>"
        )
    return f"<table><tr><th>view</th><th>corners</th><th>rms</th><th>distance</th><th>blur</th></tr>{rows}</table>"
