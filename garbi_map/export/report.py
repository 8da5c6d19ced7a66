"""What a run read, left out and reached: the model of report.json and report.html."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from garbi_map.aside import write_text
from garbi_map.errors import GarbiError
from garbi_map.seabed.types import Seabed


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Quantity(_Part):
    """A number with its unit; value None (null) where it could not be had."""

    name: str
    value: float | None
    unit: str = ""
    note: str = ""


class Topic(_Part):
    """What a log holds on one topic."""

    name: str
    type: str
    count: int


class Source(_Part):
    """What was read."""

    paths: list[str]
    begin_ns: int
    duration_s: float
    images: int
    topics: list[Topic] = []


class Span(_Part):
    """A stretch of the timeline: a lane ("sweeps", "/dvl/twist", ...), from and to, s since the log's begin."""

    lane: str
    begin_s: float
    end_s: float
    state: Literal["good", "lost", "absent"] = "good"


class SurveyOrder(_Part):
    """An order of IHO S-44 and whether the map reaches it; None where it cannot be told.

    inside: how the map's parts lie to each other; earth: against the level of the water, and on Earth.
    shares: of the cells whose vertical uncertainty (95 %) is allowed; coverage: how often everything is to be seen, and
    the share of the outline that was
    """

    name: str
    tvu_m: float
    inside_share: float
    earth_share: float | None
    thu_m: float
    inside_position: bool
    earth_position: bool | None
    feature_m: float | None
    features: bool
    coverage: int
    covered_share: float | None
    covered: bool


class Bathymetry(_Part):
    """The figures that IHO S-44 asks for, at 95 %, m, medians over the cells, and its orders from the mildest on.

    depth_m         None where no pressure tells it
    widest_gap_m    side of the largest square inside the outline without a point
    covered_once, covered_twice, five_or_more   shares: of the outline, and of the cells (five points or more)
    density         points per cell, median
    """

    depth_m: float | None
    tvu_inside_m: float
    tvu_earth_m: float | None
    thu_inside_m: float
    thu_earth_m: float | None
    widest_gap_m: float
    covered_once: float
    covered_twice: float
    density: float
    five_or_more: float
    orders: list[SurveyOrder]


class Place(_Part):
    """Where on Earth the map is.

    crs            of the files, WKT; they hold shift + (scale x, scale y, z) of the map's x, y, z
    origin         latitude and longitude of the map's origin, degrees; None where nobody knows
    sigma_m        1 sigma of the origin along each axis; None where nobody said
    notes          how this is known, what it leaves open
    """

    crs: str
    shift: tuple[float, float, float]
    scale: float
    convergence_deg: float
    origin: tuple[float, float] | None
    sigma_m: float | None
    notes: list[str]


class Report(_Part):
    """Everything that report.json holds.

    verdict        what the map is worth, in plain sentences
    weak           one line for each way in which the map is weak, and where
    counts         what was read and kept, in the order of the flow: images, stripes, profiles, sweeps, points, accepted
    rejected       points left out, by reason
    left_out       one line for everything that was in the log and is not in the map
    residuals      how well the parts agree: registration, navigation
    uncertainties  how sure the map is: `describe_seabed` and the trajectory
    bathymetry     the same as hydrographic surveys tell it
    place          where on Earth the map is
    timings_s      seconds of each stage, in order
    outputs        file name -> what it is
    """

    title: str
    created: str = Field(description="ISO 8601, UTC")
    source: Source
    verdict: str = ""
    weak: list[str] = []
    counts: dict[str, int]
    rejected: dict[str, int]
    left_out: list[str] = []
    residuals: list[Quantity] = []
    uncertainties: list[Quantity] = []
    bathymetry: Bathymetry | None = None
    place: Place | None = None
    timings_s: dict[str, float]
    timeline: list[Span] = []
    configuration: dict[str, Any]
    versions: dict[str, str]
    outputs: dict[str, str] = {}


def checked(report: Report | dict[str, Any]) -> Report:
    """A report from a plain dictionary. Raises GarbiError that names the first entry that does not fit the model."""
    if isinstance(report, Report):
        return report
    try:
        return Report.model_validate(report)
    except ValidationError as error:
        first = error.errors()[0]
        raise GarbiError(f"report: {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


def write_report_json(path: Path, report: Report | dict[str, Any]) -> None:
    """Write report.json, complete or not at all; numbers that are not finite become null."""
    write_text(path, checked(report).model_dump_json(indent=2) + "\n")


def describe_seabed(seabed: Seabed) -> list[Quantity]:
    """What the grid says of its own quality, for `uncertainties`."""
    known = seabed.known
    uncertainty = 1e3 * seabed.uncertainty[known]
    median, high = np.percentile(uncertainty, [50, 95])
    depth = -seabed.elevation[known]
    absolute = [] if seabed.absolute is None else [1e3 * float(np.median(seabed.absolute[known]))]
    return [
        Quantity(name="area", value=seabed.area, unit="m²", note="of cells with at least one point"),
        Quantity(name="cell", value=1e3 * seabed.cell, unit="mm"),
        Quantity(name="depth from", value=float(depth.min()), unit="m"),
        Quantity(name="depth to", value=float(depth.max()), unit="m"),
        Quantity(
            name="uncertainty, median",
            value=float(median),
            unit="mm",
            note="1 sigma of a cell's elevation, inside the map",
        ),
        Quantity(name="uncertainty, 95th percentile", value=float(high), unit="mm"),
        *(
            Quantity(
                name="absolute uncertainty, median", value=value, unit="mm", note="1 sigma of the elevation on Earth"
            )
            for value in absolute
        ),
        Quantity(name="density, median", value=float(np.median(seabed.density[known])), unit="points per cell"),
        Quantity(
            name="cells of five or more points",
            value=100 * float((seabed.density[known] >= 5).mean()),
            unit="%",
            note="surveyors ask for 95 %",
        ),
        Quantity(
            name="cells seen by two or more sweeps",
            value=100 * float((seabed.sweeps[known] >= 2).mean()),
            unit="%",
            note="only there can the poses be checked against each other",
        ),
    ]
