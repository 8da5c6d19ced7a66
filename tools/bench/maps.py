"""A map folder of a bench dive without a log: what `garbi map` writes, as far as the comparison of maps reads it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

from garbi_map import __version__
from garbi_map.aside import write_text
from garbi_map.config import Config
from garbi_map.export import CloudWriter, write_seabed_tif, write_trajectory
from garbi_map.navigate import Trajectory, navigate
from garbi_map.register import register
from garbi_map.seabed import Seabed, build_seabed
from garbi_map.sweep import Sweep
from tools.bench.dives import BenchDive


def write_map(dive: BenchDive, out: Path, config: Config) -> Seabed:
    """Navigation, registration and fusion of the dive's sweeps into the folder `out`."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    store = dive.copied(out / "sweeps")
    navigated = navigate(dive.navigation, config.navigate, store.stamps())
    registered = register(store, dive.navigation, navigated, config.registration, config.navigate, scanner=dive.scanner)
    mount = dive.navigation.mount("rig")

    def posed() -> Iterator[tuple[Sweep, Trajectory]]:
        for sweep in store:
            yield sweep, registered.inside.at(sweep.stamp_ns).mounted(mount)

    with CloudWriter(out / "cloud.laz", config.export.cloud_scale) as cloud:
        seabed, _ = build_seabed(posed, config.seabed, mount, cloud.write, dive.scanner.rig.eyes)
    write_seabed_tif(out / "seabed.tif", seabed)
    write_trajectory(out / "trajectory.tum", registered.trajectory)
    write_text(out / "config.yaml", config.to_yaml())
    write_text(out / "report.json", f'{{"title": "{dive.name}", "versions": {{"garbi": "{__version__}"}}}}\n')
    return seabed
