"""python -m tools.bench.behaviours [LOG]: from an image's bytes to the command, one core, decoding included; and how much
faster than real time a replay runs. CPU time of this process, so that a busy machine does not count."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np

from behaviours.feed import Intake, Sighting
from behaviours.log_feed import LogFeed
from behaviours.pilot import Pilot
from behaviours.replay import decide_all, plan_of
from garbi_map.config import Config
from garbi_map.log import open_log
from garbi_map.rig import parse_rig
from garbi_map.stripe import StripeDetector, StripeSettings
from garbi_map.stripe.decode import decode
from garbi_map.sweep import SweepSettings, laser_angle

LOGS = Path(__file__).resolve().parents[2] / "logs"


def image_to_command(path: Path) -> dict[str, float]:
    """Milliseconds per image: decode, find the stripe, triangulate, carve, decide."""
    log = open_log([path])
    rig = parse_rig(log.rig_text or "", str(path))
    readings = log.navigation()
    angle = laser_angle(readings.encoder, rig, SweepSettings())
    detector = StripeDetector(StripeSettings(), rig)
    plan = plan_of(log, None)
    intake = Intake(rig, readings.mounts, plan.behaviours.feed)
    intake.read(readings)
    pilot = Pilot(plan.behaviours, rig, intake.mount)
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
    paths = [Path(name) for name in sys.argv[1:]] or [LOGS / "sample.mcap", LOGS / "behaviour_wall.mcap"]
    found = {path.name: {**image_to_command(path), "replay_times_real_time": replay_speed(path)} for path in paths}
    print(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
