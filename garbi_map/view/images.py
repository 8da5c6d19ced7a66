"""Camera images as they were recorded, and what was found in them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.log import Image
from garbi_map.view import style
from garbi_map.view.stream import at, set_time
from garbi_map.view.thin import thinned

if TYPE_CHECKING:
    from rerun import AsComponents, RecordingStream

    from garbi_map.stripe import Stripe

_COMPRESSED = {b"\xff\xd8": "image/jpeg", b"\x89P": "image/png"}


def send_images(recording: RecordingStream, images: Iterator[Image], every: int) -> tuple[NDArray[np.int64], int]:
    """One image of so many; returns the stamps (n,) of those that are shown, and their bytes. Memory: one image."""
    stamps: list[int] = []
    size = 0
    for number, image in enumerate(images):
        if number % every == 0:
            size += send_image(recording, image)
            stamps.append(image.stamp_ns)
    recording.reset_time()
    return np.array(stamps, np.int64), size


def send_image(recording: RecordingStream, image: Image) -> int:
    """A compressed image as it is, a raw one decoded; returns its bytes. One that cannot be decoded is left out."""
    import rerun as rr

    data = bytes(image.data)
    media = _COMPRESSED.get(data[:2])
    shown: AsComponents
    if media is not None:
        shown = rr.EncodedImage(contents=data, media_type=media)
    else:
        from garbi_map.stripe.decode import UnusableImage, decode  # slow to import, and seldom needed

        try:
            pixels = decode(image)
        except UnusableImage:
            return 0
        shown = rr.Image(pixels, color_model="L" if pixels.ndim == 2 else "BGR")
    set_time(recording, image.stamp_ns)
    recording.log(style.IMAGE, shown)
    return len(data)


def style_stripe(recording: RecordingStream) -> None:
    """How the stripe is drawn, what else was found, and how sure it is."""
    import rerun as rr

    others = rr.Points2D.from_fields(radii=1.6, colors=[style.CANDIDATES.colour])
    recording.log(style.CANDIDATES.path, others, static=True)
    bars = rr.LineStrips2D.from_fields(radii=0.4, colors=[style.STRIPE_SIGMA.colour])
    recording.log(style.STRIPE_SIGMA.path, bars, static=True)
    recording.log(style.STRIPE.path, rr.Points2D.from_fields(radii=1.3, colors=[style.STRIPE.colour]), static=True)


def send_stripes(
    recording: RecordingStream, stamp_ns: NDArray[np.int64], pixels: NDArray, lengths: NDArray[np.int64]
) -> None:
    """The stripes of images at stamps (m,): pixels (n, 2), of which the first lengths[0] belong to the first image.

    The centre of the first pixel is at 0, 0 for us and at 0.5, 0.5 in the viewer.
    """
    import rerun as rr

    rows = rr.Points2D.columns(positions=(pixels + 0.5).astype(np.float32)).partition(lengths)
    recording.send_columns(style.STRIPE.path, at(stamp_ns), rows)


def send_candidates(recording: RecordingStream, stamp_ns: NDArray[np.int64], others: list[NDArray]) -> None:
    """What else might have been the stripe: pixels (n, 2) of each image at stamps (m,)."""
    import rerun as rr

    pixels = np.concatenate(others) + 0.5
    rows = rr.Points2D.columns(positions=pixels.astype(np.float32)).partition([len(one) for one in others])
    recording.send_columns(style.CANDIDATES.path, at(stamp_ns), rows)


def send_sigma(recording: RecordingStream, stripes: list[Stripe], most: int) -> None:
    """Bars of SIGMA_SCALE sigma to either side of at most so many points of each stripe."""
    import rerun as rr

    picks = [thinned(len(stripe.u), most) for stripe in stripes]
    found = list(zip(stripes, picks, strict=True))
    u, sigma, row = (
        np.concatenate([getattr(stripe, name)[pick] for stripe, pick in found]) for name in ("u", "sigma", "row")
    )
    ends = [np.stack([u + side * style.SIGMA_SCALE * sigma, row], axis=1) for side in (-1, 1)]
    bars = (np.stack(ends, axis=1) + 0.5).astype(np.float32)
    rows = rr.LineStrips2D.columns(strips=list(bars)).partition([len(pick) for pick in picks])
    recording.send_columns(style.STRIPE_SIGMA.path, at([stripe.stamp_ns for stripe in stripes]), rows)
