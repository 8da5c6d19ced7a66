"""Settings of the calibration."""

from typing import Literal

from pydantic import Field

from garbi_map.settings import Settings

Term = Literal["k1", "k2", "p1", "p2", "k3"]


class CalibrateSettings(Settings):
    """How camera and laser are calibrated, and what is refused."""

    distortion: tuple[Term, ...] = Field(
        default=("k1", "k2", "p1", "p2"), description="terms that are solved for; others are 0"
    )
    most_views: int = Field(default=60, ge=3, description="more views of the camera's target are thinned out")
    max_blur: float = Field(default=2.5, gt=0, description="an image whose edges are wider is left out, 1 sigma, px")
    max_corner_noise: float = Field(
        default=2.0, gt=0, description="a camera that fits its corners worse is refused, rms px"
    )
    max_focal_sigma: float = Field(
        default=0.02, gt=0, description="a focal length less certain is refused, share of it"
    )

    method: Literal["refined", "linear", "paper"] = Field(
        default="refined", description="'linear': the five-column solve alone; 'paper': its equations, as corrected"
    )
    target_images: int = Field(default=9, ge=3, description="images of a sweep in which the target is looked for")
    max_motion: float = Field(default=0.5, gt=0, description="a sweep in which the target moves more is left out, px")
    least_stripe: int = Field(default=12, ge=3, description="rows that an image must show of the stripe on the target")
    most_stripe_points: int = Field(default=20000, ge=100, description="more are thinned out evenly")
    max_stripe_noise: float = Field(
        default=2.0, gt=0, description="a laser that fits the stripes worse is refused, rms px"
    )
    max_outliers: float = Field(
        default=0.25, gt=0, lt=1, description="a larger share of stripe off the target is refused"
    )
    max_error: float = Field(
        default=0.02, gt=0, description="a laser that is less certain at the farthest of `ranges` is refused, m"
    )
    prior_tilt: float = Field(
        default=0.035, gt=0, description="1 sigma of beta, theta and gamma beforehand, about 0, rad"
    )
    prior_height: float = Field(
        default=0.1, gt=0, description="1 sigma of the apex's z beforehand, about the start's, m"
    )
    prior_latency: float = Field(default=0.05, gt=0, description="1 sigma of the encoder's latency beforehand, s")
    ranges: tuple[float, ...] = Field(default=(1.0, 1.5, 2.0), description="depths at which the error is stated, m")
