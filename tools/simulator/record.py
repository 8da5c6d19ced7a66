"""A dive as a log, and its truth beside it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from garbi_map.log import LogWriter, Topics
from tools.simulator.dive import Dive
from tools.simulator.sensors import START_NS, to_ns

TRUTH_RATE = 100.0  # Hz, of truth_trajectory.tum
TRUTH_TOPIC_RATE = 20.0  # Hz, of /truth/odometry
TRUTH_CELL, TRUTH_STEP = 0.01, 1e-4  # m, of /truth/seabed: between its points, and of their heights
FLOAT32 = 7  # number of the type in sensor_msgs/msg/PointField


def write_log(
    dive: Dive,
    path: Path,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
    metadata: dict[str, dict[str, str]] | None = None,
    truth: bool = True,
) -> float:
    """Render the dive into an MCAP log, in order of arrival; `progress(done, all)` is told after each image.

    The log carries rig.yaml as attachment, `metadata` as records by name and, if wanted, the truth as /truth/odometry and
    /truth/seabed.
    workers: 0 to render in this process, as a dive has to that was not flown along its route. Returns the images per
    second that were rendered and written once the workers had started."""
    total = len(dive.exposures)
    begin = time.perf_counter()
    with LogWriter(path, Topics(odometry="/truth/odometry")) as log:
        log.attach("rig.yaml", "application/yaml", dive.rig.to_yaml().encode())
        log.write_metadata("garbi.simulator", {"scenario": dive.scenario.model_dump_json()})
        for name, record in (metadata or {}).items():
            log.write_metadata(name, record)
        log.write_mounts(START_NS, dive.mounts)
        camera = dive.rig.camera
        matrix = np.array([[camera.alpha_u, 0, camera.u0], [0, camera.alpha_v, camera.v0], [0, 0, 1]])
        log.write_camera_info(START_NS, camera.width, camera.height, matrix, list(camera.distortion))
        if truth:
            _write_seabed(dive, log)
        messages = _navigation_messages(dive, log, truth)
        sent = 0
        for done, image in enumerate(dive.images(workers), 1):
            if done == 1:
                begin = time.perf_counter()
            while sent < len(messages) and messages[sent][0] <= image.arrival_ns:
                messages[sent][1]()
                sent += 1
            log.write_image(image, camera.frame_id)
            if progress:
                progress(done, total)
        for _, send in messages[sent:]:
            send()
    return (total - 1) / (time.perf_counter() - begin)


def _write_seabed(dive: Dive, log: LogWriter) -> None:
    """The true surface about what was seen, from above, as an organised cloud: rows along x, from the south."""
    seen = dive.seen(2000)
    x, y = (np.arange(seen[:, k].min() - 0.1, seen[:, k].max() + 0.1, TRUTH_CELL) for k in (0, 1))
    heights = np.round(dive.scene.heights(x, y) / TRUTH_STEP) * TRUTH_STEP
    points = np.stack([*np.meshgrid(x, y), heights], axis=-1).astype(np.float32)
    field, cloud = (log.types.types[f"sensor_msgs/msg/{name}"] for name in ("PointField", "PointCloud2"))
    fields = [field(name=name, offset=4 * k, datatype=FLOAT32, count=1) for k, name in enumerate("xyz")]
    message = cloud(
        header=log.header(START_NS, "map"), height=len(y), width=len(x), fields=fields, is_bigendian=False,
        point_step=12, row_step=12 * len(x), data=np.frombuffer(points.tobytes(), np.uint8), is_dense=False,
    )  # fmt: skip
    log.write("/truth/seabed", "sensor_msgs/msg/PointCloud2", message, START_NS)


def _navigation_messages(dive: Dive, log: LogWriter, with_truth: bool) -> list[tuple[int, Callable[[], None]]]:
    """(arrival, what writes it) of every message but the images, in order of arrival."""
    navigation = dive.navigation()
    messages: list[tuple[int, Callable[[], None]]] = []

    def add(arrival: int, write: Callable[..., None], *values: object) -> None:
        messages.append((int(arrival), lambda: write(*values)))

    if (encoder := navigation.encoder) is not None:
        joint = dive.rig.laser.joint
        for stamp, arrival, angle in zip(encoder.stamp_ns, encoder.arrival_ns, encoder.angle, strict=True):
            add(arrival, log.write_encoder, stamp, angle, arrival, joint)
    if (imu := navigation.imu) is not None:
        for i, stamp in enumerate(imu.stamp_ns):
            known = bool(np.isfinite(imu.attitude[i, 0]))
            attitude, covariance = (imu.attitude[i], imu.attitude_covariance[i]) if known else (None, None)
            values = (stamp, imu.rate[i], imu.specific_force[i], attitude, covariance, imu.arrival_ns[i])
            add(imu.arrival_ns[i], log.write_imu, *values)
    if (pressure := navigation.pressure) is not None:
        for stamp, arrival, value in zip(pressure.stamp_ns, pressure.arrival_ns, pressure.pressure, strict=True):
            add(arrival, log.write_pressure, stamp, value, arrival)
    if (dvl := navigation.dvl) is not None:
        for i, stamp in enumerate(dvl.stamp_ns):
            add(dvl.arrival_ns[i], log.write_dvl, stamp, dvl.velocity[i], dvl.covariance[i], dvl.arrival_ns[i])
    times = np.arange(0.0, dive.scenario.duration if with_truth else 0.0, 1 / TRUTH_TOPIC_RATE)
    truth = dive.motion.at(times)
    for stamp, position, quaternion in zip(to_ns(times), truth.position, truth.rotation.as_quat(), strict=True):
        add(stamp, log.write_odometry, stamp, position, quaternion, stamp, ("map", "base_link"))
    return sorted(messages, key=lambda message: message[0])


def write_truth(dive: Dive, folder: Path) -> None:
    """truth_trajectory.tum, truth_seabed.ply, truth_seen.npy and rig.yaml in the folder."""
    times = np.arange(0.0, dive.scenario.duration, 1 / TRUTH_RATE)
    truth = dive.motion.at(times)
    poses = np.c_[truth.position, truth.rotation.as_quat()]
    lines = [
        f"{stamp // 1_000_000_000}.{stamp % 1_000_000_000:09d} " + " ".join(f"{value:.9f}" for value in pose) + "\n"
        for stamp, pose in zip(to_ns(times).tolist(), poses.tolist(), strict=True)
    ]
    (folder / "truth_trajectory.tum").write_text("".join(lines))
    dive.scene.write(folder / "truth_seabed.ply")
    np.save(folder / "truth_seen.npy", dive.seen().astype(np.float32))
    (folder / "rig.yaml").write_text(dive.rig.to_yaml())
