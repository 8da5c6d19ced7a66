"""Settings of the comparison of two maps."""

from pydantic import Field

from garbi_map.settings import Settings


class AlignmentSettings(Settings):
    """How the free origin of the second map is found in the first."""

    coarse_cell: float = Field(default=0.03, gt=0.0, le=10.0, description="m, cell in which all headings are searched")
    relief_scale: float = Field(default=0.25, gt=0.0, description="m; what is broader does not count as relief")
    yaw_step: float = Field(default=2.0, gt=0.0, le=30.0, description="degrees between the headings that are tried")
    least_overlap: float = Field(
        default=0.2, gt=0.0, le=1.0, description="share of the smaller map that the other shows"
    )
    gates: tuple[float, ...] = Field(
        default=(0.06, 0.03, 0.015, 0.008, 0.005, 0.005, 0.005, 0.005),
        min_length=1,
        description="m; what lies farther apart hardly counts in a round of the fine alignment",
    )
    least_explained: float = Field(
        default=0.7, ge=0.0, le=1.0, description="share of the relief's variance that both maps must have in common"
    )
    block: float = Field(default=0.25, gt=0.0, description="m; residuals within such a square may err as one")


class CompareSettings(Settings):
    """Every field says its unit."""

    align: AlignmentSettings = AlignmentSettings()
    normal_scale: float = Field(default=0.06, gt=0.0, description="m, diameter of the ball that tells the normal")
    cylinder: float = Field(default=0.024, gt=0.0, description="m, diameter of the cylinders that are averaged")
    reach: float = Field(
        default=0.3, gt=0.0, description="m, half length of the cylinder: the largest change that is seen"
    )
    sheet: float = Field(default=0.02, gt=0.0, description="m; points this near to the middle one are of one surface")
    min_points: int = Field(default=5, ge=2, description="points in a cylinder")
    least_change: float = Field(default=0.004, ge=0.0, description="m; smaller changes are not told")
    least_area: float = Field(default=2e-4, ge=0.0, description="m^2; smaller patches are not told")
    false_alarms: float = Field(
        default=0.05, gt=0.0, lt=1.0, description="expected number of patches in a comparison where nothing has changed"
    )
    farthest_move: float = Field(
        default=0.5, ge=0.0, description="m; something lost and gained within that may have moved"
    )
    max_points: int = Field(default=20_000_000, ge=1000, description="points of a cloud that are used, evenly thinned")
