"""Navigation arrays and a stream of images become a log in the project's own topics, in the order of their stamps."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain
from pathlib import Path

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter, Mount, Navigation
from garbi_map.log.records import Dvl, Encoder, Fixes, Imu, Odometry, Pressure

Entry = tuple[int, Callable[[LogWriter], None]]
"""Stamp, ns, and what writes the message."""


def write_log(
    out: Path,
    streams: Iterable[Iterator[Entry]],
    mounts: Mapping[str, Mount],
    rig_text: str | None = None,
    about: Mapping[str, str] | None = None,
) -> None:
    """Write streams of entries, each ascending, into one log.

    mounts: base_link <- sensor frame; rig_text: the rig file to attach; about: the metadata record "import".
    Raises GarbiError where the file exists, cannot be written, or where there is nothing to write.
    """
    if out.exists():
        raise GarbiError(f"{out}: exists already; give another name with -o, or remove it")
    entries = heapq.merge(*streams, key=lambda entry: entry[0])
    first = next(entries, None)
    if first is None:
        raise GarbiError(f"{out}: not written, there is nothing to put into it")
    with LogWriter(out) as log:
        if rig_text is not None:
            log.attach("rig.yaml", "application/yaml", rig_text.encode())
        if about:
            log.write_metadata("import", dict(about))
        if mounts:
            log.write_mounts(first[0], mounts)
        for _, write in chain([first], entries):
            write(log)


def image_entries(images: Iterable[Image]) -> Iterator[Entry]:
    """Images as they are."""
    for image in images:
        yield image.stamp_ns, lambda log, image=image: log.write_image(image)  # type: ignore[misc]


def navigation_entries(navigation: Navigation, joint: str) -> list[Iterator[Entry]]:
    """A stream for each sensor; joint: what the encoder is to be called."""
    streams = []
    if navigation.encoder is not None:
        streams.append(_encoder(navigation.encoder, joint))
    if navigation.imu is not None:
        streams.append(_imu(navigation.imu))
    if navigation.pressure is not None:
        streams.append(_pressure(navigation.pressure))
    if navigation.dvl is not None:
        streams.append(_dvl(navigation.dvl))
    if navigation.fixes is not None and navigation.fixes.origin is None:
        streams.append(_usbl(navigation.fixes))
    if navigation.odometry is not None:
        streams.append(_odometry(navigation.odometry))
    return streams


def _times(record: Encoder | Imu | Pressure | Dvl | Fixes | Odometry) -> Iterator[tuple[int, int, int]]:
    """(row, stamp, arrival), ns."""
    for row, (stamp, arrival) in enumerate(zip(record.stamp_ns.tolist(), record.arrival_ns.tolist(), strict=True)):
        yield row, stamp, arrival


def _encoder(record: Encoder, joint: str) -> Iterator[Entry]:
    def write(log: LogWriter, row: int, stamp: int, arrival: int) -> None:
        log.write_encoder(stamp, float(record.angle[row]), arrival, joint)

    return _entries(record, write)


def _imu(record: Imu) -> Iterator[Entry]:
    def write(log: LogWriter, row: int, stamp: int, arrival: int) -> None:
        turn = record.attitude[row]
        attitude, covariance = (turn, record.attitude_covariance[row]) if np.isfinite(turn).all() else (None, None)
        log.write_imu(stamp, record.rate[row], record.specific_force[row], attitude, covariance, arrival)

    return _entries(record, write)


def _pressure(record: Pressure) -> Iterator[Entry]:
    return _entries(
        record, lambda log, row, stamp, arrival: log.write_pressure(stamp, float(record.pressure[row]), arrival)
    )


def _dvl(record: Dvl) -> Iterator[Entry]:
    return _entries(
        record,
        lambda log, row, stamp, arrival: log.write_dvl(stamp, record.velocity[row], record.covariance[row], arrival),
    )


def _usbl(record: Fixes) -> Iterator[Entry]:
    return _entries(
        record,
        lambda log, row, stamp, arrival: log.write_usbl(stamp, record.position[row], record.covariance[row], arrival),
    )


def _odometry(record: Odometry) -> Iterator[Entry]:
    return _entries(
        record,
        lambda log, row, stamp, arrival: log.write_odometry(
            stamp, record.position[row], record.quaternion[row], arrival
        ),
    )


def _entries(
    record: Encoder | Imu | Pressure | Dvl | Fixes | Odometry, write: Callable[[LogWriter, int, int, int], None]
) -> Iterator[Entry]:
    for row, stamp, arrival in _times(record):
        yield stamp, lambda log, row=row, stamp=stamp, arrival=arrival: write(log, row, stamp, arrival)  # type: ignore[misc]
