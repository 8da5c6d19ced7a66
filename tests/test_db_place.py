"""A further dive finds its place in the map: from its relief alone, whatever moved meanwhile; or it says that it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import Rotation

from garbi_map.db import PlaceSettings
from garbi_map.db.place import Placement, place
from garbi_map.register.surfels import Surfels
from garbi_map.seabed.relief import find_shifts

Floats = NDArray[np.float64]
STEP = 0.02  # m, of the ground's grid
SETTINGS = PlaceSettings()


def ground(seed: int, size: float = 4.0, relief: float = 0.03) -> Floats:
    """Heights (n, n) of a lumpy ground."""
    rng = np.random.default_rng(seed)
    rough = gaussian_filter(rng.normal(size=(round(size / STEP),) * 2), 0.08 / STEP, mode="wrap")
    return relief * rough / rough.std()


def seen(
    heights: Floats, low: tuple[float, float], high: tuple[float, float], seed: int, noise: float = 3e-4
) -> Surfels:
    """The patches that a scanner would make of a rectangle of the ground."""
    rng = np.random.default_rng(seed)
    count = round((high[0] - low[0]) * (high[1] - low[1]) / 0.025**2)
    place_of = rng.uniform(low, high, (count, 2))
    at = (place_of / STEP).T[::-1]
    slope_y, slope_x = np.gradient(heights, STEP)
    z, sx, sy = (map_coordinates(grid, at, order=1, mode="nearest") for grid in (heights, slope_x, slope_y))
    normal = np.column_stack([-sx, -sy, np.ones(count)])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    mean = np.column_stack([place_of, z + noise * rng.normal(size=count)])
    return Surfels(mean, normal, np.zeros(count), np.zeros(count, np.int64), np.full(count, noise))


def moved(surfels: Surfels, turn: Rotation, shift: Floats) -> Surfels:
    """The same patches as another dive's frame has them."""
    return Surfels(
        turn.apply(surfels.mean) + shift, turn.apply(surfels.normal), surfels.time, surfels.sweep, surfels.thickness
    )


def error_mm(found: Placement, turn: Rotation, shift: Floats, true: Floats) -> float:
    """Median distance of points from where they belong."""
    other = turn.apply(true) + shift
    back = other @ found.transform[:3, :3].T + found.transform[:3, 3]
    return 1e3 * float(np.median(np.linalg.norm(back - true, axis=1)))


@pytest.mark.parametrize("heading", [3.0, -14.0, 130.0])
def test_dive_is_laid_on_the_ground_it_saw_before(heading: float) -> None:
    """Metres away, turned, tilted a little and at another depth: back within a tenth of a millimetre."""
    heights = ground(1)
    known, again = seen(heights, (0.5, 0.5), (2.6, 2.6), 2), seen(heights, (1.5, 1.2), (3.4, 3.2), 3)
    turn = Rotation.from_euler("zyx", [heading, 0.3, -0.2], degrees=True)
    shift = np.array([40.0, -25.0, 0.35])
    found = place(known, moved(again, turn, shift), SETTINGS)
    assert isinstance(found, Placement)
    assert error_mm(found, turn, shift, again.mean) < 0.2
    assert found.agreement > 0.9 and 1.2 < found.overlap < 1.8
    assert found.residual < 6e-4


def test_what_moved_between_the_dives_does_not_pull() -> None:
    """A fifth of the ground is 5 cm higher and 3 cm aside in the second dive."""
    heights = ground(4)
    known, again = seen(heights, (0.5, 0.5), (3.0, 3.0), 5), seen(heights, (0.5, 0.5), (3.0, 3.0), 6)
    changed = again.mean[:, 0] < 1.0
    again.mean[changed] += [0.0, 0.03, 0.05]
    turn, shift = Rotation.from_euler("z", 4, degrees=True), np.array([1.0, 2.0, 0.0])
    found = place(known, moved(again, turn, shift), SETTINGS)
    assert isinstance(found, Placement)
    assert error_mm(found, turn, shift, again.mean) < 0.2
    assert 0.7 < found.agreement < 0.85


def test_another_site_has_no_place() -> None:
    """Ground of the same kind, but not the same ground."""
    found = place(seen(ground(1), (0, 0), (3, 3), 2), seen(ground(9), (0, 0), (3, 3), 3), SETTINGS)
    assert found == "they have no ground in common that can be recognised"


def test_level_floor_has_no_place() -> None:
    """Every place on it looks the same."""
    flat = np.zeros((200, 200))
    assert isinstance(place(seen(flat, (0, 0), (3, 3), 2), seen(flat, (0, 0), (3, 3), 3), SETTINGS), str)


def test_ripples_alone_are_ambiguous() -> None:
    """A pattern that repeats fits in more than one place: refused rather than guessed."""
    x = np.arange(0, 4, STEP)
    ripples = np.tile(0.01 * np.cos(2 * np.pi * x / 0.16), (len(x), 1))
    assert isinstance(place(seen(ripples, (0, 0), (3, 3), 2), seen(ripples, (1, 1), (3, 3), 3), SETTINGS), str)


def test_nothing_seen_has_no_place() -> None:
    """A dive without a patch."""
    known = seen(ground(1), (0, 0), (2, 2), 2)
    assert isinstance(place(known, known.select(np.zeros(len(known.mean), bool)), SETTINGS), str)


def test_correlation_finds_the_shift_of_a_cut() -> None:
    """The best guess is within a cell."""
    heights = ground(3)
    known, part = seen(heights, (0, 0), (4, 4), 1), seen(heights, (1.0, 2.0), (2.2, 3.2), 2)
    shifted = part.mean - [3.0, 1.0, 7.0]
    best = find_shifts(known.mean, shifted, np.array([-0.1, 0.0, 0.1]), 0.03, 0.1, 5)[0]
    assert best.heading == 0.0 and best.evidence > 50
    np.testing.assert_allclose(best.shift, [3.0, 1.0], atol=0.03)
