"""Write a log: the same topics that the reader knows, in an MCAP file that ROS 2, Foxglove and Rerun open."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Literal, Self

import numpy as np
from mcap.writer import CompressionType, Writer
from numpy.typing import ArrayLike, NDArray

from garbi_map.errors import GarbiError
from garbi_map.log.records import Image, Mount
from garbi_map.log.settings import Topics
from garbi_map.log.types import standard_types

COMPRESSION = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "": CompressionType.NONE}
# what ros2 bag play needs to offer a static transform to late subscribers, as rosbag2 writes it
LATCHED = """- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false"""


class LogWriter:
    """A context manager that writes one MCAP file of the `ros2` profile, zstd chunks with checksums.

    The file has its name only once it is complete; where the block ends with an exception, nothing is left. Every write
    takes the header stamp (it becomes log_time) and the arrival (publish_time; the stamp where it is not given), both
    ns. Write /tf_static first: viewers apply it from there on. Raises GarbiError where the file cannot be written.

    in_place: the file has its name from the beginning and stays however the block ends: a recording. What `flush` has
    brought to it is readable without the index that `close` writes.
    open_file: makes the file; a place for tests and benches to put a disk that stalls or is full.
    """

    def __init__(
        self,
        path: Path,
        topics: Topics | None = None,
        compression: Literal["zstd", "lz4", ""] = "zstd",
        chunk_size: int = 1 << 20,
        in_place: bool = False,
        open_file: Callable[[Path], BinaryIO] = lambda path: path.open("wb"),
    ) -> None:
        self.path = Path(path)
        self.topics = topics or Topics()
        self.types = standard_types()
        self._in_place = in_place
        self._aside = self.path if in_place else self.path.with_name(f".{self.path.name}.part")
        self._channels: dict[str, tuple[str, int]] = {}
        self._schemas: dict[str, int] = {}
        self._sequence: dict[int, int] = {}
        self._flushed = 0
        with self._refusals():
            self._file = open_file(self._aside)
        # the checksum of all data protects what lies outside of chunks: metadata
        self._writer = Writer(
            self._file, chunk_size=chunk_size, compression=COMPRESSION[compression], enable_data_crcs=True
        )
        self._writer.start("ros2", "garbi")

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        """What the file system refuses, as one line."""
        try:
            yield
        except OSError as error:
            raise GarbiError(f"{self.path}: cannot be written: {error.strerror}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abandon()

    def close(self) -> None:
        """Write the index and give the file its name."""
        with self._refusals():
            self._writer.finish()
            self._file.flush()
            self.sync()
            self._file.close()
            self._aside.replace(self.path)

    def abandon(self) -> None:
        """Close the file without an index, as after a write that failed. What was written in place is cut back to the last
        flush, any other file is removed."""
        with suppress(OSError):
            self._file.close()
        if self._in_place:
            with suppress(OSError):
                os.truncate(self._aside, self._flushed)
        else:
            self._aside.unlink(missing_ok=True)

    def flush(self) -> None:
        """Close the chunk and hand it to the operating system: what was written so far survives the end of the process,
        and with `sync` a loss of power."""
        with self._refusals():
            self._writer.flush()
            self._file.flush()
            self._flushed = self._file.tell()

    def sync(self) -> None:
        """Bring everything flushed to the disk; from any thread."""
        with self._refusals():
            os.fsync(self._file.fileno())

    @property
    def size(self) -> int:
        """Bytes of the file so far."""
        return self._file.tell()

    def attach(self, name: str, media_type: str, data: bytes, stamp_ns: int = 0) -> None:
        """Attach a file, such as rig.yaml."""
        with self._refusals():
            self._writer.add_attachment(stamp_ns, stamp_ns, name, media_type, data)

    def write_metadata(self, name: str, record: dict[str, str]) -> None:
        """Write a record of names and texts."""
        with self._refusals():
            self._writer.add_metadata(name, record)

    def write(self, topic: str, type_name: str, message: object, stamp_ns: int, arrival_ns: int | None = None) -> None:
        """Write a message of a standard type: CDR bytes, or a `self.types.types[type_name]` with arrays as numpy's."""
        if not isinstance(message, bytes):
            message = bytes(self.types.serialize_cdr(message, type_name, little_endian=True))
        channel = self._channel(topic, type_name)
        number = self._sequence[channel] = self._sequence.get(channel, -1) + 1
        arrival = stamp_ns if arrival_ns is None else arrival_ns
        with self._refusals():
            self._writer.add_message(channel, int(stamp_ns), message, int(arrival), number)

    def _channel(self, topic: str, type_name: str) -> int:
        if topic in self._channels:
            known, channel = self._channels[topic]
            if known != type_name:
                raise GarbiError(f"topic {topic}: holds {known}, not {type_name}")
            return channel
        if type_name not in self._schemas:
            definition, _ = self.types.generate_msgdef(type_name, ros_version=2)
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition.encode())
        latched = type_name == "tf2_msgs/msg/TFMessage" and topic.endswith("_static")
        metadata = {"offered_qos_profiles": LATCHED} if latched else {}
        channel = self._writer.register_channel(topic, "cdr", self._schemas[type_name], metadata)
        self._channels[topic] = (type_name, channel)
        return channel

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
        """Write a pose of base_link in a fixed frame: position (3,) m, quaternion (4,) xyzw."""
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

    def write_mounts(self, stamp_ns: int, mounts: Mapping[str, Mount], base: str = "base_link") -> None:
        """Write the poses of sensor frames in `base` as static transforms."""
        transforms = [
            self._make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(stamp_ns, base),
                child_frame_id=frame,
                transform=self._make(
                    "geometry_msgs/msg/Transform",
                    translation=self._vector(mount.translation),
                    rotation=self._quaternion(mount.quaternion),
                ),
            )
            for frame, mount in mounts.items()
        ]
        message = self._make("tf2_msgs/msg/TFMessage", transforms=transforms)
        self.write(self.topics.tf_static, "tf2_msgs/msg/TFMessage", message, stamp_ns)

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
