"""The paper's experiment (section 5), simulated: calibrate with two orthogonal planes, then measure a parallelepiped.

    python -m tools.paper_experiment [-o DIR] [--seeds N]

renders the target and the scene, calibrates from the images, reconstructs, and measures the slanting side, which is
82 mm long (the paper got 79.6 mm); writes scene.png and reconstruction.svg, the paper's figure: the points on the YZ
plane.
With --seeds, repeats it on simulated corners and stripes with 0.3 px of noise, beside the paper's own linear method.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.bundle import Poses, StripePoints
from garbi_map.calibrate.camera import FORWARD, calibrate_camera
from garbi_map.calibrate.detect import detect
from garbi_map.calibrate.laser import calibrate_laser
from garbi_map.calibrate.linear import solve_camera
from garbi_map.calibrate.observe import evenly_lit, joined, less, on_target
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.targets import AnyTarget, Face
from garbi_map.calibrate.views import View, poses_by
from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats
from garbi_map.rig import Camera, Laser, Rig
from garbi_map.stripe import StripeDetector
from tools.simulator.shapes import BLOCK_ANGLE, BLOCK_BASE, BLOCK_SLANT, BLOCK_WIDTH
from tools.simulator.target import Booth, Look
from tools.simulator.target_points import TWO_PLANES, stripes_of, target_of, views_of

SETTINGS = CalibrateSettings()
ALPHAS = np.linspace(0.12, 0.66, 28)
LASER_VIEWS = 4  # poses of the target that the laser sweeps over
CAMERA_VIEWS = 12  # poses for the camera, those included


@dataclass(frozen=True)
class Block:
    """The parallelepiped on a wall, as flat faces: the wall, its top and its slanting side; x along the slope."""

    border: float = 0.0

    @property
    def faces(self) -> list[Face]:
        """Target frame: z into the wall, which is z = 0; the block rises towards the viewer."""
        rise, run = BLOCK_SLANT * np.sin(BLOCK_ANGLE), BLOCK_SLANT * np.cos(BLOCK_ANGLE)
        across, none = np.array([0.0, 1.0, 0.0]), np.empty((0, 4))
        slope = np.array([run, 0.0, -rise]) / BLOCK_SLANT
        along = np.array([1.0, 0.0, 0.0])
        return [
            Face(np.array([-0.35, -0.25, 0.0]), along, across, np.array([0.7, 0.5]), none),
            Face(np.array([run, 0.0, -rise]), along, across, np.array([BLOCK_BASE, BLOCK_WIDTH]), none),
            Face(np.zeros(3), slope, across, np.array([BLOCK_SLANT, BLOCK_WIDTH]), none),
        ]


def true_rig(rng: np.random.Generator, tilted: bool = True) -> Rig:
    """A rig as built by hand: distortion, and about a degree of every misalignment. `rig` is the camera's frame."""
    focal = 812.0 * (1 + 0.01 * rng.normal())
    distortion = (-0.12 + 0.02 * rng.normal(), 0.03, *(3e-4 * rng.normal(size=2)).tolist(), 0.0)
    camera = Camera(
        "camera_optical_frame",
        768,
        576,
        focal,
        focal * (1 + 0.004 * rng.normal()),
        384 + 8 * rng.normal(),
        288 + 6 * rng.normal(),
        distortion,
        (0.0, 0.0, 0.0),
        FORWARD,
    )
    delta, theta, gamma = (0.015 * rng.normal(size=3)).tolist()
    if not tilted:
        theta = gamma = 0.0
    beta = float(0.03 + 0.005 * rng.normal())
    return Rig(camera, Laser(0.02, -0.4 + 0.01 * rng.normal(), 0.01 * rng.normal(), delta, theta, gamma, beta))


def target_poses(rng: np.random.Generator) -> Poses:
    """The two planes, their inner edge away from the camera; the first ones for the laser, at several distances."""
    far = np.concatenate([np.linspace(0.8, 1.4, LASER_VIEWS), rng.uniform(0.7, 1.3, CAMERA_VIEWS - LASER_VIEWS)])
    turn = np.column_stack([-0.785 + rng.uniform(-0.25, 0.25, CAMERA_VIEWS), rng.uniform(-0.35, 0.35, CAMERA_VIEWS)])
    shift = np.column_stack([rng.uniform(-0.08, 0.08, (CAMERA_VIEWS, 2)) * far[:, None], far])
    roll = Rotation.from_euler("z", rng.uniform(-0.15, 0.15, (CAMERA_VIEWS, 1)))
    return Poses(roll * Rotation.from_euler("yx", turn), shift)


def block_pose() -> tuple[Rotation, Floats]:
    """Camera <- block, with its slope towards the laser and seen well from the camera."""
    turned = Rotation.from_euler("z", np.pi / 2) * Rotation.from_euler("y", 0.15)
    return turned, np.array([0.06, -0.05, 1.1])


def calibrated(views: list[View], stripes: StripePoints, target: AnyTarget, size: tuple[int, int]) -> Rig:
    """Camera from all views, laser from the first of them."""
    camera = calibrate_camera(views, target, size, SETTINGS).camera
    found = calibrate_laser(camera, views[:LASER_VIEWS], stripes, target, SETTINGS)
    return Rig(found.scanner.camera, found.laser)


def calibrated_as_in_paper(views: list[View], stripes: StripePoints, target: AnyTarget, rig: Rig) -> Rig:
    """The paper's: one view of the target, no distortion, theta = gamma = 0, two sets; (9) and (10) corrected."""
    linear = solve_camera(target.points[views[0].number], views[0].pixel)
    intrinsics = {name: getattr(linear, name) for name in ("alpha_u", "alpha_v", "u0", "v0")}
    camera = replace(rig.camera, **intrinsics, distortion=(0.0,) * 5)
    first = stripes.part(stripes.view == 0)
    settings = SETTINGS.model_copy(update={"method": "paper", "max_outliers": 0.99})
    found = calibrate_laser(camera, views[:1], first, target, settings)
    return Rig(camera, found.laser)


def slant_of(points: Floats) -> float:
    """Length (m) of the slanting side, between wall and top along the slope, from planes through the points."""
    floor = _plane_of(points, np.random.default_rng(0))
    height = points @ floor[:3] - floor[3]
    if np.abs(height).max() > -height.min():
        floor, height = (floor, height) if height.max() > -height.min() else (-floor, -height)
    else:
        floor, height = -floor, -height
    rise = float(np.percentile(height, 99.0))
    top = _fitted(points[height > 0.93 * rise])
    slope = _fitted(points[(height > 0.15 * rise) & (height < 0.85 * rise)])
    middle = points[(height > 0.15 * rise) & (height < 0.85 * rise)].mean(axis=0)
    middle = middle - (middle @ slope[:3] - slope[3]) * slope[:3]
    up = floor[:3] - (floor[:3] @ slope[:3]) * slope[:3]
    up /= np.linalg.norm(up)
    reach = [(plane[3] - middle @ plane[:3]) / (up @ plane[:3]) for plane in (floor, top)]
    return float(abs(reach[1] - reach[0]))


def _plane_of(points: Floats, rng: np.random.Generator) -> Floats:
    """The plane that most points lie on: unit normal, offset."""
    best, most = np.zeros(4), 0
    for _ in range(200):
        three = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(three[1] - three[0], three[2] - three[0])
        length = np.linalg.norm(normal)
        if length < 1e-6:
            continue
        plane = np.append(normal / length, normal @ three[0] / length)
        count = int((np.abs(points @ plane[:3] - plane[3]) < 0.004).sum())
        if count > most:
            best, most = plane, count
    return _fitted(points[np.abs(points @ best[:3] - best[3]) < 0.006])


def _fitted(points: Floats) -> Floats:
    kept = points
    plane = np.zeros(4)
    for _ in range(4):
        middle = kept.mean(axis=0)
        normal = np.linalg.svd(kept - middle, full_matrices=False)[2][2]
        plane = np.append(normal, normal @ middle)
        off = np.abs(points @ normal - plane[3])
        kept = points[off < max(3.0 * 1.4826 * float(np.median(off)), 1e-9)]
    return plane


def simulated(seed: int, noise: float = 0.3) -> tuple[float, float]:
    """Length (m) of the slanting side with corners and stripes at `noise` px: ours, and by the paper's method."""
    rng = np.random.default_rng(seed)
    rig, target = true_rig(rng), target_of(TWO_PLANES)
    poses = target_poses(rng)
    views = views_of(rig, target, poses, noise, rng)
    first = Poses(poses.rotation[:LASER_VIEWS], poses.translation[:LASER_VIEWS])
    stripes = stripes_of(rig, target, first, ALPHAS, noise, rng, step=6)
    turned, place = block_pose()
    seen = stripes_of(
        rig,
        Block(),
        Poses(Rotation.concatenate([turned]), place[None]),
        np.linspace(0.15, 0.6, 160),
        noise,
        rng,
        step=2,
    )
    lengths = []
    for one in (
        calibrated(views, stripes, target, (768, 576)),
        calibrated_as_in_paper(views, stripes, target, rig),
    ):
        points = one.triangulate(seen.u, seen.v, seen.alpha).points
        lengths.append(slant_of(points[np.isfinite(points).all(axis=1)]))
    return lengths[0], lengths[1]


def rendered(folder: Path, seed: int = 0) -> float:
    """From images to the length (m); writes the scene's picture and the figure into a folder."""
    rng = np.random.default_rng(seed)
    rig, target = true_rig(rng), target_of(TWO_PLANES)
    booth, poses = Booth(rig, target, Look(margin=0.02)), target_poses(rng)
    detector = StripeDetector(Config().stripe)
    views: list[View] = []
    sweeps = []
    for i in range(CAMERA_VIEWS):
        placed = booth.placed(poses.rotation[i], poses.translation[i])
        still = booth.image(placed, None, rng)
        view = detect(still, target, f"view {i}")
        if view is None:
            continue
        views.append(view)
        if i < LASER_VIEWS:
            lit = [booth.image(placed, float(alpha), rng) for alpha in ALPHAS]
            sweeps.append([detector.detect(less(image, still), 0) for image in lit])
            sweeps[-1] = [evenly_lit(stripe, still) for stripe in sweeps[-1]]
    camera = calibrate_camera(views, target, (768, 576), SETTINGS).camera
    starts = poses_by(camera, views[: len(sweeps)], target)
    parts: list[StripePoints] = []
    for i, sweep in enumerate(sweeps):
        pose = Poses(starts.rotation[[i]], starts.translation[[i]])
        for alpha, stripe in zip(ALPHAS, sweep, strict=True):
            found = on_target(stripe, camera, pose, target, float(alpha), 0.0, (i, len(parts)), 12)
            if found is not None:
                parts.append(found)
    laser = calibrate_laser(camera, views[: len(sweeps)], joined(parts), target, SETTINGS)
    ours = Rig(laser.scanner.camera, laser.laser)
    stage = Booth(rig, Block(), Look(margin=0.0))  # type: ignore[arg-type]
    placed = stage.placed(*block_pose())
    dark = stage.image(placed, None, rng)
    points = []
    for alpha in np.linspace(0.15, 0.6, 160):
        image = stage.image(placed, float(alpha), rng)
        stripe = detector.detect(less(image, dark), 0)
        points.append(ours.triangulate(stripe.u, stripe.row, float(alpha)).points)
    cloud = np.concatenate(points)
    cloud = cloud[np.isfinite(cloud).all(axis=1) & (cloud[:, 0] < 1.6)]
    cv2.imwrite(str(folder / "scene.png"), stage.image(placed, 0.42, rng))
    (folder / "reconstruction.svg").write_text(figure(cloud))
    return slant_of(cloud)


def figure(points: Floats) -> str:
    """Points on the YZ plane, as in the paper's figure 5(b), shaded by how near they are."""
    shown = points[np.linspace(0, len(points) - 1, min(len(points), 12000)).astype(int)]
    low, high = np.percentile(shown, [0.5, 99.5], axis=0)
    scale = 700.0 / max(high[1] - low[1], high[2] - low[2])
    near = np.clip((high[0] - shown[:, 0]) / max(high[0] - low[0], 1e-9), 0, 1)
    dots = "".join(
        f'<circle cx="{20 + scale * (high[1] - y):.1f}" cy="{20 + scale * (high[2] - z):.1f}" r="1" '
        f'fill="rgb({int(210 - 200 * n)},{int(210 - 110 * n)},{int(215 - 50 * n)})"/>'
        for (_, y, z), n in zip(shown.tolist(), near.tolist(), strict=True)
    )
    width, height = 40 + scale * (high[1] - low[1]), 40 + scale * (high[2] - low[2])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}">'
        f'<rect width="100%" height="100%" fill="white"/>{dots}</svg>\n'
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("out/paper"))
    parser.add_argument("--seeds", type=int, default=0)
    given = parser.parse_args(arguments)
    given.output.mkdir(parents=True, exist_ok=True)
    length = 1e3 * rendered(given.output)
    print(f"slanting side, from rendered images: {length:.2f} mm (true {1e3 * BLOCK_SLANT:g}, the paper 79.6)")
    if given.seeds:
        lengths = 1e3 * np.array([simulated(seed) for seed in range(given.seeds)])
        for name, column in zip(("this project", "the paper's method, corrected"), lengths.T, strict=True):
            off = column - 1e3 * BLOCK_SLANT
            print(
                f"{name}, {given.seeds} seeds at 0.3 px: {np.median(column):.2f} mm in the median, "
                f"{np.median(np.abs(off)):.2f} off in the median, {np.abs(off).max():.2f} at most"
            )


if __name__ == "__main__":
    try:
        main()
    except GarbiError as error:
        raise SystemExit(f"paper_experiment: {error}") from error
