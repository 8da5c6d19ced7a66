"""Settings of the database and of how dives are laid on each other."""

from pydantic import Field

from garbi_map.settings import Settings


class PlaceSettings(Settings):
    """How a further dive finds its place in the map."""

    surfel_size: float = Field(default=0.03, gt=0.002, description="m, voxel of the planar patches that are compared")
    surfel_points: int = Field(default=8, ge=4, description="fewest points of a patch")
    cell: float = Field(default=0.03, gt=0.002, description="m, cell of the relief that is correlated")
    heading: float = Field(
        default=20.0, gt=0.0, le=180.0, description="deg by which headings of two dives differ at most; then all round"
    )
    least_overlap: float = Field(default=0.25, gt=0.0, description="m^2 that both must have seen")
    least_agreement: float = Field(
        default=0.5, gt=0.0, lt=1.0, description="share of the common ground that must lie within `agreement`"
    )
    agreement: float = Field(default=0.003, gt=0.0, description="m, between patches that show the same ground")
    least_move: float = Field(
        default=2e-4, ge=0.0, description="m; a submap that would be moved by less stays, and is not fused again"
    )
    weakest: float = Field(
        default=1e6, gt=0.0, description="1/m^2; where a direction is known less well, the ground is too flat to tell"
    )


class DatabaseSettings(Settings):
    """What DIR/db holds, and when a dive is refused."""

    submap_seconds: float = Field(
        default=12.0, gt=0.0, description="s; sweeps of that time make one submap, which is stiff"
    )
    several_rigs: bool = Field(default=False, description="a dive with another rig.yaml may join the map")
    split_gap: float = Field(
        default=60.0, gt=0.0, description="s; log files with a longer pause between them are different dives"
    )
    place: PlaceSettings = PlaceSettings()
