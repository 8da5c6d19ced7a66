"""GARBI as it is drawn: hull, four thrusters, two arms, camera and laser. Proportions are those of the real one, assumed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from garbi_map.view.style import CAMERA, CAMERA_PATH, DARK, HULL, LASER, RIG, VEHICLE

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.log.records import Mount
    from garbi_map.rig import Rig


def draw_vehicle(recording: RecordingStream, rig: Rig, mount: Mount) -> None:
    """The vehicle in base_link (x forward, y left, z up, m) and the rig on it; 1.3 x 0.9 x 0.7 m."""
    import rerun as rr

    def boxes(name: str, centres: list, sizes: list, colour: tuple[int, ...]) -> None:
        shape = rr.Boxes3D(centers=centres, sizes=sizes, colors=[colour] * len(centres), fill_mode="solid")
        recording.log(f"{VEHICLE}/body/{name}", shape, static=True)

    boxes("floats", [[0, 0.27, 0.2], [0, -0.27, 0.2]], [[1.2, 0.22, 0.2]] * 2, HULL)
    boxes("deck", [[0, 0, 0.26]], [[0.9, 0.36, 0.05]], HULL)
    boxes("frame", [[0.35, 0.27, -0.1], [0.35, -0.27, -0.1], [-0.35, 0.27, -0.1], [-0.35, -0.27, -0.1]],
          [[0.04, 0.04, 0.42]] * 4, DARK)  # fmt: skip
    boxes("skids", [[0, 0.27, -0.33], [0, -0.27, -0.33]], [[1.1, 0.05, 0.04]] * 2, DARK)
    recording.log(
        f"{VEHICLE}/body/pressure_hulls",
        rr.Capsules3D(
            lengths=[0.7, 0.7],
            radii=[0.09, 0.09],
            translations=[[-0.35, 0.11, -0.06], [-0.35, -0.11, -0.06]],
            rotation_axis_angles=[rr.RotationAxisAngle([0, 1, 0], degrees=90)] * 2,
            colors=[DARK] * 2,
            fill_mode="solid",
        ),
        static=True,
    )
    recording.log(
        f"{VEHICLE}/body/thrusters",
        rr.Cylinders3D(
            lengths=[0.16] * 4,
            radii=[0.09] * 4,
            centers=[[-0.5, 0.27, -0.08], [-0.5, -0.27, -0.08], [0.0, 0.42, 0.1], [0.0, -0.42, 0.1]],
            rotation_axis_angles=[rr.RotationAxisAngle([0, 1, 0], degrees=90)] * 2
            + [rr.RotationAxisAngle([0, 0, 1], degrees=0)] * 2,
            colors=[[40, 44, 52]] * 4,
            fill_mode="solid",
        ),
        static=True,
    )
    arms = [
        [[0.45, side * 0.2, -0.15], [0.62, side * 0.26, -0.05], [0.78, side * 0.16, -0.2], [0.84, side * 0.13, -0.2]]
        for side in (1, -1)
    ]
    recording.log(f"{VEHICLE}/body/arms", rr.LineStrips3D(arms, radii=0.02, colors=[DARK] * 2), static=True)

    recording.log(RIG, rr.Transform3D(translation=mount.translation, quaternion=mount.quaternion), static=True)
    camera = rig.camera
    recording.log(CAMERA_PATH, rr.Transform3D(translation=camera.position, quaternion=camera.quaternion), static=True)
    recording.log(
        f"{CAMERA_PATH}/image",
        rr.Pinhole(
            focal_length=[camera.alpha_u, camera.alpha_v],
            principal_point=[camera.u0, camera.v0],
            resolution=[camera.width, camera.height],
            image_plane_distance=0.25,
            color=CAMERA,
            line_width=0.004,
        ),
        static=True,
    )
    recording.log(
        f"{RIG}/housings",
        rr.Ellipsoids3D(
            centers=np.array([camera.position, rig.laser.apex]), radii=[0.05, 0.04], colors=[CAMERA, LASER],
            fill_mode="solid",
        ),
        static=True,
    )  # fmt: skip
