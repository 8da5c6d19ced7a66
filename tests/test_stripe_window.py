"""With the laser's angle and the range limits, the stripe is looked for only where it can be."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rigs import make_rig

from garbi_map.stripe import StripeDetector, StripeSettings
from tools.bench.stripe_images import expose, light

RIG = make_rig()
SETTINGS = StripeSettings(min_range=0.8, max_range=2.5)
ALPHA = 0.31


def true_columns(depth: float) -> NDArray[np.float64]:
    """Where the sheet at ALPHA is seen at a camera depth, px."""
    first, last = RIG.column_window(ALPHA, depth - 1e-4, depth + 1e-4)
    return 0.5 * (first + last)


@settings(deadline=None, max_examples=40)
@given(st.floats(-0.5, 0.8), st.sampled_from([0.0, 6.0]))
def test_the_window_that_is_kept_holds_that_of_the_angle(alpha: float, margin: float) -> None:
    """Kept for steps of the angle, it is at most 8 px wider than the rig's own and the margin."""
    chosen = SETTINGS.model_copy(update={"window_margin": margin})
    first, last = StripeDetector(chosen, RIG)._window(576, 768, alpha)
    own_first, own_last = RIG.column_window(alpha, 0.8, 2.5)
    seen = own_last >= own_first
    assert (first[seen] <= own_first[seen] - margin + 1e-3).all()
    assert (last[seen] >= own_last[seen] + margin - 1e-3).all()
    assert (own_first[seen] - first[seen] < margin + 8).all()
    assert (last[seen] - own_last[seen] < margin + 8).all()


def test_the_window_costs_no_accuracy() -> None:
    """The same columns as without; sigma to a few per cent, as less of the dark tells its noise."""
    image = expose(light(true_columns(1.4)), 4, 1)
    detector = StripeDetector(SETTINGS, RIG)
    everywhere, windowed = detector.detect(image, 0), detector.detect(image, 0, ALPHA)
    assert len(windowed.row) == 576
    np.testing.assert_array_equal(windowed.row, everywhere.row)
    np.testing.assert_allclose(windowed.u, everywhere.u, atol=1e-3)
    np.testing.assert_allclose(windowed.sigma, everywhere.sigma, rtol=0.05)


def test_a_brighter_line_out_of_range_is_not_seen() -> None:
    """A reflection where only a bottom at 0.6 m could be, three times as bright."""
    true, ghost = true_columns(1.4), true_columns(0.6)
    image = expose(light(true) * 0.3 + light(ghost), 4, 2)
    detector = StripeDetector(SETTINGS, RIG)
    assert np.abs(detector.detect(image, 0).u - ghost).max() < 3
    assert np.abs(detector.detect(image, 0, ALPHA).u - true).max() < 3


@pytest.mark.parametrize("alpha", [math.nan, None])
def test_an_unknown_angle_means_the_whole_width(alpha: float | None) -> None:
    """Before the encoder's first reading."""
    first, last = StripeDetector(SETTINGS, RIG)._window(576, 768, alpha)
    assert (first == 0).all()
    assert (last == 767).all()


def test_the_noise_is_that_of_the_window() -> None:
    """What lies beside it, however rough, neither moves the columns nor widens sigma."""
    true = true_columns(1.4)
    image = expose(light(true), 4, 3)
    rough = image.copy()
    beside = np.abs(np.arange(768)[None, :] - true[:, None]) > 260
    rough[beside] = np.random.default_rng(4).integers(0, 255, (int(beside.sum()), 3))
    detector = StripeDetector(SETTINGS, RIG)
    calm, stirred = detector.detect(image, 0, ALPHA), detector.detect(rough, 0, ALPHA)
    np.testing.assert_array_equal(stirred.u, calm.u)
    np.testing.assert_array_equal(stirred.sigma, calm.sigma)
