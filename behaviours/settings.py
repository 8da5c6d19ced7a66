"""Settings of the behaviours: the vehicle, what it may assume, and how each behaviour acts."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from garbi_map.settings import Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Axis = Literal["surge", "heave", "yaw", "pitch"]


class Vehicle(Settings):
    """The hull as a box about base_link, and what the propellers can do. Defaults: GARBI, assumed."""

    hull: tuple[Positive, Positive, Positive] = Field((1.3, 0.9, 0.7), description="length, width, height, m")
    limits: tuple[Positive, Positive, Positive, Positive] = Field(
        (0.3, 0.15, 0.35, 0.2), description="largest surge and heave, m/s, yaw and pitch, rad/s, that are commanded"
    )
    astern: Positive = Field(0.2, description="largest speed backwards, m/s")
    brake: Positive = Field(0.15, description="deceleration that braking reaches for sure, m/s^2")
    reaction: Positive = Field(0.5, description="from an image to the propellers' answer, s")
    sway_time: Positive = Field(3.0, description="in which the vehicle takes on the speed of the water abeam, s")
    skid: Share = Field(0.8, description="share of surge times yaw rate with which it slides outwards in a turn")


class FeedSettings(Settings):
    """When things become known, and what is no longer believed."""

    processing: NotNegative = Field(0.02, description="from an image's arrival to its profile, s")
    period: Positive = Field(0.1, description="between decisions, s")
    carve: float = Field(0.035, gt=0, lt=0.2, description="angle between the rays that carve space, rad")
    encoder_stuck: Positive = Field(0.5, description="encoder without a change for this long is stuck, s")
    encoder_reach: Positive = Field(0.05, description="extrapolation of the laser's angle at most, s")
    min_range: Positive = Field(0.2, description="nearest camera depth that is believed, m")
    max_range: Positive = Field(4.0, description="farthest camera depth that is believed, m")
    sensor_silent: Positive = Field(1.0, description="navigation silent for this long stops the vehicle, s")


class ClearWater(Settings):
    """What a row without a stripe proves: free water as far as the faintest surface would have shown."""

    attenuation: Positive = Field(0.3, description="worst beam attenuation of the light that still counts, 1/m")
    darkest: Share = Field(0.35, description="reflectance of the darkest surface relative to those seen lately")
    faintest: Positive = Field(8.0, description="grey levels at which a stripe is found for sure")
    believed: Positive = Field(4.0, description="returns prove the water's clarity for this long, s")
    farthest: Positive = Field(3.2, description="never more than this, m along the optical axis")


class SpaceSettings(Settings):
    """The local volume."""

    voxel: float = Field(0.1, gt=0.02, le=0.2, description="edge, m")
    reach: tuple[Positive, Positive] = Field((5.0, 2.5), description="half width and half height, m")
    hits: int = Field(3, ge=1, description="points in one voxel that make it occupied")
    hold: Positive = Field(6.0, description="seen free this long after the last hit, a voxel is free again, s")
    hold_moving: Positive = Field(2.5, description="the same where something moving was hit, s")
    free_passes: int = Field(2, ge=1, description="passes through which a voxel was free before a hit is a movement")
    free_time: Positive = Field(3.0, description="s since it was first seen free, likewise")
    settled: Positive = Field(2.5, description="a voxel hit again this much later holds something that stands still, s")
    launch_clearance: NotNegative = Field(
        1.2, description="free water about the hull where the vehicle is launched: the operator's word, m"
    )


class Prior(Settings):
    """Free water that is assumed rather than seen; only for rigs that cannot see ahead, and only where it is stated."""

    free_above: Positive = Field(description="water is free above this height over the highest mapped bottom, m")
    speed: Positive = Field(0.08, description="largest speed on the strength of it, m/s")


class SafetySettings(Settings):
    """The barrier and what limits speed."""

    clearance: Positive = Field(0.3, description="kept between hull and obstacle, m")
    clearance_unknown: NotNegative = Field(0.0, description="kept between hull and unseen space, m")
    nudge: NotNegative = Field(
        0.08, description="of a corner into unseen space as the vehicle turns: it stops within half a voxel, m/s"
    )
    clearance_moving: Positive = Field(0.5, description="kept between hull and a moving obstacle, m")
    gain: Positive = Field(0.6, description="class-K gain of the barrier, 1/s")
    horizon: Positive = Field(1.3, description="obstacles farther from the hull are left out, m")
    retreat: Positive = Field(0.12, description="speed of backing off when too near, m/s")
    unseen_speed: NotNegative = Field(0.15, description="speed of what may come into view unseen, m/s")
    creep: NotNegative = Field(0.1, description="speed that is always allowed in a fresh view, m/s")
    fresh: Positive = Field(6.0, description="a view is fresh until this age, s")
    stale: Positive = Field(9.0, description="a view of this age lets the vehicle go astern only, s")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stale <= self.fresh:
            raise ValueError("stale must be longer than fresh")
        return self


class EscapeSettings(Settings):
    """Out of the way of what moves."""

    horizon: Positive = Field(12.0, description="looked ahead, s")
    near: Positive = Field(0.4, description="what would come nearer to the hull than this is escaped, m")
    release: Positive = Field(0.5, description="an escape is over when nothing would come nearer than this, m")
    keep: Positive = Field(0.8, description="a manoeuvre that keeps this gap is good enough, m")
    clearance: NotNegative = Field(0.3, description="kept between hull and what stands meanwhile, m")


class AvoidanceSettings(Settings):
    """Turning away, and escape."""

    priority: int = Field(100, description="larger dominates")
    notice: Positive = Field(0.9, description="distance from the hull at which it begins to act, m")
    beside: Positive = Field(0.25, description="the same for what lies abeam, above or below, m")
    full: Positive = Field(0.45, description="distance at which it acts fully, m")
    speed: Positive = Field(0.12, description="of backing off, m/s")
    escape: EscapeSettings = EscapeSettings()


class TravelSettings(Settings):
    """On to a goal, around what is in the way; straight on without one."""

    priority: int = 10
    goal: tuple[float, float, float] | None = Field(None, description="m, in the feed's own frame (first pose 0, 0, 0)")
    speed: Positive = Field(0.2, description="m/s")
    arrived: Positive = Field(0.35, description="a goal this near is reached, m")
    replan: Positive = Field(0.5, description="between plans, s")
    unsettled_speed: NotNegative = Field(0.08, description="with which what was seen once may come out of view, m/s")
    unsettled_most: NotNegative = Field(0.6, description="by which it may have come at most before it is seen again, m")
    clearance: NotNegative = Field(0.3, description="planned between hull and obstacle, m")
    band: Positive = Field(0.6, description="heights above and below the vehicle that are considered, m")


class HoldSettings(Settings):
    """Range, yaw and pitch to an object."""

    priority: int = 50
    target: Literal["plane", "cylinder", "patch"] = Field("plane", description="what is held to")
    at: tuple[float, float, float] | None = Field(
        None, description="m, in the feed's own frame: the object that is meant; none: the nearest ahead"
    )
    range: Positive = Field(1.5, description="from the rig to the object, along the view, m")
    window: Positive = Field(4.5, description="points as old as this make a new target, s")
    tolerance: Positive = Field(0.03, description="1 sigma of the surface about the fitted shape, m")
    least_points: int = Field(300, ge=10, description="fewer points in the window are no target")
    least_spread: Positive = Field(0.12, description="m, 1 sigma: a plane is not fitted to less")
    nearest: Positive = Field(0.4, description="a nearer target is out of range, m")
    farthest: Positive = Field(2.8, description="a farther target is out of range, m")
    jump: Positive = Field(0.3, description="what is nearer than the target by this is a glitch until it lasts, m")
    confirm: Positive = Field(2.0, description="a new target has to last this long, s")
    lost: Positive = Field(4.0, description="not seen for this long the target is lost, s")
    gains: tuple[Positive, Positive, Positive] = Field((1.5, 0.8, 0.5), description="range, yaw, pitch, 1/s")
    fastest: Positive = Field(0.12, description="approach to the wanted range, m/s")
    stiffness: NotNegative = Field(3.0, description="what a speed that is off adds to the command, against waves")
    lead: NotNegative = Field(0.2, description="from a command to the vehicle's answer, s")


class SurveySettings(Settings):
    """A bounded area, covered."""

    priority: int = 30
    area: tuple[float, float, float, float] | None = Field(
        None, description="west, south, east, north, m in the feed's frame; none: wander"
    )
    altitude: Positive = Field(1.2, description="over the relief, m")
    overlap: Share = Field(0.2, description="of neighbouring lanes")
    coverage: Share = Field(0.985, description="of the cells of area and margin that have to be seen")
    margin: NotNegative = Field(0.05, description="about the area that is covered too, for navigation errs, m")
    cell: Positive = Field(0.1, description="of the coverage grid, m")
    speed: Positive = Field(0.12, description="m/s")


class BehaviourSettings(Settings):
    """Everything; a behaviour that is None does not run."""

    vehicle: Vehicle = Vehicle()
    feed: FeedSettings = FeedSettings()
    water: ClearWater = ClearWater()
    space: SpaceSettings = SpaceSettings()
    prior: Prior | None = None
    safety: SafetySettings = SafetySettings()
    avoidance: AvoidanceSettings | None = AvoidanceSettings()
    travel: TravelSettings | None = TravelSettings()
    hold: HoldSettings | None = None
    survey: SurveySettings | None = None
