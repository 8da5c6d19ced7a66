"""Raw encodings of cameras become the colours that they stand for."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from garbi_map.log import Image
from garbi_map.stripe import UnusableImage, decode

BGR = np.full((8, 12, 3), (40, 200, 60), np.uint8)


def raw(encoding: str, pixels: np.ndarray) -> Image:
    """A raw image of these rows."""
    return Image(0, 0, encoding, np.ascontiguousarray(pixels).tobytes(), 8, 12, pixels[0].nbytes)


@pytest.mark.parametrize(
    ("encoding", "code"),
    [
        ("yuv422", cv2.COLOR_BGR2YUV_UYVY),
        ("uyvy", cv2.COLOR_BGR2YUV_UYVY),
        ("yuv422_yuy2", cv2.COLOR_BGR2YUV_YUYV),
        ("yuyv", cv2.COLOR_BGR2YUV_YUYV),
    ],
)
def test_brightness_and_shared_colour(encoding: str, code: int) -> None:
    """Two pixels share their colour; which byte comes first is in the name."""
    np.testing.assert_allclose(decode(raw(encoding, cv2.cvtColor(BGR, code))), BGR, atol=4)


@pytest.mark.parametrize("depth", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_mosaics(pattern: str, depth: int) -> None:
    """A mosaic of one colour is that colour, whatever its first pixel."""
    mosaic = np.empty((8, 12), np.uint8)
    for place, letter in enumerate(pattern):
        mosaic[place // 2 :: 2, place % 2 :: 2] = BGR[0, 0, "bgr".index(letter)]
    pixels = mosaic if depth == 8 else mosaic.astype(np.uint16) << 8
    np.testing.assert_array_equal(decode(raw(f"bayer_{pattern}{depth}", pixels)), BGR)


def test_odd_width() -> None:
    """Pairs of pixels need an even width."""
    with pytest.raises(UnusableImage, match="odd width"):
        decode(Image(0, 0, "yuyv", bytes(2 * 3 * 2), 2, 3, 6))
