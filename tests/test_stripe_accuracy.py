"""Where the stripe lies, and how well that is known, on images whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from garbi_map.stripe import GateSettings, StripeDetector, StripeSettings
from garbi_map.stripe.learn import LEAST_PIXELS
from tools.bench.stripe_images import AMPLITUDE, CONDITIONS, HEIGHT, SPREAD, expose, light, synthetic, true_columns

BY_NAME = {condition.name: condition for condition in CONDITIONS}


def errors(name: str, images: int = 3) -> tuple[NDArray, NDArray, int]:
    """Errors and sigmas of all rows found in some images of a condition, and how many rows were lost."""
    detector = StripeDetector(StripeSettings())
    error, sigma, lost = [], [], 0
    for seed in range(100, 100 + images):
        image, true = synthetic(BY_NAME[name], seed)
        stripe = detector.detect(image, 0)
        error.append(stripe.u - true[stripe.row])
        sigma.append(stripe.sigma)
        lost += HEIGHT - len(stripe.row)
    return np.concatenate(error).astype(float), np.concatenate(sigma).astype(float), lost


def rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("noise", [2, 5, 10, 20])
def test_clean_stripes_reach_the_single_row_bound(noise: int) -> None:
    """Within 5 %, and the sampling error of 1700 rows."""
    error, sigma, lost = errors(f"noise {noise}")
    bound = noise / AMPLITUDE * np.sqrt(2 * SPREAD / np.sqrt(np.pi))
    assert rms(error) < 1.05 * bound * (1 + 1 / np.sqrt(len(error)))
    assert abs(error.mean()) < 4 * bound / np.sqrt(len(error))
    assert lost < 0.005 * 3 * HEIGHT
    assert 0.8 < rms(error / sigma) < 1.25


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("halo 30 %, noise 5", 0.06),
        ("backscatter 15 %, noise 5", 0.10),
        ("backscatter 15 %, noise 5, logistic", 0.10),
        ("backscatter 40 %, halo 30 %, noise 10", 0.30),
        ("backscatter 40 %, halo 30 %, noise 10, logistic", 0.30),
    ],
)
def test_dirty_water_costs_little_and_sigma_says_so(name: str, allowed: float) -> None:
    """Bias included."""
    error, sigma, lost = errors(name)
    assert rms(error) < allowed
    assert 0.8 < rms(error / sigma) < 1.25
    assert lost == 0


@pytest.mark.parametrize("contrast", [0.15, 0.35, 0.6])
def test_sigma_holds_the_texture_of_the_ground(contrast: float) -> None:
    """A thin line on spotted ground, blurred by the lens: the spots move it by more than the noise does."""
    rng = np.random.default_rng(20)
    error, sigma = [], []
    for seed in range(4):
        true = true_columns(seed)
        spots = gaussian_filter(rng.standard_normal((HEIGHT, 768)), 6.0)
        albedo = np.exp(contrast * spots / spots.std())
        line = np.exp(-0.5 * ((np.arange(768)[None, :] - true[:, None]) / 1.3) ** 2)
        # The lens, without its mixing of rows, which moves a slanted stripe for another reason
        stripe = StripeDetector(StripeSettings()).detect(
            expose(gaussian_filter1d(line * albedo, 1.25) * 0.6, 2, seed), 0
        )
        error.append(stripe.u - true[stripe.row])
        sigma.append(stripe.sigma)
    off, stated = np.concatenate(error), np.concatenate(sigma)
    assert 0.8 < rms(off / stated) < 1.25
    assert rms(off) > 0.03


def test_a_second_reflection_is_kept_as_a_candidate_only() -> None:
    """Half as bright, beside the stripe all the way down."""
    true = true_columns(21)
    image = expose(light(true) + 0.5 * light(true + 37.0), 5, 22)
    detector = StripeDetector(StripeSettings())
    stripe = detector.detect(image, 0)
    assert len(stripe.row) == HEIGHT
    assert np.abs(stripe.u - true).max() < 0.5
    candidates = detector.candidates(image).u
    assert (np.isfinite(candidates).sum(axis=1) >= 2).mean() > 0.99


def test_lit_water_on_either_side_is_the_same_but_for_its_sign() -> None:
    """Mirrored images give mirrored columns."""
    image, _ = synthetic(BY_NAME["backscatter 15 %, noise 5"], 7)
    detector = StripeDetector(StripeSettings())
    there, back = detector.detect(image, 0), detector.detect(np.ascontiguousarray(image[:, ::-1]), 0)
    np.testing.assert_array_equal(there.row, back.row)
    np.testing.assert_allclose(there.u, 767 - back.u, atol=5e-3)


def test_the_column_is_right_wherever_the_stripe_lies_between_pixels() -> None:
    """No error that repeats with every pixel (peak locking)."""
    true = 300 + np.arange(HEIGHT) / HEIGHT * 4
    stripe = StripeDetector(StripeSettings()).detect(expose(light(true), 0.5, 3), 0)
    error = stripe.u - true
    phase = np.floor(true % 1 * 16).astype(int)
    assert max(abs(error[phase == p].mean()) for p in range(16)) < 0.004


@pytest.mark.parametrize("spread", [1.0, 1.4, 2.5, 4.0])
def test_the_width_is_learnt_from_the_image(spread: float) -> None:
    """Within 6 %, and the bound is reached for that width too."""
    detector = StripeDetector(StripeSettings())
    true = true_columns(4)
    image = expose(light(true, spread=spread), 6, 5)
    assert detector.candidates(image).spread == pytest.approx(spread, rel=0.06)
    error = detector.detect(image, 0).u - true
    assert rms(error) < 1.1 * 6 / AMPLITUDE * np.sqrt(2 * spread / np.sqrt(np.pi))


def test_a_clipped_stripe_is_still_centred_and_marked() -> None:
    """Three times too bright."""
    true = true_columns(6)
    image = expose(light(true), 4, 7, amplitude=600.0)
    stripe = StripeDetector(StripeSettings()).detect(image, 0)
    assert stripe.saturated.all()
    assert len(stripe.row) == HEIGHT
    assert rms(stripe.u - true[stripe.row]) < 0.06


def test_snow_beside_the_stripe_is_not_taken_for_it() -> None:
    """Round blobs, some of them brighter than the stripe, near it and far."""
    rng = np.random.default_rng(8)
    true = true_columns(8)
    lit = light(true) * 0.6
    v, u = np.mgrid[:HEIGHT, : lit.shape[1]]
    for _ in range(40):
        row, column = rng.uniform(0, HEIGHT), rng.uniform(20, 748)
        if abs(column - true[int(row)]) > 15:
            size = rng.uniform(1.2, 3)
            lit += rng.uniform(0.2, 1.2) * np.exp(-0.5 * ((u - column) ** 2 + (v - row) ** 2) / size**2)
    stripe = StripeDetector(StripeSettings()).detect(expose(lit, 4, 9), 0)
    error = np.abs(stripe.u - true[stripe.row])
    assert len(stripe.row) > 0.99 * HEIGHT
    assert (error > 3).mean() < 0.001


def test_a_broken_stripe_is_found_in_its_pieces() -> None:
    """A step of 40 px at a depth edge, and a gap where it is hidden."""
    true = np.where(np.arange(HEIGHT) < 200, 300.3, 340.8)
    lit = light(true)
    lit[400:450] = 0
    stripe = StripeDetector(StripeSettings()).detect(expose(lit, 5, 10), 0)
    assert not set(range(400, 450)) & set(stripe.row.tolist())
    assert len(stripe.row) >= HEIGHT - 50 - 2
    assert np.abs(stripe.u - true[stripe.row]).max() < 0.4


@pytest.mark.parametrize(("laser", "channel"), [("red", 2), ("blue", 0)])
def test_other_lasers_by_configuration(laser: str, channel: int) -> None:
    """The same image with its channels exchanged."""
    image, true = synthetic(BY_NAME["noise 5"], 11)
    turned = image.copy()
    turned[:, :, [1, channel]] = image[:, :, [channel, 1]]
    settings = StripeSettings.model_validate({"laser": laser})
    stripe = StripeDetector(settings).detect(turned, 0)
    assert len(stripe.row) == HEIGHT
    assert rms(stripe.u - true) < 0.042
    assert len(StripeDetector(StripeSettings()).detect(turned, 0).row) == 0


def test_a_mono_camera_gives_the_same_as_its_channel() -> None:
    """Green of a colour image, alone."""
    image, _ = synthetic(BY_NAME["noise 5"], 12)
    mono = StripeDetector(StripeSettings(laser="mono")).detect(np.ascontiguousarray(image[:, :, 1]), 0)
    np.testing.assert_array_equal(mono.u, StripeDetector(StripeSettings()).detect(image, 0).u)


def test_a_lamp_is_not_the_laser() -> None:
    """A bright line of another colour passes no gate."""
    true = true_columns(13)
    image = expose(light(true), 3, 14)
    warm = np.stack([image[:, :, 2], image[:, :, 1] // 2, image[:, :, 1]], axis=2)
    assert len(StripeDetector(StripeSettings()).detect(warm, 0).row) == 0
    everything = StripeSettings(gate=GateSettings(hue=(0, 360), lightness=0, saturation=0))
    assert len(StripeDetector(everything).detect(warm, 0).row) > LEAST_PIXELS


def test_an_empty_image_gives_an_empty_stripe() -> None:
    """Black, white, and noise."""
    detector = StripeDetector(StripeSettings())
    noise = np.random.default_rng(15).integers(0, 40, (HEIGHT, 768, 3), np.uint8)
    for image in (np.zeros((HEIGHT, 768, 3), np.uint8), np.full((HEIGHT, 768, 3), 255, np.uint8), noise):
        assert len(detector.detect(image, 0).row) == 0


def test_the_papers_method_stays_selectable() -> None:
    """On a stripe without noise both agree."""
    true = true_columns(16)
    image = expose(light(true), 0.0, 17, black=0.0)
    paper = StripeDetector(StripeSettings(method="paper")).detect(image, 0)
    assert len(paper.row) == HEIGHT
    assert rms(paper.u - true) < 0.05
