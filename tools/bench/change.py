"""What `garbi compare` finds between two dives over a site of which every change is known.

    python -m tools.bench.change [--seeds N] [--keep DIR] [-o FILE.json]

The dives are scenarios/again_before.yaml and again_after.yaml, cast without images: five things moved by 3 to 20 cm, one
added, other drift. A seed beyond the first draws another site, other drift and other sensors for both.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from garbi_map.compare import CompareSettings, Patch, align, difference, find_patches, open_map_folder
from garbi_map.config import Config
from garbi_map.evaluate import read_tum, rigid_alignment
from tools.bench.dives import BenchDive, simulated
from tools.bench.maps import write_map
from tools.simulator.scenario import Scenario, load_scenario

Floats = NDArray[np.float64]

SCENARIOS = Path(__file__).resolve().parents[1] / "simulator/scenarios"
UNTOUCHED = 5e-4
"""m; where the true surfaces differ by less, within a cylinder's width, nothing has changed."""


@dataclass(frozen=True)
class Result:
    """What one pair of dives gave; registration: median distance of the second map's cells from where they belong."""

    seed: int
    registration_mm: float
    detection_mm: float
    moved_mm: list[list[float | None]]
    """of each thing that moved: truly, and as it was found"""
    added_found: bool
    false_patches: int
    false_area_percent: float
    within_detection_percent: float


def main() -> int:
    """Print a line for each pair."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--keep", type=Path, help="folder in which profiles and maps are kept")
    parser.add_argument("-o", "--out", type=Path, help="JSON file of the results")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        results = [bench(seed, arguments.keep or Path(scratch)) for seed in range(arguments.seeds)]
    if arguments.out:
        arguments.out.write_text(json.dumps([asdict(result) for result in results], indent=1) + "\n")
    return 0


def pair(seed: int) -> tuple[Scenario, Scenario]:
    """Both scenarios; seed 0 as they are."""
    both = [load_scenario(SCENARIOS / f"again_{name}.yaml") for name in ("before", "after")]
    site = both[0].seabed.seed
    assert site is not None
    first, second = (
        one.model_copy(
            update={
                "seed": one.seed + 100 * seed,
                "seabed": one.seabed.model_copy(update={"seed": site + 100 * seed}),
            }
        )
        for one in both
    )
    return first, second


def bench(seed: int, work: Path) -> Result:
    """Both dives, both maps, and what the comparison says against what is so."""
    config = Config()
    scenarios = pair(seed)
    dives, folders = [], []
    for name, scenario in zip(("before", "after"), scenarios, strict=True):
        dives.append(simulated(f"{name}-{seed}", scenario, work, config))
        folders.append(work / f"map-{name}-{seed}")
        write_map(dives[-1], folders[-1], config)
    settings = CompareSettings()
    first, second = (open_map_folder(folder) for folder in folders)
    motion = align(first, second, settings.align)
    change = difference(first, second, motion, settings)
    patches, labels = find_patches(change, settings)

    to_truth = [_to_truth(dive, folder) for dive, folder in zip(dives, folders, strict=True)]
    places = second.cells()[::7]
    off = _apply(to_truth[0], motion.apply(places)) - _apply(to_truth[1], places)
    row, column = np.nonzero(change.compared | change.hidden)
    cells = np.stack(
        [
            change.origin[0] + (column + 0.5) * change.cell,
            change.origin[1] + (row + 0.5) * change.cell,
            change.elevation[row, column],
        ],
        axis=1,
    )
    truth = np.full(change.distance.shape, np.nan)
    truth[row, column] = _true_rise(dives, _apply(to_truth[0], cells))
    around = round(1.5 * settings.cylinder / change.cell)
    untouched = maximum_filter(np.nan_to_num(np.abs(truth)), around) < UNTOUCHED
    untouched &= change.compared
    changed = {int(one) for one in np.unique(labels[~untouched & (labels > 0)])}
    moves, added = _things(scenarios, patches, to_truth[0])
    result = Result(
        seed=seed,
        registration_mm=1e3 * float(np.median(np.linalg.norm(off, axis=1))),
        detection_mm=1e3 * float(np.nanmedian(change.detection)),
        moved_mm=moves,
        added_found=added,
        false_patches=sum(not changed & set(patch.label) for patch in patches),
        false_area_percent=100 * float((labels[untouched] > 0).mean()),
        within_detection_percent=100 * float((np.abs(change.distance) < change.detection)[untouched].mean()),
    )
    print(result, flush=True)
    return result


def _to_truth(dive: BenchDive, folder: Path) -> tuple[Floats, Floats]:
    assert dive.truth.trajectory is not None
    made = read_tum(folder / "trajectory.tum")
    inside = (made.stamp_ns >= dive.truth.trajectory.stamp_ns[0]) & (
        made.stamp_ns <= dive.truth.trajectory.stamp_ns[-1]
    )
    made = made.at(made.stamp_ns[inside])
    rotation, shift = rigid_alignment(made, dive.truth.trajectory.at(made.stamp_ns))
    return rotation.as_matrix(), shift


def _apply(motion: tuple[Floats, Floats], points: Floats) -> Floats:
    return points @ motion[0].T + motion[1]


def _true_rise(dives: list[BenchDive], places: Floats) -> Floats:
    """From the one true surface to the other at places (n, 3), m."""
    import open3d as o3d

    heights = []
    for dive in dives:
        assert dive.truth.surface is not None
        vertices, triangles = dive.truth.surface
        scene: Any = o3d.t.geometry.RaycastingScene(nthreads=1)
        scene.add_triangles(
            o3d.core.Tensor.from_numpy(vertices.astype(np.float32)),
            o3d.core.Tensor.from_numpy(triangles.astype(np.uint32)),
        )
        rays = np.zeros((len(places), 6), np.float32)
        rays[:, :2], rays[:, 2], rays[:, 5] = places[:, :2], 5.0, -1.0
        heights.append(
            5.0 - scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["t_hit"].numpy().astype(float)
        )
    return heights[1] - heights[0]


def _things(
    scenarios: tuple[Scenario, Scenario], patches: list[Patch], to_truth: tuple[Floats, Floats]
) -> tuple[list[list[float | None]], bool]:
    """Of each thing that moved how far, truly and as found, mm; and whether what is new appeared in its place."""
    before, after = (scenario.seabed.things for scenario in scenarios)

    def place(patch: Patch) -> Floats:
        return _apply(to_truth, np.array([[*patch.place, 0.0]]))[0, :2]

    moves: list[list[float | None]] = []
    for old, new in zip(before, after, strict=False):
        true = float(np.hypot(new.at[0] - old.at[0], new.at[1] - old.at[1]))
        near = [
            patch
            for patch in patches
            if patch.moved is not None and np.linalg.norm(place(patch) - old.at) < old.size + 0.03
        ]
        found = near[0].moved if near else None
        moves.append([round(1e3 * true, 1), None if found is None else round(1e3 * found, 1)])
    added = after[len(before)]
    seen = any(
        patch.kind == "appeared" and np.linalg.norm(place(patch) - added.at) < added.size + 0.02 for patch in patches
    )
    return moves, seen


if __name__ == "__main__":
    raise SystemExit(main())
