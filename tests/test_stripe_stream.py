"""A stream of images becomes a stream of stripes: in order, the same every time, with bounded memory."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from garbi_map.log import Image
from garbi_map.stripe import StripeDetector, StripeSettings, detect_all
from tools.bench.stripe_images import CONDITIONS, synthetic

JPEGS = [cv2.imencode(".jpg", synthetic(condition, seed)[0])[1].tobytes() for seed, condition in enumerate(CONDITIONS)]


def images(count: int) -> Iterator[Image]:
    for number in range(count):
        yield Image(number, number, "jpeg", JPEGS[number % len(JPEGS)])


def test_the_order_is_kept_whatever_the_number_of_threads() -> None:
    """And each stripe is the same, bit for bit."""
    detector = StripeDetector(StripeSettings())
    alone = list(detect_all(images(27), detector, None, 1))
    several = list(detect_all(images(27), detector, None, 4))
    assert [stripe.stamp_ns for stripe in several] == list(range(27))
    for one, other in zip(alone, several, strict=True):
        for name in ("row", "u", "sigma", "intensity", "saturated"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_only_a_few_images_are_held_at_once() -> None:
    """A slow consumer makes the reader wait."""
    taken = 0

    def counted() -> Iterator[Image]:
        nonlocal taken
        for each in images(100):
            taken += 1
            yield each

    stripes = detect_all(counted(), StripeDetector(StripeSettings()), None, 2)
    for number in range(20):
        next(stripes)
        assert taken <= number + 16
    stripes.close()
    assert taken < 40


def test_the_angle_of_each_image_is_asked_for_at_its_stamp() -> None:
    """Not at its number or its arrival."""
    asked: list[int] = []

    def alpha_of(stamp_ns: int) -> float:
        asked.append(stamp_ns)
        return 0.0

    list(detect_all(images(9), StripeDetector(StripeSettings()), alpha_of, 1))
    assert asked == list(range(9))
