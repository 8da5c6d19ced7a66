"""Stripes become sweeps of points."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from rigs import WINDOW, make_rig
from test_sweep_angle import START, motor, recorded

from garbi_map.stripe.types import Stripe
from garbi_map.sweep import FixedAngle, LaserAngle, SweepLosses, SweepSettings, make_sweeps, write_sweeps

PLANE = np.array([0.8, 0.25, 0.2]) / 1.1  # plane . point = 1
SETTINGS = SweepSettings()


def lit(rig, alpha, plane=PLANE, rows=576):
    """Columns (rows,) at which the sheet's line on a plane is seen, from the line's points projected densely."""
    normal = rig.sheet(alpha)[0]
    start = np.linalg.lstsq(np.stack([normal, plane]), [normal @ rig.laser.apex, 1.0], rcond=None)[0]
    line = np.cross(normal, plane) / np.linalg.norm(np.cross(normal, plane))
    pixels = rig.project(start + np.linspace(-3.0, 3.0, 6001)[:, None] * line)
    pixels = pixels[np.isfinite(pixels[:, 0])]
    pixels = pixels[np.argsort(pixels[:, 1])]
    return np.interp(np.arange(rows), pixels[:, 1], pixels[:, 0])


def stripe(stamp_ns, u, row=None, sigma=0.05):
    row = np.arange(len(u)) if row is None else row
    inside = (u >= 0) & (u < 768)
    seen = u[inside].astype(np.float32)
    flat = np.ones_like(seen)
    return Stripe(stamp_ns, row[inside].astype(np.int32), seen, sigma * flat, 100 * flat, flat > 2)


def dive(rig, seconds=12.0, rate=25.0):
    """Stripes of a still vehicle over a slanting plane while the motor turns."""
    for time in np.arange(0.003, seconds, 1.0 / rate):
        yield stripe(START + round(time * 1e9), lit(rig, float(motor(time))))


@pytest.mark.parametrize("port", [None, WINDOW], ids=["bare", "port"])
def test_a_plane_comes_back_from_stripes_and_counts(port):
    """The whole room: points within 0.2 mm of the plane at 1.2 m, from counts of 0.01 degree."""
    rig = make_rig(port)
    sweeps = list(make_sweeps(dive(rig), rig, LaserAngle(recorded(), SETTINGS), SETTINGS))
    assert [sweep.index for sweep in sweeps] == [0, 1, 2, 3]
    for sweep in sweeps:
        off = (sweep.points @ PLANE - 1.0) / np.linalg.norm(PLANE)
        assert np.sqrt(np.mean(off**2)) < 2e-4
        assert np.all(np.diff(sweep.profile) >= 0)
        assert np.all((np.diff(sweep.row) > 0) | (np.diff(sweep.profile) > 0))
        assert np.all(np.diff(sweep.stamp_ns) > 0)
        assert sweep.sigma.min() > 0


def test_sweeps_end_where_the_laser_turns():
    """Cuts at 2, 6 and 10 s, and nothing is lost."""
    rig = make_rig()
    losses = SweepLosses()
    sweeps = list(make_sweeps(dive(rig), rig, LaserAngle(recorded(), SETTINGS), SETTINGS, losses))
    starts = np.array([sweep.stamp_ns[0] for sweep in sweeps[1:]])
    np.testing.assert_allclose((starts - START) * 1e-9, [2.0, 6.0, 10.0], atol=0.05)
    assert sum(len(sweep.stamp_ns) for sweep in sweeps) == 300
    for sweep in sweeps[1:-1]:
        assert np.all(np.diff(sweep.alpha) > -1e-3) or np.all(np.diff(sweep.alpha) < 1e-3)
    assert losses.lines() == []


def test_without_a_motor_sweeps_are_windows_of_time():
    """Every two seconds, from a laser at a fixed angle."""
    rig = make_rig()
    u = lit(rig, 0.3)
    stripes = [stripe(START + k * 40_000_000, u) for k in range(250)]
    sweeps = list(make_sweeps(stripes, rig, FixedAngle(0.3), SETTINGS))
    assert [len(sweep.stamp_ns) for sweep in sweeps] == [50] * 5


def test_a_slow_sweep_is_cut_at_the_longest():
    """A motor that turns for a minute in one direction."""
    rig = make_rig()
    encoder = recorded(seconds=60.0)
    slow = replace(encoder, angle=np.linspace(0.1, 0.5, len(encoder.angle)))
    u = lit(rig, 0.3)
    stripes = [stripe(START + k * 200_000_000, u) for k in range(299)]
    sweeps = list(make_sweeps(stripes, rig, LaserAngle(slow, SETTINGS), SETTINGS))
    assert [len(sweep.stamp_ns) for sweep in sweeps] == [75, 75, 75, 74]


def test_what_cannot_be_used_is_counted():
    """Gaps in the encoder, stamps that do not ascend, points out of range, sweeps in which nothing is seen."""
    rig = make_rig()
    stripes = list(dive(rig))
    stripes[150] = replace(stripes[150], stamp_ns=stripes[150].stamp_ns + 60_000_000_000)
    losses = SweepLosses()
    sweeps = list(make_sweeps(stripes, rig, LaserAngle(recorded(), SETTINGS), SETTINGS, losses))
    assert losses.profiles_without_angle == 1
    assert losses.profiles_out_of_order == 149
    assert len(sweeps) == 2
    assert len(losses.lines()) == 2

    empty = [stripe(START + k * 40_000_000, np.full(576, -1.0)) for k in range(100)]
    losses = SweepLosses()
    assert list(make_sweeps(empty, rig, LaserAngle(recorded(), SETTINGS), SETTINGS, losses)) == []
    assert losses.sweeps_too_small == 2

    far = [stripe(START, lit(rig, 0.1, PLANE / 10))]
    losses = SweepLosses()
    assert list(make_sweeps(far, rig, FixedAngle(0.1), SETTINGS, losses)) == []
    assert losses.points_out_of_range > 300


def test_flakes_go_and_thin_structures_stay():
    """A flake of 5 rows in front of the plane is dropped, a bar of 2 cm is kept, the rows at its edges are doubted."""
    rig = make_rig()
    u = lit(rig, 0.3)
    near = lit(rig, 0.3, PLANE / 0.8)
    rows_of_bar = int(0.02 * rig.camera.alpha_v / 1.0)
    u[100:105] = near[100:105]
    u[300 : 300 + rows_of_bar] = near[300 : 300 + rows_of_bar]
    losses = SweepLosses()
    settings = SweepSettings(least_points=1)
    (sweep,) = make_sweeps([stripe(START, u)], rig, FixedAngle(0.3), settings, losses)
    rows = set(sweep.row.tolist())
    assert rows.isdisjoint(range(100, 105))
    assert rows.issuperset(range(300, 300 + rows_of_bar))
    assert losses.points_alone == 5
    doubted = sweep.row[sweep.sigma > 5 * np.median(sweep.sigma)]
    end = 300 + rows_of_bar
    assert doubted.tolist() == [98, 99, 105, 106, 298, 299, 300, 301, end - 2, end - 1, end, end + 1]


def test_sigma_is_the_spread_of_noisy_stripes():
    """Points scatter along the ray by their sigma, from noise of the column and of the angle."""
    rig = make_rig()
    u = lit(rig, 0.3)
    rng = np.random.default_rng(6)
    stripes = [stripe(START + k * 40_000_000, u + rng.normal(0, 0.2, len(u)), sigma=0.2) for k in range(50)]
    (sweep,) = make_sweeps(stripes, rig, FixedAngle(0.3), SETTINGS)
    row, column = sweep.row, u[sweep.row]
    off = np.linalg.norm(sweep.points - rig.triangulate(column, row, 0.3).points, axis=1)
    assert np.sqrt(np.mean((off / sweep.sigma) ** 2)) == pytest.approx(1.0, abs=0.03)


def test_sweeps_are_written_as_clouds(tmp_path):
    """LAZ to 10 micrometres with time, intensity, sigma and row; the index lists them; nothing half-written is left."""
    import laspy

    rig = make_rig()
    sweeps = list(make_sweeps(dive(rig, 5.0), rig, LaserAngle(recorded(), SETTINGS), SETTINGS))
    assert write_sweeps(tmp_path / "out", iter(sweeps)) == 2
    index = json.loads((tmp_path / "out" / "sweeps.json").read_text())
    assert index["frame"] == "rig"
    for entry, sweep in zip(index["sweeps"], sweeps, strict=True):
        cloud = laspy.read(tmp_path / "out" / entry["file"])
        assert entry["points"] == len(sweep.points)
        assert entry["begin_ns"] == sweep.stamp_ns[0]
        np.testing.assert_allclose(cloud.xyz, sweep.points, atol=0.51e-5)
        np.testing.assert_allclose(cloud.gps_time, sweep.point_stamp_ns * 1e-9, atol=1e-6)
        np.testing.assert_array_equal(cloud.sigma, sweep.sigma)
        np.testing.assert_array_equal(cloud.row, sweep.row)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "sweep_0000.laz",
        "sweep_0001.laz",
        "sweeps.json",
    ]
    assert all(before["end_ns"] < after["begin_ns"] for before, after in pairwise(index["sweeps"]))
