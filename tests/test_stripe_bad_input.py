"""Whatever arrives as an image is used, or refused with a reason; nothing crashes or takes the memory."""

from __future__ import annotations

import struct
import tracemalloc
import zlib
from collections.abc import Iterator

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from garbi_map.log import Image
from garbi_map.stripe import ImageLosses, StripeDetector, StripeSettings, UnusableImage, decode, detect_all
from tools.bench.stripe_images import CONDITIONS, synthetic

PICTURE = synthetic(CONDITIONS[0], 1)[0]
JPEG = cv2.imencode(".jpg", PICTURE)[1].tobytes()
PNG = cv2.imencode(".png", PICTURE)[1].tobytes()


def image(data: bytes, encoding: str = "jpeg", stamp: int = 0) -> Image:
    return Image(stamp, stamp, encoding, data)


def bomb(side: int) -> bytes:
    """A PNG of side x side black pixels in a few hundred kilobytes."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packer = zlib.compressobj(9)
    row = bytes(side // 8 + 1)
    packed = b"".join(packer.compress(row * 100) for _ in range(side // 100)) + packer.flush()
    header = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


def with_rotation(jpeg: bytes) -> bytes:
    """The JPEG with an EXIF orientation of 6 (turn by 90 degrees)."""
    tiff = b"MM\x00*\x00\x00\x00\x08\x00\x01\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00\x00\x00\x00\x00"
    body = b"Exif\x00\x00" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "empty"),
        (JPEG[: len(JPEG) // 3], "damaged JPEG"),
        (JPEG[:20], "damaged JPEG"),
        (PNG[:200], "damaged PNG"),
        (b"GIF89a" + bytes(100), "neither JPEG nor PNG"),
        (bytes(5000), "neither JPEG nor PNG"),
    ],
)
def test_unreadable_images_are_refused_with_a_reason(data: bytes, reason: str) -> None:
    """Empty, cut off or something else."""
    with pytest.raises(UnusableImage, match=reason):
        decode(image(data))


def test_an_image_of_another_size_than_the_rigs_is_refused() -> None:
    """Its rays would be wrong."""
    with pytest.raises(UnusableImage, match="768 x 576 pixels, the rig is calibrated for 640 x 480"):
        decode(image(JPEG), (640, 480))


def test_a_png_bomb_is_refused_before_it_is_decoded() -> None:
    """30,000 x 30,000 pixels would be 900 MB."""
    data = bomb(30_000)
    tracemalloc.start()
    try:
        with pytest.raises(UnusableImage, match="30000 x 30000"):
            decode(image(data, "png"))
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


def test_a_jpeg_header_that_promises_too_much_is_refused() -> None:
    """The size stands in the start-of-frame segment."""
    at = JPEG.index(b"\xff\xc0") + 5
    with pytest.raises(UnusableImage, match="65000 x 65000"):
        decode(image(JPEG[:at] + struct.pack(">HH", 65000, 65000) + JPEG[at + 4 :]))


@pytest.mark.parametrize("channels", [1, 3])
def test_sixteen_bits_become_eight(channels: int) -> None:
    """A 16-bit PNG is the 8-bit one, 256 times brighter."""
    shallow = PICTURE[:, :, :channels].squeeze()
    deep = cv2.imencode(".png", shallow.astype(np.uint16) * 256 + 77)[1].tobytes()
    np.testing.assert_array_equal(decode(image(deep, "png")), shallow)


def test_a_rotation_in_the_exif_data_is_not_applied() -> None:
    """The rig is calibrated for the sensor as it lies."""
    np.testing.assert_array_equal(decode(image(with_rotation(JPEG))), decode(image(JPEG)))


def test_transparency_is_dropped() -> None:
    """A PNG with an alpha channel gives its colours."""
    data = cv2.imencode(".png", np.dstack([PICTURE, PICTURE[:, :, :1]]))[1].tobytes()
    np.testing.assert_array_equal(decode(image(data, "png")), PICTURE)


def test_raw_rows_may_be_padded() -> None:
    """`step` counts, not the width; RGB becomes BGR."""
    padded = np.zeros((576, 800, 3), np.uint8)
    padded[:, :768] = PICTURE[:, :, ::-1]
    raw = Image(0, 0, "rgb8", padded.tobytes(), 576, 768, 2400)
    np.testing.assert_array_equal(decode(raw), PICTURE)
    with pytest.raises(UnusableImage, match="do not agree"):
        decode(Image(0, 0, "rgb8", padded.tobytes()[:-1], 576, 768, 2400))


@settings(deadline=None, max_examples=60)
@given(st.integers(0, len(JPEG) - 1), st.binary(min_size=1, max_size=40))
def test_a_damaged_jpeg_is_decoded_or_refused(at: int, junk: bytes) -> None:
    """Never another exception."""
    try:
        pixels = decode(image(JPEG[:at] + junk + JPEG[at + len(junk) :]))
    except UnusableImage:
        return
    assert pixels.dtype == np.uint8


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from([1, 3]), st.integers(0, 2**31))
def test_tiny_images_hold_no_stripe_and_do_no_harm(height: int, width: int, channels: int, seed: int) -> None:
    """Smaller than any kernel."""
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width, channels), np.uint8)
    stripe = StripeDetector(StripeSettings()).detect(pixels, 5)
    assert stripe.stamp_ns == 5
    assert np.isfinite(stripe.u).all()
    assert ((stripe.u >= 0) & (stripe.u <= width - 1)).all()


def test_losses_are_counted_and_the_rest_keeps_its_order() -> None:
    """Each unusable image counts once under its reason."""
    data = [JPEG, b"", PNG, JPEG[:40], JPEG, b"", b"what", JPEG]
    losses = ImageLosses()

    def images() -> Iterator[Image]:
        yield from (image(each, stamp=number) for number, each in enumerate(data))

    found = list(detect_all(images(), StripeDetector(StripeSettings()), None, 2, losses))
    assert [stripe.stamp_ns for stripe in found] == [0, 2, 4, 7]
    assert losses.lines() == ["1 image: a damaged JPEG", "2 images: empty", "1 image: neither JPEG nor PNG"]
