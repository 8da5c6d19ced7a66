"""Whether sampled images are fit: neither dark, frozen nor saturated, the stripe in them, and where the rig says."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from garbi_map.health.findings import Finding, spans, told
from garbi_map.health.sample import Stretch
from garbi_map.rig import Rig
from garbi_map.stripe import Stripe, StripeDetector, UnusableImage, decode
from garbi_map.stripe.settings import StripeSettings
from garbi_map.words import percent

DARK = 8.0  # grey levels of the brightest hundredth of the pixels
BRIGHT = 250  # a saturated pixel
SATURATED = 0.02  # share of the pixels
CLIPPED = 0.5  # share of the stripe's rows
SEEN = 0.1  # share of the rows in which a stripe counts as seen
LEAST_ROWS = 30
INSIDE = 0.7  # share of the stripe's rows that the rig must expect where they are


@dataclass(frozen=True)
class Look:
    """One sampled image. time: s since the log's begin; digest: of its bytes; unusable: why it cannot be read, "" where
    it can; brightness: 99th percentile, 0..255; saturated: share of its pixels; rows: share of its rows with a stripe;
    clipped: share of those that are saturated; sigma: px, median; inside: share of the stripe's rows where the rig
    expects them, NaN where that is not known; repeats: the image before to the last bit; stripe: in full."""

    time: float
    digest: bytes
    unusable: str = ""
    size: tuple[int, int] = (0, 0)
    brightness: float = np.nan
    saturated: float = np.nan
    rows: float = np.nan
    clipped: float = np.nan
    sigma: float = np.nan
    inside: float = np.nan
    alpha: float = np.nan
    repeats: bool = False
    stripe: Stripe | None = None


@dataclass(frozen=True)
class Pictures:
    """Medians over the sampled images, and shares of them. expected: share of the stripe that lies where the rig
    expects it, None where that is not known; over_time: (s, share of the rows with a stripe) of each image."""

    looked_at: int
    size: tuple[int, int]
    brightness: float
    saturated: float
    stripe_seen: float
    stripe_rows: float
    stripe_sigma: float
    expected: float | None
    over_time: list[tuple[float, float]]


def look(found: list[Stretch], rig: Rig | None, settings: StripeSettings) -> list[Look]:
    """The first image of each stretch, looked into; of the others only whether they repeat it."""
    anywhere, expected = StripeDetector(settings, None), StripeDetector(settings, rig)
    looks: list[Look] = []
    for one in found:
        for number, image in enumerate(one.images):
            digest = hashlib.blake2b(bytes(image.data), digest_size=8).digest()
            if number:
                looks.append(Look(one.time, digest, repeats=digest == looks[-1].digest))
                continue
            try:
                pixels = decode(image, None, settings.max_pixels)
            except UnusableImage as reason:
                looks.append(Look(one.time, digest, str(reason)))
                continue
            alpha = _alpha(one, image.stamp_ns, rig)
            looks.append(_look(one.time, digest, pixels, image.stamp_ns, alpha, rig, anywhere, expected))
    return looks


def _alpha(one: Stretch, stamp_ns: int, rig: Rig | None) -> float:
    """The laser's angle at a stamp, by the readings around it."""
    if rig is not None and rig.laser.fixed_angle is not None and "encoder" not in one.said:
        return rig.laser.fixed_angle
    said = one.said.get("encoder")
    if said is None or not min(said.stamps) <= stamp_ns <= max(said.stamps):
        return np.nan
    order = np.argsort(said.stamp_ns)
    stamps = said.stamp_ns[order]
    return float(np.interp(stamp_ns - stamps[0], stamps - stamps[0], said.values[order, 0]))


def _look(
    time: float,
    digest: bytes,
    pixels: NDArray[np.uint8],
    stamp_ns: int,
    alpha: float,
    rig: Rig | None,
    anywhere: StripeDetector,
    expected: StripeDetector,
) -> Look:
    brightest = pixels if pixels.ndim == 2 else pixels.max(axis=2)
    height, width = pixels.shape[:2]
    fits = rig is not None and (width, height) == (rig.camera.width, rig.camera.height)
    free = anywhere.detect(pixels, stamp_ns)
    inside = np.nan
    stripe = free
    if fits and rig is not None and np.isfinite(alpha):
        stripe = expected.detect(pixels, stamp_ns, alpha)
        inside = _inside(free, rig, alpha, anywhere.settings)
    counts = np.bincount(brightest[::4, ::4].ravel(), minlength=256)
    share = np.cumsum(counts) / counts.sum()
    return Look(
        time,
        digest,
        "",
        (width, height),
        float(np.searchsorted(share, 0.99)),
        float(counts[BRIGHT:].sum() / counts.sum()),
        len(stripe.row) / height,
        float(stripe.saturated.mean()) if len(stripe.row) else np.nan,
        float(np.median(stripe.sigma)) if len(stripe.row) else np.nan,
        inside,
        alpha,
        stripe=stripe if fits else None,
    )


def _inside(stripe: Stripe, rig: Rig, alpha: float, settings: StripeSettings) -> float:
    if len(stripe.row) < LEAST_ROWS:
        return np.nan
    first, last = rig.column_window(alpha, settings.min_range, settings.max_range)
    margin = settings.window_margin
    good = (stripe.u >= first[stripe.row] - margin) & (stripe.u <= last[stripe.row] + margin)
    return float(good.mean())


def check_pictures(looks: list[Look], rig: Rig | None) -> tuple[Pictures | None, list[Finding]]:
    """What the looks say together; None where no image was sampled."""
    if not looks:
        return None, []
    read = [one for one in looks if np.isfinite(one.brightness)]
    findings = [*_frozen(looks), *_shown(looks, "image_unreadable", [bool(one.unusable) for one in looks], _why(looks))]
    if not read:
        return None, findings
    dark = [one.brightness < DARK for one in read]
    findings += _shown(read, "image_dark", dark, "images are dark: laser or camera off, lens cap, exposure?")
    bright = [one.saturated > SATURATED for one in read]
    findings += _shown(read, "image_saturated", bright, "images are saturated: shorten the exposure, dim the lights")
    unseen = [one.rows < SEEN and not black for one, black in zip(read, dark, strict=True)]
    findings += _shown(
        read, "stripe_unseen", unseen, "the laser's stripe is not seen: laser off, out of range, or another colour?"
    )
    clipped = [one.clipped > CLIPPED for one in read]
    findings += _shown(read, "stripe_saturated", clipped, "the stripe is saturated: shorten the exposure")
    size = read[0].size
    if rig is not None and size != (rig.camera.width, rig.camera.height):
        text = (
            f"images are {size[0]} x {size[1]} pixels, the rig file is for {rig.camera.width} x {rig.camera.height}: "
            f"give the rig of this camera"
        )
        findings.append(Finding("image_size", text, read[0].time, read[-1].time))
    known = [one.inside for one in read if np.isfinite(one.inside)]
    expected = float(np.median(known)) if known else None
    if expected is not None and expected < INSIDE:
        text = (
            f"only {percent(expected)} of the stripe lies where the rig file and the encoder expect it: wrong rig file, "
            f"encoder zero or direction, or a clock that is off"
        )
        findings.append(Finding("calibration_implausible", text, read[0].time, read[-1].time))
    sigma = [one.sigma for one in read if np.isfinite(one.sigma)]
    return Pictures(
        looked_at=len(read),
        size=size,
        brightness=float(np.median([one.brightness for one in read])),
        saturated=float(np.median([one.saturated for one in read])),
        stripe_seen=float(np.mean([one.rows >= SEEN for one in read])),
        stripe_rows=float(np.median([one.rows for one in read])),
        stripe_sigma=float(np.median(sigma)) if sigma else 0.0,
        expected=expected,
        over_time=[(one.time, one.rows) for one in read],
    ), findings


def _frozen(looks: list[Look]) -> list[Finding]:
    """Images that repeat the one before to the last bit, which no camera does twice."""
    flags = [one.repeats for one in looks]
    return _shown(looks, "image_frozen", flags, "images repeat the one before to the last bit: the camera hangs")


def _why(looks: list[Look]) -> str:
    reasons = sorted({one.unusable for one in looks if one.unusable})
    return f"images cannot be read: {'; '.join(reasons[:3])}"


def _shown(looks: list[Look], kind: str, flags: list[bool], what: str) -> list[Finding]:
    """A finding where any image shows it."""
    runs = spans([one.time for one in looks], flags)
    if not runs:
        return []
    share = percent(float(np.mean(flags)))
    return [Finding(kind, f"{what} ({share} of the sampled images, {told(runs)})", runs[0][0], runs[-1][1])]
