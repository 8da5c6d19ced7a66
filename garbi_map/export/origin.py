"""Where on Earth the map lies: as the user says, or as the fixes in the log say."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from garbi_map.errors import GarbiError
from garbi_map.export.georeference import Georeference
from garbi_map.log.frames import east_north_up

if TYPE_CHECKING:
    from rasterio.crs import CRS

    from garbi_map.log.records import Fixes, Navigation
    from garbi_map.navigate.trajectory import Trajectory

Floats = NDArray[np.float64]
Projection = Literal["utm", "local"]

_HOW = "it wants LAT,LON or LAT,LON,HEADING in decimal degrees, such as 41.9794,2.8214,90"
_STEP = 1e-4
"""Degrees to either side, over which scale and convergence of a projection are taken."""
_WATER_LEVEL = "5829"
"""EPSG: instantaneous water level height."""
_FIRST_POSE = (
    'VERT_CS["height above the first pose of the dive",VERT_DATUM["first pose of the dive",2005],'
    'UNIT["metre",1,AUTHORITY["EPSG","9001"]],AXIS["Up",UP]]'
)


@dataclass(frozen=True)
class Origin:
    """Where the dive begins: WGS 84 latitude and longitude, degrees.

    heading: of the map's x axis, degrees clockwise from true north; None: as the log's attitude has it, x east.
    """

    latitude: float
    longitude: float
    heading: float | None = None

    @classmethod
    def parse(cls, text: str) -> Origin:
        """An origin from "LAT,LON[,HEADING]". Raises ValueError that says what is wrong with it."""
        try:
            numbers = [float(part) for part in text.split(",")]
        except ValueError:
            raise ValueError(f"'{text}' is no place: {_HOW}") from None
        if len(numbers) not in (2, 3) or not np.isfinite(numbers).all():
            raise ValueError(f"'{text}' is no place: {_HOW}")
        latitude, longitude, *heading = numbers
        if abs(latitude) > 89.9:
            raise ValueError(f"latitude {latitude:g} is not between the poles: {_HOW}")
        if abs(longitude) > 360 or (heading and abs(heading[0]) > 360):
            raise ValueError(f"'{text}': longitude and heading go to 360 degrees: {_HOW}")
        if not -180 <= longitude < 180:
            longitude = (longitude + 180) % 360 - 180
        return cls(latitude, longitude, heading[0] % 360 if heading else None)


@dataclass(frozen=True)
class Located:
    """What is known of the map's place.

    reference   how files are written
    turn        rad, anticlockwise, by which the poses have to be turned for the map's axes to be those of the grid
    sigma       m, 1 sigma of the origin along each axis; None where nobody said
    origin      where the map begins; None where nobody knows
    convergence rad, of the grid: the true azimuth of grid north
    notes       how all this is known, a sentence each
    given       the origin that was given; None where the fixes or nobody said
    """

    reference: Georeference = field(default_factory=Georeference)
    turn: float = 0.0
    sigma: float | None = None
    origin: Origin | None = None
    convergence: float = 0.0
    notes: list[str] = field(default_factory=list)
    given: Origin | None = None

    @property
    def transform(self) -> Floats:
        """(4, 4) of the map with the grid's axes <- the map as it was estimated."""
        matrix = np.eye(4)
        cos, sin = np.cos(self.turn), np.sin(self.turn)
        matrix[:2, :2] = [[cos, -sin], [sin, cos]]
        return matrix

    def is_at(self, origin: Origin | None) -> bool:
        """Whether it is this origin by which the map was placed."""
        return self.given == origin

    def to_json(self) -> str:
        """As text that `from_json` reads."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> Located:
        """What `to_json` gave."""
        entries = json.loads(text)
        reference = Georeference.from_dictionary(entries.pop("reference"), json.loads(text)["reference"]["wkt"])
        places = {name: None if entries[name] is None else Origin(**entries[name]) for name in ("origin", "given")}
        return cls(reference, **{**entries, **places})


def locate(
    log: Navigation,
    paths: tuple[Trajectory, Trajectory],
    origin: Origin | None,
    projection: Projection = "utm",
    sigma: float | None = None,
) -> Located:
    """Where the map lies: at `origin` where one is given, else as the log's fixes say, else nowhere.

    paths: the navigation filter's, which reaches to the fixes before and after the scan, and the map's.
    sigma: m, 1 sigma of the origin along each axis, which wins over what the fixes say of themselves.
    Raises GarbiError where an origin is given and its heading is known neither from it nor from the log, and where the
    projection does not reach the origin.
    """
    notes, given = [], origin
    if origin is None:
        fixed = None if log.fixes is None else _origin_of(log.fixes, *paths)
        if log.fixes is None or fixed is None:
            return Located(notes=["Local: no --origin was given and no fix in the log says where it is."])
        origin, own = fixed
        sigma = own if sigma is None else sigma
        notes.append(f"Placed by {len(log.fixes.stamp_ns):,} fixes in the log.")
        if not _knows_north(log):
            return Located(notes=["Local: the fixes say where the map is, but nothing how it is turned: give --origin "
                                  f"{origin.latitude:.7f},{origin.longitude:.7f},HEADING."])  # fmt: skip
    else:
        notes.append("Placed by the origin that was given: where the dive begins.")
    turn, how = _turn(log, origin)
    crs, name = _system(origin, projection, log.pressure is not None)
    (easting, northing), scale, convergence = similarity(crs, origin)
    notes += [how, name]
    notes.append(
        f"One metre on the ground is {scale:.6f} m of the grid at sea level; grid north is "
        f"{abs(np.degrees(convergence)):.4f}° {'east' if convergence >= 0 else 'west'} of true north."
    )
    notes.append(
        "Heights count from the surface of the water during the dive (depth by pressure), not from a chart datum or an "
        "ellipsoid: tide and air pressure are not taken off."
        if log.pressure is not None
        else "Heights count from the first pose: no pressure in the log tells the depth."
    )
    reference = Georeference(crs.to_wkt(), (easting, northing, 0.0), scale)
    return Located(reference, turn + convergence, sigma, origin, convergence, notes, given)


def check_origin(log: Navigation, origin: Origin | None, projection: Projection) -> None:
    """Raises the GarbiError that `locate` would raise, before the work is done."""
    if origin is not None:
        _turn(log, origin)
        _system(origin, projection, True)


def similarity(crs: CRS, origin: Origin) -> tuple[tuple[float, float], float, float]:
    """Easting and northing (m), scale and convergence (rad, true azimuth of grid north) of a projection at a place."""
    from rasterio.warp import transform

    place = np.array([origin.latitude, origin.longitude, 0.0])
    ends = place + _STEP * np.array([[-1.0, 0, 0], [1, 0, 0]])
    east, north = transform("EPSG:4326", crs, [place[1], *ends[:, 1]], [place[0], *ends[:, 0]])[:2]
    ground = np.diff(east_north_up(ends, (origin.latitude, origin.longitude, 0.0)), axis=0)[0]
    grid = complex(east[2] - east[1], north[2] - north[1])
    return (east[0], north[0]), abs(grid) / float(np.hypot(*ground[:2])), float(np.angle(grid)) - np.pi / 2


def _system(origin: Origin, projection: Projection, has_depth: bool) -> tuple[CRS, str]:
    """The compound reference system (rasterio's CRS), and what it is in words."""
    from rasterio.crs import CRS

    if projection == "utm":
        if not -80 <= origin.latitude <= 84:
            raise GarbiError(
                f"--origin: UTM ends at 84° north and 80° south of the equator, not at {origin.latitude:g}°: "
                "say export: {projection: local} in the configuration"
            )
        code = f"EPSG:{327 if origin.latitude < 0 else 326}{utm_zone(origin.latitude, origin.longitude):02d}"
        flat = CRS.from_string(code).to_wkt()
        said = f"WGS 84 / UTM zone {code[-2:]}{'S' if origin.latitude < 0 else 'N'} ({code})"
    else:
        flat = CRS.from_proj4(
            f"+proj=tmerc +lat_0={origin.latitude:.9f} +lon_0={origin.longitude:.9f} +k=1 +x_0=0 +y_0=0 "
            "+datum=WGS84 +units=m"
        ).to_wkt()
        said = "WGS 84 / transverse Mercator about the origin of the map"
        flat = flat.replace('PROJCS["unknown"', f'PROJCS["{said}"').replace('GEOGCS["unknown"', 'GEOGCS["WGS 84"')
    level = CRS.from_epsg(_WATER_LEVEL).to_wkt() if has_depth else _FIRST_POSE
    names = "instantaneous water level" if has_depth else "first pose of the dive"
    return CRS.from_wkt(f'COMPD_CS["{said.split(" (")[0]} + {names}",{flat},{level}]'), f"{said}, heights: {names}."


def utm_zone(latitude: float, longitude: float) -> int:
    """The number of the UTM zone, with its exceptions about Bergen and Svalbard."""
    if 56 <= latitude < 64 and 3 <= longitude < 12:
        return 32
    if latitude >= 72 and 0 <= longitude < 42:
        return (31, 33, 35, 37)[int(np.searchsorted((9, 21, 33), longitude, side="right"))]
    return int((longitude + 180) // 6) % 60 + 1


def _knows_north(log: Navigation) -> bool:
    """Whether the attitude that the navigation filter uses has a north."""
    foreign = log.odometry is not None and log.dvl is None and log.fixes is None
    return log.imu is not None and bool(np.isfinite(log.imu.attitude).any()) and not foreign


def _turn(log: Navigation, origin: Origin) -> tuple[float, str]:
    """By how much (rad) the map has to be turned for its x axis to be true east, and how that is known."""
    if origin.heading is not None:
        return np.radians(90 - origin.heading), f"Turned so that its x axis had heading {origin.heading:g}°."
    if not _knows_north(log):
        raise GarbiError(
            "--origin: the log has no attitude with a north in it: give LAT,LON,HEADING, HEADING being the direction of the "
            "bow where the dive begins, degrees clockwise from true north"
        )
    return (
        0.0,
        "North is that of the attitude in the log: where that is a compass, declination and deviation are in it.",
    )


def _origin_of(fixes: Fixes, filtered: Trajectory, path: Trajectory) -> tuple[Origin, float] | None:
    """The map's origin by the fixes, and its 1 sigma, m: their errors last for minutes, and many are no better than one."""
    if fixes.origin is None:
        return None
    near = np.clip(fixes.stamp_ns, path.stamp_ns[0], path.stamp_ns[-1])
    there = filtered.at(fixes.stamp_ns).position + path.at(near).position - filtered.at(near).position
    off = (fixes.position - there)[:, :2]
    off = off[np.isfinite(off).all(axis=1)]
    if not len(off):
        return None
    middle = np.median(off, axis=0)
    stated = np.sqrt(np.nan_to_num(np.median(np.diagonal(fixes.covariance, axis1=1, axis2=2)[:, :2])))
    spread = 1.4826 * float(np.median(np.abs(off - middle)))
    latitude, longitude = _displaced(fixes.origin, middle)
    return Origin(latitude, longitude), max(float(stated), spread)


def _displaced(origin: tuple[float, float, float], offset: Floats) -> tuple[float, float]:
    """Latitude and longitude of a place (east, north) m from an origin, by Newton's method."""
    place = np.array(origin, np.float64)
    for _ in range(3):
        probes = place + np.array([[0, 0, 0], [_STEP, 0, 0], [0, _STEP, 0]])
        reached = east_north_up(probes, origin)[:, :2]
        slope = (reached[1:] - reached[0]).T / _STEP
        place[:2] += np.linalg.solve(slope, offset - reached[0])
    return float(place[0]), float(place[1])
