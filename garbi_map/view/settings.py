"""Settings of the view room."""

from pydantic import Field

from garbi_map.settings import Settings


class ViewSettings(Settings):
    """Every field says its unit."""

    images: bool = Field(default=True, description="whether recordings hold the camera images, as they were recorded")
    every: int = Field(default=1, ge=1, description="of so many images one is shown, with its profile; 1: all of them")
    size_ratio: float = Field(
        default=1.5, gt=1.0, le=10.0, description="most bytes of a map's recording per byte of its log; more is thinned"
    )
    points: int = Field(default=3_000_000, ge=1000, description="most points of the growing map")
    points_per_sweep: int = Field(default=25_000, ge=100, description="most points of a sweep in the growing map")
    point_radius: float = Field(default=0.003, gt=0.0, description="m, least of a point of the growing map")
    ellipsoid_period: float = Field(
        default=3.0, gt=0.0, description="s between ellipsoids of the position's uncertainty"
    )
    outlier_band: float = Field(
        default=0.03, gt=0.0, description="m off the finished surface, beyond its spread, up to which points are shown"
    )
    longest_film: float = Field(
        default=60.0, gt=0.0, description="s that a map plays at most; a longer dive plays faster"
    )
