"""What the columns of a table may be called, and in which units."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

ANGLE_UNITS = {"rad": 1.0, "deg": math.pi / 180}
TURN_UNITS = {"rad/s": 1.0, "deg/s": math.pi / 180}
FORCE_UNITS = {"m/s2": 1.0, "g": 9.80665}
TIME_UNITS = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9}
SPELT = {
    "degree": "deg", "degrees": "deg", "°": "deg", "radian": "rad", "radians": "rad",
    "sec": "s", "second": "s", "seconds": "s", "µs": "us", "μs": "us", "usec": "us", "msec": "ms", "nsec": "ns",
    "rps": "rad/s", "dps": "deg/s", "rads-1": "rad/s", "degs-1": "deg/s", "rad/sec": "rad/s", "deg/sec": "deg/s",
    "°/s": "deg/s", "ms-2": "m/s2", "m/s/s": "m/s2", "m/s/2": "m/s2", "ms-1": "m/s", "mps": "m/s",
    "mbar": "hpa", "metre": "m", "meter": "m", "metres": "m", "meters": "m",
}  # fmt: skip
"""Other spellings, lower case, without blanks and carets, an underscore as a stroke."""


@dataclass(frozen=True)
class Quantity:
    """A column: what it is called here, what tables call it (lower case), unit -> factor to SI.

    default: the unit of a column that does not say; None: it must say. No units at all: a number as it is, or a text.
    """

    name: str
    called: tuple[str, ...]
    units: dict[str, float]
    default: str | None = None
    text: bool = False

    @property
    def example(self) -> str:
        """A heading that would do."""
        return f"{self.called[0]}_{next(iter(self.units)).replace('/', '_')}" if self.units else self.called[0]


def _three(name: str, called: tuple[str, ...], units: dict[str, float], default: str | None) -> list[Quantity]:
    """x, y and z of a vector: "wx", "gyro_x", ..."""
    return [
        Quantity(f"{name}_{axis}", tuple(one.replace("*", axis) for one in called), units, default) for axis in "xyz"
    ]


TIME = Quantity("time", ("time", "stamp", "timestamp", "t"), {unit: float(f) for unit, f in TIME_UNITS.items()})
ENCODER = Quantity("angle", ("angle", "alpha", "encoder", "position"), ANGLE_UNITS)
IMAGE = Quantity("image", ("image", "file", "filename", "file_name", "image_name"), {}, text=True)
PRESSURE = Quantity("pressure", ("pressure", "p"), {"pa": 1.0, "hpa": 100.0, "kpa": 1e3, "bar": 1e5})
DEPTH = Quantity("depth", ("depth",), {"m": 1.0}, "m")
RATE = _three("rate", ("w*", "gyro_*", "gyr_*", "rate_*", "angular_velocity_*", "w_rs_s_*"), TURN_UNITS, None)
FORCE = _three(
    "force", ("a*", "acc_*", "accel_*", "acceleration_*", "specific_force_*", "linear_acceleration_*", "a_rs_s_*"),
    FORCE_UNITS, "m/s2",
)  # fmt: skip
VELOCITY = _three("velocity", ("v*", "velocity_*", "vel_*", "dvl_v*"), {"m/s": 1.0}, "m/s")
POSITION = _three("position", ("*", "p*", "position_*", "pos_*"), {"m": 1.0}, "m")
QUATERNION = [Quantity(f"q{axis}", (f"q{axis}", f"quaternion_{axis}", f"orientation_{axis}"), {}) for axis in "xyzw"]
EULER = [Quantity(name, (name,), ANGLE_UNITS) for name in ("roll", "pitch", "yaw")]

_BRACKETS = re.compile(r"^(.*?)\s*[\[(]([^\])]*)[\])]\s*$")


def heading(text: str) -> tuple[str, str]:
    """(name, unit or "") of a column's heading: "angle_rad", "angle [rad]", "angle (rad)", "wx_deg_s"."""
    text = text.strip().strip("\"'").strip().lower()
    bracketed = _BRACKETS.match(text)
    if bracketed:
        return _name(bracketed[1]), unit_of(bracketed[2])
    return _name(text), ""


def _name(text: str) -> str:
    return re.sub(r"[\s.\-]+", "_", text.strip()).strip("_")


def unit_of(text: str) -> str:
    """A unit in its plain spelling."""
    bare = re.sub(r"[\s^*]+", "", text.lower().strip("_").replace("_", "/"))
    return SPELT.get(bare, bare)


def match(quantity: Quantity, name: str, unit: str) -> str | None:
    """The unit (of the quantity's, "" for none) in which a heading gives the quantity, None where it is another one.

    A unit that the quantity does not have comes back as it is.
    """
    for called in quantity.called:
        if name == called:
            return unit or quantity.default or ""
        if not unit and quantity.units and name.startswith(f"{called}_"):
            found = unit_of(name[len(called) + 1 :])
            if found in quantity.units:
                return found
    return None
