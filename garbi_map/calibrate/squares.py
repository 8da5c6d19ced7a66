"""The paper's target in an image: two grids of black squares, and which square is which."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.calibrate.linear import solve_camera
from garbi_map.calibrate.targets import TwoPlanes
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats


def find_two_planes(grey: NDArray[np.uint8], target: TwoPlanes) -> Floats | None:
    """Pixels (n, 2) of all points of the target, good to a pixel or two, or None where a square is not seen.

    Raises GarbiError where it is seen mirrored.
    """
    quads = _quadrilaterals(grey)
    grids: list[Floats] = []
    while len(grids) < 2:
        grid = _grow(quads, target)
        if grid is None:
            return None
        grids.append(grid)
        centres = grid.mean(axis=1)
        gone = np.linalg.norm(quads.mean(axis=1)[:, None] - centres, axis=2).min(axis=1) < 1.0
        quads = quads[~gone]
    return _assigned(grids, target)


def _quadrilaterals(grey: NDArray[np.uint8]) -> Floats:
    """Dark convex quadrilaterals (k, 4, 2), clockwise as seen."""
    import cv2

    found: list[Floats] = []
    side = min(grey.shape)
    for block in (side // 24, side // 12, side // 6):
        block = max(block | 1, 5)
        dark = cv2.adaptiveThreshold(grey, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, block, 7)
        contours, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for contour in contours:
            area = cv2.contourArea(contour)
            if area < 40:
                continue
            quad = cv2.approxPolyDP(contour, 0.06 * cv2.arcLength(contour, True), True).reshape(-1, 2).astype(float)
            if len(quad) != 4 or not cv2.isContourConvex(quad.astype(np.float32)):
                continue
            if abs(cv2.contourArea(quad.astype(np.float32)) - area) > 0.25 * area:
                continue
            a, b = quad[1] - quad[0], quad[2] - quad[0]
            quad = quad if a[0] * b[1] - a[1] * b[0] > 0 else quad[::-1]
            centre = quad.mean(axis=0)
            inside = float(grey[int(centre[1]), int(centre[0])])
            around = float(
                np.median(
                    [
                        grey[int(y), int(x)]
                        for x, y in np.clip(centre + 1.35 * (quad - centre), 0, np.array(grey.shape[::-1]) - 1)
                    ]
                )
            )
            if inside + 10 < around and not any(np.linalg.norm(centre - q.mean(axis=0)) < 3 for q in found):
                found.append(quad)
    return np.array(found).reshape(-1, 4, 2)


def _grow(quads: Floats, target: TwoPlanes) -> Floats | None:
    """A full grid (columns rows, 4, 2) px, squares row by row, in either orientation; None if there is none."""
    columns, rows = target.squares
    best: dict[tuple[int, int], int] = {}
    for seed in range(len(quads)):
        for orientation in (0, 1):
            placed = _spread(quads, seed, orientation, target)
            if placed is not None and len(placed) > len(best):
                best = placed
        if len(best) >= columns * rows:
            break
    if len(best) < columns * rows:
        return None
    x0, y0 = min(x for x, _ in best), min(y for _, y in best)
    cells = {(x - x0, y - y0): number for (x, y), number in best.items()}
    if sorted(cells) != sorted((x, y) for x in range(columns) for y in range(rows)):
        return None
    homography = _homography(quads, best, target)
    ordered = []
    for y in range(rows):
        for x in range(columns):
            ordered.append(_turned_like(quads[cells[x, y]], _mapped(homography, _square(x + x0, y + y0, target))))
    return np.array(ordered)


def _turned_like(quad: Floats, expected: Floats) -> Floats:
    """A quadrilateral beginning with the corner with which `expected` begins."""
    turned = [np.roll(quad, k, axis=0) for k in range(4)]
    return min(turned, key=lambda one: float(np.linalg.norm(one - expected, axis=1).sum()))


def _square(x: int, y: int, target: TwoPlanes) -> Floats:
    around = target.square * np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    return around + target.pitch * np.array([x, y], float)


def _spread(quads: Floats, seed: int, orientation: int, target: TwoPlanes) -> dict[tuple[int, int], int] | None:
    """Squares reached from a seed by predicting each neighbour from those placed before; None where it stops early."""
    import cv2

    columns, rows = target.squares
    centres = quads.mean(axis=1)
    placed = {(0, 0): seed}
    first = np.roll(quads[seed], orientation, axis=0)
    begin = cv2.getPerspectiveTransform(_square(0, 0, target).astype(np.float32), first.astype(np.float32))
    homography = np.asarray(begin, float)
    edge = [(0, 0)]
    while edge:
        x, y = edge.pop(0)
        for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            if cell in placed:
                continue
            wide = [c for c, _ in [*placed, cell]]
            high = [r for _, r in [*placed, cell]]
            if max(wide) - min(wide) >= columns or max(high) - min(high) >= rows:
                continue
            expected = _mapped(homography, _square(*cell, target))
            size = float(np.linalg.norm(expected - expected.mean(axis=0), axis=1).mean())
            apart = np.linalg.norm(centres - expected.mean(axis=0), axis=1)
            nearest = int(np.argmin(apart))
            own = float(np.linalg.norm(quads[nearest] - centres[nearest], axis=1).mean())
            if apart[nearest] < 0.5 * size and 0.6 < own / size < 1.6 and nearest not in placed.values():
                placed[cell] = nearest
                edge.append(cell)
                homography = _homography(quads, placed, target, homography)
    return placed if len(placed) >= 3 else None


def _homography(
    quads: Floats, placed: dict[tuple[int, int], int], target: TwoPlanes, rough: Floats | None = None
) -> Floats:
    """Target plane to image, from the squares' centres, or from the corners of few squares."""
    import cv2

    world = np.concatenate([_square(*cell, target).mean(axis=0, keepdims=True) for cell in placed])
    image = quads[list(placed.values())].mean(axis=1)
    if rough is not None and (len(placed) < 6 or min(np.ptp(world, axis=0)) < 0.5 * target.pitch):
        corners = [_square(*cell, target) for cell in placed]
        world = np.concatenate(corners)
        image = np.concatenate(
            [_turned_like(quads[n], _mapped(rough, c)) for n, c in zip(placed.values(), corners, strict=True)]
        )
    found, _ = cv2.findHomography(world, image)
    return np.asarray(found if found is not None else rough, float)


def _mapped(homography: Floats, xy: Floats) -> Floats:
    there = np.column_stack([xy, np.ones(len(xy))]) @ homography.T
    return np.asarray(there[:, :2] / there[:, 2:])


def _assigned(grids: list[Floats], target: TwoPlanes) -> Floats:
    """Which grid is which plane, and which way round: what the linear camera solve explains best.

    A target that looks the same after half a turn has two answers; the one that is more upright is taken.
    """
    answers = []
    mirrored = np.inf
    for order in ((0, 1), (1, 0)):
        for first in (1, -1):
            for second in (1, -1):
                pixel = np.concatenate([_half_turned(grids[order[0]], first), _half_turned(grids[order[1]], second)])
                try:
                    camera = solve_camera(target.points, pixel)
                except GarbiError:
                    mirrored = min(mirrored, _misfit_mirrored(target.points, pixel))
                    continue
                here = camera.rotation.apply(target.points) + camera.translation
                seen = here[:, :2] / here[:, 2:] * [camera.alpha_u, camera.alpha_v] + [camera.u0, camera.v0]
                misfit = float(np.sqrt(((seen - pixel) ** 2).mean()))
                faces = [camera.rotation.apply(face.normal) for face in target.faces]
                if all(normal[2] > -0.2 for normal in faces):
                    answers.append((misfit, -float(camera.rotation.as_matrix()[1, 1]), pixel))
    if not answers or mirrored < 0.3 * min(answer[0] for answer in answers):
        raise GarbiError("the target is seen mirrored: check its drawing, or whether the images are flipped")
    least = min(answer[0] for answer in answers)
    good = [answer for answer in answers if answer[0] < 1.5 * least + 0.1]
    return min(good, key=lambda answer: answer[1])[2]


def _half_turned(grid: Floats, way: int) -> Floats:
    return (grid if way > 0 else np.roll(grid[::-1], 2, axis=1)).reshape(-1, 2)


def _misfit_mirrored(points: Floats, pixel: Floats) -> float:
    try:
        camera = solve_camera(points * [1.0, 1.0, -1.0], pixel)
    except GarbiError:
        return float(np.inf)
    here = camera.rotation.apply(points * [1.0, 1.0, -1.0]) + camera.translation
    seen = here[:, :2] / here[:, 2:] * [camera.alpha_u, camera.alpha_v] + [camera.u0, camera.v0]
    return float(np.sqrt(((seen - pixel) ** 2).mean()))
