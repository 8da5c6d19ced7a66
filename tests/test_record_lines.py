"""The lines that sensors send: what is sound is read, whatever else comes is refused with a reason and harms nothing."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from garbi_map.record.lines import LONGEST, BadLine, LineSplitter, Reading, nmea, parse_line
from tools.bench.fuzz_lines import fuzz

PROTOCOL = Path(__file__).resolve().parents[1] / "docs" / "record-protocol.md"
FINITE = st.floats(-9, 9).map(lambda value: round(value, 6))


def one(line: bytes) -> Reading:
    """The only reading of a line."""
    (reading,) = parse_line(line)
    return reading


@pytest.mark.parametrize(
    ("line", "kind", "device_ns", "values"),
    [
        (nmea("PGRB,ENC,12.5,0.25"), "encoder", 12_500_000_000, (0.25,)),
        (nmea("PGRB,ENC,,-0.25"), "encoder", None, (-0.25,)),
        (nmea("PGRB,IMU,1,1,2,3,4,5,6"), "imu", 1_000_000_000, (1, 2, 3, 4, 5, 6)),
        (nmea("PGRB,IMU,1,1,2,3,4,5,6,0,0,0,1"), "imu", 1_000_000_000, (1, 2, 3, 4, 5, 6, 0, 0, 0, 1)),
        (nmea("PGRB,PRS,1,101325"), "pressure", 1_000_000_000, (101325,)),
        (nmea("PGRB,DVL,1,0.1,0.2,0.3,0.01"), "dvl", 1_000_000_000, (0.1, 0.2, 0.3, 0.01)),
        (nmea("YXXDR,A,180.0,D,LASER"), "encoder", None, (math.pi,)),
        (nmea("YXXDR,P,1.5,B,DEPTH"), "pressure", None, (150_000.0,)),
        (b":BI,  100, -200,   50,    3,A", "dvl", None, (0.1, -0.2, 0.05)),
        (
            b"wrz,0.120,-0.400,2.000,y,1.30,1.855,1e-07;0;1.4;0;1.2;0;0.2;0;1e+09,7,14,123.00,1*50",
            "dvl",
            7000,
            (0.12, -0.4, 2.0, 1.855**2),
        ),
        (b'{"sensor": "pressure", "pressure": 2e5}', "pressure", None, (2e5,)),
        (b'{"sensor": "encoder", "time": 3, "angle": [0.5]}', "encoder", 3_000_000_000, (0.5,)),
    ],
)
def test_every_kind_of_line_is_read(line: bytes, kind: str, device_ns: int | None, values: tuple[float, ...]) -> None:
    """In SI units, with the device's clock where it sends one; the Water Linked line is their manual's example."""
    reading = one(line)
    assert (reading.kind, reading.device_ns) == (kind, device_ns)
    assert reading.values == pytest.approx(values, abs=1e-12)


@pytest.mark.parametrize(
    "line",
    [
        nmea("PGRB,DVL,1,,,"),
        b":BI,0,0,0,0,V",
        b'{"sensor": "dvl", "velocity": null}',
    ],
)
def test_a_dvl_that_does_not_see_the_bottom_is_a_reading_of_nothing(line: bytes) -> None:
    """NaN, which is what a log says then."""
    assert all(map(math.isnan, one(line).values))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (b"$PGRB,ENC,1,0.25*00", "checksum"),
        (b"$PGRB,ENC,1,0.25", "no checksum"),
        (nmea("PGRB,ENC,1,nan"), "finite"),
        (nmea("PGRB,ENC,1,1e400"), "finite"),
        (nmea("PGRB,ENC,1,1_0"), "not a number"),
        (nmea("PGRB,ENC,-1,0"), "absurd time"),
        (nmea("PGRB,ENC,1,0,0"), "wrong number"),
        (nmea("PGRB,XYZ,1,0"), "no such PGRB"),
        (nmea("PGRB,IMU,1,1e9,0,0,0,0,0"), "absurd value"),
        (nmea("PGRB,IMU,1,0,0,0,0,0,0,0,0,0,0"), "quaternion"),
        (nmea("PGRB,PRS,1,-5"), "negative"),
        (b":BI,1,2,3,A", "shape"),
        (b'{"sensor": "encoder", "angle": true}', "not a number"),
        (b'{"sensor": "encoder", "angle": NaN}', "not JSON"),
        (b'{"sensor": "encoder", "angle": ' + b"9" * 900 + b"}", "not a number"),
        (b'{"sensor": "rm -rf"}', "known sensor"),
        (b'{"a":' * 150, "not JSON"),
        (b"\xff\xfe\x00", "not text"),
        (b"x" * (LONGEST + 1), "too long"),
        (b"hello", "neither"),
    ],
)
def test_what_is_wrong_is_refused_with_a_reason(line: bytes, reason: str) -> None:
    """The reason is a few words, by which such lines are counted."""
    with pytest.raises(BadLine, match=reason) as refused:
        parse_line(line)
    assert len(str(refused.value)) < 40


def test_sound_lines_about_something_else_are_no_fault() -> None:
    """A GPS on the same wire."""
    assert parse_line(nmea("GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,")) == []
    assert parse_line(b":TS,26112207000000,35.0,+10.0,   1.0,1500.0,0") == []


def test_the_examples_of_the_protocol_are_what_is_read() -> None:
    """docs/record-protocol.md says nothing that is not so."""
    text = PROTOCOL.read_text()
    (sentence,) = re.findall(r"`(\$PGRB,ENC,\d[^`]*)`", text)
    assert one(sentence.encode()).values == (0.349066,)
    lines = re.findall(r'^    (\{"sensor".*\})$', text, re.MULTILINE)
    assert [one(line.encode()).kind for line in lines] == ["encoder", "imu", "pressure", "dvl"]


@settings(max_examples=300, deadline=None)
@given(line=st.binary(max_size=1100) | st.text(max_size=200).map(str.encode))
@example(line=b"$*")
@example(line=b"wr*00")
@example(line=b'{"sensor": "imu", "rate": [1,2,3], "force": [[[1]]], "attitude": {}}')
def test_no_bytes_do_any_harm(line: bytes) -> None:
    """Either readings with finite values, or BadLine; never another exception."""
    try:
        readings = parse_line(line)
    except BadLine:
        return
    for reading in readings:
        assert all(math.isfinite(value) or reading.kind == "dvl" for value in reading.values)


@settings(max_examples=150, deadline=None)
@given(
    body=st.sampled_from(["PGRB,ENC", "PGRB,IMU", "PGRB,PRS", "PGRB,DVL", "YXXDR", "GPGGA", ":BI", "wrz"]),
    fields=st.lists(
        st.text(st.characters(max_codepoint=127, exclude_characters="\n\r"), max_size=9) | FINITE.map(str), max_size=14
    ),
)
def test_no_fields_behind_a_right_checksum_do_any_harm(body: str, fields: list[str]) -> None:
    """A checksum says nothing about the sender's intentions."""
    text = ",".join([body, *fields])
    line = text.encode() if body[0] in ":w" else nmea(text)
    try:
        parse_line(line.strip())
    except BadLine as reason:
        assert str(reason)


NAMES = st.sampled_from(["sensor", "time", "angle", "rate", "force", "velocity", "pressure"])
JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(NAMES, inner, max_size=4),
    max_leaves=8,
)


@settings(max_examples=200, deadline=None)
@given(found=JSON, kind=st.sampled_from(["encoder", "imu", "pressure", "dvl", 3, None]))
def test_no_json_does_any_harm(found: object, kind: object) -> None:
    """Whatever lies where a number should."""
    body = {**found, "sensor": kind} if isinstance(found, dict) else {"sensor": kind, "angle": found, "velocity": found}
    try:
        parse_line(json.dumps(body).encode())
    except BadLine as reason:
        assert str(reason)


@settings(max_examples=100, deadline=None)
@given(values=st.lists(FINITE, min_size=1, max_size=20), cuts=st.lists(st.integers(0, 600), max_size=8))
def test_lines_come_out_whole_however_the_bytes_come_in(values: list[float], cuts: list[int]) -> None:
    """A serial port hands over what there is."""
    data = b"".join(nmea(f"PGRB,ENC,,{value}") for value in values)
    splitter, got, start = LineSplitter(), [], 0
    for cut in [*sorted(cuts), len(data)]:
        got += splitter.split(data[start:cut])
        start = max(start, cut)
    assert [one(line).values[0] for line in got] == values


def test_changed_lines_do_no_harm() -> None:
    """What the bench does a million times, three thousand times."""
    fuzzed = fuzz(3000)
    assert fuzzed.exceptions == 0 and fuzzed.readings > 300 and len(fuzzed.refused) > 10


def test_a_line_without_an_end_does_not_fill_the_memory() -> None:
    """A megabyte of garbage is one refused line, and the next line is read."""
    splitter = LineSplitter()
    refused = [line for _ in range(1000) for line in splitter.split(b"x" * 1000)]
    assert len(refused) == 1 and len(refused[0]) == LONGEST + 1
    assert splitter.split(b"xx\n" + nmea("PGRB,ENC,,1")) == [nmea("PGRB,ENC,,1").strip()]
