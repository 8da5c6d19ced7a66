"""The target in an image, to a fraction of a pixel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.calibrate.squares import find_two_planes
from garbi_map.calibrate.targets import AnyTarget, AprilTags, Charuco, Checkerboard, TwoPlanes, dictionary_of
from garbi_map.calibrate.views import View
from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats

MIRRORED = "the target is seen mirrored (its upper left square is white): are the images flipped?"
SMALLEST_WINDOW, LARGEST_WINDOW = 2, 11  # px, half the side of what a corner is refined in


def detect(image: NDArray[np.uint8], target: AnyTarget, name: str) -> View | None:
    """The target in an image (h, w) or (h, w, 3), or None. Raises GarbiError where it is seen mirrored."""
    import cv2

    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)
    found = _find(grey, target)
    if found is None and isinstance(target, Charuco | AprilTags) and _find(grey[:, ::-1].copy(), target) is not None:
        raise GarbiError(f"{name}: the target is seen mirrored: are the images flipped?")
    if found is None or len(found[0]) < target.least_points:
        return None
    number, pixel = found
    return View(name, number, pixel, edge_blur(grey, pixel))


def _find(grey: NDArray[np.uint8], target: AnyTarget) -> tuple[NDArray[np.int64], Floats] | None:
    if isinstance(target, Checkerboard):
        found = _checkerboard(grey, target)
    elif isinstance(target, Charuco):
        found = _charuco(grey, target)
    elif isinstance(target, AprilTags):
        found = _apriltags(grey, target)
    else:
        found = _two_planes(grey, target)
    if found is None:
        return None
    number, pixel = found
    inside = ((pixel > 3) & (pixel < np.array(grey.shape[::-1]) - 4)).all(axis=1)
    return number[inside], pixel[inside]


def _checkerboard(grey: NDArray[np.uint8], target: Checkerboard) -> tuple[NDArray[np.int64], Floats] | None:
    import cv2

    size = target.inner_corners
    exhaustive = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    ways = (
        lambda: cv2.findChessboardCornersSB(grey, size, flags=exhaustive),
        lambda: cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE),
        lambda: cv2.findChessboardCorners(
            grey, size, flags=cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
        ),
    )
    for way in ways:
        done, corners = way()
        if done:
            pixel = refined(grey, np.asarray(corners, float).reshape(-1, 2), 0.35)
            if _alternates(grey, pixel, size):
                return np.arange(len(pixel)), _in_printed_order(grey, pixel, target)
    return None


def _alternates(grey: NDArray[np.uint8], pixel: Floats, size: tuple[int, int]) -> bool:
    """Whether the squares about every corner are dark and light in turn: a board's border looks like corners, too."""
    grid = pixel.reshape(size[1], size[0], 2)
    along, down = np.asarray(np.gradient(grid, axis=1)), np.asarray(np.gradient(grid, axis=0))
    image = grey.astype(float)
    corners = [_sampled(image, grid + 0.3 * (p * along + q * down)) for p, q in ((1, 1), (-1, -1), (1, -1), (-1, 1))]
    one = np.minimum(corners[0], corners[1]) > np.maximum(corners[2], corners[3])
    other = np.minimum(corners[2], corners[3]) > np.maximum(corners[0], corners[1])
    even = np.add.outer(np.arange(size[1]), np.arange(size[0])) % 2 == 0
    return bool(max(np.where(even, one, other).mean(), np.where(even, other, one).mean()) > 0.97)


def _in_printed_order(grey: NDArray[np.uint8], pixel: Floats, target: Checkerboard) -> Floats:
    """x to y is clockwise in an image that is not mirrored, and the first corner has a black square to its upper left,
    unless the board looks the same after half a turn.

    Raises GarbiError for a mirrored board where the target says how it is printed: with two different odd numbers of
    corners a mirror swaps black and white, but so does naming rows before columns; all other boards look the same in
    a mirror."""
    columns, rows = target.inner_corners
    grid = pixel.reshape(rows, columns, 2)
    along, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if along[0] * down[1] - along[1] * down[0] < 0:
        grid = grid[:, ::-1]
    cells = _sampled(grey.astype(float), (grid[:-1, :-1] + grid[1:, 1:]) / 2)
    even = np.add.outer(np.arange(rows - 1), np.arange(columns - 1)) % 2 == 0
    if cells[even].mean() > cells[~even].mean():
        if (columns + rows) % 2:
            grid = grid[::-1, ::-1]
        elif target.corner_is_black and columns % 2 and columns != rows:
            raise GarbiError(MIRRORED)
    return grid.reshape(-1, 2)


def _charuco(grey: NDArray[np.uint8], target: Charuco) -> tuple[NDArray[np.int64], Floats] | None:
    import cv2

    board = cv2.aruco.CharucoBoard(target.squares, target.square, target.marker, dictionary_of(target))  # type: ignore[call-overload]
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
    if ids is None or len(ids) < 4:
        return None
    number = np.asarray(ids, np.int64).ravel()
    margin = 0.5 * (1.0 - target.marker / target.square)  # up to the next marker, as a share of a square
    return number, refined(grey, np.asarray(corners, float).reshape(-1, 2), min(0.35, 0.8 * margin))


def _apriltags(grey: NDArray[np.uint8], target: AprilTags) -> tuple[NDArray[np.int64], Floats] | None:
    import cv2

    detector = cv2.aruco.ArucoDetector(dictionary_of(target))  # type: ignore[call-overload]
    corners, ids, _ = detector.detectMarkers(grey)
    if ids is None:
        return None
    tags = np.asarray(ids, np.int64).ravel()
    known = tags < target.tags[0] * target.tags[1]
    if not known.any():
        return None
    number = (4 * tags[known][:, None] + np.arange(4)).ravel()
    rough = np.asarray(corners).reshape(-1, 4, 2)[known].reshape(-1, 2)
    return number, from_edges(grey, from_edges(grey, rough, 0.07), 0.07)


def _two_planes(grey: NDArray[np.uint8], target: TwoPlanes) -> tuple[NDArray[np.int64], Floats] | None:
    rough = find_two_planes(grey, target)
    return None if rough is None else (np.arange(len(rough)), from_edges(grey, rough, 0.25))


def refined(grey: NDArray[np.uint8], rough: Floats, share: float) -> Floats:
    """Saddle points (n, 2) near rough ones, by their gradients, in windows of that share of their spacing."""
    import cv2

    half = int(np.clip(share * _spacing(rough), SMALLEST_WINDOW, LARGEST_WINDOW))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    seed = np.ascontiguousarray(rough, np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, seed, (half, half), (-1, -1), criteria), float).reshape(-1, 2)


def _spacing(pixel: Floats) -> float:
    apart = np.linalg.norm(pixel[:, None] - pixel[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(np.median(apart.min(axis=1)))


def from_edges(grey: NDArray[np.uint8], rough: Floats, share: float) -> Floats:
    """Corners (4 k, 2) of k dark quadrilaterals: where straight lines fitted to their edges cross.

    share: how far from an edge nothing else is, of the side's length.
    A convex corner is rounded by blur, and what looks for its gradients is pulled inwards; its edges are not.
    """
    image = grey.astype(float)
    quads = rough.reshape(-1, 4, 2)
    found = np.empty_like(quads)
    for k, quad in enumerate(quads):
        lines = [_edge(image, quad[i], quad[(i + 1) % 4], share) for i in range(4)]
        for i in range(4):
            cross = np.cross(lines[i - 1], lines[i])
            place = cross[:2] / cross[2] if abs(cross[2]) > 1e-12 else quad[i]
            found[k, i] = place if np.linalg.norm(place - quad[i]) < 4.0 else quad[i]
    return found.reshape(-1, 2)


def _edge(image: Floats, begin: Floats, end: Floats, share: float) -> Floats:
    """The straight line (3,) of an edge near that from begin to end, by the centroids of its gradient across."""
    length = float(np.linalg.norm(end - begin))
    along = (end - begin) / max(length, 1e-9)
    across = np.array([-along[1], along[0]])
    reach = float(np.clip(share * length, 1.5, 6.0))
    steps = np.arange(-reach, reach + 0.25, 0.5)
    places = begin + along * np.linspace(0.15, 0.85, max(int(0.7 * length), 4))[:, None] * length
    for _ in range(2):
        profile = _sampled(image, places[:, None] + steps[:, None] * across)
        slope = np.abs(np.diff(profile, axis=1))
        slope = np.maximum(slope - 0.15 * slope.max(axis=1, keepdims=True), 0.0)
        centre = (slope * (steps[:-1] + 0.25)).sum(axis=1) / np.maximum(slope.sum(axis=1), 1e-9)
        places = places + centre[:, None] * across
    good = np.ones(len(places), bool)
    for _ in range(3):  # a place may have found the edge of something else
        middle = places[good].mean(axis=0)
        direction = np.linalg.svd(places[good] - middle)[2][0]
        normal = np.array([-direction[1], direction[0]])
        off = np.abs((places - middle) @ normal)
        good = off <= 3.0 * max(float(np.median(off)), 0.02)
    return np.append(normal, -normal @ middle)


def _sampled(image: Floats, places: Floats) -> Floats:
    """Bilinear values at places (..., 2), px."""
    height, width = image.shape
    x, y = np.clip(places[..., 0], 0, width - 1.001), np.clip(places[..., 1], 0, height - 1.001)
    column, row = x.astype(int), y.astype(int)
    s, t = x - column, y - row
    upper = (1 - s) * image[row, column] + s * image[row, column + 1]
    lower = (1 - s) * image[row + 1, column] + s * image[row + 1, column + 1]
    return np.asarray((1 - t) * upper + t * lower)


def edge_blur(grey: NDArray[np.uint8], pixel: Floats) -> float:
    """1 sigma, px, of the target's edges: contrast over steepest slope, near its corners."""
    image = grey.astype(float)
    half = float(np.clip(0.4 * _spacing(pixel), 3.0, 16.0))
    turn = np.linspace(0, 2 * np.pi, max(int(2 * np.pi * half * 2), 32), endpoint=False)
    ring = pixel[:, None] + half * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    values = _sampled(image, ring)
    contrast = np.percentile(values, 90, axis=1) - np.percentile(values, 10, axis=1)
    steepest = np.abs(values - np.roll(values, 2, axis=1)).max(axis=1) / (2 * half * (turn[1] - turn[0]))
    return float(np.median(contrast / np.maximum(steepest, 1e-6)) / np.sqrt(2 * np.pi))
