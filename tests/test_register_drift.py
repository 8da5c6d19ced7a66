"""The motion inside and between sweeps, on a floor and a path with formulas."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scanned_floor import (
    Dive,
    Suite,
    dive,
    flat,
    floor_error,
    position,
    register_dive,
    rotation,
    seconds,
    true_trajectory,
)

from garbi_map.evaluate import rigid_alignment
from garbi_map.navigate import NavigationResult, Trajectory
from garbi_map.register import Registered

CASES = {
    "with DVL": {"duration": 16.0, "sensors": ("attitude", "pressure", "dvl"), "suite": Suite(dvl=1e-3)},
    "without DVL": {"duration": 26.0, "sensors": ("attitude", "pressure")},
    "only the IMU's rates and forces": {"duration": 16.0, "sensors": ()},
    "another draw": {"duration": 16.0, "sensors": ("attitude", "pressure"), "seed": 1},
    "a third draw": {"duration": 16.0, "sensors": ("attitude", "pressure"), "seed": 2},
    "flat": {"duration": 16.0, "sensors": ("attitude", "pressure"), "floor": flat},
}


class Case(NamedTuple):
    dive: Dive
    registered: Registered
    navigated: NavigationResult


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """The registered dive of each name, made once."""
    made: dict[str, Case] = {}

    def get(name: str) -> Case:
        if name not in made:
            one = dive(tmp_path_factory.mktemp("floor"), **CASES[name])  # type: ignore[arg-type]
            made[name] = Case(one, *register_dive(one))
        return made[name]

    return get


@pytest.mark.parametrize(("name", "worse"), [("with DVL", 1.5), ("without DVL", 5.0), (list(CASES)[2], 5.0)])
def test_the_corrected_points_lie_on_the_true_floor(case, name, worse):
    """Within 0.5 mm in the median after one rigid alignment, as well as with the true poses but for a fifth; the
    navigation filter alone is several times worse, the more so without a DVL."""
    one, registered, navigated = case(name)
    error = floor_error(one, registered.trajectory)
    assert error < 5e-4
    assert error < 1.2 * floor_error(one, true_trajectory(one.store.stamps()))
    assert floor_error(one, navigated.trajectory) > worse * error


def test_overlapping_sweeps_agree_better_than_before(case):
    """The disagreement that is reported falls from that of the navigation filter to that of the points' noise."""
    before, after = case("without DVL").registered.agreement.median
    assert after < 2e-4 < 5e-3 < before


def test_the_constants_of_the_sensors_are_learnt(case):
    """The DVL's scale to 0.15 per cent; the accelerometer's bias, across only as well as the tilt is known, but upward to
    2 mm/s^2."""
    constants = case("with DVL").registered.constants
    scale, bias = constants["dvl_scale"], constants["accelerometer_bias"]
    assert (scale["unit"], bias["unit"]) == ("1", "m/s^2")
    assert 1.0 + scale["value"][0] == pytest.approx(1.0 / (1.0 + Suite().dvl_scale), abs=1.5e-3)
    assert bias["value"][2] == pytest.approx(Suite().force_bias[2], abs=2e-3)
    assert bias["value"][:2] == pytest.approx(Suite().force_bias[:2], abs=0.03)


def test_the_map_begins_where_the_filter_begins(case):
    """x and y of the first pose are the filter's, the height is the pressure's."""
    one, registered, navigated = case("without DVL")
    first = one.store.stamps()[:1]
    start = registered.trajectory.at(first).position[0]
    assert start[:2] == pytest.approx(navigated.trajectory.at(first).position[0, :2], abs=2e-3)
    assert start[2] == pytest.approx(position(seconds(first))[0, 2], abs=5e-3)


def errors_inside(trajectory: Trajectory, stamps: np.ndarray) -> np.ndarray:
    """Errors (n, 6) of position and attitude after the rigid alignment, every second."""
    turn, shift = rigid_alignment(trajectory.at(stamps), true_trajectory(stamps))
    some = stamps[::20]
    made, t = trajectory.at(some), seconds(some)
    off = position(t) - turn.apply(made.position) - shift
    return np.hstack([off, (rotation(t) * (turn * made.rotation).inv()).as_rotvec()])


def test_the_covariance_inside_the_map_is_consistent(case):
    """Over different dives and draws the squared normalised error per axis is one within a factor of two."""
    ratios = []
    for name in list(CASES)[:5]:
        one, registered, _ = case(name)
        error = errors_inside(registered.inside, one.store.stamps())
        information = np.linalg.inv(registered.inside.at(one.store.stamps()[::20]).covariance)
        ratios.append(np.einsum("ni,nij,nj->n", error, information, error).mean() / 6)
    assert 0.4 < np.mean(ratios) < 2.0
    assert min(ratios) > 0.15 and max(ratios) < 4.0


def test_a_flat_floor_says_what_it_does_not_know(case):
    """Without a DVL nothing holds x and y: their sigmas at the end are centimetres, tens of times the height's, as large as
    a third of the error or more; the map is as flat as the floor and nothing runs away."""
    one, registered, _ = case("flat")
    trajectory = registered.trajectory.at(one.store.stamps())
    sigma = np.sqrt(np.einsum("nii->ni", registered.trajectory.covariance)[-1])
    assert sigma[:2].min() > 0.02 > 20 * sigma[2]
    error = errors_inside(trajectory, one.store.stamps())
    assert np.linalg.norm(error[-1, :2]) < 8 * np.linalg.norm(sigma[:2])
    assert np.abs(trajectory.position[:, :2]).max() < 3.0
    assert floor_error(one, registered.trajectory) < 1.3 * floor_error(one, true_trajectory(one.store.stamps()))


def test_covariances_are_symmetric_and_positive(case):
    """Both of them; against the origin a pose is less sure than inside the map."""
    _, registered, _ = case("without DVL")
    for trajectory in (registered.trajectory, registered.inside):
        assert trajectory.covariance == pytest.approx(trajectory.covariance.transpose(0, 2, 1), abs=1e-12)
        assert np.linalg.eigvalsh(trajectory.covariance).min() > 0
    own, inside = (np.trace(t.covariance[-1, :3, :3]) for t in (registered.trajectory, registered.inside))
    assert inside < own
