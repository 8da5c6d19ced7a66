"""The scan streams: what it holds does not grow with the log."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from garbi_map.config import Config
from garbi_map.log import Image
from garbi_map.pipeline import open_dive
from garbi_map.stripe import StripeDetector, detect_all
from garbi_map.sweep import laser_angle, make_sweeps
from garbi_map.sweep.store import SweepStore


def peak_of_scan(dive: Path, folder: Path, times: int) -> tuple[int, int]:
    """Peak of traced bytes, and profiles, of a scan of the log played so many times on end."""
    config = Config()
    opened = open_dive([dive], config, None)
    period = opened.log.end_ns - opened.log.begin_ns + 10_000_000
    encoder = opened.navigation.encoder
    assert encoder is not None
    shifts = np.arange(times) * period
    longer = replace(
        encoder,
        stamp_ns=(encoder.stamp_ns + shifts[:, None]).ravel(),
        arrival_ns=(encoder.arrival_ns + shifts[:, None]).ravel(),
        angle=np.tile(encoder.angle, times),
    )
    angle = laser_angle(longer, opened.rig, config.sweep)

    def images() -> Iterator[Image]:
        for shift in shifts:
            for image in opened.log.images():
                yield replace(image, stamp_ns=image.stamp_ns + int(shift), arrival_ns=image.arrival_ns + int(shift))

    store = SweepStore(folder)
    gc.collect()
    tracemalloc.start()
    stripes = detect_all(images(), StripeDetector(config.stripe, opened.rig), None, 1)
    for sweep in make_sweeps(stripes, opened.rig, angle, config.sweep):
        store.add(sweep)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak, sum(entry.profiles for entry in store.entries)


def test_three_times_the_log_needs_no_more_memory(dive: Path, tmp_path: Path) -> None:
    """A dive of three times the length peaks within a tenth, and a megabyte, of the short one."""
    peak_of_scan(dive, tmp_path / "warm", 1)
    short, few = peak_of_scan(dive, tmp_path / "short", 1)
    long, many = peak_of_scan(dive, tmp_path / "long", 3)
    assert many == 3 * few
    assert long < 1.1 * short + 1_000_000
