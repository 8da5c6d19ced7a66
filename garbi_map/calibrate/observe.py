"""Images and logs to what a calibration needs: views of the target, and the stripe on it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from garbi_map.calibrate.bundle import Poses, StripePoints
from garbi_map.calibrate.detect import detect
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.targets import AnyTarget, Face
from garbi_map.calibrate.views import View, poses_by
from garbi_map.errors import GarbiError
from garbi_map.log import Image, Log
from garbi_map.log.records import Floats
from garbi_map.rig import Camera
from garbi_map.stripe import Stripe, StripeDetector, StripeSettings, UnusableImage, decode
from garbi_map.sweep import FixedAngle, LaserAngle, SweepSettings

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm", ".ppm")
DARKEST = 0.6  # share of its median that the target's own brightness may vary by along a stripe's width
REACH = 4  # px on either side of the stripe that it is looked at


@dataclass(frozen=True)
class Pictures:
    """Views of the target, the images' size (width, height), and what was left out, a line each."""

    views: list[View]
    size: tuple[int, int]
    losses: list[str]


def pictures_of(
    images: Iterable[tuple[str, NDArray[np.uint8]]], target: AnyTarget, settings: CalibrateSettings
) -> Pictures:
    """The target in named images (h, w) or (h, w, 3). Raises GarbiError where it is in none, or all are blurred."""
    views: list[View] = []
    losses: list[str] = []
    size: tuple[int, int] | None = None
    blurred = total = 0
    for name, image in images:
        total += 1
        own = (image.shape[1], image.shape[0])
        size = size or own
        if own != size:
            losses.append(f"{name}: {own[0]} x {own[1]} pixels, the first image has {size[0]} x {size[1]}")
            continue
        view = detect(image, target, name)
        if view is None:
            losses.append(f"{name}: the target was not found")
        elif view.blur > settings.max_blur:
            blurred += 1
            losses.append(f"{name}: blurred (edges {view.blur:.1f} px wide, 1 sigma)")
        else:
            views.append(view)
    if size is None:
        raise GarbiError("no image was given")
    if not views and blurred:
        raise GarbiError(f"the target was found, but all {blurred} images are blurred: focus, and hold it still")
    if not views:
        raise GarbiError(f"the target was found in none of {total} images: is target.yaml the one that is shown?")
    return Pictures(views, size, losses)


def images_of_files(paths: Iterable[Path], losses: list[str]) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Image files, and those in directories by name. Files that are no images are named in `losses`."""
    import cv2

    for path in paths:
        if path.is_dir():
            files = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
            if not files:
                raise GarbiError(f"{path}: no image in this directory")
        else:
            files = [path]
        for file in files:
            data = np.frombuffer(file.read_bytes(), np.uint8) if file.exists() else np.empty(0, np.uint8)
            image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION) if len(data) else None
            if image is None or image.dtype != np.uint8:
                losses.append(f"{file}: not an image of 8 bits")
            else:
                yield file.name, np.asarray(image if image.ndim == 2 else image[:, :, :3], np.uint8)


def images_of_log(log: Log, most: int) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """About `most` images of a log, evenly spread."""
    step = max(log.image_count // max(most, 1), 1)
    for number, image in enumerate(log.images()):
        if number % step == step // 2:
            try:
                yield f"image {number}", decode(image)
            except UnusableImage:
                continue


@dataclass(frozen=True)
class Sweeps:
    """Views of the target, one per pose, the stripe on it, what was left out, and whether the laser turns."""

    views: list[View]
    stripes: StripePoints
    losses: list[str]
    motor: bool


def sweeps_of(
    log: Log,
    camera: Camera,
    target: AnyTarget,
    settings: CalibrateSettings,
    stripe: StripeSettings,
    sweep: SweepSettings,
    fixed_angle: float | None,
) -> Sweeps:
    """The target and the stripe of each sweep of a log: the target is still during it and moves between sweeps.

    Raises GarbiError where the encoder is missing (and no fixed angle is given), and where no sweep can be used.
    """
    encoder = log.navigation().encoder
    if encoder is not None and len(encoder.angle):
        angle: LaserAngle | FixedAngle = LaserAngle(encoder, sweep)
    elif fixed_angle is not None:
        angle = FixedAngle(fixed_angle)
    else:
        raise GarbiError(
            "the log has no encoder: name its topic in log.topics.encoder, or say --no-motor if the laser does not turn"
        )
    losses: list[str] = []
    gathered = _Gathered([], [], losses)
    for number, (begin, end) in enumerate(_spans(log, angle)):
        name = f"sweep {number} at {1e-9 * (begin - log.begin_ns):.1f} s"
        _one_sweep(log, camera, target, settings, stripe, angle, (begin, end), name, gathered)
    if not gathered.views:
        why = losses[0] if losses else "it holds no image"
        raise GarbiError(f"no sweep can be used; {why}")
    if not gathered.parts:
        raise GarbiError("the stripe was found on the target in no image: does it cross the target, in its colour?")
    return Sweeps(gathered.views, joined(gathered.parts), losses, isinstance(angle, LaserAngle))


@dataclass(frozen=True)
class _Gathered:
    views: list[View]
    parts: list[StripePoints]
    losses: list[str]


def _spans(log: Log, angle: LaserAngle | FixedAngle) -> list[tuple[int, int]]:
    """Begin and end of what counts as one pose of the target: a sweep, or each image without a motor."""
    if isinstance(angle, FixedAngle):
        stamps = [image.stamp_ns for image in log.images()]
        return [(stamp, stamp + 1) for stamp in stamps]
    edges = np.unique(np.concatenate([[log.begin_ns], angle.turns_ns, [log.end_ns + 1]]))
    return [(int(a), int(b)) for a, b in pairwise(edges)]


def _one_sweep(
    log: Log,
    camera: Camera,
    target: AnyTarget,
    settings: CalibrateSettings,
    stripe: StripeSettings,
    angle: LaserAngle | FixedAngle,
    span: tuple[int, int],
    name: str,
    gathered: _Gathered,
) -> None:
    """Two passes over a sweep's images: the still target, with the moving stripe taken out; then the stripe alone."""
    size = (camera.width, camera.height)
    samples = [image for _, image in _decoded(log, span, size, settings.target_images)]
    if not samples:
        return
    background = np.median(np.stack(samples), axis=0).astype(np.uint8) if len(samples) >= 3 else None
    view = detect(samples[0] if background is None else background, target, name)
    if view is None:
        gathered.losses.append(f"{name}: the target was not found")
        return
    if view.blur > settings.max_blur:
        gathered.losses.append(f"{name}: blurred (edges {view.blur:.1f} px wide, 1 sigma)")
        return
    if background is not None and (moved := _motion(samples, view, target, name)) > settings.max_motion:
        gathered.losses.append(f"{name}: the target moves by {moved:.1f} px while the laser sweeps")
        return
    pose = poses_by(camera, [view], target)
    detector = StripeDetector(stripe)
    parts: list[StripePoints] = []
    for stamp, image in _decoded(log, span, size, None):
        alone = image if background is None else less(image, background)
        alpha = angle.alpha(stamp)
        if not np.isfinite(alpha):
            continue
        found = detector.detect(alone, stamp)
        if background is not None:
            found = evenly_lit(found, background)
        beside = angle.at(np.array([stamp - 5_000_000, stamp + 5_000_000]))[0]
        rate = float(beside[1] - beside[0]) / 0.01 if np.isfinite(beside).all() else 0.0
        number = len(gathered.views), len(gathered.parts) + len(parts)
        points = on_target(found, camera, pose, target, alpha, rate, number, settings.least_stripe)
        if points is not None:
            parts.append(points)
    if not parts:
        gathered.losses.append(f"{name}: the stripe was not found on the target")
        return
    gathered.views.append(view)
    gathered.parts.extend(parts)


def _decoded(
    log: Log, span: tuple[int, int], size: tuple[int, int], most: int | None
) -> Iterator[tuple[int, NDArray[np.uint8]]]:
    images: Iterable[Image] = log.images(*span)
    if most is not None:
        count = sum(1 for _ in log.images(*span))
        wanted = set(np.linspace(0, count - 1, min(most, count)).astype(int).tolist()) if count else set()
        images = (image for number, image in enumerate(log.images(*span)) if number in wanted)
    for image in images:
        try:
            yield image.stamp_ns, decode(image, size)
        except UnusableImage:
            continue


def _motion(samples: list[NDArray[np.uint8]], view: View, target: AnyTarget, name: str) -> float:
    """Median, px, by which the target's points in the first and last image differ from the middle's; 0 if not seen."""
    shifts = []
    for sample in (samples[0], samples[-1]):
        other = detect(sample, target, name)
        if other is None:
            continue
        _, a, b = np.intersect1d(view.number, other.number, return_indices=True)
        if len(a):
            shifts.append(float(np.median(np.linalg.norm(view.pixel[a] - other.pixel[b], axis=1))))
    return max(shifts, default=0.0)


def less(image: NDArray[np.uint8], background: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """What an image has more than another, at least zero."""
    return np.where(image > background, image - background, 0).astype(np.uint8)


def evenly_lit(stripe: Stripe, background: NDArray[np.uint8]) -> Stripe:
    """The rows in which the target is of one brightness under the stripe: an edge of the print pulls the stripe."""
    grey = background.astype(np.int16) if background.ndim == 2 else background.max(axis=2).astype(np.int16)
    offset = np.arange(-REACH, REACH + 1)
    column = np.clip(np.round(stripe.u).astype(int)[:, None] + offset, 0, grey.shape[1] - 1)
    around = [grey[np.clip(stripe.row + step, 0, grey.shape[0] - 1)[:, None], column] for step in (-2, 0, 2)]
    under = np.concatenate(around, axis=1)
    keep = under.min(axis=1) > DARKEST * under.max(axis=1)
    return Stripe(
        stripe.stamp_ns, *(getattr(stripe, key)[keep] for key in ("row", "u", "sigma", "intensity", "saturated"))
    )


def on_target(
    stripe: Stripe,
    camera: Camera,
    pose: Poses,
    target: AnyTarget,
    alpha: float,
    rate: float,
    number: tuple[int, int],
    least: int,
) -> StripePoints | None:
    """The part of a stripe that lies on a face of the target, None if it is too short.

    pose    of the target, the first of them; number: of the view and of the image."""
    origin, direction = camera.rays(stripe.u, stripe.row)
    best, which = np.full(len(stripe.u), np.inf), np.full(len(stripe.u), -1)
    for index, face in enumerate(target.faces):
        reach, inside = _meets(face, pose.rotation[0], pose.translation[0], origin, direction, target.border)
        nearer = inside & (reach > 0) & (reach < best)
        best[nearer], which[nearer] = reach[nearer], index
    kept = np.flatnonzero(which >= 0)
    if len(kept) < least:
        return None
    origins = np.array([face.origin for face in target.faces])[which[kept]]
    normals = np.array([face.normal for face in target.faces])[which[kept]]
    count = len(kept)
    return StripePoints(
        np.full(count, number[0]),
        np.full(count, number[1]),
        stripe.u[kept].astype(float),
        stripe.row[kept].astype(float),
        np.full(count, alpha),
        np.full(count, rate),
        origins,
        normals,
    )


def _meets(
    face: Face, rotation: Any, place: Floats, origin: Floats, direction: Floats, border: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """How far (n,) along rays a face's plane is, and whether they meet the face."""
    normal, base = rotation.apply(face.normal), rotation.apply(face.origin) + place
    reach = ((base - origin) @ normal) / (direction @ normal)
    there = origin + reach[:, None] * direction - base
    xy = np.column_stack([there @ rotation.apply(face.u), there @ rotation.apply(face.v)])
    return reach, np.asarray(((xy > -border) & (xy < face.size + border)).all(axis=1))


def joined(parts: list[StripePoints]) -> StripePoints:
    """Several as one."""
    names = StripePoints.__dataclass_fields__
    return StripePoints(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
