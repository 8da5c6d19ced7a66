"""The two calibrations from files to files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from garbi_map.calibrate import files
from garbi_map.calibrate.advice import camera_advice, laser_advice
from garbi_map.calibrate.camera import CameraCalibration, calibrate_camera
from garbi_map.calibrate.laser import LaserCalibration, calibrate_laser
from garbi_map.calibrate.observe import images_of_files, images_of_log, pictures_of, sweeps_of
from garbi_map.calibrate.report import write_camera_report, write_laser_report
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.sheet_test import SheetAt, sheets_of
from garbi_map.calibrate.targets import load_target
from garbi_map.config import load_config
from garbi_map.errors import GarbiError
from garbi_map.log import open_log


def camera(
    source: Sequence[Path],
    target_file: Path,
    output: Path,
    rig: Path | None = None,
    camera_info: Path | None = None,
    free: Sequence[str] | None = None,
    info_output: Path | None = None,
    report: Path | None = None,
    config_file: Path | None = None,
) -> tuple[CameraCalibration, list[str], list[str]]:
    """Calibrate a camera and write its rig file; returns it with what was left out, and advice. Raises GarbiError."""
    config = load_config(config_file)
    settings, target = config.calibrate, load_target(target_file)
    known = None if rig is None else files.read_known(rig)
    start = files.read_camera_info(camera_info) if camera_info is not None else known.camera if known else None
    losses: list[str] = []
    logs = [path for path in source if path.suffix == ".mcap" or (path / "metadata.yaml").exists()]
    if logs:
        log = open_log(logs, config.log)
        pictures = pictures_of(images_of_log(log, 2 * settings.most_views), target, settings)
        losses += log.losses
    else:
        pictures = pictures_of(images_of_files(source, losses), target, settings)
    if start is not None and (start.width, start.height) != pictures.size:
        raise GarbiError(
            f"the images have {pictures.size[0]} x {pictures.size[1]} pixels, "
            f"the camera to begin with {start.width} x {start.height}"
        )
    found = calibrate_camera(pictures.views, target, pictures.size, settings, start, free or None)
    advice = camera_advice(found)
    text = files.camera_document(found, known)
    if report is not None:
        write_camera_report(report, found, [*losses, *pictures.losses], advice)
    if info_output is not None:
        files.write_camera_info(info_output, found.camera)
    files.write_aside(output, text.encode())
    return found, [*losses, *pictures.losses], advice


def laser(
    log_file: Path,
    target_file: Path,
    rig: Path,
    output: Path,
    free: Sequence[str] = (),
    method: str = "refined",
    motor: bool = True,
    report: Path | None = None,
    config_file: Path | None = None,
) -> tuple[LaserCalibration, list[SheetAt], list[str], list[str]]:
    """Calibrate a laser and write the rig file; returns it with what shape its sheet has, what was left out, and
    advice. Raises GarbiError."""
    config = load_config(config_file)
    methods = get_args(CalibrateSettings.model_fields["method"].annotation)
    if method not in methods:
        raise GarbiError(f"method {method}: there are {', '.join(methods)}")
    settings = config.calibrate.model_copy(update={"method": method})
    target = load_target(target_file)
    known = files.read_known(rig)
    log = open_log([log_file], config.log)
    angle = None if known.laser is None else known.laser.fixed_angle
    angle = 0.0 if angle is None and not motor else angle
    sweeps = sweeps_of(log, known.camera, target, settings, config.stripe, config.sweep, angle)
    found = calibrate_laser(
        known.camera,
        sweeps.views,
        sweeps.stripes,
        target,
        settings,
        known.laser,
        sweeps.motor,
        free,
        known.prior if method == "refined" else None,
    )
    sheets = sheets_of(found)
    advice = laser_advice(found, sheets, settings)
    losses = [*log.losses, *sweeps.losses]
    text = files.laser_document(found, known)
    if report is not None:
        write_laser_report(report, found, sheets, losses, advice)
    files.write_aside(output, text.encode())
    return found, sheets, losses, advice
