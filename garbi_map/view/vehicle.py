"""GARBI as it is drawn: hull, four thrusters, two arms, camera and laser. Only the overall size is the real one's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from garbi_map.view import style
from garbi_map.view.stream import at

if TYPE_CHECKING:
    from rerun import RecordingStream

    from garbi_map.log import Mount
    from garbi_map.rig import Rig

_SIDES = (1, -1)


def draw_vehicle(recording: RecordingStream, rig: Rig, mount: Mount) -> None:
    """The vehicle in base_link (x forward, y left, z up), 1.3 x 0.9 x 0.7 m, and the rig where it is mounted."""
    import rerun as rr

    recording.log(style.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    draw_body(recording)
    _draw_rig(recording, rig, mount)


def draw_body(recording: RecordingStream) -> None:
    """The vehicle without its rig."""
    _draw_hull(recording)
    _draw_thrusters(recording)


def draw_profiles(
    recording: RecordingStream,
    apex: NDArray[np.float64],
    stamp_ns: NDArray[np.int64],
    points: NDArray[np.float64],
    lengths: NDArray[np.int64],
) -> None:
    """Profiles at stamps (m,): points (n, 3) m in the rig frame, and the sheet from the laser to each profile's ends.

    The first lengths[0] points belong to the first profile, and so on; apex (3,) is where the sheets come from."""
    import rerun as rr

    rows = rr.Points3D.columns(positions=points.astype(np.float32)).partition(lengths)
    recording.send_columns(style.PROFILE.path, at(stamp_ns), rows)
    seen = lengths > 0
    last = np.cumsum(lengths)[seen] - 1
    first = last - lengths[seen] + 1
    fans = np.stack([points[first], np.tile(apex, (len(first), 1)), points[last]], axis=1).astype(np.float32)
    recording.send_columns(style.SHEET.path, at(stamp_ns[seen]), rr.LineStrips3D.columns(strips=fans))


def _draw_hull(recording: RecordingStream) -> None:
    import rerun as rr

    def boxes(name: str, centres: Sequence, size: Sequence[float], colour: style.Colour) -> None:
        shape = rr.Boxes3D(
            centers=centres, sizes=[size] * len(centres), colors=[colour] * len(centres), fill_mode="solid"
        )
        recording.log(f"{style.BODY}/{name}", shape, static=True)

    boxes("floats", [[0, 0.26 * side, 0.22] for side in _SIDES], [1.1, 0.24, 0.2], style.HULL)
    boxes("deck", [[-0.05, 0, 0.24]], [0.8, 0.3, 0.06], style.HULL)
    posts = [[x, 0.28 * side, -0.08] for x in (0.32, -0.32) for side in _SIDES]
    boxes("frame", posts, [0.04, 0.04, 0.4], style.FRAME)
    boxes("skids", [[0, 0.28 * side, -0.3] for side in _SIDES], [1.1, 0.05, 0.04], style.FRAME)
    recording.log(
        f"{style.BODY}/pressure_hulls",
        rr.Capsules3D(
            lengths=[0.6] * 2,
            radii=[0.09] * 2,
            translations=[[-0.3, 0.1 * side, 0.0] for side in _SIDES],
            rotation_axis_angles=[rr.RotationAxisAngle([0, 1, 0], degrees=90)] * 2,
            colors=[style.FRAME] * 2,
            fill_mode="solid",
        ),
        static=True,
    )
    reach = [[[0.4, 0.2, -0.16], [0.58, 0.27, -0.1], [0.72, 0.2, -0.24], [0.76, 0.17, -0.24]]]
    arms = np.array([np.multiply(reach[0], [1, side, 1]) for side in _SIDES])
    recording.log(f"{style.BODY}/arms", rr.LineStrips3D(arms, radii=0.022, colors=[style.FRAME] * 2), static=True)


def _draw_thrusters(recording: RecordingStream) -> None:
    """Two that push forward, astern; two that push up, at the sides: surge, yaw, heave, pitch."""
    import rerun as rr

    astern = [[-0.5, 0.3 * side, -0.05] for side in _SIDES]
    abeam = [[x, 0.0, 0.24] for x in (0.42, -0.56)]
    turns = [rr.RotationAxisAngle([0, 1, 0], degrees=90)] * 2 + [rr.RotationAxisAngle([0, 1, 0], degrees=0)] * 2
    recording.log(
        f"{style.BODY}/thrusters",
        rr.Cylinders3D(
            lengths=[0.18] * 2 + [0.12] * 2,
            radii=[0.1] * 2 + [0.085] * 2,
            centers=astern + abeam,
            rotation_axis_angles=turns,
            colors=[style.THRUSTER] * 4,
            fill_mode="solid",
        ),
        static=True,
    )


def _draw_rig(recording: RecordingStream, rig: Rig, mount: Mount) -> None:
    import rerun as rr

    camera = rig.camera
    pose = rr.Transform3D(translation=mount.translation, quaternion=rr.Quaternion(xyzw=mount.quaternion))
    recording.log(style.RIG, pose, static=True)
    pose = rr.Transform3D(translation=camera.position, quaternion=rr.Quaternion(xyzw=camera.quaternion))
    recording.log(style.CAMERA_POSE, pose, static=True)
    pinhole = rr.Pinhole(
        focal_length=[camera.alpha_u, camera.alpha_v],
        principal_point=[camera.u0, camera.v0],
        resolution=[camera.width, camera.height],
        image_plane_distance=0.3,
        color=style.CAMERA,
        line_width=0.004,
    )
    recording.log(style.IMAGE, pinhole, static=True)
    housings = rr.Ellipsoids3D(
        centers=np.array([camera.position, rig.laser.apex]),
        radii=[0.05, 0.045],
        colors=[style.CAMERA, style.LASER],
        fill_mode="solid",
    )
    recording.log(f"{style.RIG}/housings", housings, static=True)
    recording.log(style.PROFILE.path, rr.Points3D.from_fields(radii=0.006, colors=[style.PROFILE.colour]), static=True)
    sheet = rr.LineStrips3D.from_fields(radii=0.002, colors=[(*style.SHEET.colour, 120)])
    recording.log(style.SHEET.path, sheet, static=True)
