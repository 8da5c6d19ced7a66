"""Targets before a rig, as numbers: where corners and stripe are in the image, with or without noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.bundle import Poses, StripePoints
from garbi_map.calibrate.targets import AnyTarget, Face, parse_target
from garbi_map.calibrate.views import View
from garbi_map.rig import Camera, Rig

CHECKERBOARD = "kind: checkerboard\ninner_corners: [9, 6]\nsquare: 0.06\nborder: 0.05\n"
GOLDEN = 2.399963  # rad, between one pose's place in the image and the next's
MARGIN = 4.0  # px, of a whole target from the border
TWO_PLANES = """
kind: two_planes
squares: [5, 4]
square: 0.04
pitch: 0.07
planes:
  - {origin: [-0.36, -0.16, 0.0], u: [1, 0, 0], v: [0, 1, 0]}
  - {origin: [0.0, -0.16, -0.04], u: [0, 0, -1], v: [0, 1, 0]}
"""


class Scene(Protocol):
    """Flat faces that a stripe may fall on; border as a target's, m."""

    @property
    def faces(self) -> list[Face]:
        """Its faces."""
        ...

    @property
    def border(self) -> float:
        """How far they reach beyond their size, m."""
        ...


def target_of(text: str = CHECKERBOARD) -> AnyTarget:
    """The target of a YAML text."""
    return parse_target(text, "target.yaml")


def poses_before(
    distances: list[float], rng: np.random.Generator, tilt: float = 0.45, centre: tuple[float, float] = (0.24, 0.15)
) -> Poses:
    """A flat target in front of the camera at these distances, m, tilted both ways and moved about the image."""
    rotation = Rotation.from_rotvec(
        np.column_stack([rng.uniform(-tilt, tilt, (len(distances), 2)), rng.uniform(-0.2, 0.2, len(distances))])
    )
    shift = np.column_stack([rng.uniform(-0.15, 0.15, (len(distances), 2)) * np.array(distances)[:, None], distances])
    return Poses(rotation, shift - rotation.apply([*centre, 0.0]))


def poses_across(
    camera: Camera, target: AnyTarget, distances: Sequence[float], rng: np.random.Generator, tilt: float = 0.45
) -> Poses:
    """A flat target shown as the calibration asks for: whole, tilted both ways, and moved up to the image's border, to
    another part of it at each pose; farther away than asked (m) where it would not fit."""
    face = target.faces[0]
    outline = face.at(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) * face.size)
    count = len(distances)
    turns = np.column_stack([rng.uniform(-tilt, tilt, (count, 2)), rng.uniform(-0.2, 0.2, count)])
    rotation = Rotation.from_rotvec(turns)
    first = rng.uniform(0, 2 * np.pi)
    translation = np.empty((count, 3))
    for i, distance in enumerate(distances):
        corners = rotation[i].apply(outline - outline.mean(axis=0))

        def whole(place: np.ndarray, corners: np.ndarray = corners) -> bool:
            pixel = camera.project(corners + place)
            return bool(((pixel > MARGIN) & (pixel < np.array([camera.width, camera.height]) - MARGIN)).all())

        middle = np.array([0.0, 0.0, distance])
        while not whole(middle):
            middle *= 1.02
        towards = first + GOLDEN * i
        shift = middle[2] * np.array([np.cos(towards), 0.75 * np.sin(towards), 0.0])
        low, high = 0.0, 1.0
        for _ in range(20):
            share = (low + high) / 2
            low, high = (share, high) if whole(middle + share * shift) else (low, share)
        translation[i] = middle + low * shift - rotation[i].apply(outline.mean(axis=0))
    return Poses(rotation, translation)


def views_of(rig: Rig, target: AnyTarget, poses: Poses, noise: float, rng: np.random.Generator) -> list[View]:
    """All corners that fall into the image."""
    views = []
    for i, place in enumerate(poses.translation):
        pixel = rig.camera.project(poses.rotation[i].apply(target.points) + place)
        pixel = pixel + noise * rng.normal(size=pixel.shape)
        inside = ((pixel > 2) & (pixel < [rig.camera.width - 3, rig.camera.height - 3])).all(axis=1)
        views.append(View(f"view {i}", np.flatnonzero(inside), pixel[inside]))
    return views


def stripes_of(
    rig: Rig,
    target: Scene,
    poses: Poses,
    alphas: np.ndarray,
    noise: float,
    rng: np.random.Generator,
    step: int = 24,
) -> StripePoints:
    """The stripe on the target's faces, every `step` rows, where rays, faces and sheet meet; found by bisection."""
    parts = []
    image = 0
    rows = np.arange(4.0, rig.camera.height - 4, step)
    columns = np.linspace(0.0, rig.camera.width - 1, 49)
    for view, place in enumerate(poses.translation):
        turned = poses.rotation[view]
        for turn, alpha in enumerate(alphas):
            for face in target.faces:
                normal, origin = turned.apply(face.normal), turned.apply(face.origin) + place

                def off(  # type: ignore[no-untyped-def]
                    u, v, normal=normal, origin=origin, alpha=alpha
                ):
                    eye, sight = rig.camera.rays(u, v)
                    reach = ((origin - eye) @ normal) / (sight @ normal)
                    there = eye + reach[:, None] * sight
                    miss = rig.laser.off_sheet(there @ rig.camera.rotation.T + rig.camera.centre, alpha)
                    return np.where(reach > 0, miss, np.nan), there

                u, v = np.meshgrid(columns, rows)
                miss = off(u.ravel(), v.ravel())[0].reshape(u.shape)
                row, column = np.nonzero(miss[:, :-1] * miss[:, 1:] < 0)
                if not len(row):
                    continue
                low, high, sign = columns[column], columns[column + 1], miss[row, column]
                for _ in range(40):
                    middle = (low + high) / 2
                    same = off(middle, rows[row])[0] * sign > 0
                    low, high = np.where(same, middle, low), np.where(same, high, middle)
                there = turned.inv().apply(off(low, rows[row])[1] - place) - face.origin
                xy = np.column_stack([there @ face.u, there @ face.v])
                on = ((xy > -target.border) & (xy < face.size + target.border)).all(axis=1)
                on &= ~_hidden(target, face, turned, place, *rig.camera.rays(low, rows[row]))
                count = int(on.sum())
                rate = 0.5 if turn % 2 else -0.5
                known = (np.full(count, view), np.full(count, image), low[on], rows[row][on], np.full(count, alpha))
                faces = (np.tile(face.origin, (count, 1)), np.tile(face.normal, (count, 1)))
                parts.append((*known, np.full(count, rate), *faces))
            image += 1
    columns_of = [np.concatenate(part) for part in zip(*parts, strict=True)]
    columns_of[2] = columns_of[2] + noise * rng.normal(size=len(columns_of[2]))
    return StripePoints(*columns_of)


def _hidden(
    target: Scene, face: Face, turned: Rotation, place: np.ndarray, eye: np.ndarray, sight: np.ndarray
) -> np.ndarray:
    """Whether (n,) another face is nearer along the lines of sight than this one."""
    own = ((turned.apply(face.origin) + place - eye) @ turned.apply(face.normal)) / (sight @ turned.apply(face.normal))
    hidden = np.zeros(len(eye), bool)
    for other in target.faces:
        if other is face:
            continue
        base, normal = turned.apply(other.origin) + place, turned.apply(other.normal)
        reach = ((base - eye) @ normal) / (sight @ normal)
        there = eye + reach[:, None] * sight - base
        xy = np.column_stack([there @ turned.apply(other.u), there @ turned.apply(other.v)])
        hidden |= (reach > 0) & (reach < own - 1e-9) & ((xy > 0) & (xy < other.size)).all(axis=1)
    return hidden
