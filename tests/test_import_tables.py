"""Tables are read by their headings, units and all; a bad line is told by its number."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from garbi_map.errors import GarbiError
from garbi_map.importing.quantities import DEPTH, ENCODER, FORCE, PRESSURE, RATE, VELOCITY, heading, match
from garbi_map.importing.table import read_table
from garbi_map.importing.tables import read_angles, read_imu, read_mount_file, read_odometry, read_pressure


def table(path: Path, text: str) -> Path:
    """A file with this text."""
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        "time_s,angle_rad\n1.5,0.5\n2.5,1.0\n",
        "stamp_ns;alpha [rad]\n1500000000;0.5\n2500000000;1.0\n",
        "Timestamp (ms)\tEncoder (deg)\n1500\t28.64788975654116\n2500\t57.29577951308232\n",
        "#t_us  position_rad  note\n1500000 0.5 x\n# a remark\n\n2500000 1.0 y\n",
        '\ufeff"time_s","angle_degrees"\n"1.5","28.64788975654116"\n2.5,57.29577951308232\n',
    ],
)
def test_headings_units_and_delimiters(tmp_path: Path, text: str) -> None:
    """The same angles in five dialects."""
    found = read_table(table(tmp_path / "a.csv", text), [ENCODER])
    assert found.time.tolist() == [1_500_000_000, 2_500_000_000]
    np.testing.assert_allclose(found.numbers["angle"], [0.5, 1.0], rtol=1e-15)


def test_times_keep_their_nanoseconds(tmp_path: Path) -> None:
    """Seconds since 1970 with nine digits behind the point do not go through a float."""
    found = read_table(table(tmp_path / "a.csv", "time_s,angle_rad\n1790000000.123456789,0\n"), [ENCODER])
    assert found.time.tolist() == [1_790_000_000_123_456_789]


@pytest.mark.parametrize(
    ("text", "quantity", "name", "unit"),
    [
        ("wx_deg_s", RATE[0], "rate_x", "deg/s"),
        ("gyro_x [rad/s]", RATE[0], "rate_x", "rad/s"),
        ("w_RS_S_x [rad s^-1]", RATE[0], "rate_x", "rad/s"),
        ("a_RS_S_x [m s^-2]", FORCE[0], "force_x", "m/s2"),
        ("accel_x_g", FORCE[0], "force_x", "g"),
        ("ax_m_s2", FORCE[0], "force_x", "m/s2"),
        ("ax", FORCE[0], "force_x", "m/s2"),
        ("vx_m_s", VELOCITY[0], "velocity_x", "m/s"),
        ("Pressure (mbar)", PRESSURE, "pressure", "hpa"),
        ("depth", DEPTH, "depth", "m"),
    ],
)
def test_what_headings_mean(text: str, quantity: object, name: str, unit: str) -> None:
    """Usual names and units of IMUs and the like."""
    assert quantity.name == name  # type: ignore[attr-defined]
    assert match(quantity, *heading(text)) == unit  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "empty; wanted is a heading line such as time_s,angle_rad"),
        ("1.5,0.5\n2.5,1\n", "line 1: numbers instead of headings; begin the file with, say, time_s,angle_rad"),
        ("time,angle_rad\n", "line 1: column time without a unit; name it time_ns"),
        ("time_s,angle\n", "line 1: column angle without a unit; name it angle_rad or so \\(rad or deg\\)"),
        ("time_s,angle [gon]\n", "line 1: column angle in 'gon'; name it angle_rad"),
        ("time_s,pressure_pa\n", "line 1: no column angle; name one angle_rad"),
        ("time_s,angle_rad,alpha_rad\n", "line 1: 2 columns could be angle"),
        ("time_s,angle_rad\n", "no rows"),
        ("time_s,angle_rad\n1,2\n\n2\n", "line 4: 1 cells, the heading has 2; correct or remove"),
        ("time_s,angle_rad\n1,two\n", "line 2: angle is 'two', not a number; correct or remove"),
        ("time_s,angle_rad\n1,1_0\n", "line 2: angle is '1_0', not a number"),
        ("time_s,angle_rad\n1,nan\n", "line 2: angle is 'nan', not a number"),
        ("time_s,angle_rad\n1,\n", "line 2: angle is '', not a number"),
        ("time_s,angle_rad\n-1,0\n", "line 2: time is '-1', not a time"),
        ("time_s,angle_rad\n1e30,0\n", "line 2: time is '1e30', not a time"),
        ("time_s,angle_rad\n1790000000123,0\n", "line 2: time is '1790000000123'"),
        ("time_s,angle_rad\n2,0\n1.5,0\n", "line 3: its time goes back by 0.5 s; sort the rows"),
        ("time_s,angle_rad\n2,0\n2,0\n", "line 3: its time repeats that of the line before"),
    ],
)
def test_bad_lines(tmp_path: Path, text: str, told: str) -> None:
    """Line, what is wrong, what to do: one line for each mistake."""
    with pytest.raises(GarbiError, match=told) as error:
        read_table(table(tmp_path / "a.csv", text), [ENCODER])
    assert "\n" not in str(error.value)
    assert "a.csv" in str(error.value)


def test_no_text(tmp_path: Path) -> None:
    """A binary file, one line without an end, a folder, nothing."""
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00\x80" * 100)
    (tmp_path / "long.csv").write_text("x" * 100_000)
    for name, told in (("b.csv", "UTF-8"), ("long.csv", "line 1: longer"), (".", "directory"), ("none.csv", "No such")):
        with pytest.raises(GarbiError, match=told):
            read_table(tmp_path / name, [ENCODER])


def test_imu_with_and_without_attitude(tmp_path: Path) -> None:
    """Units are applied; an attitude of its own is interpolated to the IMU; a part of a quaternion is an error."""
    rows = "".join(f"{0.1 * n:.1f},0,0,180,0,0,1\n" for n in range(1, 6))
    imu = table(tmp_path / "imu.csv", "time_s,wx_deg_s,wy_deg_s,wz_deg_s,ax_g,ay_g,az_g\n" + rows)
    turns = table(tmp_path / "rpy.csv", "time_s,roll_deg,pitch_deg,yaw_deg\n0.1,0,0,0\n0.5,0,0,40\n")
    found = read_imu(imu, turns)
    assert found is not None
    np.testing.assert_allclose(found.rate[:, 2], math.pi)
    np.testing.assert_allclose(found.specific_force[:, 2], 9.80665)
    np.testing.assert_allclose(
        2 * np.degrees(np.arctan2(found.attitude[:, 2], found.attitude[:, 3])), [0, 10, 20, 30, 40]
    )
    alone = read_imu(None, turns)
    assert alone is not None
    assert np.isnan(alone.rate).all()
    with pytest.raises(GarbiError, match="line 1: no column qy"):
        read_imu(None, table(tmp_path / "q.csv", "time_s,qx,qz,qw\n1,0,0,1\n"))
    with pytest.raises(GarbiError, match="line 2: qx, qy, qz, qw are no rotation"):
        read_imu(None, table(tmp_path / "q.csv", "time_s,qx,qy,qz,qw\n1,0,0,0,0\n"))


def test_depth_is_pressure(tmp_path: Path) -> None:
    """Ten metres of sea water."""
    found = read_pressure(table(tmp_path / "d.csv", "time_s,depth_m\n1,10\n"))
    np.testing.assert_allclose(found.pressure, 101325 + 1025 * 9.80665 * 10)
    with pytest.raises(GarbiError, match="neither pressure nor depth"):
        read_pressure(table(tmp_path / "d.csv", "time_s,altitude_m\n1,10\n"))


def test_a_trajectory_in_tum_columns(tmp_path: Path) -> None:
    """Blank-separated, headed by a comment."""
    text = "# timestamp_s x y z qx qy qz qw\n1.0 1 2 3 0 0 0 1\n2.0 2 3 4 0 0 1 0\n"
    found = read_odometry(table(tmp_path / "t.tum", text))
    np.testing.assert_array_equal(found.position, [[1, 2, 3], [2, 3, 4]])
    np.testing.assert_array_equal(found.quaternion[1], [0, 0, 1, 0])


@pytest.mark.parametrize(
    "text", ["", "[]", "imu_link: 3", "imu_link: {xyz: [1, 2]}", "imu_link: {xyz: [.nan, 0, 0]}", "a: ["]
)
def test_mounts_that_are_none(tmp_path: Path, text: str) -> None:
    """Each in one line that says what to give."""
    with pytest.raises(GarbiError, match=r"m\.yaml"):
        read_mount_file(table(tmp_path / "m.yaml", text))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.one_of(
        st.binary(max_size=300),
        st.text(max_size=300).map(lambda text: text.encode("utf-8", "replace")),
        st.lists(st.lists(st.sampled_from(["time_s", "angle_rad", "1", "2.5", "-3e400", "nan", '"', "", "image", "é"])))
        .map(lambda rows: "\n".join(",".join(row) for row in rows).encode()),
    ),
    st.booleans(),
)  # fmt: skip
def test_any_bytes_at_all(tmp_path: Path, data: bytes, headed: bool) -> None:
    """A table or one line of error, nothing else."""
    path = tmp_path / "fuzz.csv"
    path.write_bytes((b"time_s,angle_rad\n" if headed else b"") + data)
    try:
        found = read_angles(path)
    except GarbiError as error:
        assert "\n" not in str(error)
        assert "fuzz.csv" in str(error)
    else:
        assert len(found.time) == len(found.lines) > 0
        assert np.all(np.diff(found.time) > 0)
        assert all(np.isfinite(values).all() for values in found.numbers.values())
