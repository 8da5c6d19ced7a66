"""Settings of the behaviours: the vehicle, what it may assume, and how each behaviour acts."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from garbi_map.settings import Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]
Axis = Literal["surge", "heave", "yaw", "pitch"]


class Vehicle(Settings):
    """The hull as a box about base_link, and what the propellers can do. Defaults: GARBI, assumed."""

    hull: tuple[Positive, Positive, Positive] = (1.3, 0.9, 0.7)  # length, width, height, m
    # largest surge and heave, m/s, yaw and pitch, rad/s, that are commanded
    limits: tuple[Positive, Positive, Positive, Positive] = (0.3, 0.15, 0.35, 0.2)
    astern: Positive = 0.2  # largest speed backwards, m/s
    brake: Positive = 0.15  # deceleration that braking reaches for sure, m/s^2
    reaction: Positive = 0.5  # from an image to the propellers' answer, s
    sway_time: Positive = 3.0  # in which the vehicle takes on the speed of the water abeam, s
    skid: Share = 0.8  # share of surge times yaw rate with which it slides outwards in a turn


class FeedSettings(Settings):
    """When things become known, and what is no longer believed."""

    processing: NotNegative = 0.02  # from an image's arrival to its profile, s
    period: Positive = 0.1  # between decisions, s
    carve: Annotated[float, Field(gt=0, lt=0.2)] = 0.035  # angle between the rays that carve space, rad
    encoder_stuck: Positive = 0.5  # encoder without a change for this long is stuck, s
    encoder_reach: Positive = 0.05  # extrapolation of the laser's angle at most, s
    min_range: Positive = 0.2  # nearest camera depth that is believed, m
    max_range: Positive = 4.0  # farthest camera depth that is believed, m
    sensor_silent: Positive = 1.0  # navigation silent for this long stops the vehicle, s


class ClearWater(Settings):
    """What a row without a stripe proves: free water as far as the faintest surface would have shown."""

    attenuation: Positive = 0.3  # worst beam attenuation of the light that still counts, 1/m
    darkest: Share = 0.35  # reflectance of the darkest surface relative to those seen lately
    faintest: Positive = 13.0  # grey levels at which half of a surface's rows show (tools.trials agreement)
    believed: Positive = 4.0  # returns prove the water's clarity for this long, s
    farthest: Positive = 3.2  # never more than this, m along the optical axis


class SpaceSettings(Settings):
    """The local volume."""

    voxel: Annotated[float, Field(gt=0.02, le=0.2)] = 0.1  # edge, m
    reach: tuple[Positive, Positive] = (5.0, 2.5)  # half width and half height, m
    hits: Count = 3  # points in one voxel that make it occupied
    hold: Positive = 6.0  # seen free this long after the last hit, a voxel is free again, s
    hold_moving: Positive = 2.5  # the same where something moving was hit, s
    free_passes: Count = 2  # passes through which a voxel was free before a hit is a movement
    free_time: Positive = 3.0  # s since it was first seen free, likewise
    settled: Positive = 2.5  # a voxel hit again this much later holds something that stands still, s
    launch_clearance: NotNegative = (
        1.2  # free water about the hull where the vehicle is launched: the operator's word, m
    )


class Prior(Settings):
    """Free water that is assumed rather than seen; only for rigs that cannot see ahead, and only where it is stated."""

    free_above: Positive  # water is free above this height over the highest mapped bottom, m
    speed: Positive = 0.08  # largest speed on the strength of it, m/s


class SafetySettings(Settings):
    """The barrier and what limits speed."""

    clearance: Positive = 0.3  # kept between hull and obstacle, m
    clearance_unknown: NotNegative = 0.0  # kept between hull and unseen space, m
    nudge: NotNegative = 0.08  # of a corner into unseen space as the vehicle turns: it stops within half a voxel, m/s
    clearance_moving: Positive = 0.5  # kept between hull and a moving obstacle, m
    gain: Positive = 0.6  # class-K gain of the barrier, 1/s
    horizon: Positive = 1.3  # obstacles farther from the hull are left out, m
    retreat: Positive = 0.12  # speed of backing off when too near, m/s
    unseen_speed: NotNegative = 0.15  # speed of what may come into view unseen, m/s
    creep: NotNegative = 0.1  # speed that is always allowed in a fresh view, m/s
    fresh: Positive = 6.0  # a view is fresh until this age, s
    stale: Positive = 9.0  # a view of this age lets the vehicle go astern only, s

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.stale <= self.fresh:
            raise ValueError("stale must be longer than fresh")
        return self


class LeewaySettings(Settings):
    """Room to turn into the current in, before it carries the vehicle on to what stands."""

    horizon: Positive = 16.0  # rehearsed, s
    keep: NotNegative = 0.25  # kept between hull and what stands meanwhile, m
    release: NotNegative = 0.2  # more than that, and an escape is over, m
    above: NotNegative = 0.15  # kept above and below the hull, m


class EscapeSettings(Settings):
    """Out of the way of what moves."""

    horizon: Positive = 12.0  # looked ahead, s
    near: Positive = 0.4  # what would come nearer to the hull than this is escaped, m
    release: Positive = 0.5  # an escape is over when nothing would come nearer than this, m
    keep: Positive = 0.8  # a manoeuvre that keeps this gap is good enough, m
    clearance: NotNegative = 0.3  # kept between hull and what stands meanwhile, m


class AvoidanceSettings(Settings):
    """Turning away, and escape."""

    priority: int = 100  # larger dominates
    notice: Positive = 0.9  # distance from the hull at which it begins to act, m
    beside: Positive = 0.25  # the same for what lies abeam, above or below, m
    full: Positive = 0.45  # distance at which it acts fully, m
    speed: Positive = 0.12  # of backing off, m/s
    escape: EscapeSettings = EscapeSettings()


class TravelSettings(Settings):
    """On to a goal, around what is in the way; straight on without one."""

    priority: int = 10
    goal: tuple[float, float, float] | None = None  # m, in the feed's own frame (first pose 0, 0, 0)
    speed: Positive = 0.2  # m/s
    arrived: Positive = 0.35  # a goal this near is reached, m
    replan: Positive = 0.5  # between plans, s
    unsettled_speed: NotNegative = 0.08  # with which what was seen once may come out of view, m/s
    unsettled_most: NotNegative = 0.6  # by which it may have come at most before it is seen again, m
    clearance: NotNegative = 0.3  # planned between hull and obstacle, m
    band: Positive = 0.6  # heights above and below the vehicle that are considered, m


class HoldSettings(Settings):
    """Range, yaw and pitch to an object."""

    priority: int = 50
    target: Literal["plane", "cylinder", "patch"] = "plane"  # what is held to
    at: tuple[float, float, float] | None = (
        None  # m, feed's own frame: the object that is meant; none: the nearest ahead
    )
    range: Positive = 1.5  # from the rig to the object, along the view, m
    window: Positive = 4.5  # points as old as this make a new target, s
    tolerance: Positive = 0.03  # 1 sigma of the surface about the fitted shape, m
    least_points: Count = 300  # fewer points in the window are no target
    least_spread: Positive = 0.12  # m, 1 sigma: a plane is not fitted to less
    nearest: Positive = 0.4  # a nearer target is out of range, m
    farthest: Positive = 2.8  # a farther target is out of range, m
    jump: Positive = 0.3  # what is nearer than the target by this is a glitch until it lasts, m
    confirm: Positive = 2.0  # a new target has to last this long, s
    lost: Positive = 4.0  # not seen for this long the target is lost, s
    gains: tuple[Positive, Positive, Positive] = (1.5, 0.8, 0.5)  # range, yaw, pitch, 1/s
    fastest: Positive = 0.12  # approach to the wanted range, m/s
    stiffness: NotNegative = 3.0  # what a speed that is off adds to the command, against waves
    lead: NotNegative = 0.2  # from a command to the vehicle's answer, s


class SurveySettings(Settings):
    """A bounded area, covered."""

    priority: int = 30
    area: tuple[float, float, float, float] | None = (
        None  # west, south, east, north, m in the feed's frame; none: wander
    )
    altitude: Positive = 1.2  # over the relief, m
    overlap: Share = 0.2  # of neighbouring lanes
    coverage: Share = 0.985  # of the cells of area and margin that have to be seen
    margin: NotNegative = 0.05  # about the area that is covered too, for navigation errs, m
    cell: Positive = 0.1  # of the coverage grid, m
    speed: Positive = 0.12  # m/s


class BehaviourSettings(Settings):
    """Everything; a behaviour that is None does not run."""

    vehicle: Vehicle = Vehicle()
    feed: FeedSettings = FeedSettings()
    water: ClearWater = ClearWater()
    space: SpaceSettings = SpaceSettings()
    prior: Prior | None = None
    safety: SafetySettings = SafetySettings()
    leeway: LeewaySettings = LeewaySettings()
    avoidance: AvoidanceSettings | None = AvoidanceSettings()
    travel: TravelSettings | None = TravelSettings()
    hold: HoldSettings | None = None
    survey: SurveySettings | None = None
