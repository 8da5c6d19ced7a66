"""`python -m tools.pictures DIR -o FOLDER`: the README's pictures of a finished map, taken without a screen."""

from __future__ import annotations

import argparse
from pathlib import Path

from tools.headless import headless

PICTURES = {"map": ("Depth", 0.75, False), "uncertainty": ("Uncertainty", 1.0, True), "surface": ("Surface", 1.0, True)}
"""File -> tab, share of the dive that has passed, and whether the view is alone in the picture."""


def take_pictures(folder: Path, out: Path) -> list[Path]:
    """The pictures of a map's folder; returns the files."""
    out.mkdir(parents=True, exist_ok=True)
    files = []
    with headless(folder / "map.rrd") as viewer:
        begin, end = viewer.span_ns
        for name, (tab, share, alone) in PICTURES.items():
            files.append(out / f"{name}.png")
            viewer.picture(files[-1], begin + round(share * (end - begin)), tab, alone)
    return files


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="the folder of a finished map")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the folder for the pictures")
    arguments = parser.parse_args()
    for file in take_pictures(arguments.folder, arguments.output):
        print(file)
