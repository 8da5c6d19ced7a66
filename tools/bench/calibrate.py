"""The calibration's figures of merit: `python -m tools.bench.calibrate [--shared DIR] [--quick]`.

Every line is computed here: from noise-free numbers, from simulated noise, from rendered images, and from real ones
where the folder with them is given.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from garbi_map.calibrate import run
from garbi_map.calibrate.bundle import Bundle
from garbi_map.calibrate.files import dump, read_known
from garbi_map.calibrate.laser import calibrate_laser
from garbi_map.calibrate.linear import solve_camera, solve_laser
from garbi_map.calibrate.observe import sweeps_of
from garbi_map.calibrate.scanner import LASER_NAMES, LENS_NAMES, Scanner
from garbi_map.calibrate.sheet_models import fit_plane, plane_distance
from garbi_map.calibrate.targets import load_target
from garbi_map.calibrate.uncertainty import errors_at
from garbi_map.calibrate.views import corners_of
from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.rig import LaserWindow, Port, Rig, camera_entries, laser_entries
from tools.bench import real_calibrations
from tools.paper_experiment import BLOCK_SLANT, simulated, true_rig
from tools.simulator.calibration_log import write_sweeps
from tools.simulator.target import Booth, Look
from tools.simulator.target_points import TWO_PLANES, poses_across, poses_before, stripes_of, target_of, views_of

Row = tuple[str, str, str]  # what, target, measured
RANGES = (1.0, 1.5, 2.0)
BOARD = "kind: checkerboard\ninner_corners: [13, 9]\nsquare: 0.05\nborder: 0.04\n"
LASER_POSES, LASER_IMAGES = 8, 24
DRY, WET = (-0.02, 0.68), (-0.3, 0.75)  # rad, of the sweeps: the whole image at 1 m; a fixed window bends the sheet


def linear_exact() -> Iterable[Row]:
    """The linear solves without noise."""
    rng = np.random.default_rng(0)
    worst = 0.0
    for seed in range(20):
        rig = true_rig(np.random.default_rng(seed), tilted=False)
        laser = rig.laser
        points = rng.uniform([0.7, -0.4, -0.3], [2.0, 0.4, 0.3], (400, 3))
        alpha = rng.uniform(0.1, 0.6, 400)
        normal = laser.sheet(alpha)
        points[:, 1] -= np.einsum("ij,ij->i", normal, points - laser.apex) / normal[:, 1]
        found = solve_laser(points, alpha)
        worst = max(worst, *(abs(getattr(found, k) - getattr(laser, k)) for k in ("x", "y", "z", "delta", "beta")))
        target = target_of(TWO_PLANES)
        here = Rotation.from_euler("yx", [-0.8, -0.15]).apply(target.points) + np.array([0.0, 0.0, 1.0])
        camera = solve_camera(target.points, here[:, :2] / here[:, 2:] * [812.0, 816.0] + [370.0, 290.0])
        seen = np.array([camera.alpha_u, camera.alpha_v, camera.u0, camera.v0])
        worst = max(worst, float(np.abs(seen - [812.0, 816.0, 370.0, 290.0]).max()))
    yield "linear, noise-free: worst of all parameters", "1e-6", f"{worst:.1e}"


def paper(seeds: int) -> Iterable[Row]:
    """The paper's experiment on simulated corners and stripes."""
    off = 1e3 * np.abs(np.array([simulated(seed) for seed in range(seeds)]) - BLOCK_SLANT)
    for name, goal, column in (("ours", "0.3 mm", off[:, 0]), ("the paper's method, corrected", "-", off[:, 1])):
        text = f"{column.max():.2f} mm worst, {np.median(column):.2f} median of {seeds} seeds"
        yield f"82 mm edge at 0.3 px: {name}", goal, text


def honest(seeds: int) -> Iterable[Row]:
    """Squared parameter errors over seeds, normalised by the covariance."""
    target = target_of()
    names = tuple(name for name in LASER_NAMES if name != "laser.z")
    for noise in (0.1, 0.3):
        errors = []
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            rig, poses = true_rig(rng), poses_before([0.7, 1.1, 1.6], rng, tilt=0.3)
            corners = corners_of(views_of(rig, target, poses, noise / 3, rng), target)
            stripes = stripes_of(rig, target, poses, np.linspace(0.08, 0.6, 21), noise, rng, step=32)
            errors.append(normalised(Bundle(Scanner(rig.camera, rig.laser), poses, names, corners, stripes)))
        yield in_band(f"covariance of the laser at {noise:g} px", errors, len(names))
    errors = []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        rig, poses = true_rig(rng), poses_before(list(np.linspace(0.7, 1.6, 8)), rng)
        corners = corners_of(views_of(rig, target, poses, 0.2, rng), target)
        errors.append(normalised(Bundle(Scanner(rig.camera), poses, LENS_NAMES[:8], corners)))
    yield in_band("covariance of the camera at 0.2 px", errors, 8)


def normalised(bundle: Bundle) -> float:
    """Squared error of what a bundle that begins with the truth finds, in its own covariance."""
    found = bundle.fit()
    new, old = found.scanner.values(), bundle.scanner.values()
    error = np.array([new[name] - old[name] for name in found.free])
    return float(error @ np.linalg.solve(found.own_covariance, error))


def in_band(what: str, errors: list[float], size: int) -> Row:
    """The mean of chi-squared errors beside its 95 % band."""
    low, high = chi2.ppf([0.025, 0.975], size * len(errors)) / len(errors)
    name = f"{what}: normalised error squared, {len(errors)} seeds"
    return name, f"{low:.2f} to {high:.2f}", f"{np.mean(errors):.2f}"


def rendered(
    folder: Path, rig: Rig, name: str, nominal: bool, views: int, seed: int, plane_too: bool = False
) -> list[np.ndarray]:
    """Camera and laser from rendered images by the commands' own code: errors (3,) m rms at the ranges, of one or two
    laser models. nominal: port and window of the rig are given beforehand, as nominal values.

    The target is shown whole, up to the image's border: to the camera from 0.85 to 1.9 m, to the laser at about 0.9 m
    and about 1.9 m in turn.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    target = target_of(BOARD)
    (folder / "target.yaml").write_text(BOARD)
    booth = Booth(rig, target, Look())
    images = folder / f"{name}_camera"
    images.mkdir(exist_ok=True)
    poses = poses_across(rig.camera, target, list(np.linspace(0.85, 1.9, views)), rng)
    for i in range(views):
        placed = booth.placed(poses.rotation[i], poses.translation[i])
        cv2.imwrite(str(images / f"{i:02d}.png"), booth.image(placed, None, rng))
    start = None
    if nominal:
        start = folder / f"{name}_start.yaml"
        rough = replace(rig.laser, x=0.0, y=-0.4, z=0.0, delta=rig.laser.delta + 0.05, theta=0.0, gamma=0.0, beta=0.02)
        start.write_text(dump({"camera": camera_entries(rig.camera), "laser": laser_entries(rough)}))
    camera = folder / f"{name}_camera.yaml"
    run.camera([images], folder / "target.yaml", camera, start)
    poses = poses_across(rig.camera, target, [0.9, 1.9] * (LASER_POSES // 2), rng, tilt=0.3)
    log = folder / f"{name}.mcap"
    chain = [(poses.rotation[i], poses.translation[i]) for i in range(LASER_POSES)]
    write_sweeps(log, booth, chain, WET if nominal else DRY, LASER_IMAGES, seed)
    known, config = read_known(camera), Config()
    board, settings = load_target(folder / "target.yaml"), config.calibrate
    sweeps = sweeps_of(open_log([log]), known.camera, board, settings, config.stripe, config.sweep, None)
    log.unlink()
    found = []
    loose = settings.model_copy(update={"max_stripe_noise": 50.0, "max_error": 1.0, "max_outliers": 0.95})
    for model in (known.laser, None)[: 2 if plane_too else 1]:
        fit = calibrate_laser(
            known.camera,
            sweeps.views,
            sweeps.stripes,
            board,
            loose,
            model,
            prior=known.prior if model or not nominal else None,
        )
        one = Rig(fit.scanner.camera, fit.laser)
        found.append(np.array([np.sqrt(np.nanmean(errors_at(rig, one, depth) ** 2)) for depth in RANGES]))
    print(f"{name}, seed {seed}: {'; '.join(mm(errors) for errors in found)}", file=sys.stderr, flush=True)
    return found


def mm(errors: np.ndarray) -> str:
    """At the ranges."""
    return " / ".join(f"{1e3 * error:.2f}" for error in errors) + " mm"


def own_planes(rig: Rig) -> str:
    """How far the sheets of a rig are from their own best planes between 1 and 2 m, whatever the calibration: mm.

    Less where the sheet leaves the window at right angles: a plane comes out as one."""
    u, v = (grid.ravel() for grid in np.meshgrid(np.linspace(5, 760, 120), np.linspace(5, 570, 25)))
    off = []
    for alpha in np.linspace(*WET, 12):
        points = rig.triangulate(u, v, float(alpha)).points
        depth = rig.depth(points)
        points = points[(depth > RANGES[0]) & (depth < RANGES[-1])]
        if len(points) > 50:
            off.append(1e3 * np.abs(plane_distance(fit_plane(points), points)))
    by_angle = [float(np.sqrt((part**2).mean())) for part in off]
    most = max(float(part.max()) for part in off)
    all_rms = float(np.sqrt((np.concatenate(off) ** 2).mean()))
    return f"{all_rms:.1f} mm rms ({min(by_angle):.1f} to {max(by_angle):.1f} by angle), {most:.1f} at most"


def from_images(folder: Path, views: int, seeds: int) -> Iterable[Row]:
    """Whole chains from rendered images, over seeds: other rigs, poses and noise."""
    out = Rotation.from_euler("z", 0.35 + 0.35).as_matrix()[:, 0]
    window = LaserWindow("flat", tuple(out.tolist()), 0.04, 0.01, 1.49, 1.335)
    port = Port((0.0, 0.0, 1.0), 0.05, 0.012, 1.49, 1.335)
    errors: dict[str, list[np.ndarray]] = {"level": [], "tilted": [], "wet": [], "plane": []}
    for seed in range(seeds):
        level = true_rig(np.random.default_rng(100 + seed), tilted=False)
        laser = replace(level.laser, theta=np.radians(1.0), gamma=np.radians(-0.7))
        wet = Rig(replace(level.camera, port=port), replace(level.laser, window=window))
        errors["level"] += rendered(folder, level, "level", False, views, seed)
        errors["tilted"] += rendered(folder, Rig(level.camera, laser), "tilted", False, views, seed)
        for name, found in zip(("wet", "plane"), rendered(folder, wet, "wet", True, views, seed, True), strict=True):
            errors[name].append(found)
    rms = {name: np.sqrt(np.mean(np.square(found), axis=0)) for name, found in errors.items()}
    worst = {name: np.max(found, axis=0) for name, found in errors.items()}

    def both(name: str) -> str:
        return f"{mm(rms[name])} rms of {seeds} seeds, worst {mm(worst[name])}"

    yield "rendered, two distances: 3-D error at 1 / 1.5 / 2 m", "0.1 / 0.25 / 0.5 mm", both("level")
    ratio = " / ".join(f"{value:.2f}" for value in rms["tilted"] / rms["level"])
    yield "theta 1, gamma -0.7 degrees, against 0, 0", "at most 1.20", f"{ratio} ({both('tilted')})"
    yield "flat port and fixed laser window, rendered", "below 0.5 mm, 1 to 2 m", both("wet")
    yield "that window's sheets off their own best planes", "4 to 12 mm", own_planes(wet)
    yield "the chain with one turning plane instead", "-", both("plane")


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, help="the folder with data/etna, data/turbot, data/b33boy")
    parser.add_argument("--work", type=Path, default=Path("out/bench_calibrate"))
    parser.add_argument("--quick", action="store_true", help="few seeds and views")
    given = parser.parse_args()
    few = given.quick
    parts: list[Callable[[], Iterable[Row]]] = [
        linear_exact,
        lambda: paper(3 if few else 20),
        lambda: honest(20 if few else 100),
        lambda: from_images(given.work, 12 if few else 40, 1 if few else 5),
    ]
    if given.shared is not None:
        for real in (real_calibrations.etna, real_calibrations.turbot, real_calibrations.b33boy):
            data = given.shared / "data" / real.__name__
            parts.append(lambda real=real, data=data: ((what, "-", found) for what, found in real(data)))  # type: ignore[misc]
    print("| what | target | measured |\n| --- | --- | --- |")
    for part in parts:
        for what, goal, found in part():
            print(f"| {what} | {goal} | {found} |", flush=True)


if __name__ == "__main__":
    main()
