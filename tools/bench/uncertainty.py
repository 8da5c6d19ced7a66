"""Whether the uncertainty of the map's cells is honest: each cell's error over its own 1 sigma, as a table and a histogram.

    python -m tools.bench.uncertainty [DIVE_FOLDER...] [--only NAME]... [--draws N] [--keep DIR] [-o FILE.json]

What a cell claims includes what the calibration leaves open. So the rig errs, too: each dive is mapped with several rigs
drawn from the covariance that the map is told, equally far from the right one and at right angles to each other: one alone
bends all cells the same way. With no draws the rig is the simulator's own, and the claim is too large by that part.

Dives in shared/data/dives beside this checkout, and simulated ones of our own (drift_scenarios.yaml); the true surface is
read after one rigid alignment of the cloud, for the origin of a map is free. A cell is compared where the true surface is
less steep than 60 degrees within it: beyond that its elevation is not one number.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.map_uncertainty import MapSamples, View, rig_errors
from garbi_map.config import Config
from garbi_map.evaluate import TrueSurface
from garbi_map.navigate import Trajectory, navigate
from garbi_map.register import register
from garbi_map.rig import Rig
from garbi_map.seabed import AcceptedPoints, JudgedPoints, Seabed, build_seabed
from garbi_map.sweep import Sweep
from tools.bench.dives import BenchDive, recorded, scenarios, shared_dives, simulated

Floats = NDArray[np.float64]

STEEPEST = 1.7
"""Slope of a cell's true surface."""
EDGES = np.arange(-4.0, 4.01, 0.5)
GAUSSIAN_95 = 1.96


@dataclass(frozen=True)
class Result:
    """Of the compared cells of one dive, of the maps with all its rigs; normalised: error over the cell's 1 sigma.

    rigs        that were drawn, 0 for the right one
    within95    per cent within 1.96 sigma
    spread      half the width of the normalised errors' middle 68 %: 1 where sigma is right
    histogram   per cent of cells between the edges; the first and the last entry are all beyond
    """

    dive: str
    poses: str
    rigs: int
    cells: int
    error_mm: float
    sigma_mm: float
    within95: float
    spread: float
    histogram: list[float]


def main() -> int:
    """Print a line and a histogram for each dive."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--only", action="append", help="names of dives")
    parser.add_argument("--draws", type=int, default=3, help="rigs; 0: the right one")
    parser.add_argument("--true-poses", action="store_true", help="also with the true poses: what noise alone claims")
    parser.add_argument("--keep", type=Path, help="folder in which profiles are kept")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the results")
    arguments = parser.parse_args()
    config, results = Config(), []
    with tempfile.TemporaryDirectory() as scratch:
        work = arguments.keep or Path(scratch)
        for dive in _dives(arguments.folders or shared_dives(), arguments.only, work, config):
            for poses in ("found", "true")[: 2 if arguments.true_poses else 1]:
                results.append(bench(dive, config, arguments.draws, poses))
                show(results[-1])
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return 0


def _dives(folders: list[Path], only: list[str] | None, work: Path, config: Config) -> Iterator[BenchDive]:
    for folder in folders:
        if only is None or folder.name in only:
            yield recorded(folder, work, config)
    for name, scenario in scenarios().items():
        if only is None or name in only:
            yield simulated(name, scenario, work, config)


def bench(dive: BenchDive, config: Config, draws: int, poses: str = "found") -> Result:
    """The maps of one dive, cell by cell against the truth."""
    found = [mapped(dive, config, poses, rig) for rig in (drawn(dive.scanner.rig, draws) if draws else [None])]
    error, sigma = (np.concatenate(parts) for parts in zip(*found, strict=True))
    normalised = error / sigma
    low, high = np.percentile(normalised, [15.865, 84.135])
    counts = np.histogram(np.clip(normalised, EDGES[0] - 0.1, EDGES[-1] + 0.1), np.r_[-np.inf, EDGES, np.inf])[0]
    return Result(
        dive=dive.name,
        poses=poses,
        rigs=draws,
        cells=len(error),
        error_mm=1e3 * float(np.median(np.abs(error))),
        sigma_mm=1e3 * float(np.median(sigma)),
        within95=100 * float((np.abs(normalised) < GAUSSIAN_95).mean()),
        spread=float(high - low) / 2,
        histogram=[round(100 * float(count) / len(error), 2) for count in counts],
    )


def drawn(rig: Rig, draws: int) -> list[Rig]:
    """The rig as so many calibrations would have left it; the same ones whenever they are asked for."""
    unknown, _ = rig_errors(rig)
    k = len(unknown.names)
    directions = np.linalg.qr(np.random.default_rng(7).standard_normal((k, k)))[0]
    return [unknown.at(z) for z in np.sqrt(k) * directions[:draws]]


def mapped(dive: BenchDive, config: Config, poses: str, rig: Rig | None) -> tuple[Floats, Floats]:
    """Errors and sigmas (k,) m of the cells of a map with another rig, or with the right one."""
    assert dive.truth.trajectory is not None and dive.truth.surface is not None
    mount = dive.navigation.mount("rig")
    with tempfile.TemporaryDirectory() as scratch:
        store, scanner = dive.copied(Path(scratch) / "sweeps"), dive.scanner
        if rig is not None:
            store, scanner = dive.seen_by(rig, Path(scratch) / "drawn")
        inside = path = dive.truth.trajectory
        if poses == "found":
            navigated = navigate(dive.navigation, config.navigate, store.stamps())
            registered = register(
                store, dive.navigation, navigated, config.registration, config.navigate, scanner=scanner
            )
            inside, path = registered.inside, registered.trajectory
        judged: list[JudgedPoints] = []

        def posed() -> Iterator[tuple[Sweep, Trajectory]]:
            for sweep in store:
                yield sweep, inside.at(sweep.stamp_ns).mounted(mount)

        def take(points: AcceptedPoints) -> None:
            assert isinstance(points, JudgedPoints)
            judged.append(points)

        seabed, _ = build_seabed(posed, config.seabed, mount, take, scanner.rig.eyes)
    samples, view = MapSamples(seabed), View(scanner.rig, mount)
    for points in judged:
        samples.add(points, view)
    seabed = samples.uncertainty(path.at).carried_into(seabed, 0.0)
    return cell_errors(seabed, np.concatenate([points.points[::7] for points in judged]), dive, inside)


def cell_errors(seabed: Seabed, cloud: Floats, dive: BenchDive, inside: Trajectory) -> tuple[Floats, Floats]:
    """Error of the elevation (k,) m of the cells that can be compared, and the sigma (k,) m that they claim."""
    assert dive.truth.surface is not None
    rotation, shift = onto_truth(cloud, dive, inside)
    x, y = np.meshgrid(*seabed.centres())
    known = seabed.known
    cells = np.stack([x[known], y[known], seabed.elevation[known].astype(float)], axis=1)
    places = rotation.apply(cells) + shift
    heights, slope = _true_heights(*dive.truth.surface, places, seabed.cell)
    good = np.isfinite(heights) & (slope < STEEPEST)
    # truth_seabed.ply may be cropped, and the ray meets the top of what overhangs
    good &= np.abs(places[:, 2] - heights) < 0.03
    return (places[:, 2] - heights)[good], seabed.uncertainty[known].astype(float)[good]


def onto_truth(cloud: Floats, dive: BenchDive, inside: Trajectory) -> tuple[Rotation, Floats]:
    """The one rigid motion of a map, rotation and shift (3,) m, that lays its path on the true one and then its cloud (n, 3)
    on the true surface."""
    from garbi_map.evaluate import rigid_alignment

    assert dive.truth.trajectory is not None and dive.truth.surface is not None
    true = dive.truth.trajectory
    within = (inside.stamp_ns >= true.stamp_ns[0]) & (inside.stamp_ns <= true.stamp_ns[-1])
    made = inside.at(inside.stamp_ns[within])
    rotation, shift = rigid_alignment(made, true.at(made.stamp_ns))
    rough = rotation.apply(cloud) + shift
    fine = TrueSurface(*dive.truth.surface).aligned(rough)
    turn, _ = Rotation.align_vectors(fine - fine.mean(0), rough - rough.mean(0))
    return turn * rotation, turn.apply(shift - rough.mean(0)) + fine.mean(0)


def _true_heights(vertices: Floats, triangles: NDArray[np.int32], places: Floats, cell: float) -> tuple[Floats, Floats]:
    """Of the surface under places (n, 3), m, and its steepest slope across the cell."""
    import open3d as o3d

    scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
    centre = np.round(vertices.mean(0))
    scene.add_triangles(
        o3d.core.Tensor.from_numpy((vertices - centre).astype(np.float32)),
        o3d.core.Tensor.from_numpy(triangles.astype(np.uint32)),
    )
    top = float((vertices[:, 2] - centre[2]).max()) + 1.0
    found = []
    for dx, dy in ((0.0, 0.0), (0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)):
        rays = np.zeros((len(places), 6), np.float32)
        rays[:, :2] = places[:, :2] - centre[:2] + np.array([dx, dy]) * cell
        rays[:, 2], rays[:, 5] = top, -1.0
        hit = scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["t_hit"].numpy().astype(float)
        found.append(np.where(np.isfinite(hit), top - hit + centre[2], np.nan))
    corners = np.stack(found[1:])
    return found[0], (corners.max(0) - corners.min(0)) / (np.sqrt(2.0) * cell)


def show(result: Result) -> None:
    """One dive."""
    print(
        f"{result.dive}, {result.poses} poses, {result.rigs} rigs drawn: {result.cells} cells, median error "
        f"{result.error_mm:.3f} mm, median sigma {result.sigma_mm:.3f} mm, "
        f"{result.within95:.1f} % within 95 %, spread {result.spread:.2f}"
    )
    largest = max(result.histogram)
    names = ["below", *(f"{edge:+.1f}" for edge in EDGES[:-1]), "above"]
    for name, share in zip(names, result.histogram, strict=True):
        print(f"  {name:>6} {share:6.2f} % {'#' * round(50 * share / largest)}")
    print(flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
