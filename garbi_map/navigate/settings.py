"""Settings of the navigate room."""

from pydantic import Field, PositiveFloat

from garbi_map.settings import Settings


class NavigateSettings(Settings):
    """What the navigation filter assumes of water, sensors and vehicle; every field says its unit.

    Sensor noises are floors: what the log states or shows to be larger wins.
    """

    water_density: PositiveFloat = Field(default=1025.0, description="kg/m^3")
    gravity: PositiveFloat = Field(default=9.80665, description="m/s^2")
    atmosphere: PositiveFloat = Field(default=101325.0, description="Pa, pressure at the surface")

    node_rate: PositiveFloat = Field(default=20.0, description="Hz, at which the covariance is propagated and smoothed")
    output_rate: PositiveFloat = Field(
        default=100.0, ge=10.0, description="Hz, at most this many poses per second come out"
    )
    gap: PositiveFloat = Field(default=0.1, description="s, a longer pause of the IMU is a gap")
    longest_gap: PositiveFloat = Field(
        default=600.0, description="s, stamps beyond such a pause belong to another dive"
    )

    gyro_noise: PositiveFloat = Field(default=2e-5, description="rad/s/sqrt(Hz), floor")
    gyro_bias: PositiveFloat = Field(default=5e-3, description="rad/s, 1 sigma at switch-on")
    gyro_bias_walk: PositiveFloat = Field(default=1e-5, description="rad/s/sqrt(s)")
    accelerometer_noise: PositiveFloat = Field(default=2e-4, description="m/s^2/sqrt(Hz), floor")
    accelerometer_bias: PositiveFloat = Field(default=0.05, description="m/s^2, 1 sigma at switch-on")
    accelerometer_bias_walk: PositiveFloat = Field(default=1e-4, description="m/s^2/sqrt(s)")

    use_attitude: bool = Field(default=True, description="whether the IMU's own attitude is used, not only its rates")
    attitude_noise: PositiveFloat = Field(default=5e-4, description="rad, white part of the attitude topic's error")
    attitude_tilt: PositiveFloat = Field(default=4e-3, description="rad, slow part of roll and pitch, floor")
    attitude_yaw: PositiveFloat = Field(default=2e-2, description="rad, slow part of yaw, floor")
    attitude_time: PositiveFloat = Field(default=20.0, description="s, correlation time of the slow part")
    dvl_noise: PositiveFloat = Field(default=2e-3, description="m/s, floor")
    dvl_scale: PositiveFloat = Field(default=0.01, description="1 sigma of the DVL's scale error")
    dvl_scale_walk: PositiveFloat = Field(default=1e-6, description="1/sqrt(s)")
    pressure_noise: PositiveFloat = Field(default=1e-3, description="m of water, floor")
    fix_noise: PositiveFloat = Field(default=0.01, description="m, floor of an absolute position")
    gate: float = Field(
        default=0.9999, gt=0.5, lt=1.0, description="share of honest measurements that the outlier gate passes"
    )

    odometry_noise: PositiveFloat = Field(default=2e-3, description="m, of a foreign trajectory's position")
    odometry_drift: PositiveFloat = Field(default=0.01, description="m of drift per sqrt(m) travelled")
    odometry_rotation: PositiveFloat = Field(default=2e-3, description="rad, of a foreign trajectory's attitude")
    odometry_rotation_drift: PositiveFloat = Field(default=5e-4, description="rad/sqrt(s)")

    speed: PositiveFloat = Field(default=0.2, description="m/s, 1 sigma of a vehicle whose velocity nothing measures")
    tilt: PositiveFloat = Field(
        default=0.05, description="rad, 1 sigma of the roll and pitch of one whose attitude nothing measures"
    )
    habit_time: PositiveFloat = Field(
        default=10.0, description="s, for which such a vehicle keeps its velocity and tilt"
    )
    acceleration: PositiveFloat = Field(
        default=0.2, description="m/s^2/sqrt(Hz), random walk of velocity without accelerometer"
    )
    turn_rate: PositiveFloat = Field(default=0.1, description="rad/s/sqrt(Hz), random walk of attitude without gyro")
