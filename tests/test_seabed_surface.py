"""The elevation grid is right, says honestly how right, and does not care about order."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seabed_scene import dome, error, plane, scan

from garbi_map.errors import GarbiError
from garbi_map.log.records import Mount
from garbi_map.navigate.trajectory import Trajectory
from garbi_map.seabed import (
    CELL_BYTES,
    Seabed,
    SeabedBuilder,
    SeabedSettings,
    SurfaceGrid,
    SweptPoints,
    build_seabed,
    fuse,
)
from garbi_map.seabed.builder import Posed
from garbi_map.seabed.surface import TILE


def built(posed: list[Posed], **settings: float) -> Seabed:
    """The seabed of these sweeps."""
    return build_seabed(lambda: posed, SeabedSettings(**settings))[0]


def same(one: Seabed, other: Seabed) -> None:
    """Assert that two maps differ by rounding at most."""
    assert one.origin == pytest.approx(other.origin)
    np.testing.assert_array_equal(one.density, other.density)
    np.testing.assert_array_equal(one.sweeps, other.sweeps)
    for band in ("elevation", "uncertainty", "standard_deviation", "intensity"):
        np.testing.assert_allclose(getattr(one, band), getattr(other, band), rtol=1e-3, atol=2e-7, equal_nan=True)


def test_a_slope_seen_with_noise_is_found_and_its_uncertainty_is_the_error() -> None:
    """20 % slope, 0.5 mm noise, six sweeps: the error is as large as the uncertainty says, cell by cell."""
    seabed = built([scan(plane, k) for k in range(6)])
    off = error(seabed, plane)
    known = seabed.known
    assert np.sqrt(np.mean(off[known] ** 2)) < 0.3e-3
    normalised = off[known] / seabed.uncertainty[known]
    assert 0.9 < np.sqrt(np.mean(normalised**2)) < 1.1
    assert 0.93 < np.mean(np.abs(normalised) < 1.96) < 0.97


def test_a_dome_keeps_its_shape() -> None:
    """A half sphere of 15 cm on a level floor: the median error is below the noise of one point."""
    off = error(built([scan(dome, k) for k in range(6)]), dome)
    assert np.nanmedian(np.abs(off)) < 0.25e-3
    assert np.nanpercentile(np.abs(off), 95) < 2e-3  # where the sphere stands on the floor its side is vertical


def test_pose_errors_that_the_covariance_tells_are_in_the_uncertainty() -> None:
    """Sweeps off by draws of their covariance: over many maps the error is what the uncertainty says."""
    squares = []
    for seed in range(12):
        seabed = built([scan(plane, k, pose_sigma=0.002, seed=100 * seed + k, profiles=20, rows=60) for k in range(4)])
        squares.append(np.nanmean((error(seabed, plane) / seabed.uncertainty) ** 2))
    assert 0.3 < np.mean(squares) < 1.5


def test_sweeps_that_disagree_are_less_certain_than_their_covariances_claim() -> None:
    """Poses 3 mm wrong with a covariance of zero: the uncertainty grows to the size of the error."""
    shifts = 0.003 * np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 0.6], [0, 0, -0.3]])
    seabed = built([scan(plane, k, shift=shift) for k, shift in enumerate(shifts)])
    crossed = seabed.sweeps >= 3
    assert np.median(seabed.uncertainty[crossed]) > 0.8e-3
    honest = built([scan(plane, k) for k in range(4)])
    assert np.median(honest.uncertainty[honest.known]) < 0.3e-3


def test_one_vertical_face_does_not_make_its_surroundings_uncertain() -> None:
    """Cells on an edge are uncertain; those 5 cm away are not."""

    def step(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.where(x > 0.3, 0.1, 0.0)

    seabed = built([scan(step, k) for k in range(6)])
    x = np.broadcast_to(seabed.centres()[0], seabed.elevation.shape)
    away = seabed.uncertainty[seabed.known & (np.abs(x - 0.3) > 0.05) & (np.abs(x - 0.3) < 0.08)]
    far = seabed.uncertainty[seabed.known & (np.abs(x - 0.3) > 0.2)]
    assert np.median(away) < 1.5 * np.median(far)


def test_the_order_of_the_sweeps_does_not_matter() -> None:
    """Forwards and backwards the same map; shuffled, too, where the errors of neighbours in time are no errors in common."""
    posed = [scan(dome, k, pose_sigma=0.001) for k in range(5)]
    same(built(posed), built(posed[::-1]))
    shuffled = [posed[k] for k in (2, 4, 0, 3, 1)]
    same(built(posed, pose_memory=0.0), built(shuffled, pose_memory=0.0))


def test_errors_that_follow_each_other_closely_do_not_average_out() -> None:
    """Five sweeps in 12 s of one path: less sure together than five of five dives, surer than one."""
    posed = [scan(plane, k, sigma=0.0001, pose_sigma=0.001, shift=np.zeros(3)) for k in range(5)]
    one, none, some = (built(posed, pose_memory=memory) for memory in (1e6, 0.0, 4.0))
    cells = one.sweeps >= 3
    assert cells.sum() > 500
    assert np.median(one.uncertainty[cells]) == pytest.approx(0.001, rel=0.1)
    assert np.median((none.uncertainty * np.sqrt(none.sweeps))[cells]) == pytest.approx(0.001, rel=0.1)
    assert (none.uncertainty < some.uncertainty)[cells].all()
    assert (some.uncertainty < one.uncertainty)[cells].all()


def test_two_halves_merged_are_the_whole() -> None:
    """Grids of other sweeps merge cell by cell, also where only one of them has been."""
    posed = [scan(plane, k, begin=0.25 * k, pose_sigma=0.001) for k in range(6)]
    builders = [SeabedBuilder(SeabedSettings()) for _ in range(3)]
    for builder, part in zip(builders, (posed, posed[:3], posed[3:]), strict=True):
        for every in posed:
            builder.observe(*every)
        for own in part:
            builder.add(*own)
    whole, first, second = builders
    first.surface.merge(second.surface)
    same(whole.finish(), first.finish())


def test_grids_of_different_cells_do_not_merge() -> None:
    """One clear line instead of a wrong map."""
    with pytest.raises(GarbiError, match=r"0\.005 m and 0\.01 m"):
        SurfaceGrid(SeabedSettings()).merge(SurfaceGrid(SeabedSettings(cell=0.01)))


def test_what_was_not_seen_stays_without_data() -> None:
    """Two lanes 1 m apart: nothing in between, in no band."""
    seabed = built([scan(plane, 0, length=0.3), scan(plane, 1, begin=1.3, length=0.3)])
    x = seabed.centres()[0]
    gap = (x > 0.35) & (x < 1.25)
    assert gap.sum() > 150
    for band in (seabed.elevation, seabed.uncertainty, seabed.standard_deviation, seabed.intensity):
        assert np.isnan(band[:, gap]).all()
    assert not seabed.density[:, gap].any()


def test_negative_coordinates_and_tile_borders_leave_no_seam() -> None:
    """A floor on both sides of the origin, over several tiles, has the same elevation error everywhere."""
    begin = -1.5 * TILE * 0.005
    seabed = built([scan(plane, k, begin=begin, length=1.0, profiles=220) for k in range(3)])
    assert seabed.origin[0] == pytest.approx(np.floor(begin / 0.005) * 0.005, abs=0.011)
    assert np.nanmax(np.abs(error(seabed, plane))) < 3e-3


def test_a_large_site_gets_coarser_cells_instead_of_more_memory() -> None:
    """Four times too many cells: sides twice as long, the same points, the same surface."""
    posed = [scan(plane, k) for k in range(4)]
    fine, coarse = built(posed), built(posed, max_cells=4 * TILE * TILE // 2)
    assert coarse.cell == 2 * fine.cell
    assert coarse.density.sum() == fine.density.sum()
    assert np.nanmedian(np.abs(error(coarse, plane))) < 0.3e-3


def test_point_errors_agree_with_a_monte_carlo_of_the_poses() -> None:
    """Sigma along the ray and of the elevation, lever arm of the rig included, against 20,000 perturbed poses."""
    from garbi_map.seabed import kernels

    rng = np.random.default_rng(3)
    mount = Mount(np.array([0.6, -0.2, -0.3]), Rotation.from_rotvec([0.2, 1.2, -0.4]).as_quat())
    root = 0.003 * rng.standard_normal((6, 6))
    attitude = Rotation.from_rotvec([[0.1, -0.2, 2.0]]).as_quat()
    base = Trajectory(np.array([0]), np.array([[3.0, 2.0, -8.0]]), attitude, (root @ root.T)[None])
    rig = base.mounted(mount)
    point, own, slope = np.array([1.4, 0.3, -0.5]), 0.0008, np.array([0.3, -0.7])
    placed = rig.rotation.apply(point) + rig.position[0]
    sigma = np.array([own], np.float32)
    along, noise, pose = kernels.point_errors(
        placed[:1], np.zeros(1, np.int32), sigma, rig.position, base.position, rig.covariance, slope[None]
    )
    draw = rng.standard_normal((20_000, 6)) @ root.T
    moved = Rotation.from_rotvec(draw[:, 3:]).apply(placed[0] - base.position[0]) + base.position[0] + draw[:, :3]
    ray = (placed[0] - rig.position[0]) / np.linalg.norm(placed[0] - rig.position[0])
    off = moved - placed[0]
    up = np.array([-slope[0], -slope[1], 1.0])
    assert along[0] == pytest.approx(np.hypot(own, np.std(off @ ray)), rel=0.03)
    assert pose[0] == pytest.approx(np.std(off @ up), rel=0.03)
    assert np.sqrt(noise[0]) == pytest.approx(own * abs(ray @ up), rel=1e-6)


def test_accepted_points_say_when_they_were_measured_and_how_surely() -> None:
    """Stamps are the profiles'; sigma holds the pose's share."""
    sweep, poses = scan(plane, 0, pose_sigma=0.002)
    builder = SeabedBuilder(SeabedSettings())
    builder.observe(sweep, poses)
    points = builder.add(sweep, poses)
    np.testing.assert_array_equal(points.stamp_ns, sweep.point_stamp_ns[points.mask])
    np.testing.assert_allclose(points.sigma, np.hypot(0.0005, 0.002), rtol=1e-5)
    assert len(points.points) + sum(points.rejected.values()) == len(sweep.points)


def test_no_seabed_at_all_is_said_in_one_line() -> None:
    """An empty map is an error for a user to read."""
    sweep, poses = scan(plane, 0)
    nothing = replace(sweep, sigma=np.full_like(sweep.sigma, np.nan))
    with pytest.raises(GarbiError, match="no point of the seabed was accepted"):
        built([(nothing, poses)])


def test_memory_for_a_cell_is_what_is_said() -> None:
    """From the points of a sweep over a square metre to its rasters: no more bytes than the budget counts with."""
    sweep, poses = scan(plane, 0, length=1.0, width=1.0, profiles=240, rows=480)
    builder = SeabedBuilder(SeabedSettings())
    builder.observe(sweep, poses)
    points = builder.judge(sweep, poses)
    tracemalloc.start()
    grid = SurfaceGrid(SeabedSettings(), room=25)
    before = tracemalloc.get_traced_memory()[0]
    grid.add(points)
    tracemalloc.reset_peak()
    seabed = grid.finish()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert before < peak < CELL_BYTES * max(seabed.density.size, 25 * TILE**2)


def test_points_of_many_sweeps_fused_at_once_are_the_sweeps_one_by_one() -> None:
    """Sorted by cell or not: what a cell remembers is the same to the digits that it keeps."""
    rng = np.random.default_rng(3)
    settings, sweeps = SeabedSettings(), []
    for _ in range(4):
        points = np.column_stack([rng.uniform(-0.5, 0.5, (3000, 2)), rng.normal(-2.0, 0.01, 3000)])
        slope, noise, pose = rng.normal(0, 0.2, (3000, 2)), rng.uniform(1e-8, 1e-6, 3000), rng.uniform(0, 1e-3, 3000)
        sweeps.append((points, slope, noise, pose, rng.uniform(0, 255, 3000)))
    whole = [np.concatenate(parts) for parts in zip(*sweeps, strict=True)]
    number = np.repeat(np.arange(4, dtype=np.int32), 3000)
    at_once, one_by_one = SurfaceGrid(settings), SurfaceGrid(settings)
    at_once.take(fuse(SweptPoints(whole[0], number, 2.0 * np.arange(4), *map(np.float32, whole[1:])), settings))
    for k, (points, *rest) in enumerate(sweeps):
        swept = SweptPoints(points, np.zeros(3000, np.int32), np.array([2.0 * k]), *map(np.float32, rest))
        one_by_one.take(fuse(swept, settings))
    same(at_once.finish(), one_by_one.finish())


def test_a_cell_remembers_what_its_points_say() -> None:
    """Weighted mean, its variance and the spread, by the formulas over all points of one cell of one sweep."""
    rng = np.random.default_rng(4)
    z, noise, pose = rng.normal(-7.0, 0.002, 40), rng.uniform(1e-7, 1e-6, 40), rng.uniform(1e-4, 5e-4, 40)
    points = np.column_stack([rng.uniform(0.0, 0.005, (40, 2)), z])
    flat, grey = np.zeros((40, 2), np.float32), np.arange(40, dtype=np.float32)
    swept = SweptPoints(points, np.zeros(40, np.int32), np.zeros(1), flat, *map(np.float32, (noise, pose)), grey)
    (cell,) = fuse(swept, SeabedSettings()).memory
    weight = 1 / (noise + pose**2)
    mean = np.average(z, weights=weight)
    found = [float(cell[name]) for name in ("count", "z", "weight", "noise", "pose", "within", "intensity")]
    true = [
        40, mean, weight.sum(), (weight**2 * noise).sum(), (weight @ pose) ** 2,
        weight @ (z - mean) ** 2, np.average(grey, weights=weight),
    ]  # fmt: skip
    np.testing.assert_allclose(found, true, rtol=1e-6)
