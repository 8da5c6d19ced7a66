"""A rig checked, and corrected where it has to be, from an ordinary dive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from garbi_map.calibrate.field_evidence import Finding, judge
from garbi_map.calibrate.field_joint import Joint
from garbi_map.calibrate.field_rig import RigUnknowns
from garbi_map.calibrate.field_views import UnknownScanner, load_views
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.log.records import Floats, Navigation
from garbi_map.navigate import NavigationResult, navigate
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.register import Registered, RegisterSettings
from garbi_map.register.scanner import ENCODER
from garbi_map.register.sensors import Sensors
from garbi_map.register.timing import restamped
from garbi_map.sweep import Angle
from garbi_map.sweep.store import SweepStore


@dataclass(frozen=True)
class Registration:
    """A dive whose sweeps have been placed with the rig as given: the sweeps, what the sensors said, and what was found."""

    store: SweepStore
    log: Navigation
    navigated: NavigationResult
    registered: Registered
    angle: Angle
    settings: RegisterSettings
    navigate: NavigateSettings


def find(
    dive: Registration, unknowns: RigUnknowns, progress: Callable[[str], None] = lambda _: None
) -> tuple[Finding, list[Joint]]:
    """What a dive says of its rig; and rig and motion as they fit each stretch of it, the last stretch last."""
    stamps = dive.store.stamps()
    clocks = [offset for offset in dive.registered.clocks if offset.name != ENCODER and offset.state == "applied"]
    right = restamped(dive.log, clocks)
    navigated = navigate(right, dive.navigate, stamps) if clocks else dive.navigated
    told = navigated.trajectory, navigated.inertial, navigated.attitude
    scanner = UnknownScanner(unknowns, dive.angle, dive.log.mount("rig"))
    drift = dive.settings.drift
    count = int(np.ceil((stamps[-1] - stamps[0]) * 1e-9 / drift.window))
    edges = np.linspace(stamps[0], stamps[-1], count + 1).astype(np.int64)
    solved = []
    z = _start(unknowns, dive.store.latency)
    for number, (begin, end) in enumerate(pairwise(edges)):
        progress(f"rig and motion, {number + 1} of {count}")
        views = load_views(dive.store, unknowns.rig, int(begin), int(end), drift.window_points)
        sensors = Sensors(right, *told, dive.navigate, int(views.stamp_ns[0]))
        joint = Joint.begin(scanner, sensors, drift, views, dive.registered.trajectory, z)
        joint.solve()
        z = joint.z
        solved.append(joint)
    return judge(unknowns, [joint.evidence() for joint in solved]), solved


def _start(unknowns: RigUnknowns, latency: float) -> Floats:
    """Nothing is wrong but the latency that is known of."""
    offsets = np.array([latency if name == LATENCY else 0.0 for name in unknowns.names])
    return np.linalg.solve(unknowns.root, offsets)
