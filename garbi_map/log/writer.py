"""Write a log: the same topics that the reader knows, in an MCAP file that ROS 2, Foxglove and Rerun open."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from garbi_map.log.mcap_file import FileOptions, McapFile
from garbi_map.log.records import Image, Mount
from garbi_map.log.settings import Topics

TF = "/tf"


class LogWriter(McapFile):
    """A McapFile that knows the topics of a log and makes their messages."""

    def __init__(self, path: Path, topics: Topics | None = None, **file: Unpack[FileOptions]) -> None:
        super().__init__(path, **file)
        self.topics = topics or Topics()

    def header(self, stamp_ns: int, frame: str) -> Any:
        """A std_msgs/msg/Header."""
        seconds, nanoseconds = divmod(int(stamp_ns), 1_000_000_000)
        time = self.types.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        return self._make("std_msgs/msg/Header", stamp=time, frame_id=frame)

    def _make(self, type_name: str, **fields: Any) -> Any:
        return self.types.types[type_name](**fields)

    def _vector(self, values: ArrayLike, type_name: str = "geometry_msgs/msg/Vector3") -> Any:
        x, y, z = (float(value) for value in np.asarray(values, float))
        return self._make(type_name, x=x, y=y, z=z)

    def _quaternion(self, values: ArrayLike) -> Any:
        x, y, z, w = (float(value) for value in np.asarray(values, float))
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _pose(self, position: ArrayLike, quaternion: ArrayLike) -> Any:
        point = self._vector(position, "geometry_msgs/msg/Point")
        return self._make("geometry_msgs/msg/Pose", position=point, orientation=self._quaternion(quaternion))

    def write_image(self, image: Image, frame: str = "camera_optical_frame") -> None:
        """Write an image, compressed (height 0) or raw, on the image topic."""
        data = np.frombuffer(image.data, np.uint8)
        header = self.header(image.stamp_ns, frame)
        if image.height:
            type_name = "sensor_msgs/msg/Image"
            message = self._make(
                type_name,
                header=header,
                height=image.height,
                width=image.width,
                encoding=image.encoding,
                is_bigendian=0,
                step=image.step,
                data=data,
            )
        else:
            type_name = "sensor_msgs/msg/CompressedImage"
            message = self._make(type_name, header=header, format=image.encoding, data=data)
        self.write(self.topics.image, type_name, message, image.stamp_ns, image.arrival_ns)

    def write_encoder(
        self, stamp_ns: int, angle: float, arrival_ns: int | None = None, joint: str = "laser_joint"
    ) -> None:
        """Write a laser angle, rad."""
        message = self._make(
            "sensor_msgs/msg/JointState",
            header=self.header(stamp_ns, ""),
            name=[joint],
            position=np.array([angle], float),
            velocity=np.empty(0),
            effort=np.empty(0),
        )
        self.write(self.topics.encoder, "sensor_msgs/msg/JointState", message, stamp_ns, arrival_ns)

    def write_imu(
        self,
        stamp_ns: int,
        rate: ArrayLike,
        specific_force: ArrayLike,
        attitude: ArrayLike | None = None,
        attitude_covariance: ArrayLike | None = None,
        arrival_ns: int | None = None,
        frame: str = "imu_link",
    ) -> None:
        """Write body rates (3,) rad/s, specific force (3,) m/s^2 and, where there is one, the attitude (4,) xyzw with
        its covariance (3, 3) rad^2; a missing attitude is said as ROS says it (first covariance -1)."""
        covariance = _matrix(attitude_covariance, 3)
        if attitude is None:
            covariance[0] = -1.0
        message = self._make(
            "sensor_msgs/msg/Imu",
            header=self.header(stamp_ns, frame),
            orientation=self._quaternion([0.0, 0.0, 0.0, 1.0] if attitude is None else attitude),
            orientation_covariance=covariance,
            angular_velocity=self._vector(rate),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=self._vector(specific_force),
            linear_acceleration_covariance=np.zeros(9),
        )
        self.write(self.topics.imu, "sensor_msgs/msg/Imu", message, stamp_ns, arrival_ns)

    def write_pressure(
        self, stamp_ns: int, pressure: float, arrival_ns: int | None = None, frame: str = "pressure_link"
    ) -> None:
        """Write an absolute pressure, Pa."""
        message = self._make(
            "sensor_msgs/msg/FluidPressure",
            header=self.header(stamp_ns, frame),
            fluid_pressure=float(pressure),
            variance=0.0,
        )
        self.write(self.topics.pressure, "sensor_msgs/msg/FluidPressure", message, stamp_ns, arrival_ns)

    def write_dvl(
        self,
        stamp_ns: int,
        velocity: ArrayLike,
        covariance: ArrayLike | None = None,
        arrival_ns: int | None = None,
        frame: str = "dvl_link",
    ) -> None:
        """Write a bottom-track velocity (3,) m/s with its covariance (3, 3); NaN where the instrument has none."""
        twist = self._make(
            "geometry_msgs/msg/Twist", linear=self._vector(velocity), angular=self._vector([0.0, 0.0, 0.0])
        )
        message = self._make(
            "geometry_msgs/msg/TwistWithCovarianceStamped",
            header=self.header(stamp_ns, frame),
            twist=self._make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=_matrix(covariance, 6)),
        )
        self.write(self.topics.dvl, "geometry_msgs/msg/TwistWithCovarianceStamped", message, stamp_ns, arrival_ns)

    def write_navsat(
        self,
        stamp_ns: int,
        latitude: float,
        longitude: float,
        height: float,
        covariance: ArrayLike | None = None,
        arrival_ns: int | None = None,
        frame: str = "navsat_link",
    ) -> None:
        """Write a satellite fix: degrees, degrees, m above the WGS84 ellipsoid, covariance (3, 3) m^2 ENU."""
        message = self._make(
            "sensor_msgs/msg/NavSatFix",
            header=self.header(stamp_ns, frame),
            status=self._make("sensor_msgs/msg/NavSatStatus", status=0, service=1),
            latitude=float(latitude),
            longitude=float(longitude),
            altitude=float(height),
            position_covariance=_matrix(covariance, 3),
            position_covariance_type=0 if covariance is None else 3,
        )
        self.write(self.topics.navsat, "sensor_msgs/msg/NavSatFix", message, stamp_ns, arrival_ns)

    def write_usbl(
        self,
        stamp_ns: int,
        position: ArrayLike,
        covariance: ArrayLike | None = None,
        arrival_ns: int | None = None,
        frame: str = "map",
    ) -> None:
        """Write an absolute position (3,) m in a fixed east-north-up frame, with its covariance (3, 3)."""
        pose = self._make(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=self._pose(position, [0.0, 0.0, 0.0, 1.0]),
            covariance=_matrix(covariance, 6),
        )
        message = self._make(
            "geometry_msgs/msg/PoseWithCovarianceStamped", header=self.header(stamp_ns, frame), pose=pose
        )
        self.write(self.topics.usbl, "geometry_msgs/msg/PoseWithCovarianceStamped", message, stamp_ns, arrival_ns)

    def write_odometry(
        self,
        stamp_ns: int,
        position: ArrayLike,
        quaternion: ArrayLike,
        arrival_ns: int | None = None,
        frames: tuple[str, str] = ("odom", "base_link"),
    ) -> None:
        """Write a pose of base_link in a fixed frame: position (3,) m, quaternion (4,) xyzw.

        It is written as a transform on /tf too, which other viewers draw everything else by; nothing here reads that.
        """
        zero = self._vector([0.0, 0.0, 0.0])
        message = self._make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp_ns, frames[0]),
            child_frame_id=frames[1],
            pose=self._make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._pose(position, quaternion),
                covariance=np.zeros(36),
            ),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self._make("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=np.zeros(36),
            ),
        )
        self.write(self.topics.odometry, "nav_msgs/msg/Odometry", message, stamp_ns, arrival_ns)
        pose = Mount(np.asarray(position, float), np.asarray(quaternion, float))
        self._write_transforms(TF, stamp_ns, frames[0], {frames[1]: pose}, arrival_ns)

    def write_mounts(self, stamp_ns: int, mounts: Mapping[str, Mount], base: str = "base_link") -> None:
        """Write the poses of sensor frames in `base` as static transforms."""
        self._write_transforms(self.topics.tf_static, stamp_ns, base, mounts)

    def _write_transforms(
        self, topic: str, stamp_ns: int, base: str, poses: Mapping[str, Mount], arrival_ns: int | None = None
    ) -> None:
        transforms = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(stamp_ns, base),
                child_frame_id=frame,
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._vector(pose.translation),
                    rotation=self._quaternion(pose.quaternion),
                ),
            )
            for frame, pose in poses.items()
        ]
        message = self._make("tf2_msgs/msg/TFMessage", transforms=transforms)
        self.write(topic, "tf2_msgs/msg/TFMessage", message, stamp_ns, arrival_ns)

    def write_camera_info(
        self,
        stamp_ns: int,
        width: int,
        height: int,
        matrix: ArrayLike,
        distortion: Sequence[float],
        model: str = "plumb_bob",
        frame: str = "camera_optical_frame",
    ) -> None:
        """Write the pinhole matrix (3, 3) px and distortion coefficients, for other tools."""
        intrinsic = np.asarray(matrix, float)
        region = self._make(
            "sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        message = self._make(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns, frame),
            height=height,
            width=width,
            distortion_model=model,
            d=np.asarray(distortion, float),
            k=intrinsic.ravel(),
            r=np.eye(3).ravel(),
            p=np.hstack([intrinsic, np.zeros((3, 1))]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=region,
        )
        self.write(self.topics.camera_info, "sensor_msgs/msg/CameraInfo", message, stamp_ns)


def _matrix(covariance: ArrayLike | None, size: int) -> NDArray[np.float64]:
    """A covariance (3, 3), or None, as the flat matrix of `size` rows whose upper left corner it is."""
    full = np.zeros((size, size))
    if covariance is not None:
        full[:3, :3] = np.asarray(covariance, float)
    return full.ravel()
