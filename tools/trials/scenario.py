"""The rigs and waters of the trials."""

from __future__ import annotations

from typing import Any

import numpy as np

from tools.simulator.scenario import Scenario

# A forward rig whose sheet sweeps the whole view: a wider lens than the mapping rig's, and a motor that turns farther.
FORWARD: dict[str, Any] = {
    "mount": {"xyz": (0.45, 0.0, 0.0), "down": 0.08},
    "camera": {"focal": 560.0, "exposure_range": 2.2},
    "laser": {"range": (-0.42, 0.68), "sweep": 3.0, "fan": 0.62},
}
DOWNWARD: dict[str, Any] = {"mount": {"xyz": (0.25, 0.0, -0.1)}}
# A rig for surveys: the sheet is laid across the way; straight down, or so far forward that it shows what is to come.
ACROSS: dict[str, Any] = {
    "mount": {"xyz": (0.25, 0.0, -0.1), "turn": float(np.pi / 2)},
    "camera": {"focal": 560.0, "rate": 12.5},
    "laser": {"range": (-0.2, 0.6), "sweep": 2.0, "fan": 0.6},
}
OBLIQUE: dict[str, Any] = {**ACROSS, "mount": {"xyz": (0.45, 0.0, -0.1), "turn": float(np.pi / 2), "down": 0.95}}


def open_water(seed: int, rig: dict[str, Any] = FORWARD, **more: Any) -> Scenario:
    """18 m x 18 m of ground under a vehicle that starts in the middle, heading east."""
    given: dict[str, Any] = {
        "seed": seed,
        "altitude": 1.1,
        "duration": 3600.0,
        "route": {"kind": "station"},
        "seabed": {
            "margin": 9.0,
            "cell": 0.06,
            "stones": 0.0,
            "relief": 0.04,
            "ripple_height": 0.01,
            "ripple_length": 0.5,
        },
        "sway": {"translation": 0.02, "rotation": 0.005},
        **rig,
    }
    for key, value in more.items():
        given[key] = {**given[key], **value} if isinstance(value, dict) and key in given else value
    return Scenario.model_validate(given)
