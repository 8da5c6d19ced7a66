"""Submaps of all dives settle where they agree, and a trajectory follows its submaps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_db_place import ground, seen

from garbi_map.db import Pose, StoredSubmap, SubmapFile, laid
from garbi_map.db.graph import settle
from garbi_map.navigate import Trajectory
from garbi_map.register.surfels import Surfels, join


def strips(count: int, dive: int, seed: int) -> Surfels:
    """Overlapping strips along x over one ground, one for each submap of a dive, numbered from dive * count."""
    parts = []
    for k in range(count):
        part = seen(ground(1), (0.2 + 0.7 * k, 0.5), (1.3 + 0.7 * k, 1.5), seed + k)
        parts.append(Surfels(part.mean, part.normal, part.time, part.sweep + dive * count + k, part.thickness))
    return join(join(parts[0], parts[1]), parts[2]) if count == 3 else parts[0]


def bent(surfels: Surfels, steps: np.ndarray) -> Surfels:
    """Each submap moved by its own small shift (k, 3) and turn about the vertical."""
    transforms = np.tile(np.eye(4), (len(steps), 1, 1))
    transforms[:, :3, 3] = steps
    transforms[:, :3, :3] = Rotation.from_rotvec(0.3 * steps[:, :1] * [0.0, 0.0, 1.0]).as_matrix()
    return surfels.moved(transforms)


def test_a_dive_that_bends_is_straightened_by_one_that_does_not() -> None:
    """Submaps up to 4 mm off come back to a few tenths of a millimetre; the first submap stays where it is."""
    straight, other = strips(3, 0, 10), strips(3, 1, 20)
    steps = np.zeros((6, 3))
    steps[3:] = [[0.001, 0.0, 0.002], [0.0, 0.002, -0.001], [-0.002, 0.004, 0.001]]
    both = bent(join(straight, other), steps)
    found = settle(both, np.array([0, 0, 0, 1, 1, 1]))
    np.testing.assert_allclose(found[0], np.eye(4), atol=1e-5)
    left = np.linalg.norm(both.moved(found).mean - join(straight, other).mean, axis=1)
    before = np.linalg.norm(both.mean - join(straight, other).mean, axis=1)
    assert np.median(before[both.sweep > 2]) > 2e-3
    assert np.median(left[both.sweep > 2]) < 4e-4


def test_submaps_that_share_no_ground_stay() -> None:
    """Nothing holds them but their neighbours, and nothing pulls."""
    far = strips(3, 0, 10)
    apart = Surfels(far.mean + 50.0 * far.sweep[:, None], far.normal, far.time, far.sweep, far.thickness)
    np.testing.assert_allclose(settle(apart, np.array([0, 0, 1])), np.tile(np.eye(4), (3, 1, 1)), atol=1e-9)


def submap(name: str, begin_s: float, end_s: float, shift: float) -> StoredSubmap:
    """One whose frame is the dive's, shifted along x."""
    transform = np.eye(4)
    transform[0, 3] = shift
    times = (round(begin_s * 1e9), round(end_s * 1e9))
    return StoredSubmap(
        SubmapFile(name, np.array([1.0, 2.0, 3.0]), 1, *times), Pose.of(transform, np.array([1.0, 2.0, 3.0]))
    )


def test_trajectory_follows_its_submaps() -> None:
    """In the middle of a submap as that was moved, in between evenly; with one motion for all, stiff."""
    stamps = np.arange(0, 21, dtype=np.int64) * 1_000_000_000
    path = Trajectory(stamps, np.zeros((21, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (21, 1)), np.zeros((21, 6, 6)))
    moved = laid(path, [submap("a", 0, 10, 0.1), submap("b", 10, 20, 0.2)]).position[:, 0]
    np.testing.assert_allclose(moved[[0, 5, 10, 15, 20]], [0.1, 0.1, 0.15, 0.2, 0.2], atol=1e-9)
    stiff = laid(path, [submap("a", 0, 10, 0.3), submap("b", 10, 20, 0.3)]).position
    np.testing.assert_allclose(stiff, np.tile([0.3, 0.0, 0.0], (21, 1)), atol=1e-12)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, -0.1, 2.0)])
def test_pose_knows_the_motion_of_its_dive(angles: tuple[float, float, float]) -> None:
    """map <- dive comes back from the pose of a submap, and two motions after each other are one."""
    transform, frame = np.eye(4), np.array([3.0, -2.0, -12.0])
    transform[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    transform[:3, 3] = [4.0, 5.0, 6.0]
    np.testing.assert_allclose(Pose.of(transform, frame).transform(frame), transform, atol=1e-12)
    twice = Pose.of(transform, frame).after(transform).transform(frame)
    np.testing.assert_allclose(twice, transform @ transform, atol=1e-11)
