"""How much of a map fits into a recording that shall not be much larger than its log."""

from __future__ import annotations

from dataclasses import dataclass

from garbi_map.view.settings import ViewSettings

_TRIANGLE = 24  # bytes of a triangle, with its half of a vertex: place, normal, colour
_POINT = 36  # bytes of a point of the growing map: place and six colours
_SEEN = 20  # bytes of a point of a profile: place in the rig and in the image
_CURVES = 15_000  # bytes of poses and curves per second
_LEAST = 400_000  # bytes without which there is nothing to see


@dataclass(frozen=True)
class Budget:
    """triangles of the mesh; points of each sweep in the growing map; points of each profile."""

    triangles: int
    points_per_sweep: int
    points_per_profile: int


def share_out(
    log_bytes: int, image_bytes: int, seconds: float, sweeps: int, profiles: int, settings: ViewSettings
) -> Budget:
    """What images and curves leave of `size_ratio` times the log: two fifths for the mesh, two for the map, one for the
    profiles."""
    left = max(settings.size_ratio * log_bytes * 0.97 - image_bytes - _CURVES * seconds, _LEAST)
    points = min(0.4 * left / _POINT, settings.points)
    return Budget(
        triangles=max(int(0.4 * left / _TRIANGLE), 1000),
        points_per_sweep=max(min(int(points / max(sweeps, 1)), settings.points_per_sweep), 50),
        points_per_profile=min(max(int(0.2 * left / _SEEN / max(profiles, 1)), 8), 128),
    )
