"""The report holds what it was given, lets nothing in and needs nothing from outside."""

from __future__ import annotations

import base64
import json
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from seabed_scene import plane, scan

from garbi_map.errors import GarbiError
from garbi_map.export import Quantity, Report, describe_seabed, figures, write_report_html, write_report_json
from garbi_map.export.axes import ticks
from garbi_map.export.drift import draw_steps
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.register import Agreement, Registered
from garbi_map.seabed import Seabed, SeabedSettings, build_seabed

HOSTILE = "<script>alert('x')</script>\"&'<img src=x onerror=alert(1)>$title ${title}"
VOID = {"meta", "img", "br", "link", "input", "path", "rect", "i"}


@pytest.fixture(scope="module")
def seabed() -> Seabed:
    """A small slope."""
    return build_seabed(lambda: [scan(plane, k, profiles=30, rows=100) for k in range(2)], SeabedSettings())[0]


@pytest.fixture
def path_of_vehicle() -> Trajectory:
    """Along the slope, 1.5 m above."""
    count = 50
    position = np.linspace([0.0, 0.3, 1.5], [0.6, 0.3, 1.5], count)
    quaternion = np.tile([0, 0, 0, 1.0], (count, 1))
    return Trajectory(np.arange(count) * 100_000_000, position, quaternion, np.tile(1e-4 * np.eye(6), (count, 1, 1)))


def registered(trajectory: Trajectory, pairs: int = 400) -> Registered:
    """The map's side of things: sweeps that lay 3 mm apart lie 0.2 mm apart, two sweeps moved by 1 and 2 mm."""
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 0.6, (pairs, 2)).astype(np.float32)
    noise = np.abs(rng.normal(0, 1, pairs)).astype(np.float32)
    agreement = Agreement(place, 3e-3 * noise, 2e-4 * noise, (-11.0, -12.5))
    return Registered(trajectory, trajectory, [], np.array([1e-3, 2e-3]), 1, agreement, {})


def write_html(path: Path, entry: dict[str, Any], seabed: Seabed, trajectory: Trajectory) -> str:
    """The page as text; navigation alone would have been a decimetre beside."""
    drifted = replace(trajectory, position=trajectory.position + np.linspace([0, 0, 0], [0.1, 0, 0], 50))
    write_report_html(path, entry, seabed, registered(trajectory), drifted)
    return path.read_text()


def report(text: str = "drift.mcap") -> dict[str, Any]:
    """A report as a pipeline would assemble it, with `text` wherever a string may come from a user or a log."""
    return {
        "title": text,
        "created": "2026-11-22T01:00:00Z",
        "source": {
            "paths": [text],
            "begin_ns": 1_790_000_000_000_000_000,
            "duration_s": 45.0,
            "images": 1125,
            "topics": [{"name": text, "type": text, "count": 7}],
        },
        "verdict": text,
        "weak": [text],
        "counts": {"images": 1125, text: 3},
        "rejected": {"isolated": 65, text: 1},
        "left_out": [text, "chunk 3 is damaged"],
        "residuals": [{"name": text, "value": 0.21, "unit": text, "note": text}],
        "uncertainties": [{"name": "nothing", "value": None}],
        "timings_s": {"stripes": 3.0, text: 0.0},
        "timeline": [{"lane": text, "begin_s": 0.0, "end_s": 45.0, "state": "lost"}],
        "configuration": {text: {"cell": 0.005, "name": text}},
        "versions": {"garbi": text},
        "outputs": {text: text},
    }


class Page(HTMLParser):
    """Every tag of a page, what it refers to, and whether all are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text = ""
        self._open: list[str] = []
        self.feed(text)
        assert not [tag for tag in self._open if tag not in {"tr", "td", "li", "p"}]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self._open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_json_says_what_the_dictionary_said(tmp_path: Path) -> None:
    """And reads back into the same model."""
    write_report_json(tmp_path / "report.json", report(HOSTILE))
    read = json.loads((tmp_path / "report.json").read_text())
    assert Report.model_validate(read) == Report.model_validate(report(HOSTILE))
    assert read["left_out"][0] == HOSTILE


def test_numbers_that_are_none_are_null(tmp_path: Path) -> None:
    """JSON knows no NaN."""
    entry = report() | {"residuals": [Quantity(name="a", value=float("nan")), Quantity(name="b", value=float("inf"))]}
    write_report_json(tmp_path / "report.json", entry)
    read = json.loads((tmp_path / "report.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert [q["value"] for q in read["residuals"]] == [None, None]


def test_a_report_that_does_not_fit_the_model_is_named(tmp_path: Path) -> None:
    """Which entry, in one line."""
    with pytest.raises(GarbiError, match=r"report: source\.images"):
        write_report_json(tmp_path / "r.json", report() | {"source": report()["source"] | {"images": "many"}})
    with pytest.raises(GarbiError, match="report: speling"):
        write_report_json(tmp_path / "r.json", report() | {"speling": 1})
    assert not list(tmp_path.iterdir())


def test_hostile_strings_are_shown_and_not_run(tmp_path: Path, seabed: Seabed, path_of_vehicle: Trajectory) -> None:
    """Every string a log or a user can bring, as markup, entity and template."""
    folder = tmp_path / "<i onclick=alert(2)>"
    folder.mkdir()
    text = write_html(folder / "report.html", report(HOSTILE), seabed, path_of_vehicle)
    page = Page(text)
    assert page.tags.count("script") == 1 and text.count("<script") == 1  # our own
    assert not [name for name, _ in page.attributes if name.startswith("on")]
    assert page.text.count(HOSTILE) >= 14
    assert f"garbi view '{folder}'" in page.text


def test_the_page_needs_nothing_from_outside(tmp_path: Path, seabed: Seabed, path_of_vehicle: Trajectory) -> None:
    """No import, no address but the one that its script falls back to when it is served; pictures are inside."""
    text = write_html(tmp_path / "report.html", report(), seabed, path_of_vehicle)
    page = Page(text)
    assert not {"link", "iframe", "object"} & set(page.tags)
    static, script = text.split("<script>")
    assert not re.search(r"https?:|@import|url\(", static)
    assert re.findall(r"https?://[^\"/]*", script) == ["https://app.rerun.io"]
    sources = [value for name, value in page.attributes if name in ("src", "href")]
    assert len(sources) == 6  # hillshade; uncertainty, sweeps, points; residuals before and after
    for source in sources:
        assert source is not None
        kind, _, data = source.partition(",")
        assert kind == "data:image/png;base64"
        assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR) is not None


def test_the_verdict_comes_first(tmp_path: Path, seabed: Seabed, path_of_vehicle: Trajectory) -> None:
    """Then four numbers, the map, where it is weak, the drift, the residuals."""
    text = write_html(tmp_path / "report.html", report("a sentence"), seabed, path_of_vehicle)
    order = ["class=\"verdict\"", "class=tile", "Relief, shaded", "Where the map is weak", "The drift that was found",
             "How well the sweeps agree", "Depth along the path", "Timeline", "Time spent"]  # fmt: skip
    found = [text.index(mark) for mark in order]
    assert found == sorted(found)
    assert text.count("class=tile>") == 4


def test_every_drawing_is_well_formed(tmp_path: Path, seabed: Seabed, path_of_vehicle: Trajectory) -> None:
    """SVG that an XML parser accepts: maps, the drift in six axes, its steps, histograms, depth, timeline."""
    text = write_html(tmp_path / "report.html", report(), seabed, path_of_vehicle)
    drawings = [ElementTree.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL)]
    names = [drawing.attrib["aria-label"] for drawing in drawings]
    assert [name for name in names if name.startswith("Correction of")] == [
        f"Correction of {axis} over time" for axis in ("x", "y", "z", "roll", "pitch", "yaw")
    ]
    assert {
        "Uncertainty",
        "Sweeps that saw each cell",
        "Points per cell",
        "Distance between sweeps",
        "Timeline",
    } <= set(names)
    assert {f"Distance between sweeps, {which}" for which in ("navigation filter alone", "this map")} <= set(names)


def test_a_map_without_overlap_says_so(tmp_path: Path, seabed: Seabed, path_of_vehicle: Trajectory) -> None:
    """And has no residual maps."""
    alone = registered(path_of_vehicle, pairs=0)
    write_report_html(tmp_path / "report.html", report(), seabed, alone, path_of_vehicle)
    text = (tmp_path / "report.html").read_text()
    assert "No two sweeps overlap" in text
    assert "nan" not in re.sub(r"base64,[^\"]*", "", text).lower()


def test_figures_are_well_formed_and_inside_their_frame() -> None:
    """SVG that an XML parser accepts; no coordinate outside the drawing."""
    x = np.linspace(0, 60, 5000)
    y = np.where((x > 20) & (x < 25), np.nan, 3 + np.sin(x))
    drawn = [
        figures.chart("c", [figures.Line(HOSTILE, x, y, band=np.full_like(y, 0.1))], "s", HOSTILE, flip=True),
        figures.histogram("h", np.random.default_rng(0).gamma(2, 0.1, 5000), "mm"),
        figures.timeline(HOSTILE, [(HOSTILE, 0, 5, "good"), ("b", 5, 9, "lost"), ("c", 0, 9, "absent")]),
        figures.histograms(HOSTILE, [(HOSTILE, np.random.default_rng(1).gamma(2, 0.1, 5000), "a")], HOSTILE),
    ]
    for svg in drawn:
        root = ElementTree.fromstring(svg)
        width, height = (float(v) for v in root.attrib["viewBox"].split()[2:])
        for element in root.iter():
            numbers = re.findall(r"[ML](-?[\d.]+) (-?[\d.]+)", element.attrib.get("d", ""))
            assert all(0 <= float(a) <= width and 0 <= float(b) <= height for a, b in numbers)
    assert drawn[0].count("M") > 2  # the curve begins anew after its gap


def test_depth_grows_downward() -> None:
    """A deeper point lies lower in the drawing."""
    svg = figures.chart("c", [figures.Line("d", np.array([0.0, 1.0]), np.array([1.0, 5.0]))], "s", "m", flip=True)
    (path,) = re.findall(r'class="a l" d="M[\d.]+ ([\d.]+)L[\d.]+ ([\d.]+)"', svg)
    assert float(path[0]) < float(path[1])


def test_figures_of_nothing_are_nothing() -> None:
    """No data, no drawing, no error."""
    nan = np.full(3, np.nan)
    assert figures.chart("c", [figures.Line("a", np.arange(3.0), nan)], "s", "m") == ""
    assert figures.histogram("h", nan, "mm") == ""
    assert figures.timeline("t", []) == ""
    assert figures.histograms("h", [("a", nan, "a")], "mm") == ""
    assert draw_steps([], np.empty(0)) == ""


def test_ticks_are_round_and_inside() -> None:
    """Whatever the range."""
    for low, high in ((0.0, 1.0), (-3.2, 17.0), (1e-5, 3e-5), (1000.0, 1000.5)):
        values = [value for value, _ in ticks(low, high, 6)]
        assert 2 <= len(values) <= 7
        assert all(low - 1e-9 <= value <= high + 1e-9 for value in values)
        assert [text for _, text in ticks(low, high, 6)] == list(dict.fromkeys(text for _, text in ticks(low, high, 6)))


def test_the_seabed_describes_itself(seabed: Seabed) -> None:
    """Area, density and uncertainty as counted by hand."""
    found = {quantity.name: quantity.value for quantity in describe_seabed(seabed)}
    assert found["area"] == pytest.approx(seabed.known.sum() * 0.005**2)
    assert found["cells of five or more points"] == pytest.approx(
        100 * (seabed.density >= 5).sum() / seabed.known.sum()
    )
    assert found["uncertainty, median"] == pytest.approx(1e3 * np.nanmedian(seabed.uncertainty))
