"""python -m tools.bench.behaviours [LOG...]: from an image's bytes to the command, one core, decoding included; how much
faster than real time a replay runs; memory over an hour. CPU time of this process, so that a busy machine does not count."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from behaviours.feed import Intake, Sighting
from behaviours.log_feed import LogFeed
from behaviours.pilot import Pilot
from behaviours.replay import decide_all, plan_of
from behaviours.settings import HoldSettings
from garbi_map.config import Config
from garbi_map.log import Navigation, open_log
from garbi_map.rig import parse_rig
from garbi_map.stripe import StripeDetector, StripeSettings
from garbi_map.stripe.decode import decode
from garbi_map.sweep import SweepSettings, laser_angle

LOGS = Path(__file__).resolve().parents[2] / "logs"


HOLD = HoldSettings(target="patch", farthest=4.0, least_points=200)  # the slowest registration there is


def image_to_command(path: Path, hold: HoldSettings | None = None) -> dict[str, float]:
    """Milliseconds per image: decode, find the stripe, triangulate, carve, decide. hold: besides the log's own plan."""
    log = open_log([path])
    rig = parse_rig(log.rig_text or "", str(path))
    readings = log.navigation()
    angle = laser_angle(readings.encoder, rig, SweepSettings())
    detector = StripeDetector(StripeSettings(), rig)
    given = plan_of(log, None).behaviours
    given = given if hold is None else given.model_copy(update={"hold": hold})
    intake = Intake(rig, readings.mounts, given.feed)
    intake.read(readings)
    pilot = Pilot(given, rig, intake.mount)
    took = []
    for image in log.images():
        intake.until(image.arrival_ns)  # navigation is taken in as it comes, not when an image does
        begin = time.process_time()
        alpha = angle.alpha(image.stamp_ns)
        stripe = detector.detect(decode(image), image.stamp_ns, alpha)
        intake.sight(Sighting(stripe, image.arrival_ns + 1, alpha, 0, False))
        pilot.decide(intake.until(image.arrival_ns + 1))
        took.append(1e3 * (time.process_time() - begin))
    steady = np.array(took[25:])  # compiling and the first touch of memory come before a dive
    return {
        "median_ms": float(np.median(steady)), "p99_ms": float(np.percentile(steady, 99)), "max_ms": float(steady.max()),
    }  # fmt: skip


def memory(path: Path, minutes: int = 60, every: int = 10, thin: int = 3) -> list[float]:
    """MB resident after each `every` minutes of a feed that shows the log again and again, holding station besides; of the
    images one in `thin` is shown, and decisions are as much rarer: what grows, grows by them all the same."""
    log = open_log([path])
    rig = parse_rig(log.rig_text or "", str(path))
    readings = log.navigation()
    angle = laser_angle(readings.encoder, rig, SweepSettings())
    detector = StripeDetector(StripeSettings(), rig)
    images = list(log.images())[::thin]
    stripes = [detector.detect(decode(one), one.stamp_ns, angle.alpha(one.stamp_ns)) for one in images]
    given = plan_of(log, None).behaviours.model_copy(update={"hold": HOLD})
    intake = Intake(rig, readings.mounts, given.feed)
    pilot = Pilot(given, rig, intake.mount)
    period, length = round(thin * given.feed.period * 1e9), log.end_ns - log.begin_ns
    found: list[float] = []
    shift, now = 0, log.begin_ns
    while len(found) < minutes // every:
        intake.read(_later(readings, shift))
        for image, stripe in zip(images, stripes, strict=True):
            shown = replace(stripe, stamp_ns=stripe.stamp_ns + shift)
            intake.sight(Sighting(shown, image.arrival_ns + shift, angle.alpha(image.stamp_ns), shift // length, False))
        while now < log.begin_ns + shift + length:
            now += period
            pilot.decide(intake.until(now))
        shift += length
        if shift > (len(found) + 1) * every * 60e9:
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            found.append(pages * 4096 / 1e6)
    return found


def _later(readings: Navigation, shift: int) -> Navigation:
    moved = {}
    for kind in ("encoder", "imu", "pressure", "dvl"):
        record = getattr(readings, kind)
        if record is not None:
            moved[kind] = replace(record, stamp_ns=record.stamp_ns + shift, arrival_ns=record.arrival_ns + shift)
    return Navigation(**moved)


def replay_speed(path: Path) -> float:
    """Seconds of log per second of CPU."""
    log = open_log([path])
    plan = plan_of(log, None)
    begin = time.process_time()
    feed = LogFeed(log, plan.behaviours.feed, Config().stripe, workers=1)
    count = sum(1 for _ in decide_all(feed, plan))
    return count * plan.behaviours.feed.period / (time.process_time() - begin)


def main() -> int:
    """Print and leave the figures as JSON."""
    paths = [Path(name) for name in sys.argv[1:]] or [LOGS / "sample.mcap", *sorted(LOGS.glob("behaviour_*.mcap"))]
    found: dict[str, object] = {
        path.name: {**image_to_command(path), "replay_times_real_time": replay_speed(path)} for path in paths
    }
    found["with a patch held: " + paths[0].name] = image_to_command(paths[0], HOLD)
    found["memory_mb_every_10_min"] = memory(paths[-1])
    print(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
