"""The report's part for hydrographers: the orders of IHO S-44, and where on Earth the map is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape

from garbi_map.export.report import Bathymetry, Place, SurveyOrder
from garbi_map.words import length, percent


def survey_table(found: Bathymetry | None) -> str:
    """What each order asks for, a column each, and what the map gives; empty where nothing was found out."""
    if found is None:
        return ""
    depth = "no depth: none was measured" if found.depth_m is None else length(found.depth_m)
    asked: list[tuple[str, float | None, Callable[[SurveyOrder], str]]] = [
        (f"Depth, allowed at {depth}", None, lambda order: length(order.tvu_m)),
        ("cells that keep it, inside the map", found.tvu_inside_m, lambda order: _cells(order.inside_share)),
        ("cells that keep it, below the water level", found.tvu_earth_m, lambda order: _cells(order.earth_share)),
        ("Position, allowed", None, lambda order: length(order.thu_m)),
        ("kept inside the map", found.thu_inside_m, lambda order: _kept(order.inside_position)),
        ("kept on Earth", found.thu_earth_m, lambda order: _kept(order.earth_position)),
        ("Cube that must be found", None, lambda order: length(order.feature_m) if order.feature_m else "–"),
        (
            "wider than the widest gap",
            found.widest_gap_m,
            lambda order: _kept(order.features if order.feature_m else None),
        ),
        ("Coverage asked", None, lambda order: ("–", "100 %", "200 %")[order.coverage]),
        ("of the outline, to a quarter of the cube", None, _covered),
    ]
    rows = [_row(name, own, name[0].isupper(), [of(order) for order in found.orders]) for name, own, of in asked]
    names = "".join(f"<th class=r>{escape(order.name)}</th>" for order in found.orders)
    density = (
        f"{found.density:g} points per cell (median), {percent(found.five_or_more)} of the cells hold five or more; "
        f"{percent(found.covered_once)} of the outline seen, {percent(found.covered_twice)} by two sweeps or more."
    )
    return (
        f"<p>{escape(_reached(found))}</p>"
        f"<table class=survey><tr><th></th><th class=r>this map</th>{names}</tr>{''.join(rows)}</table>"
        f"<p class=fine>{escape(density)}</p>"
    )


def place_list(place: Place | None) -> str:
    """Where the map is, and how that is known, line by line."""
    if place is None:
        return ""
    lines = [escape(note) for note in place.notes]
    if place.origin is not None:
        (latitude, longitude), (east, north, _) = place.origin, place.shift
        sigma = f"{length(place.sigma_m)} (1 sigma along each axis)" if place.sigma_m else _UNSAID
        lines.insert(
            0,
            f"The map's origin is at {latitude:.7f}°, {longitude:.7f}°: easting {east:,.3f} m, northing {north:,.3f} m. "
            f"Its uncertainty: {sigma}.",
        )
    return "<ul>" + "".join(f"<li>{line}</li>" for line in lines) + "</ul>"


def place_line(place: Place | None, found: Bathymetry | None) -> str:
    """For the head of the page: where, in which system, how deep."""
    parts = []
    if place is not None and place.origin is not None:
        latitude, longitude = place.origin
        parts = [
            f"{abs(latitude):.6f}° {'N' if latitude >= 0 else 'S'}, {abs(longitude):.6f}° {'E' if longitude >= 0 else 'W'}",
            place.crs.split('"')[1],
        ]
    elif place is not None:
        parts = ["local frame, not georeferenced"]
    if found is not None and found.depth_m is not None:
        parts.append(f"{found.depth_m:.2f} m deep (median)")
    return escape(" · ".join(parts))


_UNSAID = "nobody said (export: {origin_sigma: metres} in the configuration does)"
_ALL = 0.95
"""Share of the cells that must keep what is allowed at 95 %."""


def _reached(found: Bathymetry) -> str:
    """The best order whose every demand is met, inside the map and on Earth, in a sentence."""

    def best(good: Callable[[SurveyOrder], bool]) -> str:
        names = [order.name for order in found.orders if good(order) and order.features and order.covered]
        return names[-1].removeprefix("Order ") if names else "none"

    inside = best(lambda order: order.inside_share >= _ALL and order.inside_position)
    earth = best(lambda order: (order.earth_share or 0.0) >= _ALL and bool(order.earth_position))
    said = f"Best order whose figures are met: inside the map {inside}, "
    if found.thu_earth_m is None:
        return said + "on Earth not to be told, because nobody said how well the place of the map is known."
    return said + f"on Earth {earth}."


def _cells(share: float | None) -> str:
    return "not known" if share is None else _marked(_brief(share), share >= _ALL)


def _brief(share: float) -> str:
    """A share as a narrow column holds it."""
    return percent(share).replace("more than", ">").replace("less than", "<")


def _kept(good: bool | None) -> str:
    return "–" if good is None else _marked("yes" if good else "no", good)


def _covered(order: SurveyOrder) -> str:
    return "–" if order.covered_share is None else _marked(_brief(order.covered_share), order.covered)


def _marked(text: str, good: bool) -> str:
    return text if good else f"<b class=no>{text}</b>"


def _row(name: str, own: float | None, is_demand: bool, cells: Sequence[str]) -> str:
    """What is asked for, or what the map has (m) and makes of it."""
    head = f"<td>{escape(name)}</td><td class=r>{'' if own is None else length(own)}</td>"
    kind = " class=ask" if is_demand else ""
    return f"<tr{kind}>{head}{''.join(f'<td class=r>{cell}</td>' for cell in cells)}</tr>"
