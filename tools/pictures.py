"""`python -m tools.pictures MAP LOG -o FOLDER`: the README's pictures, taken without a screen: a finished map, its
uncertainty, and a decision that behaviours made on a log."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from behaviours.replay import plan_of, replay
from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.view.show import Wishes, save_log
from tools.headless import headless

PICTURES = {"map": ("Depth", 0.75, False), "uncertainty": ("Uncertainty", 1.0, True)}
"""File -> tab, share of the dive that has passed, and whether the view is alone in the picture."""
DECISION = 0.6
"""Share of the log that has passed when something crosses the vehicle's way."""
MOST = 2000
"""Pixels of one colour that count at most when a picture's palette is chosen; of n pixels, 2 sqrt(n) count."""


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


def take_decision(log: Path, out: Path) -> Path:
    """A picture of what behaviours decided on a log."""
    with tempfile.TemporaryDirectory() as work:
        decisions, recording = Path(work) / "decisions.mcap", Path(work) / "decisions.rrd"
        opened = open_log([log])
        replay(opened, plan_of(opened, None), Config(), decisions)
        save_log(decisions, Wishes(), recording)
        with headless(recording) as viewer:
            begin, end = viewer.span_ns
            viewer.picture(out / "decision.png", begin + round(DECISION * (end - begin)))
    return out / "decision.png"


def shrink(picture: Path) -> None:
    """Write a picture again, in few colours and without the viewer's own menu at its top where it has one.

    The palette is chosen from the colours that occur rather than from the pixels: thin lines keep theirs.
    """
    from PIL import Image

    with Image.open(picture) as opened:
        pixels = opened.convert("RGB")
    if pixels.size == (1920, 1080):
        pixels = pixels.crop((0, 37, 1920, 1080)).resize((1600, 869), Image.Resampling.LANCZOS)
    colours, counts = np.unique(np.asarray(pixels).reshape(-1, 3) // 4 * 4 + 2, axis=0, return_counts=True)
    sample = np.repeat(colours, np.clip(2 * np.sqrt(counts), 1, MOST).astype(int), axis=0)[None].astype(np.uint8)
    palette = Image.fromarray(sample).quantize(256, Image.Quantize.MEDIANCUT, kmeans=2)
    pixels.quantize(palette=palette, dither=Image.Dither.NONE).save(picture, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="the folder of a finished map")
    parser.add_argument("log", type=Path, help="a log for the behaviours")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the folder for the pictures")
    arguments = parser.parse_args()
    taken = [*take_pictures(arguments.folder, arguments.output), take_decision(arguments.log, arguments.output)]
    for file in taken:
        shrink(file)
        print(file)
