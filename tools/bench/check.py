"""What `garbi check` and a span of `garbi map` cost on a log of many hours, whether foreign recordings give the same map,
and how the figures that `garbi check` promises compare with the finished map.

    python -m tools.bench.check [--long DIR] [--dives DIR] [-o tools/bench/results/check.json]

--long: a folder for the long log (3 GB on the disk, 30 GB to a reader; it is made where it is missing); --dives: a folder
of dives with dive.mcap. Each command runs in a process of its own; CPU seconds are those of user and system together.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.config import Config
from garbi_map.health import check_health
from garbi_map.log import open_log
from garbi_map.pipeline import build_map
from tools.bench.long_log import write_long

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
SPAN = (20_000.0, 20_025.0)


class Counted:
    """A file that counts the bytes that are read from it."""

    total = 0

    def __init__(self, file: Any) -> None:
        self._file = file

    def read(self, size: int = -1) -> bytes:
        """Read, and count."""
        data: bytes = self._file.read(size)
        Counted.total += len(data)
        return data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)

    def __enter__(self) -> Counted:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def counted(action: Callable[[], object]) -> int:
    """Bytes that the log room reads while something is done."""
    plain = Path.open

    def opened(path: Path, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        file = plain(path, mode, *arguments, **options)
        return Counted(file) if path.suffix == ".mcap" and mode == "rb" else file

    Counted.total = 0
    Path.open = opened  # type: ignore[method-assign,assignment]
    try:
        action()
    finally:
        Path.open = plain  # type: ignore[method-assign]
    return Counted.total


def cost(*arguments: object) -> dict[str, Any]:
    """CPU seconds, exit status and peak memory, MB, of a garbi command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run(
        ["/usr/bin/env", sys.executable, "-c", _MEASURED, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    peak = re.search(r"^PEAK (\d+)$", ended.stderr, re.MULTILINE)
    return {"cpu_s": round(cpu, 2), "status": ended.returncode, "peak_mb": int(peak[1]) // 1024 if peak else None}


_MEASURED = """
import atexit, pathlib, re, sys
status = pathlib.Path("/proc/self/status")
atexit.register(lambda: print("PEAK", re.search(r"VmHWM:\\s*(\\d+)", status.read_text())[1], file=sys.stderr))
sys.argv[0] = "garbi"
from garbi_map.cli import main
main()
"""


def long_log(folder: Path) -> dict[str, Any]:
    """Twelve hours and 30 GB: checked, checked without its index, and 25 s of it mapped."""
    folder.mkdir(parents=True, exist_ok=True)
    path, cut = folder / "long.mcap", folder / "cut.mcap"
    if not path.exists():
        write_long(SAMPLE, path, 12.0, 30.0)
    if not cut.exists():
        subprocess.run(["cp", "--sparse=always", path, cut], check=True)
        with cut.open("rb+") as file:
            file.truncate(path.stat().st_size - 8_000_000)
    cost("check", path)  # what is compiled is compiled
    begin = open_log([path]).begin_ns
    first, last = (begin + round(t * 1e9) for t in SPAN)

    def read_span() -> None:
        log = open_log([path])
        log.navigation(first, last)
        for _ in log.images(first, last):
            pass

    with tempfile.TemporaryDirectory() as out:
        read = _megabytes(lambda: build_map([path], Path(out, "read"), Config(), None, SPAN, 1))
        mapped = cost("map", path, "-o", f"{out}/map", "--from", SPAN[0], "--to", SPAN[1], "--workers", 1)
    size = path.stat().st_size
    return {
        "gigabytes": round(size * 1e-9, 1),
        "hours": 12,
        "check": {
            **cost("check", path),
            "megabytes_read": _megabytes(lambda: check_health(open_log([path]), Config())),
        },
        "check, index lost": {
            **cost("check", cut),
            "megabytes_read": _megabytes(lambda: check_health(open_log([cut], quick=True), Config())),
        },
        "open alone": {"megabytes_read": _megabytes(lambda: open_log([path]))},
        "25 s of it, opened and read": {"megabytes_read": _megabytes(read_span)},
        "25 s of it in megabytes": round(size * (SPAN[1] - SPAN[0]) / 43_200 * 1e-6, 1),
        "map of 25 s": {**mapped, "megabytes_read": read},
    }


def _megabytes(action: Callable[[], object]) -> float:
    return round(counted(action) * 1e-6, 1)


def promises(dives: Path) -> dict[str, Any]:
    """What the check of a dive expects, and what its map has."""
    import laspy

    found = {}
    for folder in sorted(path for path in dives.iterdir() if (path / "dive.mcap").exists()):
        expected = check_health(open_log([folder / "dive.mcap"]), Config()).expected
        assert expected is not None
        with tempfile.TemporaryDirectory() as out:
            cost("map", folder / "dive.mcap", "-o", f"{out}/map", "--workers", 1)
            cloud = laspy.read(f"{out}/map/cloud.laz")
        places, counts = np.unique(np.floor(np.c_[cloud.x, cloud.y] / 0.02).astype(int), axis=0, return_counts=True)
        found[folder.name] = {
            "area_m2": [round(expected.area_m2 or 0, 2), round(len(places) * 4e-4, 2)],
            "points_per_cm2": [round(expected.points_per_cm2 or 0, 1), round(float(np.median(counts)) / 4, 1)],
            "point_sigma_mm": [
                round(1e3 * expected.point_sigma_m[0], 3),
                round(1e3 * float(np.median(np.asarray(cloud.sigma))), 3),
            ],
        }
    return found


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--long", type=Path)
    parser.add_argument("--dives", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    results = json.loads(options.output.read_text()) if options.output and options.output.exists() else {}
    if options.long:
        results["long log"] = long_log(options.long)
    if options.dives:
        results["promised, found in the map"] = promises(options.dives)
    text = json.dumps(results, indent=2)
    print(text)
    if options.output:
        options.output.write_text(text + "\n")


if __name__ == "__main__":
    main()
