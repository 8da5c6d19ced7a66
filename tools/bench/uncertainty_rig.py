"""Whether maps made with rigs that err as their covariance says differ by as much as `garbi map` states.

    python -m tools.bench.uncertainty_rig [DIVE_FOLDER...] [--rig rig.yaml] [--times F]... [--draws N] [-o FILE.json]

Every draw adds errors from the covariance to the rig of a dive, triangulates its stripes with that, and estimates its path
anew; draws are equally large and at right angles to each other, so that as many as there are parameters tell the spread.
What the map differs from that of the rig as it is shows what such errors do; and its cells are held against the truth.
The covariance is that of a calibrated rig file, or of a careful calibration, its sigmas some times as large.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from garbi_map.calibrate.map_uncertainty import MapSamples, MapUncertainty, View, rig_errors
from garbi_map.config import Config
from garbi_map.navigate import Trajectory, navigate
from garbi_map.register import Registered, register
from garbi_map.rig import Rig, load_rig
from garbi_map.seabed import JudgedPoints, Seabed, build_seabed
from garbi_map.sweep import Sweep
from tools.bench.dives import BenchDive, recorded, shared_dives
from tools.bench.uncertainty import GAUSSIAN_95, cell_errors

Floats = NDArray[np.float64]

LEVEL = 1.0
"""Slope of cells that are compared with those of another map: beyond, they hold an edge."""


@dataclass(frozen=True)
class Result:
    """Of one dive, rms over cells and draws, mm: what is stated, and what was found.

    times          the sigmas of the rig's parameters, in those of its covariance
    bent           inside the map, after the best rigid motion
    displaced      on Earth
    within95       per cent of cells within 1.96 sigma of the truth, of maps with erring rigs, the calibration carried in;
    within95_bare  and left out
    """

    dive: str
    times: float
    draws: int
    bent_stated_mm: float
    bent_found_mm: float
    displaced_stated_mm: float
    displaced_found_mm: float
    within95: float
    within95_bare: float


@dataclass(frozen=True)
class Made:
    """A map, every seventh of its points, its path, and what its rig's covariance means for it."""

    seabed: Seabed
    cloud: Floats
    registered: Registered
    doubt: MapUncertainty


def main() -> int:
    """Print a line for each dive and size of errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--rig", type=Path, help="a calibrated rig file, whose covariance is taken")
    parser.add_argument("--times", action="append", type=float, help="sigmas; 1 and 8 where none are given")
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--keep", type=Path, help="folder in which profiles are kept")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the results")
    arguments = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        for folder in arguments.folders or shared_dives():
            dive = recorded(folder, arguments.keep or Path(scratch), Config())
            for times in arguments.times or [1.0, 8.0]:
                results.append(bench(dive, load_rig(arguments.rig) if arguments.rig else None, times, arguments.draws))
                print(results[-1], flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return 0


def bench(dive: BenchDive, like: Rig | None, times: float, draws: int) -> Result:
    """One dive and as many maps of it with erring rigs."""
    rig = dive.scanner.rig
    unknown, _ = rig_errors(like or rig)
    covariance = times**2 * unknown.root @ unknown.root.T
    told = {"calibration": {"free": list(unknown.names), "covariance": covariance.tolist()}}
    rig = replace(rig, extra={**rig.extra, "laser": told})
    right = make(dive, rig)
    stated = right.doubt
    bent, displaced, within = [], [], []
    k = len(unknown.names)
    directions = np.linalg.qr(np.random.default_rng(7).standard_normal((k, k)))[0]
    for z in np.sqrt(k) * directions[:draws]:
        wrong = make(dive, rig_errors(rig)[0].at(z))
        change, left = differences(right.seabed, wrong.seabed)
        bent.append(np.mean(left**2))
        displaced.append(np.mean(change**2))
        error, sigma = cell_errors(wrong.seabed, wrong.cloud, dive, wrong.registered.inside)
        carried = cell_errors(wrong.doubt.carried_into(wrong.seabed, 0.0), wrong.cloud, dive, wrong.registered.inside)
        within.append([np.mean(np.abs(e / s) < GAUSSIAN_95) for e, s in (carried, (error, sigma))])
    known = right.seabed.known

    def rms(squared: object) -> float:
        return 1e3 * float(np.sqrt(np.mean(np.asarray(squared))))

    shares = 100 * np.mean(within, axis=0)
    return Result(
        dive=dive.name,
        times=times,
        draws=draws,
        bent_stated_mm=rms(stated.bent[known] ** 2),
        bent_found_mm=rms(bent),
        displaced_stated_mm=rms(stated.displaced[known] ** 2),
        displaced_found_mm=rms(displaced),
        within95=float(shares[0]),
        within95_bare=float(shares[1]),
    )


def make(dive: BenchDive, rig: Rig) -> Made:
    """The map of a dive's stripes as another rig triangulates them."""
    config, mount = Config(), dive.navigation.mount("rig")
    with tempfile.TemporaryDirectory() as scratch:
        store, scanner = dive.seen_by(rig, Path(scratch) / "sweeps")
        navigated = navigate(dive.navigation, config.navigate, store.stamps())
        registered = register(store, dive.navigation, navigated, config.registration, config.navigate, scanner=scanner)
        judged: list[JudgedPoints] = []

        def posed() -> Iterator[tuple[Sweep, Trajectory]]:
            for sweep in store:
                yield sweep, registered.inside.at(sweep.stamp_ns).mounted(mount)

        def take(points: object) -> None:
            assert isinstance(points, JudgedPoints)
            judged.append(points)

        seabed, _ = build_seabed(posed, config.seabed, mount, take, rig.eyes)
    samples = MapSamples(seabed)
    for points in judged:
        samples.add(points, View(rig, mount))
    cloud = np.concatenate([points.points[::7] for points in judged])
    return Made(seabed, cloud, registered, samples.uncertainty(registered.trajectory.at))


def differences(one: Seabed, other: Seabed) -> tuple[Floats, Floats]:
    """Between the elevations of the cells that both know (k,) m, but steep ones and the fiftieth that differ most; and what
    is left of that after the rigid motion of one that makes it least."""
    corner = [round((other.origin[k] - one.origin[k]) / one.cell) for k in (0, 1)]
    row, column = np.nonzero(one.known)
    there = (row - corner[1], column - corner[0])
    inside = np.all([(k >= 0) & (k < n) for k, n in zip(there, other.elevation.shape, strict=True)], axis=0)
    row, column = row[inside], column[inside]
    change = other.elevation[there[0][inside], there[1][inside]].astype(float) - one.elevation[row, column]
    south_north, west_east = np.gradient(one.elevation.astype(float), one.cell)
    up = np.stack([-west_east[row, column], -south_north[row, column], np.ones(len(row))], axis=1)
    x, y = one.centres()
    place = np.stack([x[column], y[row], one.elevation[row, column]], axis=1)
    good = np.isfinite(change) & (np.linalg.norm(np.nan_to_num(up[:, :2], nan=np.inf), axis=1) < LEVEL)
    change, up, place = change[good], up[good], place[good]
    rigid = np.concatenate([up, np.cross(place - place.mean(axis=0), up)], axis=1)
    usual = np.ones(len(change), np.bool_)
    for _ in range(4):
        left = change - rigid @ np.linalg.lstsq(rigid[usual], change[usual])[0]
        usual = np.abs(left) < np.percentile(np.abs(left), 98.0)
    return change[usual], left[usual]


if __name__ == "__main__":
    raise SystemExit(main())
