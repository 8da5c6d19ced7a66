"""Rauch-Tung-Striebel smoothing of the filter's nodes, in windows of bounded memory."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats
from garbi_map.navigate.eskf import Node
from garbi_map.navigate.observations import ATTITUDE, POSITION, STATES

_POSE = np.r_[POSITION, ATTITUDE]


@dataclass(frozen=True)
class Smoothed:
    """What all the data say of the error that the forward pass had at its k nodes.

    sample       (k,) index into the timebase
    error        (k, STATES) to be added to the nominal state after the node's update
    correction   (k, STATES) that update itself
    biases       (k, STATES - 9) smoothed: gyro, accelerometer, attitude topic, DVL scale
    sigma        (k, STATES) 1 sigma
    pose         (k, 6, 6) covariance of position and attitude of the IMU
    """

    sample: np.ndarray
    error: Floats
    correction: Floats
    biases: Floats
    sigma: Floats
    pose: Floats


def smooth(nodes: Iterable[Node], window: int, lag: int) -> Smoothed:
    """Smooth the nodes, `window` at a time, each window helped by the `lag` nodes after it."""
    parts: list[Smoothed] = []
    buffer: list[Node] = []
    for node in nodes:
        buffer.append(node)
        if len(buffer) == window + lag:
            parts.append(_smooth_window(buffer, window))
            buffer = buffer[window:]
    if buffer:
        parts.append(_smooth_window(buffer, len(buffer)))
    return Smoothed(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("sample", "error", "correction", "biases", "sigma", "pose")
        )
    )


def _smooth_window(nodes: list[Node], keep: int) -> Smoothed:
    """filterpy's smoother knows no reset: give it the sum of all corrections carried along by the transitions, which is
    the error against a nominal path that was never corrected; the differences are then those of the reset filter."""
    from filterpy.kalman import KalmanFilter

    filtered = np.zeros((len(nodes), STATES))
    for k in range(1, len(nodes)):
        filtered[k] = nodes[k].transition @ filtered[k - 1] + nodes[k].correction
    covariances = np.array([node.covariance for node in nodes])
    transitions = np.array([node.transition for node in nodes])
    noises = np.array([node.noise for node in nodes])
    # the method, not filterpy's function of the same name: only the method takes Fs[k] as what leads to node k
    smoother = KalmanFilter(dim_x=STATES, dim_z=1)
    means, covariances, _, _ = smoother.rts_smoother(filtered, covariances, transitions, noises)
    covariances = 0.5 * (covariances[:keep] + covariances[:keep].transpose(0, 2, 1))
    error = means[:keep] - filtered[:keep]
    return Smoothed(
        sample=np.array([node.sample for node in nodes[:keep]]),
        error=error,
        correction=np.array([node.correction for node in nodes[:keep]]),
        biases=np.array([node.biases for node in nodes[:keep]]) + error[:, 9:],
        sigma=np.sqrt(np.maximum(np.einsum("kii->ki", covariances), 0.0)),
        pose=covariances[:, _POSE[:, None], _POSE],
    )
