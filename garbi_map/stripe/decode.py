"""Recorded images to arrays, whatever they are; what cannot be used is refused before it costs memory."""

from __future__ import annotations

import struct
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from garbi_map.log.records import Image
from garbi_map.words import many

_RAW = {
    "bgr8": (3, np.uint8), "rgb8": (3, np.uint8), "bgra8": (4, np.uint8), "rgba8": (4, np.uint8),
    "mono8": (1, np.uint8), "8UC1": (1, np.uint8), "8UC3": (3, np.uint8),
    "mono16": (1, np.uint16), "16UC1": (1, np.uint16), "bgr16": (3, np.uint16), "rgb16": (3, np.uint16),
    "bayer_rggb8": (1, np.uint8), "bayer_bggr8": (1, np.uint8),
    "bayer_gbrg8": (1, np.uint8), "bayer_grbg8": (1, np.uint8),
    "bayer_rggb16": (1, np.uint16), "bayer_bggr16": (1, np.uint16),
    "bayer_gbrg16": (1, np.uint16), "bayer_grbg16": (1, np.uint16),
    "yuv422": (2, np.uint8), "uyvy": (2, np.uint8), "yuv422_yuy2": (2, np.uint8), "yuyv": (2, np.uint8),
}  # fmt: skip

_MOST_DEFLATED = 1032  # bytes that a byte of deflated data can stand for (RFC 1951)


class UnusableImage(Exception):
    """Why an image cannot be used, in a few words; counted, not shown for each."""


class ImageLosses:
    """How many images were left out, and why."""

    def __init__(self) -> None:
        self.reasons: Counter[str] = Counter()

    def lines(self) -> list[str]:
        """One line per reason."""
        return [f"{many(count, 'image')}: {reason}" for reason, count in sorted(self.reasons.items())]


def decode(image: Image, size: tuple[int, int] | None = None, most_pixels: int = 50_000_000) -> NDArray[np.uint8]:
    """Pixels (h, w, 3) BGR or (h, w) mono, uint8; as recorded, a rotation in the EXIF data is not applied.

    size: (width, height) that the rig was calibrated for; another one is refused.
    Raises UnusableImage.
    """
    data = bytes(image.data)
    if len(data) == 0:
        raise UnusableImage("empty")
    pixels = _raw(image, data, most_pixels) if image.encoding in _RAW else _compressed(data, most_pixels, size)
    if size is not None and pixels.shape[:2] != (size[1], size[0]):
        height, width = pixels.shape[:2]
        raise UnusableImage(f"{width} x {height} pixels, the rig is calibrated for {size[0]} x {size[1]}")
    return pixels


def _refuse_size(width: int, height: int, most_pixels: int, size: tuple[int, int] | None) -> None:
    if width * height > most_pixels:
        raise UnusableImage(f"{width} x {height} pixels are more than the {most_pixels} that are allowed")
    if size is not None and (width, height) != size:
        raise UnusableImage(f"{width} x {height} pixels, the rig is calibrated for {size[0]} x {size[1]}")


def _compressed(data: bytes, most_pixels: int, size: tuple[int, int] | None) -> NDArray[np.uint8]:
    if data[:2] == b"\xff\xd8":
        return _jpeg(data, most_pixels, size)
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 26:
        width, height, depth = struct.unpack(">IIB", data[16:25])
        _refuse_size(width, height, most_pixels, size)
        if not _is_whole_png(data) or (width * depth + 7) // 8 * height > _MOST_DEFLATED * len(data):
            raise UnusableImage("a damaged PNG")
        import cv2

        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
        if pixels is None:
            raise UnusableImage("a damaged PNG")
        return _eight_bits(pixels)
    raise UnusableImage("neither JPEG nor PNG")


def _is_whole_png(data: bytes) -> bool:
    """Whether every chunk fits, and nothing moves: OpenCV allocates what a chunk or a frame states as its size."""
    position, kind = 8, b""
    while position + 12 <= len(data) and kind != b"IEND":
        length, kind = struct.unpack(">I4s", data[position : position + 8])
        if (kind == b"IHDR") != (position == 8) or kind in (b"acTL", b"fcTL", b"fdAT"):
            return False
        position += 12 + length
    return kind == b"IEND" and position <= len(data)


def _jpeg(data: bytes, most_pixels: int, size: tuple[int, int] | None) -> NDArray[np.uint8]:
    import simplejpeg

    try:
        height, width, colour, _ = simplejpeg.decode_jpeg_header(data)
        _refuse_size(width, height, most_pixels, size)
        if colour.lower() in ("gray", "grey"):
            return simplejpeg.decode_jpeg(data, "GRAY")[:, :, 0]
        return simplejpeg.decode_jpeg(data, "BGR")
    except ValueError as error:
        raise UnusableImage("a damaged JPEG") from error


def _raw(image: Image, data: bytes, most_pixels: int) -> NDArray[np.uint8]:
    channels, kind = _RAW[image.encoding]
    height, width = image.height, image.width
    wide = width * channels * np.dtype(kind).itemsize
    step = image.step or wide
    if height <= 0 or width <= 0 or height * width > most_pixels or step < wide or len(data) < step * height:
        raise UnusableImage("a raw image whose size and data do not agree")
    rows = np.frombuffer(data, np.uint8, step * height).reshape(height, step)[:, :wide]
    pixels = np.ascontiguousarray(rows).view(kind).reshape(height, width, channels)
    if channels == 2:
        import cv2

        if width % 2:
            raise UnusableImage("a YUV image of an odd width")
        first_is_brightness = image.encoding in ("yuv422_yuy2", "yuyv")
        order = cv2.COLOR_YUV2BGR_YUYV if first_is_brightness else cv2.COLOR_YUV2BGR_UYVY
        return np.asarray(cv2.cvtColor(pixels, order), np.uint8)
    if image.encoding.startswith("bayer"):
        import cv2

        pixels = _eight_bits(pixels)[:, :, None]
        # OpenCV names a pattern by its second row's second pixel on, ROS by the first row's first
        code = {"rggb": cv2.COLOR_BayerBG2BGR, "bggr": cv2.COLOR_BayerRG2BGR}
        code |= {"gbrg": cv2.COLOR_BayerGR2BGR, "grbg": cv2.COLOR_BayerGB2BGR}
        return np.asarray(cv2.cvtColor(pixels[:, :, 0], code[image.encoding[6:10]]), np.uint8)
    if image.encoding.startswith("rgb"):
        pixels = pixels[:, :, [2, 1, 0]]
    return _eight_bits(pixels)


def _eight_bits(pixels: NDArray) -> NDArray[np.uint8]:
    if pixels.dtype == np.uint16:
        pixels = (pixels >> 8).astype(np.uint8)
    if pixels.dtype != np.uint8:
        raise UnusableImage(f"pixels of type {pixels.dtype}")
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        pixels = pixels[:, :, :3]
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[:, :, 0]
    return np.ascontiguousarray(pixels)
