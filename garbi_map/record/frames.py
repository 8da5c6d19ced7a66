"""Where images come from: a camera or a stream that OpenCV opens, a video file, a folder of images.

What is already JPEG stays as it is, byte for byte; the rest is encoded by `Camera`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from numpy.typing import NDArray

from garbi_map.errors import GarbiError

JPEG, PNG = b"\xff\xd8", b"\x89PNG\r\n\x1a\n"
SUFFIXES = {".jpg", ".jpeg", ".png"}
LARGEST = 1 << 27  # bytes of an image file
USUAL_RATE = 25.0  # Hz, of a folder
OPENING_MS = 5000


class CameraTrouble(Exception):
    """The camera cannot be opened, or is gone; a few words."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One image: a file's bytes with their encoding, or pixels (h, w) or (h, w, 3) BGR.

    device_ns  the camera's own clock, where it has one; steady: that clock is this machine's monotonic one
    """

    data: bytes | NDArray[Any]
    encoding: str = ""
    device_ns: int | None = None
    steady: bool = False


class Frames(Protocol):
    """A source of images. rate: of a file or folder, which is played at that pace, Hz; None: they come when they come."""

    name: str
    rate: float | None

    def open(self) -> None:
        """Raises CameraTrouble."""

    def next(self) -> Frame | None:
        """The next one, None at the end of a file. Raises CameraTrouble."""

    def close(self) -> None:
        """It may be opened again."""


def frames_of(text: str, rate: float | None = None, size: tuple[int, int] | None = None, loop: bool = False) -> Frames:
    """What the user called the camera: a number or /dev/video*, a URL, a GStreamer pipeline, a video file, a folder.

    Raises GarbiError where a file or folder is not there or has no images.
    """
    if text.isdecimal() or text.startswith("/dev/"):
        return Capture(text, "device", rate, size, loop=False)
    if "://" in text or " ! " in text:
        return Capture(text, "stream", rate, size, loop=False)
    path = Path(text)
    if not path.exists():
        raise GarbiError(f"{text}: no such camera: neither a device, a URL, a file nor a folder")
    if path.is_dir():
        return Folder(path, rate or USUAL_RATE, loop)
    film = Capture(text, "file", rate, None, loop)
    try:
        film.open()
    except CameraTrouble as error:
        raise GarbiError(f"{text}: {error}") from error
    film.close()
    return film


class Folder:
    """The JPEG and PNG files of a folder in the order of their names, as they are."""

    def __init__(self, path: Path, rate: float, loop: bool) -> None:
        self.name, self._loop = str(path), loop
        self.rate: float | None = rate
        try:
            self._files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
        except OSError as error:
            raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
        if not self._files:
            raise GarbiError(f"{path}: no .jpg or .png files in this folder")
        self._left: Iterator[Path] = iter(())

    def open(self) -> None:
        """See `Frames`."""
        self._left = iter(self._files)

    def next(self) -> Frame | None:
        """See `Frames`; a file that is no image comes as bytes without an encoding."""
        file = next(self._left, None)
        if file is None and self._loop:
            self._left = iter(self._files)
            file = next(self._left)
        if file is None:
            return None
        try:
            data = file.read_bytes() if file.stat().st_size <= LARGEST else b""
        except OSError as error:
            raise CameraTrouble(f"{file.name} cannot be read") from error
        return Frame(data, _encoding(data))

    def close(self) -> None:
        """See `Frames`."""


def _encoding(data: bytes) -> str:
    return "jpeg" if data.startswith(JPEG) else "png" if data.startswith(PNG) else ""


class Capture:
    """What OpenCV's VideoCapture opens. Motion JPEG is asked for, and taken as it comes."""

    def __init__(self, name: str, kind: str, rate: float | None, size: tuple[int, int] | None, loop: bool) -> None:
        self.name = re.sub(r"//[^/@]*@", "//", name)  # a password goes neither into the log nor on the screen
        self._where, self._kind, self._size, self._loop = name, kind, size, loop
        self._wanted_rate = rate
        self.rate = rate if kind == "file" else None
        self._capture: Any = None
        self._raw = False
        self._first = True

    def open(self) -> None:
        """See `Frames`."""
        os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # its own words are not one line
        import cv2

        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._raw, self._first = True, True
        if self._kind == "device":
            where: str | int = int(self._where) if self._where.isdecimal() else self._where
            self._capture = cv2.VideoCapture(where, cv2.CAP_V4L2)
            self._configure_device(cv2)
        elif " ! " in self._where:
            self._raw = False
            self._capture = cv2.VideoCapture(self._where, cv2.CAP_GSTREAMER)
        else:
            waits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPENING_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, OPENING_MS]
            self._capture = cv2.VideoCapture(self._where, cv2.CAP_FFMPEG, waits if self._kind == "stream" else [])
            motion_jpeg = int(self._capture.get(cv2.CAP_PROP_FOURCC)) == cv2.VideoWriter.fourcc(*"MJPG")
            self._raw = motion_jpeg and self._capture.set(cv2.CAP_PROP_FORMAT, -1)
        if not self._capture.isOpened():
            self._capture = None
            raise CameraTrouble("cannot be opened" if self._kind != "file" else "not a video that OpenCV reads")
        if self._kind == "file":
            stated = self._capture.get(cv2.CAP_PROP_FPS)
            self.rate = self._wanted_rate or (stated if 0.1 <= stated <= 1000 else USUAL_RATE)

    def _configure_device(self, cv2: Any) -> None:
        capture = self._capture
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG"))
        if self._size is not None:
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, self._size[0])
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self._size[1])
        if self._wanted_rate is not None:
            capture.set(cv2.CAP_PROP_FPS, self._wanted_rate)
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)

    def next(self) -> Frame | None:
        """See `Frames`."""
        import cv2

        try:
            got = self._capture.grab()
            if not got and self._kind == "file":
                return self._again()
            got, pixels = self._capture.retrieve() if got else (False, None)
            if not got or pixels is None or pixels.size == 0:
                raise CameraTrouble("gives no more images")
            device_ns, steady = self._clock(cv2)
        except cv2.error as error:
            raise CameraTrouble("gives no more images") from error
        first, self._first = self._first, False
        if not self._raw:
            return Frame(pixels, "", device_ns, steady)
        data = pixels.tobytes()
        if data.startswith(JPEG):
            end = data.rfind(b"\xff\xd9")  # drivers pad
            return Frame(data[: end + 2] if end > 0 else data, "jpeg", device_ns, steady)
        if first:  # the device has its own mind about formats: let OpenCV convert
            self._raw = False
            self._capture.set(cv2.CAP_PROP_CONVERT_RGB, 1)
            return self.next()
        return Frame(data, "", device_ns, steady)

    def _again(self) -> Frame | None:
        if not self._loop or self._first:
            return None
        self.close()
        self.open()
        return self.next()

    def _clock(self, cv2: Any) -> tuple[int | None, bool]:
        if self._kind == "file":
            return None, False
        milliseconds = self._capture.get(cv2.CAP_PROP_POS_MSEC)
        return (round(milliseconds * 1e6) if milliseconds > 0 else None), self._kind == "device"

    def close(self) -> None:
        """See `Frames`."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None
