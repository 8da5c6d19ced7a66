"""Real images and points: what the calibration says about them, held out where it can be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.bundle import Poses, StripePoints
from garbi_map.calibrate.camera import calibrate_camera
from garbi_map.calibrate.laser import calibrate_laser, off_plane
from garbi_map.calibrate.observe import images_of_files, joined, on_target, pictures_of
from garbi_map.calibrate.scanner import Scanner
from garbi_map.calibrate.settings import CalibrateSettings
from garbi_map.calibrate.sheet_models import compare_sheets, fit_plane
from garbi_map.calibrate.targets import parse_target
from garbi_map.config import Config
from garbi_map.log.records import Floats
from garbi_map.rig import Rig
from garbi_map.stripe import Stripe, StripeDetector

Row = tuple[str, str]
ETNA_BOARD = "kind: checkerboard\ninner_corners: [7, 6]\nsquare: 0.01\nborder: 0.06\n"
B33BOY_BOARD = "kind: checkerboard\ninner_corners: [9, 7]\nsquare: 0.02\n"


def rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def etna(folder: Path) -> list[Row]:
    """Camera and plane of calib3's sixteen images, and the arm's chain of poses."""
    settings, target = CalibrateSettings(), parse_target(ETNA_BOARD, "etna")
    pictures = pictures_of(images_of_files([folder / "calib3"], []), target, settings)
    found = calibrate_camera(pictures.views, target, pictures.size, settings)
    camera, poses = found.camera, found.adjusted.poses
    detector = StripeDetector(Config().stripe.model_copy(update={"laser": "mono", "largest_step": 6.0}))
    parts: list[StripePoints] = []
    for i, (_, image) in enumerate(images_of_files([folder / "calib3"], [])):
        pose = Poses(poses.rotation[[i]], poses.translation[[i]])
        points = on_target(detector.detect(image, 0), camera, pose, target, 0.0, 0.0, (i, i), settings.least_stripe)
        if points is not None:
            parts.append(points.part(np.arange(0, len(points.u), 4)))
    stripes = joined(parts)
    loose = settings.model_copy(update={"ranges": (0.2, 0.3), "max_stripe_noise": 10.0})
    learn = stripes.view % 2 == 0
    views = pictures.views[0::2]
    half = replace(stripes.part(learn), view=stripes.view[learn] // 2)
    laser = calibrate_laser(camera, views, half, target, loose, motor=False)
    scanner = Scanner(camera, laser.laser)
    inside = off_plane(scanner, poses, stripes.part(learn))
    outside = off_plane(scanner, poses, stripes.part(~learn))
    return [
        (
            "etna, camera",
            f"{len(views) * 2} views: {found.in_sample:.2f} px rms per corner in sample "
            f"({found.in_sample / np.sqrt(2):.2f} per coordinate), {found.hold_out:.2f} held out "
            f"({found.hold_out / np.sqrt(2):.2f} per coordinate)",
        ),
        (
            "etna, laser plane from half of the images",
            f"{1e3 * rms(inside):.3f} mm rms on that half, {1e3 * rms(outside):.3f} on the other "
            f"(median {1e3 * float(np.median(np.abs(outside))):.3f})",
        ),
        ("etna, the arm's chain of poses", _arm(folder / "calib3", poses, stripes, Rig(camera, laser.laser))),
    ]


def _arm(folder: Path, poses: Poses, stripes: StripePoints, rig: Rig) -> str:
    """Hand-eye from even images; then the board's plane, in the arm's base, as odd images' stripes measure it."""
    turn, place = [], []
    for file in sorted(folder.glob("pose*.txt")):
        values = [
            float(value) for value in file.read_text().replace("(", " ").replace(")", " ").replace(",", " ").split()
        ]
        place.append(values[:3])
        turn.append(Rotation.from_quat(values[3:7]))
    even = list(range(0, len(place), 2))
    mount, shift = hand_eye([turn[i] for i in even], [np.array(place[i]) for i in even], poses, even)

    def in_base(i: int, points: Floats) -> Floats:
        return np.asarray(turn[i].apply(mount.apply(points) + shift) + place[i])

    centres = np.array([in_base(i, poses.translation[[i]])[0] for i in range(len(place))])
    normals = np.array([turn[i].apply(mount.apply(poses.rotation[i].apply([0.0, 0.0, 1.0]))) for i in even])
    normal = normals.mean(axis=0) / np.linalg.norm(normals.mean(axis=0))
    offset = float((centres[even] @ normal).mean())
    off = []
    for i in range(1, len(place), 2):
        mine = stripes.view == i
        points = rig.triangulate(stripes.u[mine], stripes.v[mine], rig.laser.fixed_angle or 0.0).points
        points = (points - rig.camera.centre) @ rig.camera.rotation
        off.append(in_base(i, points[np.isfinite(points).all(axis=1)]) @ normal - offset)
    spread = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
    return (
        f"board's origin in the base scatters by {1e3 * rms(spread):.2f} mm; stripes of unseen images, by laser and "
        f"arm alone, lie {1e3 * rms(np.concatenate(off)):.2f} mm rms off the board"
    )


def hand_eye(turn: list[Rotation], place: list[Floats], poses: Poses, which: list[int]) -> tuple[Rotation, Floats]:
    """tool <- camera from the arm's poses and the board's, by relative motions (Park and Martin, 1994)."""
    rotations, motions = [], []
    for a in range(len(which)):
        for b in range(a):
            arm = turn[a].inv() * turn[b]
            eye = poses.rotation[which[a]] * poses.rotation[which[b]].inv()
            shift = poses.translation[which[a]] - eye.apply(poses.translation[which[b]])
            rotations.append((arm.as_rotvec(), eye.as_rotvec()))
            motions.append((arm.as_matrix(), turn[a].inv().apply(place[b] - place[a]), shift))
    first, second = (np.array(side) for side in zip(*rotations, strict=True))
    mount = Rotation.align_vectors(first, second)[0]
    left = np.concatenate([arm - np.eye(3) for arm, _, _ in motions])
    right = np.concatenate([mount.apply(shift) - moved for _, moved, shift in motions])
    return mount, np.linalg.lstsq(left, right, rcond=None)[0]


def turbot_points(folder: Path) -> tuple[Floats, NDArray[np.int64]]:
    """Points (n, 3) m on the sheet, and the number (n,) of their segment."""
    storage = cv2.FileStorage(str(folder / "turbot_calibration.yaml"), cv2.FILE_STORAGE_READ)
    points = np.asarray(storage.getNode("points").mat(), float)
    return points, np.concatenate([[0], np.cumsum(np.diff(points[:, 0]) < -0.05)])


def turbot(folder: Path) -> list[Row]:
    """Plane or cone, on the points of 23 segments."""
    test = compare_sheets(*turbot_points(folder))
    return [("turbot, which sheet", f"{test.supported}; {test.evidence}")]


def straight(stripe: Stripe) -> tuple[Floats, Floats]:
    """u, v (20,) px of the straight line that most of a stripe lies on: a wall is flat, what is above it is not."""
    row, u = stripe.row.astype(float), stripe.u.astype(float)
    good = np.ones(len(row), bool)
    line = np.zeros(2)
    for _ in range(5):
        line = np.polyfit(row[good], u[good], 1)
        off = np.abs(u - np.polyval(line, row))
        good = off < 4.5 * max(float(np.median(off[good])), 0.2)
    low, high = np.percentile(row[good], [5, 95])
    rows = np.linspace(float(low), float(high), 20, dtype=float)
    return np.asarray(np.polyval(line, rows), float), rows


def b33boy(folder: Path) -> list[Row]:
    """Camera from the chessboard; the sheet from every second wall, whose stated distances give it its scale."""
    settings, target = CalibrateSettings(), parse_target(B33BOY_BOARD, "b33boy")
    pictures = pictures_of(images_of_files([folder / "chessboard"], []), target, settings)
    found = calibrate_camera(pictures.views, target, pictures.size, settings)
    camera = found.camera
    detector = StripeDetector(Config().stripe.model_copy(update={"laser": "red"}))
    walls: list[tuple[float, Floats]] = []
    for name, image in images_of_files([folder / "distance"], []):
        u, v = straight(detector.detect(image, 0))
        walls.append((float(name.split("_")[2].removesuffix("cm.png")) / 100, camera.rays(u, v)[1]))
    learnt, tested = walls[0::2], walls[1::2]

    def plane_with(offset: float) -> tuple[Floats, Floats]:
        """The sheet if walls were `offset` farther than stated, and how far (n,) m its points are off the walls."""
        points = []
        for distance, direction in learnt:
            points.append(direction / direction[:, 2:] * (distance + offset))
        plane = fit_plane(np.concatenate(points))
        sights = np.concatenate([part / np.linalg.norm(part, axis=1, keepdims=True) for part in points])
        depth = plane[3] / (sights @ plane[:3]) * sights[:, 2]
        return plane, depth - np.concatenate(points)[:, 2]

    offset = float(minimize_scalar(lambda x: rms(plane_with(x)[1]), bounds=(-0.1, 0.4), method="bounded").x)
    plane = plane_with(offset)[0]
    off = []
    for distance, direction in tested:
        depth = plane[3] / (direction @ plane[:3]) * direction[:, 2]
        off.append(1e3 * (float(np.median(depth)) - distance - offset))
    stated = ", ".join(f"{100 * d:.0f} cm {error:+.1f}" for (d, _), error in zip(tested, off, strict=True))
    return [
        (
            "b33boy, walls that were not used",
            f"{rms(np.array(off)):.2f} mm rms ({stated} mm), stated from {1e3 * offset:.0f} mm before the pinhole; "
            f"camera {found.in_sample:.2f} px rms per corner in sample, "
            f"{found.hold_out:.2f} held out",
        )
    ]
