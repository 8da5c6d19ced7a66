"""Levenberg-Marquardt on normal equations, with weights that may be robust."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg
from scipy.sparse import csr_array, diags_array

from garbi_map.log.records import Floats

HUBER = 1.5  # sigma, beyond which a residual counts linearly
STEPS = 60
SETTLED = 1e-9  # of the cost
ROUGHLY = 1e-4  # of the robust cost, which only tells outliers from the rest


def minimise(
    evaluate: Callable[[Floats], Floats],
    jacobian: Callable[[Floats], csr_array],
    start: Floats,
    robust: bool = False,
    trusted: int = 0,
) -> Floats:
    """x that minimises the squares of the residuals evaluate(x) (n,), in sigmas.

    robust: Huber's cost instead, but for the last `trusted` residuals, which are priors.
    jacobian(x) (n, k), sparse. Returns the best x that was reached.
    """
    x, damping = np.array(start, float), 1e-4
    residual = evaluate(x)
    cost = _cost(residual, robust, trusted)
    for _ in range(STEPS):
        slope = jacobian(x)
        weight = np.ones_like(residual)
        if robust:
            doubted = np.abs(residual[: len(residual) - trusted])
            weight[: len(doubted)] = np.minimum(1.0, HUBER / np.maximum(doubted, 1e-12))
        normal = (slope.T @ diags_array(weight) @ slope).toarray()
        right = slope.T @ (weight * residual)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        scaled = normal / scale[:, None] / scale
        improved = False
        for _ in range(12):
            step = -scipy.linalg.solve(scaled + damping * np.eye(len(x)), right / scale, assume_a="pos") / scale
            residual_new = evaluate(x + step)
            cost_new = _cost(residual_new, robust, trusted)
            if cost_new < cost:
                improved = True
                break
            damping *= 10.0
        if not improved:
            break
        gain = cost - cost_new
        x, residual, cost = x + step, residual_new, cost_new
        damping = max(0.1 * damping, 1e-12)
        if gain <= (ROUGHLY if robust else SETTLED) * cost:
            break
    return x


def covariance_of(slope: csr_array) -> Floats:
    """Inverse (k, k) of the normal equations of slope (n, k), sigmas; infinite where nothing determines a parameter."""
    normal = (slope.T @ slope).toarray()
    scale = np.sqrt(np.diag(normal))
    free = scale > 0
    covariance = np.diag(np.where(free, 0.0, np.inf))
    scaled = normal[np.ix_(free, free)] / scale[free][:, None] / scale[free]
    values, vectors = np.linalg.eigh(scaled)
    inverse = (vectors / np.maximum(values, 1e-15)) @ vectors.T
    covariance[np.ix_(free, free)] = inverse / scale[free][:, None] / scale[free]
    return covariance


def _cost(residual: Floats, robust: bool, trusted: int) -> float:
    if not robust:
        return float(residual @ residual)
    doubted, prior = np.split(np.abs(residual), [len(residual) - trusted])
    huber = np.where(doubted <= HUBER, doubted**2, 2 * HUBER * doubted - HUBER**2)
    return float(huber.sum() + prior @ prior)
