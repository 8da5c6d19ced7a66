"""Distances and levels of detection of `garbi compare` beside those of py4dgeo's M3C2, on the same two clouds.

    python -m tools.bench.change_m3c2 [--seeds N] [--keep DIR] [-o FILE.json]

The dives are those of tools.bench.change; the second cloud is laid on the first by our alignment, whose median 1 sigma is
py4dgeo's registration error. Needs py4dgeo (the extra dev).
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from garbi_map.compare import CompareSettings, align, difference, find_patches, open_map_folder
from garbi_map.config import Config
from tools.bench.change import pair
from tools.bench.dives import simulated
from tools.bench.maps import write_map

EVERY = 5
"""Cells, of which one is a core point."""


@dataclass(frozen=True)
class Result:
    """Of one pair of maps, mm, over the core points that both compare and where neither map hides the other.

    apart_median, apart_p95     between the two distances
    detection, theirs           median level of detection
    beyond, theirs_beyond       per cent of the unchanged cells' distances beyond it; 5 are right
    """

    seed: int
    cores: int
    apart_median: float
    apart_p95: float
    registration_sigma: float
    detection: float
    theirs: float
    beyond: float
    theirs_beyond: float


def main() -> int:
    """Print a line for each pair."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--keep", type=Path, help="folder in which profiles and maps are kept, and used again")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the results")
    arguments = parser.parse_args()
    results = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(arguments.seeds):
            results.append(bench(seed, arguments.keep or Path(scratch)))
            print(results[-1], flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return 0


def bench(seed: int, work: Path) -> Result:
    """Both maps of a pair, compared twice."""
    import py4dgeo

    config, settings = Config(), CompareSettings()
    folders = [work / f"map-{name}-{seed}" for name in ("before", "after")]
    for folder, scenario in zip(folders, pair(seed), strict=True):
        if not (folder / "seabed.tif").is_file():
            write_map(simulated(folder.name[4:], scenario, work, config), folder, config)
    first, second = (open_map_folder(folder) for folder in folders)
    motion = align(first, second, settings.align)
    change = difference(first, second, motion, settings)
    _, labels = find_patches(change, settings)
    row, column = (index[::EVERY] for index in np.nonzero(np.isfinite(change.distance)))
    cores = np.stack(
        [
            change.origin[0] + (column + 0.5) * change.cell,
            change.origin[1] + (row + 0.5) * change.cell,
            change.elevation[row, column],
        ],
        axis=1,
    )
    up = np.tile([0.0, 0.0, 1.0], (len(cores), 1))
    sigma = float(np.median(np.sqrt(motion.variance(cores, up))))
    algorithm = py4dgeo.M3C2(
        epochs=(
            py4dgeo.Epoch(first.cloud(settings.max_points)),
            py4dgeo.Epoch(motion.apply(second.cloud(settings.max_points))),
        ),
        corepoints=cores,
        normal_radii=[0.5 * settings.normal_scale],
        cyl_radius=0.5 * settings.cylinder,
        max_distance=settings.reach,
        registration_error=sigma,
    )
    distance, uncertainty = algorithm.run()
    ours, detection = change.distance[row, column], change.detection[row, column]
    both = np.isfinite(distance) & np.isfinite(uncertainty["lodetection"])
    still = both & (labels[row, column] == 0)
    apart = 1e3 * np.abs(distance - ours)[both]
    theirs = uncertainty["lodetection"]
    return Result(
        seed=seed,
        cores=int(both.sum()),
        apart_median=float(np.median(apart)),
        apart_p95=float(np.percentile(apart, 95)),
        registration_sigma=1e3 * sigma,
        detection=1e3 * float(np.median(detection[both])),
        theirs=1e3 * float(np.median(theirs[both])),
        beyond=100 * float((np.abs(ours) > detection)[still].mean()),
        theirs_beyond=100 * float((np.abs(distance) > theirs)[still].mean()),
    )


if __name__ == "__main__":
    raise SystemExit(main())
