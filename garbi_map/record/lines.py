"""The lines that encoders, IMUs, pressure sensors and DVLs send, to readings; docs/record-protocol.md describes them.

A line comes from a wire, or from whoever can reach the port: its length is bounded, its numbers are finite and within what
such a sensor can measure, and whatever else it is, it is refused with a reason of a few words.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

Kind = Literal["encoder", "imu", "pressure", "dvl"]
KINDS: tuple[Kind, ...] = get_args(Kind)
LONGEST = 1024  # bytes of a line
LATEST = 1 << 33  # s, of a device's clock: later than any, be it since boot or since 1970
OURS = "PGRB"

_LIMITS: dict[Kind, tuple[float, ...]] = {
    "encoder": (1e4,),
    "imu": (100.0,) * 3 + (1000.0,) * 3,
    "pressure": (2e8,),
    "dvl": (50.0,) * 3,
}  # rad; rad/s and m/s^2; Pa; m/s


class BadLine(ValueError):
    """Why a line is refused, in a few words; they are counted by it."""


@dataclass(frozen=True, slots=True)
class Reading:
    """One measurement of one sensor.

    device_ns  the device's own clock, ns since whatever it counts from; None where it sends none
    values     encoder: angle, rad. imu: rates (3), rad/s, specific force (3), m/s^2 and, where there is one, the attitude
               (4), xyzw. pressure: absolute, Pa. dvl: velocity (3), m/s, NaN where the bottom is not seen, and its
               variance, m^2/s^2, where it is told
    """

    kind: Kind
    device_ns: int | None
    values: tuple[float, ...]


class LineSplitter:
    """Bytes in, whole lines out; never more than LONGEST bytes wait for their end of line."""

    def __init__(self) -> None:
        self._waiting = b""
        self._overlong = False

    def split(self, data: bytes) -> list[bytes]:
        """The lines that end in the data, without their ends. One that is too long comes cut, so that it is refused."""
        *ended, rest = (self._waiting + data).replace(b"\r", b"\n").split(b"\n")
        if ended and self._overlong:
            ended, self._overlong = ended[1:], False
        lines = [line[: LONGEST + 1] for line in ended if line]
        if len(rest) > LONGEST:
            if not self._overlong:
                lines.append(rest[: LONGEST + 1])
            self._overlong, rest = True, b""
        self._waiting = b"" if self._overlong else rest
        return lines


def parse_line(line: bytes) -> list[Reading]:
    """The readings of one line; none where a sound line is about something else. Raises BadLine."""
    if len(line) > LONGEST:
        raise BadLine("too long")
    try:
        text = line.decode("ascii").strip()
    except UnicodeDecodeError as error:
        raise BadLine("not text") from error
    if text.startswith("{"):
        return [_from_json(text)]
    if text.startswith("$"):
        return _from_nmea(text)
    if text.startswith(":"):
        return _from_pd6(text)
    if text.startswith("wr"):
        return _from_wrz(text)
    raise BadLine("neither NMEA nor JSON")


def nmea(body: str) -> bytes:
    """A sentence with its checksum and end of line: nmea("PGRB,ENC,,0.1")."""
    return f"${body}*{_xor(body):02X}\r\n".encode("ascii")


def _xor(body: str) -> int:
    value = 0
    for byte in body.encode("ascii"):
        value ^= byte
    return value


def _crc8(body: str) -> int:
    """Polynomial 0x07, from nought."""
    value = 0
    for byte in body.encode("ascii"):
        value ^= byte
        for _ in range(8):
            value = (value << 1) ^ (0x107 if value & 0x80 else 0)
    return value


def _checked(text: str, checksum: Callable[[str], int]) -> list[str]:
    """The fields of a line that ends in *HH."""
    body, star, stated = text.rpartition("*")
    if not star or len(stated) != 2:
        raise BadLine("no checksum")
    try:
        wrong = int(stated, 16) != checksum(body)
    except ValueError as error:
        raise BadLine("no checksum") from error
    if wrong:
        raise BadLine("checksum does not match")
    return body.split(",")


def _from_nmea(text: str) -> list[Reading]:
    name, *fields = _checked(text[1:], _xor)
    if name == OURS:
        return [_ours(fields)]
    if len(name) == 5 and name.endswith("XDR"):
        return _transducers(fields)
    return []


def _ours(fields: list[str]) -> Reading:
    kinds: dict[str, Kind] = {"ENC": "encoder", "IMU": "imu", "PRS": "pressure", "DVL": "dvl"}
    if len(fields) < 3 or fields[0] not in kinds:
        raise BadLine(f"no such {OURS} sentence")
    kind = kinds[fields[0]]
    if kind == "dvl" and not any(fields[2:5]):
        return _reading(kind, _device_ns(fields[1]), [math.nan] * 3)
    return _reading(kind, _device_ns(fields[1]), [_number(field) for field in fields[2:]])


def _transducers(fields: list[str]) -> list[Reading]:
    """NMEA 0183 XDR: quadruples of type, value, unit, name. Angles in degrees, pressures in bar or pascal."""
    if len(fields) % 4:
        raise BadLine("XDR without four fields a transducer")
    readings = []
    for i in range(0, len(fields), 4):
        what, value, unit, _ = fields[i : i + 4]
        if what == "A" and unit == "D" and value:
            readings.append(_reading("encoder", None, [math.radians(_number(value))]))
        elif what == "P" and unit in ("B", "P") and value:
            readings.append(_reading("pressure", None, [_number(value) * (1e5 if unit == "B" else 1.0)]))
    return readings


def _from_pd6(text: str) -> list[Reading]:
    """Teledyne's PD6: `:BI,x,y,z,error,status`, mm/s, A for valid. It has no checksum: every field is looked at."""
    name, *fields = text.split(",")
    if name != ":BI":
        if name in (":SA", ":TS", ":WI", ":WS", ":WE", ":WD", ":BS", ":BE", ":BD", ":RA"):
            return []
        raise BadLine("no such PD6 line")
    if len(fields) != 5 or fields[4] not in ("A", "V"):
        raise BadLine("PD6 line of the wrong shape")
    velocity = [_number(field) * 1e-3 for field in fields[:3]]
    return [_reading("dvl", None, velocity if fields[4] == "A" else [math.nan] * 3)]


def _from_wrz(text: str) -> list[Reading]:
    """Water Linked's `wrz` report of the velocity; its time of validity is the device's clock, microseconds."""
    name, *fields = _checked(text, _crc8)
    if name != "wrz":
        return []
    if len(fields) != 11:
        raise BadLine("wrz of the wrong shape")
    device = round(_number(fields[7]) * 1000)
    if not 0 <= device < LATEST * 1_000_000_000:
        raise BadLine("absurd time")
    if fields[3] != "y":
        return [_reading("dvl", device, [math.nan] * 3)]
    return [_reading("dvl", device, [*(_number(field) for field in fields[:3]), _number(fields[5]) ** 2])]


_FIELDS: dict[Kind, tuple[tuple[str, int, bool], ...]] = {
    "encoder": (("angle", 1, True),),
    "imu": (("rate", 3, True), ("force", 3, True), ("attitude", 4, False)),
    "pressure": (("pressure", 1, True),),
    "dvl": (("velocity", 3, True), ("variance", 1, False)),
}  # name, how many numbers, whether it has to be there


def _from_json(text: str) -> Reading:
    """`{"sensor": "imu", "time": 12.5, "rate": [..], "force": [..]}`"""
    try:
        found = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise BadLine("not JSON") from error
    kind = found.get("sensor") if isinstance(found, dict) else None
    if kind not in KINDS:
        raise BadLine("JSON without a known sensor")
    values: list[float] = []
    for name, count, needed in _FIELDS[kind]:
        value = found.get(name)
        if kind == "dvl" and name == "velocity" and value is None and name in found:
            values += [math.nan] * 3
        elif value is not None or needed:
            values += _numbers(value, count)
    return _reading(kind, _device_ns(found.get("time")), values)


def _no_constant(name: str) -> float:
    raise ValueError(name)


def _numbers(value: Any, count: int) -> list[float]:
    listed = value if isinstance(value, list) else [value]
    if len(listed) != count:
        raise BadLine("wrong number of values")
    return [_number(one) for one in listed]


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, str | int | float) or "_" in str(value):
        raise BadLine("not a number")
    try:
        number = float(value)
    except (ValueError, OverflowError) as error:
        raise BadLine("not a number") from error
    if not math.isfinite(number):
        raise BadLine("not a finite number")
    return number


def _device_ns(value: Any) -> int | None:
    """Seconds to nanoseconds; empty or missing where the device has no clock."""
    if value is None or value == "":
        return None
    seconds = _number(value)
    if not 0.0 <= seconds < LATEST:
        raise BadLine("absurd time")
    return round(seconds * 1e9)


def _reading(kind: Kind, device_ns: int | None, values: list[float]) -> Reading:
    limits = _LIMITS[kind]
    if kind == "imu" and len(values) == 10:
        length = math.hypot(*values[6:])
        if not 0.5 < length < 2.0:
            raise BadLine("no attitude quaternion")
        values[6:] = [value / length for value in values[6:]]
    elif kind == "dvl" and len(values) == 4:
        if not 0.0 <= values[3] < 2500.0:
            raise BadLine("absurd variance")
    elif len(values) != len(limits):
        raise BadLine("wrong number of values")
    if any(abs(value) > limit for value, limit in zip(values, limits, strict=False)):  # NaN is not: no bottom
        raise BadLine("absurd value")
    if kind == "pressure" and values[0] < 0.0:
        raise BadLine("negative pressure")
    return Reading(kind, device_ns, tuple(values))
