"""Rauch-Tung-Striebel smoothing of the filter's nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from garbi_map.log.records import Floats
from garbi_map.navigate.eskf import Node
from garbi_map.navigate.process import ProcessModel
from garbi_map.navigate.states import ATTITUDE, POSITION, STATES
from garbi_map.navigate.tape import NodeTape

_POSE = np.r_[POSITION, ATTITUDE]
_CHUNK = 2000  # nodes whose full matrices are in memory at once


@dataclass(frozen=True)
class Smoothed:
    """What all the data say of the error that the forward pass had at its k nodes.

    error        (k, STATES) to be added to the nominal state after the node's update
    correction   (k, STATES) that update itself
    biases       (k, STATES - 9) smoothed: gyro, accelerometer, attitude topic, DVL scale
    sigma        (k, STATES) 1 sigma
    pose         (k, 6, 6) covariance of position and attitude of the IMU
    """

    error: Floats
    correction: Floats
    biases: Floats
    sigma: Floats
    pose: Floats


def smooth(nodes: NodeTape, model: ProcessModel) -> Smoothed:
    """Smooth all nodes, from the last to the first, a chunk at a time."""
    count = len(nodes)
    error, correction, sigma = (np.zeros((count, STATES)) for _ in range(3))
    biases, pose = np.zeros((count, STATES - 9)), np.zeros((count, 6, 6))
    last_error, last_covariance = np.zeros(STATES), _unpacked(nodes.stretch(count - 1, count))[0]
    for end in range(count, 0, -_CHUNK):
        first = max(end - 1 - _CHUNK, 0)
        here, chunk = slice(first, end), nodes.stretch(first, end)
        means, covariances = _smooth_chunk(chunk, model, last_error, last_covariance)
        error[here] = means
        sigma[here] = np.sqrt(np.maximum(np.einsum("kii->ki", covariances), 0.0))
        pose[here] = covariances[:, _POSE[:, None], _POSE]
        correction[here] = [node.correction for node in chunk]
        biases[here] = [node.biases for node in chunk]
        last_error, last_covariance = means[0], covariances[0]
    return Smoothed(error, correction, biases + error[:, 9:], sigma, pose)


def _smooth_chunk(
    nodes: Sequence[Node], model: ProcessModel, last_error: Floats, last_covariance: Floats
) -> tuple[Floats, Floats]:
    """Errors (k, STATES) and covariances (k, STATES, STATES) of a chunk whose last node is smoothed already.

    filterpy's smoother knows no reset: give it the sum of all corrections carried along by the transitions, which is
    the error against a nominal path that was never corrected; the differences are then those of the reset filter.
    """
    from filterpy.kalman import KalmanFilter

    transitions = np.array([model.transition(node.step) for node in nodes])
    noises = np.array([model.noise(node.step) for node in nodes])
    filtered = np.zeros((len(nodes), STATES))
    for k in range(1, len(nodes)):
        filtered[k] = transitions[k] @ filtered[k - 1] + nodes[k].correction
    means, covariances = filtered.copy(), _unpacked(nodes)
    means[-1] += last_error
    covariances[-1] = last_covariance
    # the method, not filterpy's function of the same name: only the method takes Fs[k] as what leads to node k
    smoother = KalmanFilter(dim_x=STATES, dim_z=1)
    means, covariances, _, _ = smoother.rts_smoother(means, covariances, transitions, noises)
    return means - filtered, 0.5 * (covariances + covariances.transpose(0, 2, 1))


def _unpacked(nodes: Sequence[Node]) -> Floats:
    """Full covariances (k, STATES, STATES) from the upper triangles."""
    rows, columns = np.triu_indices(STATES)
    out = np.zeros((len(nodes), STATES, STATES))
    out[:, rows, columns] = out[:, columns, rows] = np.array([node.covariance for node in nodes])
    return out
