"""The rig and sweep rooms against the independent dives' true surface, with true poses."""

from __future__ import annotations

import numpy as np
import open3d as o3d
import pytest
import simplejpeg
from scipy.spatial.transform import Rotation

from garbi_map.log import open_log
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.rig import parse_rig
from garbi_map.stripe.types import Stripe
from garbi_map.sweep import LaserAngle, SweepSettings, make_sweeps

REACH = np.arange(-7, 8)


def plain_stripe(image) -> Stripe:
    """Centre of gravity of green about its brightest pixel: a detector that owes nothing to the stripe room."""
    colour = simplejpeg.decode_jpeg(image.data, colorspace="RGB").astype(np.float32)
    green = colour[:, :, 1]
    excess = green - 0.5 * (colour[:, :, 0] + colour[:, :, 2])
    peak = excess.argmax(axis=1)
    row = np.flatnonzero((excess.max(axis=1) > 40.0) & (peak >= 7) & (peak < green.shape[1] - 7))
    column = peak[row][:, None] + REACH
    light = green[row[:, None], column]
    light -= np.minimum(light[:, :3].mean(axis=1), light[:, -3:].mean(axis=1))[:, None]
    light = np.clip(light - 0.1 * light.max(axis=1, keepdims=True), 0.0, None)
    u = (light * column).sum(axis=1) / light.sum(axis=1)
    flat = np.ones(len(row), np.float32)
    return Stripe(image.stamp_ns, row.astype(np.int32), u.astype(np.float32), 0.1 * flat, 100 * flat, flat > 2)


@pytest.mark.parametrize(("dive", "median", "tail"), [("calm", 0.15e-3, 0.45e-3), ("drift", 0.2e-3, 0.7e-3)])
def test_points_with_true_poses_lie_on_the_true_surface(shared, dive, median, tail):
    """Seven seconds, two turning points: what is left is the stripe's noise (field: 0.11/0.34 and 0.15/0.53 mm)."""
    folder = shared / "data" / "dives" / dive
    log = open_log([folder / "dive.mcap"])
    rig = parse_rig(log.rig_text, "rig.yaml")
    navigation = log.navigation()
    angle = LaserAngle(navigation.encoder, SweepSettings())
    begin = int(angle.turns_ns[0]) - 1_000_000_000
    stripes = (plain_stripe(image) for image in log.images(begin, begin + 7_000_000_000))
    sweeps = list(make_sweeps(stripes, rig, angle, SweepSettings()))
    assert len(sweeps) == 3

    truth = np.loadtxt(folder / "truth_trajectory.tum")
    stamps = np.round(truth[:, 0] * 1e9).astype(np.int64)
    base = Trajectory(stamps, truth[:, 1:4], truth[:, 4:8], np.zeros((len(truth), 6, 6)))
    trajectory = base.mounted(navigation.mount("rig"))
    surface = o3d.t.geometry.RaycastingScene()
    surface.add_triangles(o3d.t.io.read_triangle_mesh(str(folder / "truth_seabed.ply")))
    off = []
    for sweep in sweeps:
        poses = trajectory.at(sweep.stamp_ns)
        points = Rotation.from_quat(poses.quaternion[sweep.profile]).apply(sweep.points)
        points += poses.position[sweep.profile]
        off.append(surface.compute_distance(points.astype(np.float32)).numpy())
    distance = np.concatenate(off)
    assert len(distance) > 90_000
    assert np.median(distance) < median
    assert np.percentile(distance, 95) < tail
    assert np.mean(distance > 0.01) < 1e-3
