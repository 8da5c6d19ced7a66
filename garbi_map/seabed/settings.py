"""Settings of the seabed room."""

from pydantic import Field

from garbi_map.settings import Settings


class OutlierSettings(Settings):
    """When a point is taken for marine snow, a reflection or a stray instead of the seabed."""

    voxel: float = Field(default=0.01, gt=0.0, le=1.0, description="m; agreement is judged in 3 x 3 x 3 of these")
    min_points: int = Field(
        default=6, ge=1, description="points that the neighbourhood of a seabed point holds at least"
    )
    min_run: int = Field(
        default=12, ge=2, description="consecutive rows of one profile that are a surface by themselves"
    )
    min_share: float = Field(
        default=0.03,
        ge=0.0,
        lt=1.0,
        description="of the profiles that hit the best of the column, below which it was seen through",
    )
    max_through: float = Field(
        default=0.45,
        gt=0.0,
        le=1.0,
        description="of the profiles that hit a place or saw through it, those that saw through, beyond which it moved",
    )
    body: float = Field(default=0.5, gt=0.0, description="m, longest side of what may move as one body")
    body_through: float = Field(
        default=0.2,
        gt=0.0,
        le=1.0,
        description="of a body's points, beyond which those seen through speak for all that was not looked at again",
    )
    clearance: float = Field(
        default=0.05,
        gt=0.0,
        description="m between the seabed and what floats over it and is no seabed unless seen again",
    )
    gap: float = Field(default=0.02, gt=0.0, description="m before what a ray hits, within which it proves nothing")
    beam: float = Field(default=0.003, gt=0.0, description="m from the middle of a voxel's points to a ray through it")
    thin_beam: float = Field(default=0.0012, gt=0.0, description="m, likewise for what is thinner than such a ray")
    every: int = Field(default=2, ge=1, description="rows, of which the rays of one are followed")
    gate: float = Field(
        default=4.0, gt=0.0, description="sigmas that a point without support of its own may lie off the surface"
    )
    max_sigma: float = Field(default=0.05, gt=0.0, description="m; a point less certain than this is left out")
    max_voxels: int = Field(
        default=3_000_000,
        ge=10_000,
        description="that are in memory at a time, 0.3 kB each; a dive that has hit so many is judged in stretches",
    )


class SolidSettings(Settings):
    """The surface in three dimensions."""

    make: bool = Field(default=False, description="write surface.ply: half a minute for every square metre")
    voxel: float = Field(default=0.004, gt=0.0, le=1.0, description="m; points are averaged in these")
    tile: float = Field(default=1.0, gt=0.0, description="m, side of the cubes that are worked on one after the other")
    normal_radius: float = Field(default=0.02, gt=0.0, description="m; the points within tell the surface's normal")
    reach: float = Field(default=0.012, gt=0.0, description="m from a point, within which the surface is kept")
    deepest: int = Field(default=9, ge=4, le=12, description="most halvings of a tile by the octree")


class SeabedSettings(Settings):
    """Every field says its unit."""

    cell: float = Field(default=0.005, gt=0.0, le=10.0, description="m, side of a cell of the elevation grid")
    sigma_floor: float = Field(default=5e-5, gt=0.0, description="m; no point is believed to be better than this")
    pose_memory: float = Field(
        default=4.0, ge=0.0, description="s, correlation time of the path's errors; 0: those of every sweep are its own"
    )
    max_cells: int = Field(
        default=4_000_000,
        ge=4096,
        description="cells of the finished grid; a larger site gets cells of 2, 4, 8, ... times the side",
    )
    agreement_window: float = Field(
        default=0.16, gt=0.0, description="m; sweeps are compared with their covariances over squares of this side"
    )
    outliers: OutlierSettings = OutlierSettings()
    solid: SolidSettings = SolidSettings()
