"""A log of a laser that sweeps over a target at several poses, as `garbi calibrate laser` takes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.log import Image, LogWriter
from garbi_map.log.records import Floats
from tools.simulator.target import Booth

START_NS = 1_700_000_000_000_000_000
PERIOD = 0.05  # s, between images
RATE = 200.0  # Hz, of the encoder


def write_sweeps(
    path: Path,
    booth: Booth,
    poses: Sequence[tuple[Rotation, Floats]],
    alphas: tuple[float, float],
    images: int,
    seed: int,
    latency: float = 0.0,
    encoder: bool = True,
) -> None:
    """Forth over the first pose, back over the second, and so on; PNG images.

    alphas: between which the laser turns, rad; images per pose; latency: s by which the encoder's stamps are late.
    """
    rng = np.random.default_rng(seed)
    sweep = PERIOD * images
    total = sweep * len(poses)

    def alpha_at(time: float) -> float:
        turn, part = divmod(np.clip(time, 0.0, total - 1e-9) / sweep, 1.0)
        share = part if turn % 2 == 0 else 1.0 - part
        return alphas[0] + share * (alphas[1] - alphas[0])

    with LogWriter(path) as log:
        if encoder:
            for time in np.arange(0.0, total, 1.0 / RATE):
                stamp = START_NS + int(1e9 * time)
                log.write_encoder(stamp, alpha_at(time - latency), stamp, booth.rig.laser.joint)
        for number, (rotation, translation) in enumerate(poses):
            placed = booth.placed(rotation, translation)
            for k in range(images):
                time = number * sweep + (k + 0.5) * PERIOD
                data = cv2.imencode(".png", booth.image(placed, alpha_at(time), rng))[1].tobytes()
                stamp = START_NS + int(1e9 * time)
                log.write_image(Image(stamp, stamp, "png", data))
