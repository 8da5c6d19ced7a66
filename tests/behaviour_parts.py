"""Small worlds for the tests of the behaviours: a rig, poses, profiles of planes, a vehicle that obeys at once."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.pieces import solid
from behaviours.settings import BehaviourSettings, ClearWater, FeedSettings, SpaceSettings, Vehicle
from behaviours.space import Space
from behaviours.types import Pose, Profile
from garbi_map.log.records import Floats, Mount
from garbi_map.rig import Rig, parse_rig
from garbi_map.stripe import Stripe

SECOND = 1_000_000_000
START = 1_790_000_000 * SECOND
MOUNT = Mount(np.array([0.45, 0.0, 0.0]))
RIG_TEXT = """
camera:
  frame_id: camera_optical_frame
  image_width: 384
  image_height: 288
  distortion_model: plumb_bob
  intrinsics: {alpha_u: 280.0, alpha_v: 280.0, u0: 192.0, v0: 144.0}
  distortion: [0.0, 0.0, 0.0, 0.0, 0.0]
  pose_in_rig: {xyz: [0.0, 0.0, 0.0], quaternion_xyzw: [-0.5, 0.5, -0.5, 0.5]}
laser: {joint: laser_joint, x: 0.02, y: -0.4, z: 0.0, delta: 0.0, theta: 0.0, gamma: 0.0, beta: 0.02}
"""


def rig() -> Rig:
    """A forward rig, 0.45 m before base_link."""
    return parse_rig(RIG_TEXT, "the tests' rig")


def pose(
    seconds: float,
    position: tuple[float, float, float] = (0.0, 0.0, 0.0),
    heading: float = 0.0,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tilt: float = 0.0,
) -> Pose:
    """A pose at that many seconds after START."""
    rotation = Rotation.from_euler("ZY", [heading, tilt]).as_matrix()
    return Pose(START + round(seconds * SECOND), np.array(position, float), rotation, np.array(velocity), np.zeros(3))


def wall_stripe(alpha: float, distance: float, seconds: float, seed: int = 0) -> Stripe:
    """What a wall square to the view, `distance` m before the rig, shows at a laser angle: the rays that meet the sheet
    there, found by projecting points that lie on both."""
    one = rig()
    normal = one.sheet(alpha)[0]
    z = np.linspace(-1.5, 1.5, 1500)
    y = (
        one.laser.apex[1]
        - (normal[0] * (distance - one.laser.apex[0]) + normal[2] * (z - one.laser.apex[2])) / normal[1]
    )
    pixels = one.project(np.stack([np.full(len(z), distance), y, z], 1))
    pixels = pixels[np.isfinite(pixels).all(1)][::-1]
    rows = np.arange(288)
    u = np.interp(rows, pixels[:, 1], pixels[:, 0], left=np.nan, right=np.nan)
    rows = np.flatnonzero((u > 1) & (u < 382)).astype(np.int32)
    noise = np.random.default_rng([seed, round(seconds * 1e3)]).normal(0, 0.05, len(rows))
    return Stripe(
        START + round(seconds * SECOND), rows, (u[rows] + noise).astype(np.float32), np.full(len(rows), 0.05, np.float32),
        np.full(len(rows), 120.0, np.float32), np.zeros(len(rows), bool),
    )  # fmt: skip


def profile(points: Floats, at: Pose, alpha: float = 0.2, sweep: int = 0, intensity: float = 120.0) -> Profile:
    """Points (n, 3), odom, as a profile of an upright line: one point a row."""
    one = rig()
    base = at.to_base(points) - MOUNT.translation
    pixels = one.project(base)
    seen = np.isfinite(pixels).all(1) & (pixels >= 0).all(1) & (pixels[:, 1] < 288)
    points, base, pixels = points[seen], base[seen], pixels[seen]
    order = np.lexsort((one.depth(base), pixels[:, 1].astype(np.int32)))
    row = pixels[order, 1].astype(np.int32)
    order = order[np.r_[True, np.diff(row) > 0]] if len(order) else order  # a row shows what is nearest
    row = pixels[order, 1].astype(np.int32)
    depth = one.depth(base[order])
    return Profile(
        at.stamp_ns, at.stamp_ns, alpha, sweep, row, depth, points[order], np.full(len(order), intensity),
        *solid(row, depth, 1 / 280.0), at,
    )  # fmt: skip


def wall(distance: float, width: float = 0.9, height: float = 0.7, step: float = 0.02) -> Floats:
    """Points of a wall square to x, that far from base_link."""
    y, z = np.meshgrid(np.arange(-width, width, step), np.arange(-height, height, step))
    return np.stack([np.full(y.size, distance), y.ravel(), z.ravel()], 1)


def space(**changed: object) -> Space:
    """An empty local volume of the default vehicle."""
    settings = BehaviourSettings()
    return Space(
        rig(), MOUNT, Vehicle(), SpaceSettings.model_validate({**settings.space.model_dump(), **changed}), FeedSettings(),
        ClearWater(),
    )  # fmt: skip


def obeyed(at: Pose, surge: float, heave: float, yaw: float, dt: float) -> Pose:
    """Where a vehicle is that obeys at once."""
    moved = at.position + at.rotation @ np.array([surge, 0.0, heave]) * dt
    turned = at.rotation @ Rotation.from_euler("z", yaw * dt).as_matrix()
    return Pose(
        at.stamp_ns + round(dt * SECOND), moved, turned, np.array([surge, 0.0, heave]), np.array([0.0, 0.0, yaw])
    )
