"""Where a map is weak, said in words: on maps whose weakness was put there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from garbi_map.export import plain_verdict, weak_places
from garbi_map.export.drift import correction
from garbi_map.export.weak import holes_inside, outline, sweeps_about, where
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.register import Agreement
from garbi_map.seabed import Seabed, fill_holes
from garbi_map.words import angle, length, many, percent

CELL = 0.005
ROWS, COLUMNS = 200, 300


def even(rows: int = ROWS, columns: int = COLUMNS) -> Seabed:
    """1 m by 1.5 m, every cell with nine points of three sweeps and 0.2 mm of doubt; x from -0.5 m, y from 2 m."""
    shape = (rows, columns)
    return Seabed(
        (-0.5, 2.0),
        CELL,
        np.zeros(shape, np.float32),
        np.full(shape, 2e-4, np.float32),
        np.full(shape, 9, np.int32),
        np.full(shape, 1e-4, np.float32),
        np.full(shape, 100, np.float32),
        np.full(shape, 3, np.int32),
    )


def pairs(after: float = 1e-4, before: float = 2e-3, seabed: Seabed | None = None) -> Agreement:
    """A thousand places all over the map."""
    rng = np.random.default_rng(0)
    place = rng.uniform([-0.5, 2.0], [1.0, 3.0], (1000, 2)).astype(np.float32)
    one = np.ones(1000, np.float32)
    return Agreement(place, before * one, after * one, (-11.0, -12.0))


def without(seabed: Seabed, rows: slice, columns: slice) -> Seabed:
    """The map with a rectangle that nothing saw."""
    density, elevation, sweeps = seabed.density.copy(), seabed.elevation.copy(), seabed.sweeps.copy()
    density[rows, columns], sweeps[rows, columns], elevation[rows, columns] = 0, 0, np.nan
    return replace(seabed, density=density, elevation=elevation, sweeps=sweeps)


def test_an_even_map_is_weak_nowhere() -> None:
    """No line."""
    assert weak_places(even(), pairs(), 0.02) == []


def test_a_corner_seen_once_is_named() -> None:
    """Share, area and corner."""
    sweeps = even().sweeps.copy()
    sweeps[-40:, -60:] = 1
    (line,) = weak_places(replace(even(), sweeps=sweeps), pairs(), 0.02)
    assert line.startswith("4 % of the area (")
    assert "seen by one sweep only, mostly in the north-east corner" in line


def test_a_sweep_that_saw_the_neighbour_saw_the_cell() -> None:
    """Rows of points are farther apart than cells are wide: every second cell alone is no weakness."""
    sweeps = even().sweeps.copy()
    sweeps[::2] = 1
    seabed = replace(even(), sweeps=sweeps)
    assert weak_places(seabed, pairs(), 0.02) == []
    assert sweeps_about(seabed).min() == 3


def test_a_hole_is_found_where_it_is() -> None:
    """A square of 10 cm, its middle at x = 0.25 m, y = 2.4 m; a scratch of 1 cm is none."""
    seabed = without(without(even(), slice(70, 90), slice(140, 160)), slice(20, 22), slice(20, 200))
    (line,) = weak_places(seabed, pairs(), 0.02)
    assert "inside the outline was not seen" in line
    assert "one hole of 100 cm² about x = 0.25 m, y = 2.40 m" in line
    assert holes_inside(seabed, outline(seabed), 0.02).sum() == 400


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.05, 0.9), width=st.integers(0, 9))
def test_holes_are_what_is_not_interpolated(seed: int, share: float, width: int) -> None:
    """The same cells that the hillshade and the mesh leave open."""
    unseen = np.random.default_rng(seed).uniform(size=(30, 40)) < share
    seabed = even(30, 40)
    elevation = np.where(unseen, np.float32(np.nan), seabed.elevation)
    seabed = replace(seabed, elevation=elevation, density=np.where(unseen, 0, seabed.density).astype(np.int32))
    filled, _ = fill_holes(elevation, width)
    everywhere = np.ones_like(unseen)
    assert np.array_equal(holes_inside(seabed, everywhere, width * CELL), np.isnan(filled))


def test_an_inlet_is_a_hole_and_the_sea_is_not() -> None:
    """A slit of 6 cm from the rim inward is inside the outline; a bay of half a metre is outside."""
    slit = without(even(), slice(100, 112), slice(150, 300))
    assert outline(slit)[100:112, 150:290].all()
    bay = without(even(), slice(50, 150), slice(150, 300))
    assert not outline(bay)[100, 250]


def test_doubt_and_disagreement_are_located() -> None:
    """Cells of 1 mm in the west, sweeps a millimetre apart at the southern edge's middle."""
    uncertainty = even().uncertainty.copy()
    uncertainty[:, :40] = 1e-3
    found = pairs()
    far = (found.place[:, 1] < 2.3) & (np.abs(found.place[:, 0] - 0.25) < 0.2)
    apart = replace(found, after=np.where(far, np.float32(1e-3), found.after))
    lines = weak_places(replace(even(), uncertainty=uncertainty), apart, 0.02)
    assert "is less sure than 0.6 mm" in lines[0] and "mostly in the western third" in lines[0]
    assert "more than 0.5 mm apart" in lines[1] and "mostly at the southern edge" in lines[1]


def test_few_points_are_counted_as_surveyors_do() -> None:
    """Five points in 95 % of the cells are enough."""
    density = even().density.copy()
    density[:9] = 4  # 4.5 %
    assert weak_places(replace(even(), density=density), pairs(), 0.02) == []
    density[:30] = 4
    (line,) = weak_places(replace(even(), density=density), pairs(), 0.02)
    assert line.startswith("15 % of the cells of 5 mm hold fewer than 5 points")


def test_everywhere_is_nowhere_in_particular() -> None:
    """A mask like the map is spread over it; a frame is its rim."""
    known = even().known
    assert where(known, known, known) == "spread over the map"
    frame = known.copy()
    frame[10:-10, 10:-10] = False
    assert where(frame, known, known) == "mostly along the rim"


@pytest.mark.parametrize(
    ("after", "before", "words"),
    [(1e-4, 2e-3, "was found and removed"), (1e-3, 1.1e-3, "little drift"), (3e-3, 1e-3, "Look twice")],
)
def test_the_verdict_follows_the_numbers(after: float, before: float, words: str) -> None:
    """Better, the same, worse."""
    said = plain_verdict(even(), pairs(after, before), 0)
    assert words in said and length(after) in said and length(before) in said
    assert "left out" not in said and "left out" in plain_verdict(even(), pairs(), 2)


def test_without_overlap_nothing_is_claimed() -> None:
    """The verdict and the list say that nothing checks the path."""
    none = Agreement(np.empty((0, 2), np.float32), np.empty(0, np.float32), np.empty(0, np.float32), (np.nan, np.nan))
    assert "nothing checks" in plain_verdict(even(), none, 0)
    assert weak_places(even(), none, 0.02) == ["No two sweeps overlap: nothing checks the path anywhere."]


def test_the_drift_is_told_apart_from_one_turn_of_the_map() -> None:
    """Navigation that is turned by 4 degrees and drifts by 5 cm to the map's north: heading 4 degrees, drift 5 cm."""
    count = 200
    stamp = np.arange(count) * 100_000_000
    share = np.linspace(0, 1, count)[:, None]
    rotation = Rotation.from_euler("ZYX", np.c_[0.5 + 0.3 * share, 0.05 * share, 0.03 * np.sin(9 * share)])
    covariance = np.tile(np.diag([1e-4, 4e-4, 1e-6, 1e-6, 1e-6, 1e-4]), (count, 1, 1))
    path = share * [2.0, 0.4, 0.0] + [1.0, -1.0, -10.0]
    true = Trajectory(stamp, path, rotation.as_quat(), covariance)
    turn = Rotation.from_euler("z", -4, degrees=True)
    off = turn.apply(path - path[0] - share * [0.0, 0.05, 0.0]) + path[0]
    found = correction(Trajectory(stamp, off, (turn * rotation).as_quat(), covariance), true)
    assert np.rad2deg(found.heading) == pytest.approx(4.0, abs=1e-6)
    assert found.position[-1] == pytest.approx([0.0, 0.05, 0.0], abs=1e-9)
    assert np.abs(found.attitude).max() < 1e-9
    assert found.distance == pytest.approx(0.05 / np.sqrt(3), rel=0.01)
    assert found.position_sigma[0] == pytest.approx([0.01, 0.02, 1e-3], rel=0.02)


def test_numbers_read_as_a_person_writes_them() -> None:
    """Two digits, units that suit, singular and plural, never "0 %" of something."""
    assert [length(v) for v in (1.234e-4, 0.005, 0.0123, 0.4, 1.26, 12.3)] == [
        "0.12 mm", "5 mm", "1.2 cm", "40 cm", "1.3 m", "12 m"
    ]  # fmt: skip
    assert [percent(v) for v in (0, 0.0001, 0.004, 0.034, 0.5, 0.9999, 1)] == [
        "0 %", "less than 0.1 %", "0.4 %", "3 %", "50 %", "more than 99.9 %", "100 %"
    ]  # fmt: skip
    assert [many(1, "sweep"), many(7, "sweep"), many(0, "image"), many(2, "index", "indices"), many(1200, "row")] == [
        "1 sweep", "7 sweeps", "0 images", "2 indices", "1,200 rows"
    ]  # fmt: skip
    assert angle(0.123) == "0.12°"
