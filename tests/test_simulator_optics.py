"""The simulated images obey the physics that they claim."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from garbi_map.log.records import Floats
from tools.simulator.optics import Renderer, View
from tools.simulator.profiles import cast_stripe
from tools.simulator.rigs import make_rig
from tools.simulator.scenario import Camera, Scenario, Water, Window
from tools.simulator.sheet import plane_at

CLEAR = Water(absorption=0.0, scattering=0.0, backscatter=0.0, snow=0.0)
NIGHT = Camera(ambient=0.0)
UP = np.array([0.0, 0.0, 1.0])


def wall_at(distance: float, plate: float | None = None) -> View:
    """A wall square to the view, and perhaps a small plate half-way that hides a part of it from the camera alone."""

    def cast(origin: Floats, direction: Floats) -> tuple[Floats, Floats]:
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(direction[:, 0] > 1e-9, (distance - origin[:, 0]) / direction[:, 0], np.inf)
            if plate is not None:
                half = (distance / 2 - origin[:, 0]) / direction[:, 0]
                at = origin + half[:, None] * direction
                hit = (half > 0) & (np.abs(at[:, 1]) < plate) & (np.abs(at[:, 2]) < plate)
                reach = np.where(hit, half, reach)
        return reach, np.broadcast_to([-1.0, 0.0, 0.0], origin.shape)

    return View(cast, lambda points: np.full(len(points), 0.3, np.float32), UP)


def light(renderer: Renderer, view: View, alpha: float) -> NDArray[np.float64]:
    """Laser light (h, w) without the sensor's noise."""
    return renderer.light(view, alpha, np.random.default_rng(0))[0].astype(float)


def alpha_to_centre(renderer: Renderer, distance: float) -> float:
    """The laser angle at which the sheet meets the optical axis at a distance."""
    laser = renderer.rig.laser
    return float(np.arctan2(-laser.y, distance - laser.x) - laser.delta)


def centres(image: NDArray[np.float64]) -> tuple[NDArray[np.int64], Floats]:
    """Rows in which there is a stripe, and its centre of gravity within 8 px of the peak."""
    rows = np.flatnonzero(image.max(1) > 5)
    peak = image[rows].argmax(1)
    around = np.clip(peak[:, None] + np.arange(-8, 9), 0, image.shape[1] - 1)
    weight = image[rows[:, None], around]
    return rows, (weight * around).sum(1) / weight.sum(1)


@pytest.mark.parametrize("port", [None, Window()])
def test_the_stripe_is_where_the_rig_projects_the_sheet(port: Window | None) -> None:
    """Without noise the rendered centre lies within 0.02 px of where sheet and wall meet, port included."""
    scenario = Scenario(water=CLEAR, camera=Camera(ambient=0.0, port=port))
    renderer = Renderer(scenario, make_rig(scenario))
    rig = renderer.rig
    alpha = alpha_to_centre(renderer, 1.3)
    rows, centre = centres(light(renderer, wall_at(1.3), alpha))
    normal = rig.sheet(alpha)[0]
    z = np.linspace(-0.7, 0.7, 4000)
    y = (normal @ rig.laser.apex - normal[0] * 1.3 - normal[2] * z) / normal[1]
    pixel = rig.project(np.stack([np.full_like(z, 1.3), y, z], 1))
    order = np.argsort(pixel[:, 1])
    expected = np.interp(rows, pixel[order, 1], pixel[order, 0])
    inside = (rows > 8) & (rows < rig.camera.height - 9)
    assert inside.sum() > 500
    assert np.abs(centre - expected)[inside].max() < 0.02


@pytest.mark.parametrize("distance", [1.0, 1.8])
def test_water_dims_the_stripe_by_beer_and_lambert(distance: float) -> None:
    """Clear against absorbing water: exp(-c (way of the laser + way to the camera)), with the same power."""
    clear = Scenario(water=CLEAR, camera=NIGHT)
    dim = clear.model_copy(update={"water": CLEAR.model_copy(update={"absorption": 0.5})})
    rig = make_rig(clear)
    a, b = Renderer(clear, rig), Renderer(dim, rig)
    b.power = a.power
    alpha = alpha_to_centre(a, distance)
    row = rig.camera.height // 2
    bright, dark = light(a, wall_at(distance), alpha)[row], light(b, wall_at(distance), alpha)[row]
    there = rig.triangulate([(bright * np.arange(len(bright))).sum() / bright.sum()], [row], alpha).points[0]
    way = np.linalg.norm(there - rig.laser.apex) + np.linalg.norm(there - rig.camera.centre)
    assert dark.sum() / bright.sum() == pytest.approx(np.exp(-0.5 * way), rel=2e-3)


def test_what_is_hidden_from_the_camera_leaves_no_stripe() -> None:
    """A plate between camera and wall, clear of the sheet, blots out the rows behind it and no others."""
    scenario = Scenario(water=CLEAR, camera=NIGHT)
    renderer = Renderer(scenario, make_rig(scenario))
    rig = renderer.rig
    image = light(renderer, wall_at(1.2, plate=0.05), alpha_to_centre(renderer, 1.2))
    edge = rig.project(np.array([[0.6, 0.0, 0.05], [0.6, 0.0, -0.05]]))[:, 1]
    dark = np.flatnonzero(image.max(1) < 0.02 * image.max())
    assert abs(dark.min() - edge.min()) < 8
    assert abs(dark.max() - edge.max()) < 8
    assert (np.diff(dark) == 1).all()


def test_backscatter_lies_on_the_lasers_side() -> None:
    """The lit water between laser and wall shows on the right of the stripe, for the laser is on the right."""
    water = CLEAR.model_copy(update={"backscatter": 0.1})
    scenario = Scenario(water=water, camera=NIGHT)
    renderer = Renderer(scenario, make_rig(scenario))
    image = light(renderer, wall_at(1.2), alpha_to_centre(renderer, 1.2))
    row = image[image.shape[0] // 2]
    peak = int(row.argmax())
    assert row[peak + 20 : peak + 200].min() > 0.3
    assert row[: peak - 12].max() < 1e-3


def test_backscatter_has_the_level_of_single_scattering() -> None:
    """One pixel against the radiance integral: power / range, volume scattering, slant path through the sheet."""
    water = Water(absorption=0.2, scattering=0.0, backscatter=0.1, snow=0.0)
    scenario = Scenario(water=water, camera=NIGHT)
    renderer = Renderer(scenario, make_rig(scenario))
    rig = renderer.rig
    alpha = alpha_to_centre(renderer, 1.2)
    image = light(renderer, wall_at(1.2), alpha)
    u, v = 560, 300
    plane = plane_at(rig, alpha, scenario.laser)
    eye, sight = (value[0] for value in rig.rays([u], [v]))
    t = (plane.apex - eye) @ plane.normal / (sight @ plane.normal)
    r = np.linalg.norm(eye + t * sight - plane.apex)
    cosine = sight @ rig.camera.rotation[:, 2]
    solid = cosine**4 / (rig.camera.alpha_u * rig.camera.alpha_v)
    expected = renderer.power / r * 0.1 / abs(sight @ plane.normal) * np.exp(-0.2 * (r + t)) * solid
    assert image[v, u] == pytest.approx(expected, rel=2e-3)


def test_scattered_light_is_not_lost() -> None:
    """Small-angle scattering only moves light from the stripe to its skirt."""
    still = Scenario(water=CLEAR, camera=NIGHT)
    water = CLEAR.model_copy(update={"scattering": 0.3, "forward_sharpness": 1.0})
    hazy = still.model_copy(update={"water": water})
    rig = make_rig(still)
    a, b = Renderer(still, rig), Renderer(hazy, rig)
    b.power = a.power
    alpha = alpha_to_centre(a, 1.2)
    sharp, skirted = light(a, wall_at(1.2), alpha), light(b, wall_at(1.2), alpha)
    assert skirted.max() < 0.75 * sharp.max()
    assert 0.9 < skirted.sum() / sharp.sum() < 1.0  # the far ends of the skirt are cut


def test_the_operator_has_set_the_exposure() -> None:
    """The peak on mean ground at the stated range is the stated grey level, whatever the water."""
    for water in (CLEAR, Water(absorption=0.4, scattering=0.5, backscatter=0.0, snow=0.0, forward_sharpness=0.0)):
        scenario = Scenario(water=water, camera=NIGHT)
        renderer = Renderer(scenario, make_rig(scenario))
        image = light(renderer, wall_at(1.2), alpha_to_centre(renderer, 1.2))
        assert image.max() == pytest.approx(150.0, rel=0.05)


def test_cast_profiles_are_what_the_images_show() -> None:
    """The quick stripes and the rendered ones agree within the noise that the quick ones state."""
    scenario = Scenario(water=CLEAR, camera=NIGHT)
    renderer = Renderer(scenario, make_rig(scenario))
    alpha = alpha_to_centre(renderer, 1.2)
    rows, centre = centres(light(renderer, wall_at(1.2), alpha))
    stripe = cast_stripe(renderer, wall_at(1.2), alpha, 0, np.random.default_rng(3))
    _, one, other = np.intersect1d(rows[10:-10], stripe.row, return_indices=True)
    error = (stripe.u[other] - centre[10:-10][one]) / stripe.sigma[other]
    assert len(error) > 500
    assert abs(error.mean()) < 0.2
    assert 0.85 < error.std() < 1.15
