"""Rigs that the tests use: like the real ones, with every parameter away from zero."""

from __future__ import annotations

from dataclasses import replace

from scipy.spatial.transform import Rotation

from garbi_map.rig import Camera, Laser, Port, Rig

FORWARD = Rotation.from_quat([-0.5, 0.5, -0.5, 0.5])
WINDOW = Port(normal=(0.0, 0.0, 1.0), distance=0.05, thickness=0.012, index_glass=1.49, index_water=1.335)
TILTED_WINDOW = replace(WINDOW, normal=tuple(Rotation.from_euler("xy", [0.05, -0.08]).as_matrix()[:, 2].tolist()))


def make_rig(port: Port | None = None, distortion: tuple[float, ...] = (-0.12, 0.033, 1.6e-4, 5.8e-4, 0.0)) -> Rig:
    """A rig with the distortion of the recorded dives and a camera slightly turned in the rig."""
    turn = Rotation.from_euler("xyz", [0.01, -0.02, 0.015]) * FORWARD
    camera = Camera(
        frame_id="camera_optical_frame",
        width=768,
        height=576,
        alpha_u=812.0,
        alpha_v=816.0,
        u0=367.4,
        v0=289.2,
        distortion=distortion,  # type: ignore[arg-type]
        position=(0.002, 0.003, -0.005),
        quaternion=tuple(turn.as_quat().tolist()),
        port=port,
    )
    laser = Laser(x=0.0156, y=-0.395, z=-0.0036, delta=0.0129, theta=-0.0234, gamma=0.0171, beta=0.0285)
    return Rig(camera, laser)
