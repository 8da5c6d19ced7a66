"""What is known of a dive and of its map, for the stages that come after."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from garbi_map.calibrate.map_uncertainty import MapUncertainty
from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.export import Located
from garbi_map.keys import code_key, digest_of, recording_key
from garbi_map.log import Log, Navigation, open_log
from garbi_map.navigate import NavigationResult, Trajectory
from garbi_map.register import Registered
from garbi_map.rig import Rig, load_rig, parse_rig
from garbi_map.seabed import Seabed
from garbi_map.sweep import Angle, laser_angle

Span = tuple[float | None, float | None]
"""First and last second, counted from the log's begin."""


@dataclass(eq=False)
class Dive:
    """What is known of a dive as the stages go by; each stage fills in its part."""

    paths: list[Path]
    config: Config
    log: Log
    rig: Rig
    navigation: Navigation
    span_ns: tuple[int | None, int | None] = (None, None)
    losses: list[str] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)

    @property
    def angle(self) -> Angle:
        """The laser's angle at any moment."""
        return laser_angle(self.navigation.encoder, self.rig, self.config.sweep)

    @property
    def left_out(self) -> list[str]:
        """What was in the log and is not in the map, so far: one line each, each once."""
        return list(dict.fromkeys([*self.log.losses, *self.losses]))

    @property
    def title(self) -> str:
        """As reports name it."""
        return self.paths[0].stem

    @cached_property
    def recording(self) -> str:
        """A name for the content of the log."""
        return recording_key(self.paths)

    @property
    def sweeps_key(self) -> str:
        """A name for its sweeps, which changes with everything they depend on."""
        return self._key("log", "stripe", "sweep")

    @property
    def key(self) -> str:
        """A name for its estimate, likewise."""
        return self._key("log", "stripe", "sweep", "navigate", "registration", "seabed", "database")

    def _key(self, *sections: str) -> str:
        settings = [getattr(self.config, section).model_dump_json() for section in sections]
        return digest_of(self.recording, code_key(), self.rig.to_yaml(), repr(self.span_ns), *settings)


@dataclass(frozen=True)
class Map:
    """The finished map, as the export stage wants it.

    navigated, registered   of the dive that joined last, in `map`
    seabed, path            of all dives
    accepted, rejected      points of all dives, and those left out, by reason
    located                 where on Earth `map` is
    doubt                   what the calibration and the path leave open, where it was carried into the seabed
    """

    navigated: NavigationResult
    registered: Registered
    seabed: Seabed
    path: Trajectory
    accepted: int
    rejected: dict[str, int]
    located: Located = field(default_factory=Located)
    doubt: MapUncertainty | None = None


def open_dive(paths: list[Path], config: Config, rig_path: Path | None, span: Span = (None, None)) -> Dive:
    """The log, its rig and its navigation; a rig file that is given wins over the attached one."""
    log = open_log(paths, config.log)
    if rig_path is not None:
        rig = load_rig(rig_path)
    elif log.rig_text is not None:
        rig = parse_rig(log.rig_text, f"{paths[0]}: attachment rig.yaml")
    else:
        raise GarbiError(f"{paths[0]}: the log carries no rig.yaml; give one with --rig rig.yaml")
    if log.image_count == 0:
        raise GarbiError(
            f"{paths[0]}: no images on {config.log.topics.image}; name the topic in the configuration, log.topics.image"
        )
    begin_ns, end_ns = (None if t is None else log.begin_ns + round(t * 1e9) for t in span)
    first, last = max(begin_ns or log.begin_ns, log.begin_ns), log.end_ns if end_ns is None else end_ns
    if first >= min(last, log.end_ns):
        length = (log.end_ns - log.begin_ns) * 1e-9
        raise GarbiError(f"{paths[0]}: nothing between the asked seconds; the log lasts {length:.1f} s")
    navigation = log.navigation(begin_ns, end_ns, joint=rig.laser.joint)
    return Dive(paths, config, log, rig, navigation, (begin_ns, end_ns))
