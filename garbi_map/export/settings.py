"""Settings of the export room."""

from typing import Literal

from pydantic import Field, field_validator

from garbi_map.export.origin import Origin
from garbi_map.settings import Settings

_PROGRAM = 7e8
"""Bytes of memory that code and libraries take, and what does not grow with the site."""


class ExportSettings(Settings):
    """Every field says its unit."""

    memory: float = Field(
        default=2.0,
        ge=1.0,
        description="GB for making the map of however large a site: points beyond it are sorted on disk, and cells grow",
    )

    origin: str | None = Field(
        default=None, description="LAT,LON[,HEADING], degrees: where the dive begins, and where the map's x axis points"
    )
    origin_sigma: float | None = Field(
        default=None, gt=0.0, description="m, 1 sigma of the origin along each axis; null: as the fixes say, or unknown"
    )
    surface_sigma: float = Field(
        default=0.1, ge=0.0, description="m, 1 sigma of the water level that depths count from: air pressure, waves"
    )
    projection: Literal["utm", "local"] = Field(
        default="utm",
        description="local: transverse Mercator about the origin, in which metres are those of the ground",
    )
    cloud_scale: float = Field(default=1e-5, gt=0.0, le=0.01, description="m, step of the coordinates in cloud.laz")
    max_triangles: int = Field(default=500_000, ge=1000, description="of seabed.glb; cells are averaged until it fits")
    widest_hole: float = Field(
        default=0.02, ge=0.0, le=1.0, description="m; holes up to this are interpolated in seabed.glb and hillshade.png"
    )
    hillshade_pixels: int = Field(default=1800, ge=400, le=20_000, description="longer side of hillshade.png, px")
    sun_azimuth: float = Field(default=315.0, ge=0.0, le=360.0, description="degrees clockwise from north")
    sun_elevation: float = Field(default=45.0, gt=0.0, le=90.0, description="degrees above the horizon")
    exaggeration: float = Field(default=1.5, gt=0.0, description="of the relief, for shading only")
    contour_interval: float | None = Field(default=None, gt=0.0, description="m; null: about twenty contours")

    @field_validator("origin")
    @classmethod
    def _is_a_place(cls, text: str | None) -> str | None:
        if text is not None:
            Origin.parse(text)
        return text

    @property
    def place(self) -> Origin | None:
        """The origin that was given."""
        return None if self.origin is None else Origin.parse(self.origin)

    def room_for(self, size: int) -> int:
        """How many things of so many bytes fit into half of the memory beside the program: two files are made at a time."""
        return int((1e9 * self.memory - _PROGRAM) / 2 / size)
