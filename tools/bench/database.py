"""Figures of the map's database: further dives over a site, kill -9, many dives on Dask, growth, fusion beside Open3D.

python -m tools.bench.database {together,kills,dask,growth,fusion} [...] [-o FILE.json]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools.bench.database_dask import dask
from tools.bench.database_growth import fusion, growth
from tools.bench.database_kills import kills
from tools.bench.database_together import together

PARTS: dict[str, Callable[[Path, int], dict[str, Any]]] = {
    "together": together, "kills": kills, "dask": dask, "growth": growth, "fusion": fusion,
}  # fmt: skip


def main() -> int:
    """Run the parts that are asked for; one JSON file holds what each gave."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="+", choices=sorted(PARTS))
    parser.add_argument("-n", type=int, default=0, help="kills, dives or million points; 0: as the issue asks")
    parser.add_argument("-o", "--out", type=Path, default=Path("tools/bench/results/database.json"))
    arguments = parser.parse_args()
    found = json.loads(arguments.out.read_text()) if arguments.out.exists() else {}
    for part in arguments.parts:
        with tempfile.TemporaryDirectory() as scratch:
            found[part] = PARTS[part](Path(scratch), arguments.n)
        arguments.out.write_text(json.dumps(found, indent=1) + "\n")
        print(json.dumps(found[part], indent=1), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
