"""How well and how fast the stripe is found, beside other ways, on images whose truth is known and on real ones.

    python -m tools.bench.stripe [DATA_FOLDER] [--images N] [--no-murky]

The data folder holds dives/*, etna/ and b33boy/; by default shared/data beside this checkout. A dive in murky water is
simulated on the way.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from garbi_map.log import Image, open_log
from garbi_map.log.settings import LogSettings
from garbi_map.stripe import Stripe, StripeDetector, StripeSettings, decode, detect_all
from garbi_map.sweep import laser_angle
from garbi_map.sweep.settings import SweepSettings
from tools.bench.stripe_baselines import BASELINES
from tools.bench.stripe_dives import rig_of, simulated, true_stripes
from tools.bench.stripe_images import AMPLITUDE, CONDITIONS, HEIGHT, SPREAD, synthetic

console = Console(width=max(Console().width, 170))

RANGES = (0.8, 2.5)
"""m: what there is to see in a muddy lake; the window is narrower than that of the default ranges."""


def accuracy(images: int) -> Table:
    """The table of conditions."""
    table = Table(title="Synthetic stripes, px", title_justify="left")
    for heading in ("condition", "method", "rms", "bias", "noise", "lost %", "rms(error/sigma)", "single-row bound"):
        table.add_column(heading, justify="left" if heading in ("condition", "method") else "right", no_wrap=True)
    detector = StripeDetector(StripeSettings())
    for condition in CONDITIONS:
        scenes = [synthetic(condition, seed) for seed in range(images)]
        bound = condition.noise / AMPLITUDE * np.sqrt(2.0 * SPREAD / np.sqrt(np.pi))
        found = [detector.detect(image, 0) for image, _ in scenes]
        error = np.concatenate([s.u - true[s.row] for s, (_, true) in zip(found, scenes, strict=True)])
        sigma = np.concatenate([s.sigma for s in found])
        table.add_row(condition.name, "this", *_figures(error, images), _rms(error / sigma), f"{bound:.4f}")
        for name, method in BASELINES.items():
            off = np.concatenate([method(image) - true for image, true in scenes])
            table.add_row("", name, *_figures(off[np.abs(off) < 20.0], images), "", "")
        table.add_section()
    return table


def _figures(error: NDArray, images: int) -> tuple[str, str, str, str]:
    lost = 100.0 * (1.0 - len(error) / (images * HEIGHT))
    if len(error) == 0:
        return "", "", "", f"{lost:.2f}"
    return _rms(error), f"{error.mean():+.4f}", f"{error.std():.4f}", f"{lost:.2f}"


def _rms(values: NDArray) -> str:
    return f"{np.sqrt(np.mean(np.square(values, dtype=float))):.4f}"


def speed(dive: Path) -> Table:
    """One thread, an image of a dive and a synthetic one, beside OpenCV's chain in the same run."""
    cv2.setNumThreads(1)
    table = Table(title="Speed, 768 x 576, one thread, processor time", title_justify="left")
    for heading in ("image", "what", "columns", "ms", "images/s", "of OpenCV's time", "of that without a window"):
        table.add_column(heading, justify="left" if heading in ("image", "what") else "right")
    true = next(islice(true_stripes(dive, 400), 1, 2))
    rig, recorded = rig_of(dive), decode(true.image)
    near, far = RANGES
    detector = StripeDetector(StripeSettings(), rig)
    narrow = StripeDetector(StripeSettings(min_range=near, max_range=far), rig)
    for name, image in (("synthetic", synthetic(CONDITIONS[1], 0)[0]), (dive.name, recorded)):
        works: dict[str, Callable[[], object]] = {
            "OpenCV: HLS, inRange, moments": lambda image=image: _opencv(image),  # type: ignore[misc]
            "this, no window": lambda image=image: detector.detect(image, 0),  # type: ignore[misc]
        }
        widths = ["", str(image.shape[1])]
        if image is recorded:
            for each in (detector, narrow):
                least, most = each.settings.min_range, each.settings.max_range
                works[f"this, window {least:g} to {most:g} m"] = lambda each=each: each.detect(recorded, 0, true.alpha)  # type: ignore[misc]
                first, last = rig.column_window(true.alpha, least, most)
                widths.append(f"{np.mean(last - first):.0f}")
        # The processor's caches hold the image as they would after decoding, and nothing of the work before
        fresh = partial(np.copyto, image, image.copy())
        decoded = partial(decode, true.image)
        seconds = _alternating(list(works.values()), clock=time.thread_time, before=lambda: (decoded(), fresh()))  # noqa: B023
        for what, width, times in zip(works, widths, seconds, strict=True):
            took, ours = float(np.median(times)), f"{np.median(times / seconds[1]):.2f}" if width else ""
            share = f"{np.median(times / seconds[0]):.2f}"
            table.add_row(name, what, width, f"{1e3 * took:.3f}", f"{1 / took:.0f}", share, ours)
    return table


def _opencv(image: NDArray[np.uint8]) -> object:
    hls = cv2.cvtColor(image, cv2.COLOR_BGR2HLS)
    return cv2.moments(cv2.inRange(hls, (45, 15, 60), (90, 255, 255)), True)


def _alternating(
    works: list[Callable[[], object]],
    rounds: int = 80,
    clock: Callable[[], float] = time.perf_counter,
    before: Callable[[], object] = lambda: None,
) -> NDArray[np.float64]:
    """Seconds (works, rounds) of each, taken in turns so that a busy machine is as unkind to all; `before` each comes
    something that does not count."""
    taken = np.empty((len(works), rounds))
    for turn in range(-3, rounds):
        for number, work in enumerate(works):
            before()
            begin = clock()
            work()
            if turn >= 0:
                taken[number, turn] = clock() - begin
    return taken


def whole_log(dive: Path, images: int = 400) -> Table:
    """Decoding and detecting on two threads beside decoding alone on one."""
    log = open_log([dive / "dive.mcap"], LogSettings())
    rig = rig_of(dive)
    angle = laser_angle(log.navigation().encoder, rig, SweepSettings())
    recorded = list(islice(log.images(), images))
    detector = StripeDetector(StripeSettings(), rig)

    def decode_all(workers: int) -> None:
        with ThreadPoolExecutor(workers) as pool:
            for _ in pool.map(decode, recorded):
                pass

    works: dict[str, Callable[[], object]] = {
        "decode, 1 thread": lambda: decode_all(1),
        "decode, 2 threads": lambda: decode_all(2),
        "decode and detect, 2 threads": lambda: sum(1 for _ in detect_all(recorded, detector, angle.alpha, 2)),
    }
    table = Table(title=f"{images} images of {dive.name}", title_justify="left")
    for heading in ("what", "s", "of decoding on 1 thread", "processor s", "processor s per thread, of decoding"):
        table.add_column(heading, justify="left" if heading == "what" else "right")
    seconds = np.median(_alternating(list(works.values()), 3), axis=1)
    used = []
    for work in works.values():
        begin = time.process_time()
        work()
        used.append(time.process_time() - begin)
    for threads, what, wall, busy in zip((1, 2, 2), works, seconds, used, strict=True):
        share = f"{busy / threads / used[0]:.2f}"
        table.add_row(what, f"{wall:.3f}", f"{wall / seconds[0]:.2f}", f"{busy:.3f}", share)
    return table


def dives(folders: list[Path], every: int = 25) -> Table:
    """Rows of recorded dives against the projection of the true surface."""
    table = Table(title=f"Dives: every {every}th image against the true surface", title_justify="left")
    for heading in ("dive", "rows", "found %", "beyond 3 px %", "median error", "rms below 0.5 px", "rms(error/sigma)"):
        table.add_column(heading, justify="left" if heading == "dive" else "right")
    for dive in folders:
        detector = StripeDetector(StripeSettings(), rig_of(dive))
        error, sigma, rows = [], [], 0
        for true in true_stripes(dive, every):
            inside = (true.row >= 0) & (true.row < rig_of(dive).camera.height)
            row, u = true.row[inside], true.u[inside]
            rows += len(np.unique(row))
            stripe = detector.detect(decode(true.image), true.image.stamp_ns, true.alpha)
            off = _nearest(stripe, row, u)
            off -= np.nanmedian(off)  # the true angle is known to some hundredths of a pixel only
            error.append(off)
            sigma.append(stripe.sigma)
        e, s = np.concatenate(error), np.concatenate(sigma)
        known = np.isfinite(e)
        near = known & (np.abs(e) < 0.5)
        table.add_row(
            dive.name,
            str(rows),
            f"{100 * known.sum() / rows:.2f}",
            f"{100 * (np.abs(e[known]) > 3.0).mean():.3f}",
            f"{np.median(np.abs(e[near])):.4f}",
            _rms(e[near]),
            _rms(e[near] / s[near]),
        )
    return table


def _nearest(stripe: Stripe, row: NDArray, u: NDArray) -> NDArray[np.float64]:
    """Distance (n,) px to the nearest of the row's true columns; NaN where the truth has none."""
    best = np.full(len(stripe.row), np.nan)
    first = np.searchsorted(row, stripe.row)
    for number in range(6):
        at = np.minimum(first + number, len(row) - 1)
        off = np.where(row[at] == stripe.row, stripe.u - u[at], np.nan)
        best = np.where(np.isnan(best) | (np.abs(off) < np.abs(best)), np.where(np.isnan(off), best, off), best)
    return best


def real(data: Path) -> Table:
    """Real stripes on planes: what is left of a straight line, or of a parabola, which takes the lens's distortion."""
    table = Table(title="Real images of a plane, px", title_justify="left")
    for heading in ("image", "rows", "clipped %", "width", "line rms", "parabola rms", "median sigma"):
        table.add_column(heading, justify="left" if heading == "image" else "right")
    mono, red = StripeDetector(StripeSettings(laser="mono")), StripeDetector(StripeSettings(laser="red"))
    for name, detector, path in [
        *((path.relative_to(data).as_posix(), mono, path) for path in sorted(data.glob("etna/calib*/*.png"))),
        *((path.relative_to(data).as_posix(), red, path) for path in sorted(data.glob("b33boy/distance/*.png"))),
    ]:
        pixels = decode(Image(0, 0, "png", path.read_bytes()))
        found = detector.candidates(pixels)
        stripe = detector.detect(pixels, 0)
        table.add_row(
            name,
            str(len(stripe.row)),
            f"{100 * stripe.saturated.mean():.0f}" if len(stripe.row) else "",
            f"{found.spread:.2f}",
            *(f"{value:.3f}" for value in _residuals(stripe)),
            f"{np.median(stripe.sigma):.3f}" if len(stripe.row) else "",
        )
    return table


def _residuals(stripe: Stripe) -> Iterator[float]:
    """Robust rms about a line and about a parabola, of the plane that most of the rows lie on."""
    row, u = stripe.row.astype(float), stripe.u.astype(float)
    rng = np.random.default_rng(0)
    best = np.zeros(len(row), bool)
    for _ in range(300 if len(row) > 40 else 0):
        i, j = np.sort(rng.choice(len(row), 2, replace=False))
        slope = (u[j] - u[i]) / (row[j] - row[i])
        near = np.abs(u - u[i] - slope * (row - row[i])) < 2.0
        if near.sum() > best.sum():
            best = near
    for degree in (1, 2):
        if best.sum() < 20:
            yield float("nan")
            continue
        off = u[best] - np.polynomial.Polynomial.fit(row[best], u[best], degree)(row[best])
        off = off[np.abs(off) < 4.0 * 1.4826 * np.median(np.abs(off))]
        yield float(np.sqrt(np.mean(off**2)))


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    beside = [parent / "shared" / "data" for parent in Path(__file__).resolve().parents]
    default = next((folder for folder in beside if folder.is_dir()), None)
    parser.add_argument("data", type=Path, nargs="?", default=default)
    parser.add_argument("--images", type=int, default=6, help="synthetic images per condition")
    parser.add_argument("--no-murky", action="store_true", help="do not simulate a dive in murky water")
    given = parser.parse_args()
    console.print(accuracy(given.images))
    if not given.no_murky:
        with tempfile.TemporaryDirectory() as folder:
            console.print(dives([simulated("murky", 5.0, Path(folder))], 5))
    if given.data is None:
        console.print("no data folder: the synthetic table alone")
        return
    console.print(speed(given.data / "dives" / "drift"))
    console.print(whole_log(given.data / "dives" / "drift"))
    recorded = (path for path in (given.data / "dives").iterdir() if (path / "truth_seabed.ply").exists())
    console.print(dives(sorted(recorded)))
    console.print(real(given.data))


if __name__ == "__main__":
    main()
