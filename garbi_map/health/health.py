"""The health of a log on one page."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.health.clocks import Clock, check_clocks
from garbi_map.health.expected import Expected, expect
from garbi_map.health.findings import Finding
from garbi_map.health.motor import Motor, check_motor
from garbi_map.health.pictures import Pictures, check_pictures, look
from garbi_map.health.sample import STRETCHES, stretches
from garbi_map.log import Log
from garbi_map.log.check import LogCheck, check_log
from garbi_map.rig import Rig, parse_rig

ROLES = ["image", "encoder", "imu", "attitude", "pressure", "depth", "dvl", "navsat", "usbl", "odometry"]


@dataclass(frozen=True)
class Sampling:
    """How much of the log the figures rest on: stretches, of how many s each, share of the log's duration."""

    stretches: int
    length: float
    share: float


@dataclass(frozen=True)
class Health:
    """What a log holds, what is wrong with it, and what may be expected of it. remarks: what was not taken as it is."""

    log: LogCheck
    sampling: Sampling
    clocks: list[Clock]
    motor: Motor | None
    pictures: Pictures | None
    expected: Expected | None
    findings: list[Finding]
    remarks: list[str]

    def as_dict(self) -> dict[str, Any]:
        """Everything, as JSON can hold it; docs/check.md says what it means."""
        parts = {name: value for name, value in asdict(self).items() if name != "log"}
        return {"schema": 1, **self.log.as_dict(), **parts}


def check_health(
    log: Log, config: Config, rig: Rig | None = None, whole: bool | None = None, count: int = STRETCHES
) -> Health:
    """Check a log, by samples but for what its index tells; whole: read all of it for damage (None: where it is small).

    rig: instead of the attached rig file.
    """
    found = check_log(log, whole)
    findings: list[Finding] = []
    duration = max(found.duration, 1e-3)
    if rig is None and log.rig_text is not None:
        try:
            rig = parse_rig(log.rig_text, "rig.yaml")
        except GarbiError as error:
            findings.append(Finding("rig_unusable", str(error), 0.0, found.duration))
    sampled, length = stretches(log, rig.laser.joint if rig else "laser_joint", count)
    clocks, wrong = check_clocks(sampled, ROLES, log.settings.reorder)
    findings += wrong
    ranges = config.stripe.min_range, config.stripe.max_range
    motor, wrong = check_motor(sampled, rig, ranges)
    findings += wrong
    looks = look(sampled, rig, config.stripe)
    pictures, wrong = check_pictures(looks, rig)
    findings += wrong
    rate = next((topic.rate for topic in found.topics if topic.role == "image"), 0.0)
    expected = expect(sampled, looks, rig, motor, rate, found.duration, config.stripe)
    sampling = Sampling(len(sampled), length, min(len(sampled) * length / duration, 1.0))
    return Health(found, sampling, clocks, motor, pictures, expected, findings, log.remarks)
