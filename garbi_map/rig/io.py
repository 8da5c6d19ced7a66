"""rig.yaml in and out."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from garbi_map.errors import GarbiError
from garbi_map.plain_yaml import parse_yaml, read_text
from garbi_map.rig.camera import Camera
from garbi_map.rig.laser import Laser
from garbi_map.rig.port import Port
from garbi_map.rig.rig import Rig
from garbi_map.rig.window import KINDS, LaserWindow

TILT = math.radians(45.0)  # a rig beyond this has its angles in degrees, or is another kind of scanner
UNIT = 1e-3  # how far from length one a direction may be written


def load_rig(path: Path) -> Rig:
    """The rig of a file. Raises GarbiError that names the file, the key, its value and what is expected."""
    return parse_rig(read_text(Path(path)), str(path))


def parse_rig(text: str, where: str) -> Rig:
    """The rig of a YAML text; `where` names it in errors. Raises GarbiError for what is missing or absurd."""
    top = _document(text, where)
    rig = Rig(_camera(top.section("camera")), _laser(top.section("laser")), copy.deepcopy(top.values))
    if np.linalg.norm(rig.laser.apex - rig.camera.centre) < 1e-3:
        top.section("laser").fail("x", "a laser (x, y, z) that is not where the camera is: no baseline, no range")
    return rig


def parse_camera(text: str, where: str) -> Camera:
    """The camera of a rig file whose laser may be missing yet. Raises GarbiError for what is missing or absurd."""
    return _camera(_document(text, where).section("camera"))


def parse_laser(text: str, where: str, key: str = "laser") -> Laser:
    """The laser of a rig file, or of another section of it. Raises GarbiError for what is missing or absurd."""
    return _laser(_document(text, where).section(key))


def _document(text: str, where: str) -> _Section:
    return _Section(where, "", parse_yaml(text, where))


def dump_rig(rig: Rig) -> str:
    """The YAML text of a rig. What its file held besides is written too."""
    known = {"camera": camera_entries(rig.camera), "laser": laser_entries(rig.laser)}
    extra = copy.deepcopy(dict(rig.extra))
    for section, optional in (("camera", "port"), ("laser", "fixed_angle"), ("laser", "window")):
        if optional not in known[section] and section in extra:
            extra[section].pop(optional, None)
    return yaml.safe_dump(_over(known, extra), sort_keys=False)


def camera_entries(camera: Camera) -> dict[str, Any]:
    """The section `camera` of a rig file."""
    entries: dict[str, Any] = {
        "frame_id": camera.frame_id,
        "image_width": camera.width,
        "image_height": camera.height,
        "distortion_model": "plumb_bob",
        "intrinsics": {"alpha_u": camera.alpha_u, "alpha_v": camera.alpha_v, "u0": camera.u0, "v0": camera.v0},
        "distortion": list(camera.distortion),
        "pose_in_rig": {"xyz": list(camera.position), "quaternion_xyzw": list(camera.quaternion)},
    }
    if camera.port is not None:
        port = camera.port
        entries["port"] = {
            "kind": "flat",
            "normal": list(port.normal),
            "distance": port.distance,
            "thickness": port.thickness,
            "index_glass": port.index_glass,
            "index_water": port.index_water,
        }
    return entries


def laser_entries(laser: Laser) -> dict[str, Any]:
    """The section `laser` of a rig file."""
    entries = {key: getattr(laser, key) for key in ("joint", "x", "y", "z", "delta", "theta", "gamma", "beta")}
    if laser.fixed_angle is not None:
        entries["fixed_angle"] = laser.fixed_angle
    if laser.window is not None:
        entries["window"] = _plain_window(laser.window)
    return entries


def _over(known: Mapping[str, Any], extra: Mapping[str, Any]) -> dict[str, Any]:
    """`known`, and after it the keys that only `extra` has, section by section."""
    merged = {
        key: _over(value, extra[key]) if isinstance(value, Mapping) and isinstance(extra.get(key), Mapping) else value
        for key, value in known.items()
    }
    return merged | {key: value for key, value in extra.items() if key not in known}


def _camera(section: _Section) -> Camera:
    section.choice("distortion_model", "plumb_bob")
    width, height = section.count("image_width"), section.count("image_height")
    lens = section.section("intrinsics")
    pose = section.section("pose_in_rig")
    coefficients = section.numbers("distortion", 5, -100.0, 100.0, "k1 k2 p1 p2 k3")
    camera = Camera(
        frame_id=section.text("frame_id"),
        width=width,
        height=height,
        alpha_u=lens.number("alpha_u", 1.0, 1e6, "a focal length in pixels"),
        alpha_v=lens.number("alpha_v", 1.0, 1e6, "a focal length in pixels"),
        u0=lens.number("u0", -width, 2 * width, "the principal point's column, in or near the image"),
        v0=lens.number("v0", -height, 2 * height, "the principal point's row, in or near the image"),
        distortion=coefficients,  # type: ignore[arg-type]
        position=pose.numbers("xyz", 3, -10.0, 10.0, "metres"),  # type: ignore[arg-type]
        quaternion=pose.unit("quaternion_xyzw", 4),  # type: ignore[arg-type]
        port=_port(section.section("port")) if section.has("port") else None,
    )
    corner_u, corner_v = np.meshgrid([0.0, width - 1.0], [0.0, height - 1.0])
    if not np.isfinite(camera.rays(corner_u.ravel(), corner_v.ravel())[1]).all():
        section.fail("distortion", "coefficients that can be inverted over the whole image")
    return camera


def _port(section: _Section) -> Port:
    section.choice("kind", "flat")
    normal = section.unit("normal", 3)
    if normal[2] < 0.2:
        section.fail("normal", "a direction out of the housing, along the view (third number positive)")
    return Port(
        normal=normal,  # type: ignore[arg-type]
        distance=section.number("distance", 1e-4, 1.0, "metres from the pinhole to the inner face, positive"),
        thickness=section.number("thickness", 0.0, 0.5, "metres"),
        index_glass=section.number("index_glass", 1.0, 3.0, "a refractive index"),
        index_water=section.number("index_water", 1.0, 2.0, "a refractive index"),
    )


def _laser(section: _Section) -> Laser:
    turn = 2.0 * math.pi
    return Laser(
        x=section.number("x", -10.0, 10.0, "metres"),
        y=section.number("y", -10.0, 10.0, "metres"),
        z=section.number("z", -10.0, 10.0, "metres"),
        delta=section.number("delta", -turn, turn, "radians"),
        theta=section.number("theta", -TILT, TILT, "radians, at most 45 degrees"),
        gamma=section.number("gamma", -TILT, TILT, "radians, at most 45 degrees"),
        beta=section.number("beta", -TILT, TILT, "radians, at most 45 degrees"),
        joint=section.text("joint"),
        fixed_angle=section.number("fixed_angle", -turn, turn, "radians") if section.has("fixed_angle") else None,
        window=_laser_window(section.section("window")) if section.has("window") else None,
    )


def _laser_window(section: _Section) -> LaserWindow:
    kind = section.text("kind")
    if kind not in KINDS:
        section.fail("kind", f"one of {', '.join(KINDS)}")
    normal = (1.0, 0.0, 0.0) if kind == "cylinder" else section.unit("normal", 3)
    if normal[0] < 0.2:
        section.fail("normal", "a direction out of the housing, along the light (first number positive)")
    return LaserWindow(
        kind=kind,  # type: ignore[arg-type]
        normal=normal,  # type: ignore[arg-type]
        distance=section.number("distance", 1e-4, 1.0, "metres from the apex to the inner face, positive"),
        thickness=section.number("thickness", 0.0, 0.5, "metres"),
        index_glass=section.number("index_glass", 1.0, 3.0, "a refractive index"),
        index_water=section.number("index_water", 1.0, 2.0, "a refractive index"),
    )


def _plain_window(window: LaserWindow) -> dict[str, Any]:
    entries = {key: getattr(window, key) for key in ("kind", "distance", "thickness", "index_glass", "index_water")}
    return entries if window.kind == "cylinder" else entries | {"normal": list(window.normal)}


class _Section:
    """A mapping of the file, whose values are taken with what they are expected to be."""

    def __init__(self, where: str, path: str, values: Any) -> None:
        self.where = where
        self.path = path
        if not isinstance(values, dict):
            found = "nothing" if values is None else _short(values)
            raise GarbiError(f"{where}: {path or 'top level'}: expected keys with values, found {found}")
        self.values = values

    def has(self, key: str) -> bool:
        return self.values.get(key) is not None

    def fail(self, key: str, expected: str) -> None:
        name = f"{self.path}.{key}" if self.path else key
        found = f"is {_short(self.values[key])}" if self.has(key) else "is missing"
        raise GarbiError(f"{self.where}: {name} {found}: expected {expected}")

    def section(self, key: str) -> _Section:
        if not self.has(key):
            self.fail(key, "a section with keys")
        return _Section(self.where, f"{self.path}.{key}" if self.path else key, self.values[key])

    def text(self, key: str) -> str:
        if not isinstance(self.values.get(key), str) or not self.values[key]:
            self.fail(key, "a name")
        return str(self.values[key])

    def choice(self, key: str, only: str) -> None:
        if self.values.get(key) != only:
            self.fail(key, f"{only}, the one kind that is known")

    def count(self, key: str) -> int:
        value = self.values.get(key)
        if not isinstance(value, int) or isinstance(value, bool) or not 16 <= value <= 65536:
            self.fail(key, "a whole number of pixels, 16 to 65536")
        return int(self.values[key])

    def number(self, key: str, low: float, high: float, expected: str) -> float:
        value = _number(self.values.get(key))
        if not low <= value <= high:
            self.fail(key, f"{expected}, {low:g} to {high:g}")
        return value

    def numbers(self, key: str, count: int, low: float, high: float, expected: str) -> tuple[float, ...]:
        values = self.values.get(key)
        numbers = tuple(_number(value) for value in values) if isinstance(values, list) else ()
        if len(numbers) != count or not all(low <= number <= high for number in numbers):
            self.fail(key, f"{count} numbers ({expected}), each {low:g} to {high:g}")
        return numbers

    def unit(self, key: str, count: int) -> tuple[float, ...]:
        numbers = self.numbers(key, count, -1.0 - UNIT, 1.0 + UNIT, "a vector of length 1")
        length = math.sqrt(math.fsum(number * number for number in numbers))
        if abs(length - 1.0) > UNIT:
            self.fail(key, f"{count} numbers of length 1 within {UNIT:g} (the length is {length:.6g})")
        if abs(length - 1.0) < 1e-15:
            return numbers
        return tuple(number / length for number in numbers)


def _number(value: Any) -> float:
    """NaN for what is no number. YAML 1.1 reads 1e-3 as text, people write it as a number."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (ValueError, OverflowError):
        return math.nan


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else text[:57] + "..."
