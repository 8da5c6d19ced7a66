"""Settings of the stripe room."""

from typing import Literal

from pydantic import Field

from garbi_map.settings import Settings


class GateSettings(Settings):
    """The laser's colour in hue, lightness, saturation: what the paper's look-up tables held."""

    hue: tuple[float, float] = Field((90.0, 180.0), description="degrees, red 0, green 120, blue 240; may wrap")
    lightness: float = Field(0.06, ge=0, le=1, description="least lightness, 0..1")
    saturation: float = Field(0.25, ge=0, le=1, description="least saturation, 0..1")
    white: float = Field(0.85, ge=0, le=1, description="lighter than this passes whatever its hue: a saturated stripe")


class StripeSettings(Settings):
    """How the laser line is found in an image."""

    method: Literal["matched", "paper"] = Field("matched", description="'paper': HLS threshold and centre of gravity")
    laser: Literal["green", "red", "blue", "mono"] = Field("green", description="the channel that carries the laser")
    gate: GateSettings = GateSettings()
    window: bool = Field(True, description="look only where the laser's angle and the ranges allow the stripe")
    window_margin: float = Field(6.0, ge=0, description="widens that window on both sides, px")
    min_range: float = Field(0.25, gt=0, description="nearest bottom that is looked for, m along the optical axis")
    max_range: float = Field(5.0, gt=0, description="farthest bottom that is looked for, m")
    width: float = Field(0.0, ge=0, le=20, description="1 sigma of the stripe's profile, px; 0: learnt from each image")
    least_contrast: float = Field(10.0, gt=0, le=255, description="least peak above its surroundings, 0..255")
    significance: float = Field(5.0, gt=0, description="least peak above its surroundings, in noise sigmas")
    least_run: int = Field(5, ge=1, description="a piece of the stripe of fewer rows is dropped")
    largest_step: float = Field(
        4.0, gt=0, description="columns by which neighbouring rows of one piece differ at most, px"
    )
    max_pixels: int = Field(50_000_000, ge=10_000, description="larger images are refused before they are decoded")
