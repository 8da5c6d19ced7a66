"""Camera and laser as named numbers that a fit may hold or free."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from garbi_map.log.records import Floats
from garbi_map.rig import Camera, Laser

LENS = ("alpha_u", "alpha_v", "u0", "v0", "k1", "k2", "p1", "p2", "k3")
PANE = ("turn", "tilt", "distance", "thickness", "index_glass", "index_water")
LASER = ("x", "y", "z", "delta", "theta", "gamma", "beta")

LENS_NAMES = tuple(f"camera.{name}" for name in LENS)
PORT_NAMES = tuple(f"camera.port.{name}" for name in PANE)
LASER_NAMES = tuple(f"laser.{name}" for name in LASER)
WINDOW_NAMES = tuple(f"laser.window.{name}" for name in PANE)
LATENCY = "laser.latency"

UNITS = dict.fromkeys(("alpha_u", "alpha_v", "u0", "v0"), "px")
UNITS |= dict.fromkeys(("x", "y", "z", "distance", "thickness"), "m")
UNITS |= dict.fromkeys(("turn", "tilt", "delta", "theta", "gamma", "beta"), "rad") | {"latency": "s"}


def unit_of(name: str) -> str:
    """Unit of a parameter; empty for a plain number."""
    return UNITS.get(name.rsplit(".", 1)[-1], "")


@dataclass(frozen=True)
class Scanner:
    """What is calibrated.

    Names: camera.alpha_u ... camera.k3; camera.port.turn, .tilt (rad, from its normal as it was), .distance ...;
    laser.x ... laser.beta; laser.window.turn ...; laser.latency (s, by which the encoder's stamps are late).
    """

    camera: Camera
    laser: Laser | None = None
    latency: float = 0.0

    def values(self) -> dict[str, float]:
        """Every parameter that there is, by name; turn and tilt are zero."""
        camera, laser = self.camera, self.laser
        lens = (camera.alpha_u, camera.alpha_v, camera.u0, camera.v0, *camera.distortion)
        found = dict(zip(LENS_NAMES, lens, strict=True))
        if camera.port is not None:
            found |= {name: _pane(camera.port, name) for name in PORT_NAMES}
        if laser is not None:
            found |= {f"laser.{name}": float(getattr(laser, name)) for name in LASER}
            found[LATENCY] = self.latency
            if laser.window is not None:
                found |= {name: _pane(laser.window, name) for name in WINDOW_NAMES}
        return found

    def changed(self, values: Mapping[str, float]) -> Scanner:
        """With other values for some names."""
        new = self.values() | dict(values)
        camera, laser = self.camera, self.laser
        lens = {name: float(new[f"camera.{name}"]) for name in LENS[:4]}
        distortion = tuple(float(new[f"camera.{name}"]) for name in LENS[4:])
        port = camera.port
        if port is not None:
            port = replace(port, **_panes(port.normal, new, "camera.port."))
        camera = replace(camera, **lens, distortion=distortion, port=port)  # type: ignore[arg-type]
        if laser is not None:
            window = laser.window
            if window is not None:
                window = replace(window, **_panes(window.normal, new, "laser.window."))
            sheet: dict[str, Any] = {name: float(new[f"laser.{name}"]) for name in LASER}
            laser = replace(laser, **sheet, window=window)
        return Scanner(camera, laser, float(new.get(LATENCY, 0.0)))


def _pane(pane: object, name: str) -> float:
    return float(getattr(pane, name.rsplit(".", 1)[1], 0.0))


def _panes(normal: tuple[float, float, float], new: Mapping[str, float], prefix: str) -> dict[str, Any]:
    entries: dict[str, Any] = {name: float(new[prefix + name]) for name in PANE[2:]}
    first, second = across(np.array(normal))
    turned = np.array(normal) + new[prefix + "turn"] * first + new[prefix + "tilt"] * second
    entries["normal"] = tuple((turned / np.linalg.norm(turned)).tolist())
    return entries


def across(normal: Floats) -> tuple[Floats, Floats]:
    """Two unit directions at right angles to a unit normal (3,) and to each other."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)
