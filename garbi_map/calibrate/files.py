"""Rig files and camera_info files, in and out, with what a calibration knows about itself."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from garbi_map.calibrate.bundle import Prior
from garbi_map.calibrate.camera import FORWARD, CameraCalibration
from garbi_map.calibrate.field_evidence import Finding
from garbi_map.calibrate.laser import LaserCalibration
from garbi_map.calibrate.scanner import LATENCY, LENS_NAMES, PORT_NAMES, Scanner
from garbi_map.errors import GarbiError
from garbi_map.plain_yaml import parse_yaml, read_text, read_yaml
from garbi_map.rig import Camera, Laser, Rig, camera_entries, laser_entries, parse_camera, parse_laser, parse_rig

NOMINAL = "nominal_laser"  # a laser that is not calibrated with this camera: no program takes it for one


@dataclass(frozen=True)
class Known:
    """What a rig file holds before a calibration: camera, nominal laser, the camera's covariance, and all of it."""

    camera: Camera
    laser: Laser | None
    prior: Prior | None
    document: dict[str, Any]


def read_known(path: Path) -> Known:
    """A rig file whose laser may be missing. Raises GarbiError for what is missing or absurd."""
    text = read_text(path)
    camera = parse_camera(text, str(path))
    document: dict[str, Any] = parse_yaml(text, str(path))
    key = next((key for key in ("laser", NOMINAL) if document.get(key) is not None), None)
    laser = None if key is None else parse_laser(text, str(path), key)
    return Known(camera, laser, _prior(camera, document["camera"].get("calibration"), path), document)


def _prior(camera: Camera, entries: Any, path: Path) -> Prior | None:
    if not isinstance(entries, dict) or not entries.get("free"):
        return None
    names = tuple(str(name) for name in entries["free"])
    try:
        covariance = np.array(entries["covariance"], float)
        sound = covariance.shape == (len(names),) * 2 and float(np.linalg.eigvalsh(covariance).min()) > 0
    except (KeyError, TypeError, ValueError, np.linalg.LinAlgError):
        sound = False
    if not sound or any(name not in LENS_NAMES + PORT_NAMES for name in names):
        raise GarbiError(
            f"{path}: camera.calibration.covariance is not that of the parameters in camera.calibration.free"
        )
    values = Scanner(camera).values()
    return Prior(names, np.array([values[name] for name in names]), covariance)


def camera_document(found: CameraCalibration, known: Known | None) -> str:
    """A rig file's text with a new camera. A laser that it held is nominal from now on: calibrate it next."""
    document = {} if known is None else dict(known.document)
    laser = document.pop("laser", None)
    if laser is not None:
        laser.pop("calibration", None)
        document[NOMINAL] = laser
    kept = {key: value for key, value in document.get("camera", {}).items() if key not in ("calibration", "port")}
    entries = {
        "date": _now(),
        "views": len(found.views),
        "corners": int(found.adjusted.corner_good.sum()),
        "left_out": int((~found.adjusted.corner_good).sum()),
        "rms_px": found.in_sample,
        "hold_out_px": found.hold_out,
        **_covariance(found.adjusted.free, found.adjusted.own_covariance),
    }
    section = kept | camera_entries(found.camera) | {"calibration": entries}
    return dump({"camera": section} | {key: value for key, value in document.items() if key != "camera"})


def laser_document(found: LaserCalibration, known: Known) -> str:
    """A rig file's text with a new laser, and the camera as it moved within its covariance. Raises GarbiError."""
    document = {key: value for key, value in known.document.items() if key != NOMINAL}
    before = document.get("laser") or known.document.get(NOMINAL) or {}
    kept = {key: value for key, value in before.items() if key not in ("calibration", "window")}
    entries = {
        "date": _now(),
        "poses_of_target": len(found.views),
        "distances_m": [float(value) for value in found.distances],
        "points": int(found.adjusted.stripe_good.sum()),
        "left_out": int((~found.adjusted.stripe_good).sum()),
        "rms_m": found.rms,
        "hold_out_m": found.hold_out,
        "hold_out_px": found.hold_out_px,
        "encoder_latency_s": found.scanner.latency,
        "sigma_m_at_depth": {f"{spread.depth:g}": spread.rms for spread in found.spreads},
        **_covariance(found.adjusted.free, found.adjusted.own_covariance),
    }
    laser = kept | laser_entries(found.laser) | {"calibration": entries}
    camera = known.document["camera"] | camera_entries(found.scanner.camera)
    text = dump(
        {"camera": camera, "laser": laser} | {k: v for k, v in document.items() if k not in ("camera", "laser")}
    )
    parse_rig(text, "the calibrated rig")
    return text


def field_document(found: Finding, rig: Rig, log: str) -> str:
    """A rig file's text after a dive: corrected where that is offered, else with the values that it had."""
    corrected = found.unknowns.at(found.applied)
    document: dict[str, Any] = parse_yaml(corrected.to_yaml(), "the corrected rig")
    entries = {
        "date": _now(),
        "method": "field",
        "log": log,
        "corrected": dict(found.corrections),
        "held_out_m": {"given": found.held_out[0], "corrected": found.held_out[1]},
        "encoder_latency_s": float(found.estimate[found.unknowns.names.index(LATENCY)])
        if LATENCY in found.unknowns.names
        else 0.0,
        **_covariance(found.unknowns.names, found.covariance),
    }
    if found.corrections:
        document["laser"]["calibration"] = entries
    else:
        document["laser"]["field_check"] = entries
    text = dump(document)
    parse_rig(text, "the corrected rig")
    return text


def _covariance(names: tuple[str, ...], covariance: Any) -> dict[str, Any]:
    sigma = np.sqrt(np.diag(covariance)) if len(names) else np.empty(0)
    return {
        "free": list(names),
        "sigma": dict(zip(names, sigma, strict=True)),
        "covariance": np.asarray(covariance).tolist(),
    }


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def dump(document: dict[str, Any]) -> str:
    """YAML of plain numbers, in the order of the keys."""
    return yaml.safe_dump(_plain(document), sort_keys=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value.item() if isinstance(value, np.generic) else value


def read_camera_info(path: Path) -> Camera:
    """The camera of a ROS camera_info file (camera_calibration's YAML). Raises GarbiError."""
    document = read_yaml(path)
    try:
        matrix = [float(value) for value in document["camera_matrix"]["data"]]
        model = document.get("distortion_model", "plumb_bob")
        terms = [float(value) for value in document.get("distortion_coefficients", {"data": [0] * 5})["data"]]
        width, height = int(document["image_width"]), int(document["image_height"])
        name = str(document.get("camera_name", "camera_optical_frame"))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise GarbiError(f"{path}: not a camera_info file ({type(error).__name__}: {error})") from error
    if model != "plumb_bob" or len(terms) not in (4, 5) or len(matrix) != 9:
        raise GarbiError(f"{path}: distortion_model {model} with {len(terms)} terms: only plumb_bob with 5 is known")
    distortion = (*terms, 0.0)[:5]
    camera = Camera(name, width, height, matrix[0], matrix[4], matrix[2], matrix[5], distortion, (0.0,) * 3, FORWARD)  # type: ignore[arg-type]
    return parse_camera(dump({"camera": camera_entries(camera)}), str(path))


def write_camera_info(path: Path, camera: Camera) -> None:
    """Write a ROS camera_info file. A port has no place in it: raises GarbiError where there is one."""
    if camera.port is not None:
        raise GarbiError(f"{path}: camera_info cannot describe a camera behind a port; not written")
    matrix = [camera.alpha_u, 0.0, camera.u0, 0.0, camera.alpha_v, camera.v0, 0.0, 0.0, 1.0]
    projection = [*matrix[:3], 0.0, *matrix[3:6], 0.0, *matrix[6:], 0.0]
    document = {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": camera.frame_id,
        "camera_matrix": {"rows": 3, "cols": 3, "data": matrix},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": list(camera.distortion)},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": projection},
    }
    write_aside(path, dump(document).encode())


def write_aside(path: Path, data: bytes) -> None:
    """Write a file, complete or not at all. Raises GarbiError where the file system refuses."""
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with aside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        aside.replace(path)
    except OSError as error:
        raise GarbiError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        aside.unlink(missing_ok=True)
