"""Where sensors are: mounts from static transforms, and local metres from latitude and longitude."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from garbi_map.log.records import Floats, Mount

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563  # WGS84 (NIMA TR8350.2)


def compose(outer: Mount, inner: Mount) -> Mount:
    """a <- c from a <- b and b <- c."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_quat(outer.quaternion)
    return Mount(
        outer.translation + rotation.apply(inner.translation),
        (rotation * Rotation.from_quat(inner.quaternion)).as_quat(),
    )


def invert(mount: Mount) -> Mount:
    """b <- a from a <- b."""
    from scipy.spatial.transform import Rotation

    back = Rotation.from_quat(mount.quaternion).inv()
    return Mount(-back.apply(mount.translation), back.as_quat())


def mounts_in(base: str, transforms: Iterable[tuple[str, str, Mount]]) -> dict[str, Mount]:
    """Poses base <- frame of every frame that a chain of (parent, child, parent <- child) connects with `base`."""
    neighbours: dict[str, dict[str, Mount]] = {}
    for parent, child, mount in transforms:
        neighbours.setdefault(parent, {})[child] = mount
        neighbours.setdefault(child, {})[parent] = invert(mount)
    mounts = {base: Mount()}
    waiting = [base]
    while waiting:
        frame = waiting.pop()
        for neighbour, mount in neighbours.get(frame, {}).items():
            if neighbour not in mounts:
                mounts[neighbour] = compose(mounts[frame], mount)
                waiting.append(neighbour)
    del mounts[base]
    return mounts


def _earth_centred(latitude: Floats, longitude: Floats, height: Floats) -> Floats:
    squared = FLATTENING * (2 - FLATTENING)
    normal = SEMI_MAJOR / np.sqrt(1 - squared * np.sin(latitude) ** 2)
    across = (normal + height) * np.cos(latitude)
    return np.stack(
        [
            across * np.cos(longitude),
            across * np.sin(longitude),
            (normal * (1 - squared) + height) * np.sin(latitude),
        ],
        axis=-1,
    )


def east_north_up(geodetic: Floats, origin: tuple[float, float, float]) -> Floats:
    """Local tangent-plane coordinates (n, 3) m of WGS84 positions (n, 3) lat deg, lon deg, height m about `origin`."""
    latitude, longitude = np.radians(origin[0]), np.radians(origin[1])
    both = np.vstack([[origin], geodetic])
    earth = _earth_centred(np.radians(both[:, 0]), np.radians(both[:, 1]), both[:, 2])
    offset = earth[1:] - earth[0]
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return (
        offset
        @ np.array(
            [
                [-sin_lon, cos_lon, 0],
                [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
                [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
            ]
        ).T
    )
