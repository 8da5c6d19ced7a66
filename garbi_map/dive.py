"""What is known of a dive and of its map, for the stages that come after."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from garbi_map.config import Config
from garbi_map.log import Log, Navigation
from garbi_map.navigate import NavigationResult
from garbi_map.register import Registered
from garbi_map.rig import Rig
from garbi_map.seabed import Seabed, SeabedBuilder
from garbi_map.sweep import Angle, laser_angle


@dataclass
class Dive:
    """What is known of a dive as the stages go by; each stage fills in its part."""

    paths: list[Path]
    config: Config
    log: Log
    rig: Rig
    navigation: Navigation
    span_ns: tuple[int | None, int | None] = (None, None)
    losses: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)

    @property
    def angle(self) -> Angle:
        """The laser's angle at any moment."""
        return laser_angle(self.navigation.encoder, self.rig, self.config.sweep)

    @property
    def left_out(self) -> list[str]:
        """What was in the log and is not in the map, so far: one line each, each once."""
        return list(dict.fromkeys([*self.log.losses, *self.losses]))


@dataclass(frozen=True)
class Map:
    """The finished map, as the export stage wants it."""

    navigated: NavigationResult
    registered: Registered
    seabed: Seabed
    builder: SeabedBuilder
