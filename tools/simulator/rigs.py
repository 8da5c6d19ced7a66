"""The rig of a dive: the file that the scenario names, or one drawn about nominal, as built by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from garbi_map.log.records import Mount
from garbi_map.rig import Rig, load_rig, parse_rig
from tools.simulator.scenario import Scenario


def make_rig(scenario: Scenario) -> Rig:
    """The true rig, which is also what the log carries."""
    if scenario.rig is not None:
        return load_rig(scenario.rig)
    rng = np.random.default_rng([scenario.seed, 3])
    camera, laser = scenario.camera, scenario.laser
    forward = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # rig <- optical frame, both as nominal
    quaternion = (Rotation.from_rotvec(rng.normal(0, 0.01, 3)) * forward).as_quat()
    focal = camera.focal * (1 + rng.normal(0, 0.01))
    tilt = rng.normal(0, laser.misalignment, 3)
    text: dict[str, Any] = {
        "camera": {
            "frame_id": "camera_optical_frame",
            "image_width": camera.width,
            "image_height": camera.height,
            "distortion_model": "plumb_bob",
            "intrinsics": {
                "alpha_u": focal,
                "alpha_v": focal * (1 + rng.normal(0, 0.004)),
                "u0": camera.width / 2 + rng.normal(0, 10.0),
                "v0": camera.height / 2 + rng.normal(0, 6.0),
            },
            "distortion": [rng.normal(-0.1, 0.02), rng.normal(0.03, 0.005), *rng.normal(0, 3e-4, 2), 0.0],
            "pose_in_rig": {"xyz": [*rng.normal(0, 0.004, 3)], "quaternion_xyzw": [*quaternion]},
        },
        "laser": {
            "joint": "laser_joint",
            "x": 0.02 + rng.normal(0, 0.004),
            "y": -laser.baseline + rng.normal(0, 0.01),
            "z": rng.normal(0, 0.005),
            "delta": tilt[0],
            "theta": tilt[1],
            "gamma": tilt[2],
            "beta": 0.02 + rng.normal(0, 0.25 * laser.misalignment),
        },
    }
    if camera.port is not None:
        normal = Rotation.from_rotvec([*rng.normal(0, 0.01, 2), 0.0]).apply([0.0, 0.0, 1.0])
        text["camera"]["port"] = {"kind": "flat", "normal": [*normal], **camera.port.model_dump()}
    if not laser.motor:
        text["laser"]["fixed_angle"] = sum(laser.range) / 2
    return parse_rig(yaml.safe_dump(_plain(text)), "the drawn rig")


def rig_mount(scenario: Scenario) -> Mount:
    """base_link <- rig."""
    turned = Rotation.from_euler("YX", [scenario.mount.down, scenario.mount.turn])
    return Mount(np.array(scenario.mount.xyz), turned.as_quat())


def _plain(value: Any) -> Any:
    """Numpy numbers as Python's, for YAML."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value
