"""A rig checked, and corrected where it has to be, from an ordinary dive: from files to a file."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from garbi_map.calibrate import files
from garbi_map.calibrate.field_evidence import Finding, judge
from garbi_map.calibrate.field_joint import Joint
from garbi_map.calibrate.field_known import Known, load_known
from garbi_map.calibrate.field_limits import refuse_dive, refuse_rig
from garbi_map.calibrate.field_rig import RigUnknowns, unknowns
from garbi_map.calibrate.field_views import UnknownScanner, load_views
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.config import load_config
from garbi_map.dive import Dive
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats, Navigation
from garbi_map.navigate import NavigationResult, navigate
from garbi_map.navigate.settings import NavigateSettings
from garbi_map.progress import Progress, Silent
from garbi_map.register import Registered, RegisterSettings, Scanner, register
from garbi_map.register.scanner import ENCODER
from garbi_map.register.sensors import Sensors
from garbi_map.register.timing import restamped
from garbi_map.rig import Rig
from garbi_map.sweep import Angle
from garbi_map.sweep.store import SweepStore


@dataclass(frozen=True)
class Registration:
    """A dive whose sweeps have been placed with the rig as given: the sweeps, what the sensors said, and what was found."""

    store: SweepStore
    log: Navigation
    navigated: NavigationResult
    registered: Registered
    rig: Rig
    angle: Angle
    settings: RegisterSettings
    navigate: NavigateSettings


def calibrate_field(
    logs: Sequence[Path],
    output: Path,
    rig_path: Path | None = None,
    focal: bool = False,
    index: bool = False,
    known_file: Path | None = None,
    span: tuple[float | None, float | None] = (None, None),
    config_file: Path | None = None,
    workers: int = 2,
    progress: Progress | None = None,
) -> tuple[Finding, list[str]]:
    """Check the rig of a dive and write it, corrected where it has to be; returns what was found, and what was left out.

    Raises GarbiError, with nothing written, where the dive cannot tell or the rig is beyond correction.
    """
    from garbi_map.pipeline import open_dive, sweeps_of

    progress = progress or Silent()
    config = load_config(config_file)
    patches = () if known_file is None else load_known(known_file)
    dive = open_dive(list(logs), config, rig_path, span)
    where = str(logs[0])
    if index and dive.rig.camera.port is None and dive.rig.laser.window is None:
        raise GarbiError(f"{rig_path or where}: neither camera.port nor laser.window: the water's index bends no ray")
    with tempfile.TemporaryDirectory(dir=output.resolve().parent, prefix=".garbi-field-") as work:
        store = sweeps_of(dive, Path(work) / "sweeps", workers, progress)
        refuse_dive(where, store, dive.navigation)
        progress.stage("registration")
        navigated = navigate(dive.navigation, config.navigate, store.stamps())
        scanner = Scanner(dive.rig, dive.angle, dive.navigation.mount("rig"))
        settings = config.registration
        registered = register(store, dive.navigation, navigated, settings, config.navigate, progress.note, scanner)
        progress.stage("rig and motion")
        sure = placed(dive, store, navigated, registered)
        motor = len(dive.angle.turns_ns) > 0
        known = Known(patches, dive.log.begin_ns)
        unknown = unknowns(dive.rig, motor, focal, index, baseline_held=not known.tells_lengths)
        found, _ = find(sure, unknown, known, progress.note)
        refuse_rig(where, registered, found)
    files.write_aside(output, files.field_document(found, dive.rig, where).encode())
    return found, dive.left_out


def placed(dive: Dive, store: SweepStore, navigated: NavigationResult, registered: Registered) -> Registration:
    """What the pipeline knows of a dive once its sweeps are registered."""
    config = dive.config
    told = store, dive.navigation, navigated, registered
    return Registration(*told, dive.rig, dive.angle, config.registration, config.navigate)


def find(
    dive: Registration,
    unknown: RigUnknowns,
    known: Known | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> tuple[Finding, list[Joint]]:
    """What a dive says of its rig; and rig and motion as they fit each stretch of it."""
    stamps = dive.store.stamps()
    count = int(np.ceil((stamps[-1] - stamps[0]) * 1e-9 / dive.settings.drift.window))
    edges = np.linspace(stamps[0], stamps[-1], count + 1).astype(np.int64)
    known = known or Known()
    known.refuse_beyond(int(edges[0]), int(edges[-1]))
    solved: list[Joint] = []
    z = _start(unknown, dive.store.latency)
    for number, (begin, end) in enumerate(pairwise(edges)):
        progress(f"stretch {number + 1} of {count}")
        joint = begin_joint(dive, unknown, int(begin), int(end), z, known)
        joint.solve()
        z = joint.z
        solved.append(joint)
    return judge(unknown, [joint.evidence() for joint in solved]), solved


def begin_joint(dive: Registration, unknown: RigUnknowns, begin_ns: int, end_ns: int, z: Floats, known: Known) -> Joint:
    """Rig and motion over a stretch of a dive, as they have been found with the rig as given, corrected by z."""
    clocks = [offset for offset in dive.registered.clocks if offset.name != ENCODER and offset.state == "applied"]
    right = restamped(dive.log, clocks)
    navigated = navigate(right, dive.navigate, dive.store.stamps()) if clocks else dive.navigated
    told = navigated.trajectory, navigated.inertial, navigated.attitude
    drift = dive.settings.drift
    views = load_views(dive.store, dive.rig, begin_ns, end_ns, drift.window_points)
    sensors = Sensors(right, *told, dive.navigate, int(views.stamp_ns[0]))
    scanner = UnknownScanner(unknown, dive.angle, dive.log.mount("rig"), dive.store.latency)
    views = scanner.surely_lit(views)
    return Joint.begin(scanner, sensors, drift, views, dive.registered.trajectory, z, known.within(begin_ns, end_ns))


def _start(unknown: RigUnknowns, latency: float) -> Floats:
    """Nothing is wrong but the latency that is known of."""
    offsets = np.array([latency if name == LATENCY else 0.0 for name in unknown.names])
    return np.linalg.solve(unknown.root, offsets)
