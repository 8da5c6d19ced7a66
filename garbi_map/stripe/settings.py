"""Settings of the stripe room."""

from typing import Literal

from pydantic import Field

from garbi_map.settings import Settings


class GateSettings(Settings):
    """The laser's colour in hue, lightness, saturation: what the paper's look-up tables held."""

    hue: tuple[float, float] | None = Field(
        default=None, description="degrees, red 0, green 120, blue 240; may wrap; none: that of the laser's channel"
    )
    lightness: float = Field(default=0.06, ge=0, le=1, description="least lightness, 0..1")
    saturation: float = Field(default=0.25, ge=0, le=1, description="least saturation, 0..1")
    white: float = Field(
        default=0.85, ge=0, le=1, description="lighter than this passes whatever its hue: a saturated stripe"
    )


class StripeSettings(Settings):
    """How the laser line is found in an image."""

    method: Literal["matched", "paper"] = Field(default="matched", description="'paper': its centre of gravity")
    laser: Literal["green", "red", "blue", "mono"] = Field(default="green", description="the laser's channel")
    gate: GateSettings = GateSettings()
    window: bool = Field(default=True, description="look only where the laser's angle and the ranges allow the stripe")
    window_margin: float = Field(default=6.0, ge=0, description="widens that window on both sides, px")
    min_range: float = Field(default=0.25, gt=0, description="nearest bottom looked for, m of camera depth")
    max_range: float = Field(default=5.0, gt=0, description="farthest bottom that is looked for, m")
    width: float = Field(default=0.0, ge=0, le=20, description="1 sigma of the stripe, px; 0: learnt from each image")
    least_contrast: float = Field(default=10.0, gt=0, le=255, description="least peak above its surroundings, 0..255")
    significance: float = Field(default=5.0, gt=0, description="least peak above its surroundings, in noise sigmas")
    least_run: int = Field(default=12, ge=1, description="a piece of the stripe of fewer rows is dropped")
    largest_step: float = Field(default=4.0, gt=0, description="most px between neighbouring rows of a piece")
    max_pixels: int = Field(default=50_000_000, ge=10_000, description="larger images are refused undecoded")
