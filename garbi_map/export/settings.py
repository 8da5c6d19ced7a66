"""Settings of the export room."""

from pydantic import Field

from garbi_map.settings import Settings


class ExportSettings(Settings):
    """Every field says its unit."""

    cloud_scale: float = Field(default=1e-5, gt=0.0, le=0.01, description="m, step of the coordinates in cloud.laz")
    max_triangles: int = Field(default=500_000, ge=1000, description="of seabed.glb; cells are averaged until it fits")
    widest_hole: float = Field(
        default=0.02, ge=0.0, le=1.0, description="m; holes up to this are interpolated in seabed.glb and hillshade.png"
    )
    hillshade_pixels: int = Field(default=1800, ge=400, le=20_000, description="longer side of hillshade.png, px")
    sun_azimuth: float = Field(default=315.0, ge=0.0, le=360.0, description="degrees clockwise from north")
    sun_elevation: float = Field(default=45.0, gt=0.0, le=90.0, description="degrees above the horizon")
    exaggeration: float = Field(default=1.5, gt=0.0, description="of the relief, for shading only")
