"""Other ways to find a stripe, for comparison only.

Each takes an image (h, w, 3) BGR and gives columns (h,), NaN for none.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from garbi_map.stripe import StripeDetector, StripeSettings

REACH = 8
LEAST = 25.0


def paper(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The paper's: a global threshold in hue, lightness and saturation, centre of gravity per row."""
    stripe = StripeDetector(StripeSettings(method="paper")).detect(image, 0)
    u = np.full(len(image), np.nan)
    u[stripe.row] = stripe.u
    return u


def gravity(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Centre of gravity around the highest smoothed pixel, the row's median subtracted."""
    columns, window, _ = _windows(image)
    weight = np.clip(window, 0.0, None)
    return (columns * weight).sum(axis=1) / weight.sum(axis=1)


def gaussian(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Least-squares fit of height, column, width and dark level, Gauss-Newton from the centre of gravity."""
    columns, window, top = _windows(image)
    height, u, width, dark = top.copy(), gravity(image), np.full(len(image), 2.0), np.zeros(len(image))
    for _ in range(12):
        t = (columns - u[:, None]) / width[:, None]
        bell = np.exp(-0.5 * t * t)
        along = (height / width)[:, None] * t * bell
        jacobian = np.stack([bell, along, t * along, np.ones_like(t)], axis=2)
        residual = window - height[:, None] * bell - dark[:, None]
        square = np.einsum("nij,nik->njk", jacobian, jacobian) + 1e-6 * np.eye(4)
        step = np.linalg.solve(square, np.einsum("nij,ni->nj", jacobian, residual)[:, :, None])[:, :, 0]
        height += step[:, 0]
        u += np.clip(step[:, 1], -1.0, 1.0)
        width = np.clip(width + step[:, 2], 0.6, 8.0)
        dark += step[:, 3]
    return np.where(np.abs(u - columns[:, REACH]) < REACH, u, np.nan)


def steger(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Ridge of the second derivatives of the smoothed image (Steger 1998), where its line crosses each row."""
    green = image[:, :, 1].astype(np.float32)
    smooth = cv2.GaussianBlur(green, (0, 0), 1.8)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0) / 8, cv2.Sobel(smooth, cv2.CV_32F, 0, 1) / 8
    gxx, gyy = (smooth[1:-1, 2:] - 2 * smooth[1:-1, 1:-1] + smooth[1:-1, :-2]), np.zeros_like(smooth)
    gxx = np.pad(gxx, 1)
    gyy[1:-1] = smooth[2:] - 2 * smooth[1:-1] + smooth[:-2]
    gxy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1) / 4
    row = np.arange(len(image))
    column = smooth[:, 2:-2].argmax(axis=1) + 2
    xx, yy, xy = gxx[row, column], gyy[row, column], gxy[row, column]
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    nx, ny = np.cos(angle), np.sin(angle)
    swap = xx * nx**2 + 2 * xy * nx * ny + yy * ny**2 > xx * ny**2 - 2 * xy * nx * ny + yy * nx**2
    nx, ny = np.where(swap, -ny, nx), np.where(swap, nx, ny)
    bend = xx * nx**2 + 2 * xy * nx * ny + yy * ny**2
    off = -(gx[row, column] * nx + gy[row, column] * ny) / bend / nx
    return np.where(np.abs(off) < 3.0, column + off, np.nan)


def triangular(image: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Highest score of a triangular window along the row, its peak by a parabola: after the description of the
    Southampton group's open pipeline (oplab_pipeline)."""
    green = image[:, :, 1].astype(np.float32)
    window = 1.0 - np.abs(np.arange(-REACH, REACH + 1)) / (REACH + 1.0)
    score = cv2.filter2D(green, -1, window[None, :].astype(np.float32))
    row = np.arange(len(image))
    c = np.clip(score.argmax(axis=1), 1, green.shape[1] - 2)
    a, b, d = score[row, c - 1], score[row, c], score[row, c + 1]
    return c + 0.5 * (a - d) / np.minimum(a - 2 * b + d, -1e-6)


BASELINES = {
    "paper: HLS threshold, centre of gravity": paper,
    "centre of gravity, background subtracted": gravity,
    "Gaussian fit": gaussian,
    "Steger": steger,
    "triangular window (oplab)": triangular,
}


def _windows(image: NDArray[np.uint8]) -> tuple[NDArray, NDArray, NDArray]:
    """Columns (h, 2 REACH + 1), green above the row's median there, and its highest value (h,)."""
    green = image[:, :, 1].astype(np.float32)
    smooth = cv2.GaussianBlur(green, (0, 0), 1.8, sigmaY=1e-3)
    middle = np.clip(smooth.argmax(axis=1), REACH, green.shape[1] - REACH - 1)
    columns = middle[:, None] + np.arange(-REACH, REACH + 1)
    window = np.take_along_axis(green, columns, axis=1) - np.median(green, axis=1)[:, None]
    return columns.astype(float), window.astype(float), window.max(axis=1).astype(float)
