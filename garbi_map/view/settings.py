"""Settings of the view room."""

from pydantic import Field

from garbi_map.settings import Settings


class ViewSettings(Settings):
    """Every field says its unit."""

    images: bool = Field(True, description="put the camera images into the recording, as they were recorded")
    every: int = Field(1, ge=1, description="take every so-manieth image, with its profile; 1: all")
    points_per_sweep: int = Field(20_000, ge=100, description="most points of a sweep in the map that grows")
    size_ratio: float = Field(
        1.5,
        gt=1.0,
        le=10.0,
        description="largest size of the recording over that of the log: points and mesh are thinned",
    )
    ellipsoid_period: float = Field(3.0, gt=0.0, description="s between two ellipsoids of the position's uncertainty")
    outlier_band: float = Field(
        0.03,
        gt=0.0,
        description="m beside the finished surface, beyond 4 standard deviations, up to which points are shown",
    )
