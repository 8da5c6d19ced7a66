"""Settings of the sweep room."""

from typing import Self

from pydantic import Field, model_validator

from garbi_map.settings import Settings


class SweepSettings(Settings):
    """How stripes become points, and points become sweeps."""

    min_range: float = Field(
        default=0.2, gt=0, description="nearest camera depth (along the optical axis) that is kept, m"
    )
    max_range: float = Field(default=5.0, gt=0, description="farthest camera depth that is kept, m")

    window: float = Field(default=2.0, gt=0, description="length of a sweep while the laser stands still, s")
    longest: float = Field(default=15.0, gt=0, description="a longer sweep is cut, s")
    least_turn: float = Field(
        default=0.01, gt=0, lt=3, description="a smaller change of the laser's angle is standing still, rad"
    )
    least_points: int = Field(default=500, ge=1, description="a sweep with fewer points is left out")

    encoder_gap: float = Field(
        default=0.05, gt=0, description="readings farther apart are not interpolated (or 2.5 periods), s"
    )

    row_gap: int = Field(default=3, ge=1, description="rows farther apart are not neighbours in a profile")
    edge_slope: float = Field(
        default=6.0,
        gt=0,
        description="neighbours farther apart along the ray than this many times across it are a depth edge",
    )
    least_run: int = Field(default=3, ge=1, description="a run of fewer points between depth edges or gaps is dropped")
    least_extent: float = Field(
        default=0.01, ge=0, description="and one that is shorter across the ray, m: marine snow"
    )
    edge_rows: int = Field(default=2, ge=0, description="rows on either side of a depth edge whose stripe may be mixed")
    edge_sigma: float = Field(default=0.7, ge=0, description="what a mixed stripe adds to the column's sigma, px")

    @model_validator(mode="after")
    def _ranges_are_ordered(self) -> Self:
        if self.min_range >= self.max_range:
            raise ValueError("min_range must be less than max_range")
        return self
