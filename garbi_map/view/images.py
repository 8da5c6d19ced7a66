"""Camera images as they were recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from garbi_map.log.records import Image
from garbi_map.view import style

if TYPE_CHECKING:
    from rerun import RecordingStream


def show_image(recording: RecordingStream, image: Image) -> None:
    """A compressed image goes in as it was recorded, a raw one decoded; one that cannot be read is not shown."""
    import rerun as rr

    recording.set_time(style.TIMELINE, timestamp=np.datetime64(image.stamp_ns, "ns"))
    if image.encoding in ("jpeg", "png"):
        shown = rr.EncodedImage(contents=bytes(image.data), media_type=f"image/{image.encoding}")
        recording.log(style.IMAGE, shown)
        return
    from garbi_map.stripe import UnusableImage, decode

    try:
        pixels = decode(image)
    except UnusableImage:
        return
    recording.log(style.IMAGE, rr.Image(pixels, color_model="L" if pixels.ndim == 2 else "BGR"))
