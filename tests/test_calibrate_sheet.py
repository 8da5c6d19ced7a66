"""Which sheet the points support, whatever their residuals look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_rig_laser_window import behind, traced

from garbi_map.calibrate.sheet_models import compare_sheets
from garbi_map.rig import LaserWindow
from tools.bench.real_calibrations import turbot_points


def points_of(tilt: float | None, noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points in groups at 1 to 2 m on a sheet behind a fixed window tilted by so many degrees, or on a plane."""
    index = 1.335 if tilt is not None else 1.0
    out = Rotation.from_euler("z", np.radians(tilt or 0.0) + 0.25).as_matrix()[:, 0]
    glass = 1.49 if tilt is not None else 1.0
    rig = behind(LaserWindow("flat", tuple(out.tolist()), 0.04, 0.01, glass, index))
    places = [traced(rig, 0.25, f, r) for r in np.linspace(1, 2, 16) for f in np.linspace(-0.25, 0.25, 30)]
    points = np.array(places) + noise * np.random.default_rng(seed).normal(size=(480, 3))
    return points, np.repeat(np.arange(16), 30), rig.laser.apex


def test_a_plane_is_supported_where_it_is_one():
    """A richer model is not chosen for noise."""
    points, group, source = points_of(None, 5e-4)
    assert compare_sheets(points, group, source).supported == "plane"


@pytest.mark.parametrize("tilt", [10.0, 25.0])
def test_a_tilted_window_is_noticed_although_the_plane_fits_to_a_millimetre(tilt):
    """The plane's residuals are small; unseen groups say that it is wrong, by many standard errors."""
    points, group, source = points_of(tilt, 3e-4)
    test = compare_sheets(points, group, source)
    plane, cone, window = test.models
    assert plane.rms < 3e-3
    assert test.supported in ("cone", "window")
    assert test.gain[1] > 5.0
    assert max(cone.held_out, window.held_out) < 0.7 * plane.held_out


def test_the_window_model_is_exact_without_noise():
    """And the cone nearly."""
    test = compare_sheets(*points_of(20.0, 0.0))
    assert test.models[2].rms < 2e-5
    assert test.models[1].rms < 1e-4


def test_the_real_sheet_is_a_plane_as_far_as_its_points_tell(shared: Path):
    """23 segments of a real scanner: a cone is not supported beyond two standard errors."""
    points, segment = turbot_points(shared / "data" / "turbot")
    assert len(points) == 9971
    assert segment[-1] == 22
    test = compare_sheets(points[::8], segment[::8])
    assert test.supported == "plane"
    assert test.models[0].rms == pytest.approx(0.9e-3, abs=0.05e-3)
