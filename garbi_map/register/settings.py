"""Settings of the register room."""

from pydantic import Field

from garbi_map.settings import Settings


class DriftSettings(Settings):
    """The continuous-time estimate of the motion inside and between sweeps."""

    position_knots: float = Field(0.2, gt=0.02, description="spacing of the position spline's knots, s")
    attitude_knots: float = Field(1.0, gt=0.05, description="spacing of the attitude correction's knots, s")
    window: float = Field(150.0, gt=20, description="longest stretch of time that is solved at once, s")
    live_window: float = Field(
        24.0, gt=4, description="stretch of time that is solved anew with each sweep while a dive lasts, s"
    )
    overlap: float = Field(40.0, gt=4, description="how much two neighbouring windows share, s")
    window_points: int = Field(1_000_000, ge=10_000, description="points of a window beyond which they are thinned")
    surfel_size: float = Field(0.03, gt=0.002, description="voxel that the last surfels are made from, m")
    coarse_surfel_size: float = Field(0.04, gt=0.002, description="voxel that the first surfels are made from, m")
    settled_surfels: int = Field(8, ge=1, description="surfels of a voxel that are remembered once a window is solved")
    surfel_points: int = Field(8, ge=4, description="fewest points of a surfel")
    gate: float = Field(0.01, gt=0.001, description="largest distance between matched surfels in the last round, m")
    coarse_gate: float = Field(0.06, gt=0.001, description="largest distance between matched surfels at first, m")
    match_sigma: float = Field(2.5e-4, gt=0, description="1 sigma of a match in the last round, m")
    coarse_match_sigma: float = Field(4e-3, gt=0, description="1 sigma of a match in the first round, m")


class FrontEndSettings(Settings):
    """kiss-icp, scan to map; it computes in centimetres, see front_end.py."""

    voxel: float = Field(0.02, gt=0.001, description="voxel of the local map, m")
    points_per_voxel: int = Field(20, ge=1)
    correspondence: float = Field(0.05, gt=0.001, description="largest distance of a correspondence, m")
    kernel: float = Field(0.01, gt=0.0001, description="scale of the robust kernel, m")
    local_map: float = Field(3.0, gt=0.1, description="points farther than this from the sweep are forgotten, m")
    weakest: float = Field(1e6, gt=0, description="a direction with less information is not corrected, 1/m^2")
    sweeps_per_place: int = Field(
        8, ge=1, description="sweeps of a place that later ones are laid on, the first of them"
    )
    loops_per_sweep: int = Field(6, ge=1, description="earlier sweeps that a sweep may close loops with")
    loop_matches: int = Field(60, ge=6, description="fewest matched surfels of a loop")
    loop_agreement: float = Field(
        0.002, gt=0, description="median distance of matched surfels after a loop is closed, m"
    )


class RegisterSettings(Settings):
    """Scan to map, pose graph, drift."""

    live: bool = Field(False, description="place each sweep by what is known when it ends, as a vehicle would")
    drift: DriftSettings = DriftSettings()
    front_end: FrontEndSettings = FrontEndSettings()
