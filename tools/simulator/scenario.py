"""What a simulated dive is made of: one YAML file, validated, every field with its unit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import Field, ValidationError

from garbi_map.errors import GarbiError
from garbi_map.settings import Settings

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]
Vector = tuple[float, float, float]


class Route(Settings):
    """Where the vehicle is asked to go; it starts at the first point, heading along the first leg."""

    kind: Literal["lawnmower", "straight", "shuttle", "station"] = "lawnmower"
    length: Positive = 2.0  # m, of a lane
    spacing: Positive = 0.5  # m, between lanes (lawnmower), joined by half circles
    lanes: int = Field(default=2, ge=1)
    heading: float = 0.0  # rad, of the first lane, east = 0
    fan: float = 0.1  # rad, between the out and home legs of a shuttle (which reverses instead of turning)
    centre: tuple[float, float] = (0.0, 0.0)  # m, the middle of the route
    speed: Positive = 0.12  # m/s


class Water(Settings):
    """The medium at the laser's wavelength (532 nm), and its motion."""

    absorption: NotNegative = 0.07  # 1/m
    scattering: NotNegative = 0.16  # 1/m
    backscatter: NotNegative = 0.02  # 1/(m sr), volume scattering function at backward angles
    forward_sharpness: Share = 0.8  # share of the scattering that is small-angle and reaches the image as a skirt
    forward_angle: NotNegative = 0.012  # rad/m, width of that skirt (Jaffe's B)
    snow: NotNegative = 1000.0  # particles per cubic metre that are large enough to be seen
    snow_brightness: NotNegative = 1.0  # median particle in the sheet, in units of 60 grey levels at 1 m
    depth: Positive = 12.0  # m, of the seabed below the surface
    current: tuple[float, float] = (0.0, 0.0)  # m/s east, north, mean
    current_sigma: NotNegative = 0.0  # m/s, of its slow variation (Ornstein-Uhlenbeck, 20 s)


class Sway(Settings):
    """What waves do: water moves to and fro, and turns the vehicle. Amplitudes: 1 sigma of several periods together."""

    translation: NotNegative = 0.01  # m, of the water particles, horizontally; vertically half of it
    rotation: NotNegative = (
        0.005  # rad, roll and pitch that the waves' moment would hold; yaw rate per second half of it
    )
    period: Positive = 4.0  # s, the longest


class Thing(Settings):
    """A solid that lies on the seabed, where the scenario says; two dives that differ in it show what changed."""

    kind: Literal["stone", "block", "sphere"]
    size: Positive = 0.06  # m: radius of a stone or a sphere; edge length of a block
    at: tuple[float, float]  # m, map
    turn: float = 0.0  # rad, about the vertical
    sunk: Share = 0.25  # of its size that is in the ground
    shape: int = Field(default=0, ge=0)  # seed of a stone's lumps


class Seabed(Settings):
    """Ground and what lies on it; z = 0 is its mean level."""

    seed: int | None = Field(default=None, ge=0)  # of ground, stones and texture, where it is not that of the dive
    things: tuple[Thing, ...] = ()
    margin: Positive = 1.3  # m, of ground around the route
    cell: Positive = 0.008  # m, grid step of the ground
    relief: NotNegative = 0.03  # m, 1 sigma, of broad undulation
    roughness: NotNegative = 0.0006  # m, 1 sigma, of grain
    ripple_height: NotNegative = 0.016  # m, trough to crest
    ripple_length: Positive = 0.16  # m
    stones: NotNegative = 12.0  # per square metre
    stone_size: tuple[Positive, Positive] = (0.02, 0.12)  # m, smallest and largest radius
    pipe_radius: NotNegative = 0.0  # m; 0: no pipe
    block: bool = False  # the parallelepiped with a slanting side of 82 mm, near the start
    rod_radius: NotNegative = 0.0  # m; a rod held 15 cm above the ground across the route; 0: none
    wall: NotNegative = 0.0  # m, height of a wall ahead of the route; 0: none
    wall_distance: float = 1.5  # m, of the wall ahead of the route's end
    albedo: Share = 0.3  # mean diffuse reflectance
    texture: Share = 0.35  # relative 1-sigma variation of it


class Mover(Settings):
    """A rigid body that moves through the scene: a fish passes by, a cable swings, an obstacle closes in."""

    kind: Literal["fish", "cable", "sphere"]
    size: Positive = 0.2  # m: length of the fish, of the cable; diameter of the sphere
    start: Vector  # m, its centre at time 0, map
    velocity: Vector = (0.0, 0.0, 0.0)  # m/s
    swing: NotNegative = 0.0  # m, amplitude of a swing across its velocity
    period: Positive = 3.0  # s, of the swing


class Mount(Settings):
    """The rig on the vehicle: base_link <- rig."""

    xyz: Vector = (0.25, 0.0, -0.1)  # m
    down: float = 1.5707963267948966  # rad, how far the view is pitched down from straight ahead
    turn: float = 0.0  # rad, by which the rig is turned about its view; a quarter turn lays the sheet across the way


class Window(Settings):
    """A flat port in front of the camera; the angle between its normal and the optical axis is drawn at random."""

    distance: Positive = 0.05  # m, pinhole to the inner face
    thickness: Positive = 0.012  # m
    index_glass: Positive = 1.49
    index_water: Positive = 1.335


class Camera(Settings):
    """Image formation behind the lens."""

    rate: Positive = 25.0  # images per second
    width: int = Field(default=768, ge=16, le=8192)  # pixels
    height: int = Field(default=576, ge=16, le=8192)  # pixels
    focal: Positive = 800.0  # pixels
    exposure: Positive = 150.0  # grey level of the stripe's peak on mean ground at exposure_range, in this water
    exposure_range: Positive = 1.2  # m
    black: NotNegative = 3.0  # grey level without light
    psf: Positive = 1.4  # pixels, 1 sigma of the lens
    full_well: Positive = 10_000.0  # electrons at grey level 255
    read_noise: NotNegative = 25.0  # electrons
    laser_blue: Share = 0.28  # the laser's crosstalk into the blue pixels
    laser_red: Share = 0.09  # and into the red ones
    ambient: NotNegative = 10.0  # grey level of mean ground in daylight, green; 0: night
    ambient_step: int = Field(default=8, ge=1)  # pixels per cast ray of the daylight view
    quality: int = Field(default=92, ge=1, le=100)  # JPEG
    latency: NotNegative = 0.03  # s, exposure to arrival
    clock_offset: float = 0.0  # s, stamp minus the moment of exposure
    port: Window | None = None


class Laser(Settings):
    """The sheet, its motor and its encoder."""

    motor: bool = True  # False: the sheet is fixed in the middle of its range and the vehicle's motion is the scan
    baseline: Positive = 0.4  # m, camera to axis
    range: tuple[float, float] = (-0.026, 0.672)  # rad, turning points of alpha
    sweep: Positive = 4.0  # s, from one turning point to the next
    round: Share = 0.06  # share of a sweep in which the motor slows down and turns back
    width: Positive = 0.0013  # m, 1 sigma of the sheet's thickness at its source
    divergence: NotNegative = 0.0004  # rad, by which it grows
    count: Positive = 0.00017453292519943296  # rad, one encoder count
    encoder_rate: Positive = 100.0  # Hz
    encoder_latency: NotNegative = 0.004  # s
    fan: Positive = 0.5  # tangent of the half angle over which the line generator spreads the beam
    misalignment: NotNegative = 0.02  # rad, 1 sigma of delta, theta, gamma and beta about nominal


class Sensor(Settings):
    """What every navigation sensor has."""

    rate: Positive = 100.0  # Hz
    latency: NotNegative = 0.01  # s, measurement to arrival
    clock_offset: float = 0.0  # s, stamp minus the moment of measurement
    gaps: tuple[tuple[float, float], ...] = ()  # s, (from, to) after the start, in which it is silent


class ImuErrors(Sensor):
    """Noise is 1 sigma per sample; biases are drawn once per dive with the 1 sigma given."""

    attitude: bool = True
    gyro_noise: NotNegative = 0.001  # rad/s
    gyro_bias: NotNegative = 0.001  # rad/s
    accelerometer_noise: NotNegative = 0.02  # m/s^2
    accelerometer_bias: NotNegative = 0.02  # m/s^2
    tilt_bias: NotNegative = 0.003  # rad, roll and pitch, constant
    tilt_wander: NotNegative = 0.002  # rad, roll and pitch, over 10 s
    heading_bias: NotNegative = 0.015  # rad
    heading_wander: NotNegative = 0.008  # rad, over 10 s
    rate_limit: Positive = 10.0  # rad/s, where the gyro saturates


class PressureErrors(Sensor):
    """Errors as metres of water."""

    rate: Positive = 10.0
    noise: NotNegative = 0.003  # m
    bias: NotNegative = 0.02  # m


class DvlErrors(Sensor):
    """Bottom-track velocity."""

    rate: Positive = 8.0
    latency: NotNegative = 0.1
    noise: NotNegative = 0.004  # m/s
    scale: NotNegative = 0.004  # relative, 1 sigma over dives
    outliers: Share = 0.0  # share of samples that are off by decimetres per second


class Sensors(Settings):
    """The navigation suite; a sensor that is not there is null."""

    suite: Literal["good", "cheap"] = "good"  # cheap: every error four times larger
    imu: ImuErrors | None = ImuErrors()
    pressure: PressureErrors | None = PressureErrors()
    dvl: DvlErrors | None = DvlErrors()

    @property
    def factor(self) -> float:
        """What every error above is multiplied by."""
        return 4.0 if self.suite == "cheap" else 1.0


Model = Literal["garbi", "bluerov2"]


class Scenario(Settings):
    """A whole dive."""

    title: str = ""
    vehicle: Model = "garbi"
    duration: Positive = 30.0  # s
    seed: int = Field(default=1, ge=0)
    altitude: Positive = 1.3  # m, of base_link above the mean seabed
    route: Route = Route()
    sway: Sway = Sway()
    water: Water = Water()
    seabed: Seabed = Seabed()
    movers: tuple[Mover, ...] = ()
    mount: Mount = Mount()
    camera: Camera = Camera()
    laser: Laser = Laser()
    sensors: Sensors = Sensors()
    rig: Path | None = None  # a rig.yaml to use instead of one drawn about nominal; relative to the scenario's file


def load_scenario(path: Path) -> Scenario:
    """Read and validate a scenario file.

    Raises GarbiError that names the file, the key and what is wrong with it.
    """
    try:
        scenario = Scenario.model_validate(yaml.safe_load(path.read_text()) or {})
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise GarbiError(f"{path}: not YAML: {' '.join(str(error).split())}") from error
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise GarbiError(f"{path}: {key or 'top level'}: {first['msg']}") from error
    if scenario.rig is None:
        return scenario
    return scenario.model_copy(update={"rig": path.parent / scenario.rig})
