"""The backward pass: against the exact joint estimate, and against the filter it starts from."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic_navigation import MOUNTS, build, derivative, point_on, seconds, typical_errors

from garbi_map.navigate import NavigateSettings, gyro_attitude, prepare_inertial, smoother
from garbi_map.navigate.eskf import ErrorStateFilter, Node
from garbi_map.navigate.observations import make_sources
from garbi_map.navigate.process import ProcessModel, Step
from garbi_map.navigate.start import first_guess
from garbi_map.navigate.states import STATES, VELOCITY
from garbi_map.navigate.tape import NodeTape
from garbi_map.navigate.timebase import make_timebase

TRIANGLE = np.triu_indices(STATES)


def forward_pass(seed: int, duration: float = 20.0) -> tuple[ErrorStateFilter, list[Node]]:
    """The filter over a synthetic dive, and its nodes."""
    settings = NavigateSettings()
    log = build(duration, typical_errors(seed), seed)
    series = prepare_inertial(log, settings)
    assert series is not None
    span = (int(series.stamp_ns[0]), int(series.stamp_ns[-1]))
    sources = make_sources(log, series, None, *span, settings)
    start = first_guess(series, gyro_attitude(log, settings, series), sources, settings)
    forward = ErrorStateFilter(make_timebase(series, *span, settings), series, sources, start, settings)
    return forward, list(forward.run())


def linear_nodes(steps: int) -> tuple[list[Node], ProcessModel, np.ndarray, np.ndarray]:
    """A linear system filtered with resets, and its exact answer: all nodes conditioned on all measurements at once.

    The answer is the mean (steps, STATES) of the errors against the nominal path after each node's update, and their
    joint covariance.
    """
    random = np.random.default_rng(0)
    model = ProcessModel(None, NavigateSettings())
    step = Step(0.05, np.eye(9, 15) + 0.05 * random.normal(0, 0.3, (9, 15)), 0.05, 0.05, np.zeros(STATES))
    transition, noise = model.transition(step), model.noise(step)
    covariance, total = np.diag(random.uniform(0.5, 2.0, STATES)) * 0.01, np.zeros(STATES)
    size, per_node = steps * STATES, 4
    joint, all_rows = np.zeros((size, size)), np.zeros((steps * per_node, size))
    measured, nodes, carried = np.zeros(steps * per_node), [], []
    joint[:STATES, :STATES] = covariance
    for k in range(steps):
        here, past = slice(k * STATES, (k + 1) * STATES), slice(0, k * STATES)
        if k:
            covariance, total = transition @ covariance @ transition.T + noise, transition @ total
            before = slice((k - 1) * STATES, k * STATES)
            joint[here, past] = transition @ joint[before, past]
            joint[past, here] = joint[here, past].T
            joint[here, here] = transition @ joint[before, before] @ transition.T + noise
        rows = random.normal(0, 1, (per_node, STATES))
        innovation = random.normal(0, 0.3, per_node)
        # innovations are against the corrected path; the joint problem counts from the path never corrected
        these = slice(k * per_node, (k + 1) * per_node)
        all_rows[these, here], measured[these] = rows, innovation + rows @ total
        gain = covariance @ rows.T @ np.linalg.inv(rows @ covariance @ rows.T + 0.05 * np.eye(per_node))
        covariance = covariance - gain @ rows @ covariance
        total = total + gain @ innovation
        carried.append(total)
        nodes.append(Node(k, step, gain @ innovation, np.zeros(STATES - 9), covariance[TRIANGLE]))
    gain = joint @ all_rows.T @ np.linalg.inv(all_rows @ joint @ all_rows.T + 0.05 * np.eye(len(measured)))
    mean = (gain @ measured).reshape(steps, STATES) - np.array(carried)
    return nodes, model, mean, joint - gain @ all_rows @ joint


def test_smoothing_is_the_exact_joint_estimate() -> None:
    """Errors and pose covariances equal those of one least squares over all nodes and measurements."""
    steps = 7
    nodes, model, error, joint = linear_nodes(steps)
    smoothed = smoother.smooth(NodeTape(nodes), model)
    assert np.allclose(smoothed.error, error, atol=1e-7)
    for k in range(steps):
        block = joint[k * STATES : (k + 1) * STATES, k * STATES : (k + 1) * STATES]
        assert np.allclose(smoothed.sigma[k], np.sqrt(np.diag(block)), rtol=1e-5)
        pose = np.r_[0:3, 6:9]
        assert np.allclose(smoothed.pose[k], block[np.ix_(pose, pose)], atol=1e-7)


def test_nodes_come_back_from_the_tape_as_they_were() -> None:
    """Any stretch of them, across the blocks in which they were written."""
    _, nodes = forward_pass(1, 40.0)
    tape = NodeTape(iter(nodes))
    assert len(tape) == len(nodes) > 600
    for first, end in ((0, len(nodes)), (480, 530), (len(nodes) - 1, len(nodes)), (7, 7)):
        for one, other in zip(tape.stretch(first, end), nodes[first:end], strict=True):
            assert (one.sample, one.step.seconds) == (other.sample, other.step.seconds)
            for a, b in ((one.covariance, other.covariance), (one.step.jacobian, other.step.jacobian)):
                assert np.array_equal(a, b)
            assert np.array_equal(one.correction, other.correction) and np.array_equal(one.biases, other.biases)


@pytest.mark.parametrize("chunk", [1, 3, 50])
def test_chunks_change_nothing(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many nodes are in memory at once, the answer is the same."""
    nodes, model, error, _ = linear_nodes(7)
    monkeypatch.setattr(smoother, "_CHUNK", chunk)
    assert np.allclose(smoother.smooth(NodeTape(nodes), model).error, error, atol=1e-7)


def test_smoothing_beats_filtering() -> None:
    """The velocity of the same nodes before and after the backward pass: later data halve its error."""
    before, after = [], []
    for seed in range(3):
        forward, nodes = forward_pass(seed)
        smoothed = smoother.smooth(NodeTape(nodes), forward.model)
        rows = forward.base.nodes
        true = derivative(point_on(MOUNTS["imu_link"].translation), seconds(forward.base.stamp_ns[rows]), 1)
        filtered = forward.velocity[rows]
        # against the direction-free speed: both passes share the compass's yaw
        before.append(np.std(np.linalg.norm(filtered, axis=1) - np.linalg.norm(true, axis=1)))
        after.append(
            np.std(np.linalg.norm(filtered + smoothed.error[:, VELOCITY], axis=1) - np.linalg.norm(true, axis=1))
        )
    assert np.mean(after) < 0.7 * np.mean(before)


def test_smoothed_sigmas_never_exceed_filtered_ones() -> None:
    """More data cannot make the estimate worse."""
    forward, nodes = forward_pass(4, 10.0)
    smoothed = smoother.smooth(NodeTape(nodes), forward.model)
    diagonal = np.flatnonzero(TRIANGLE[0] == TRIANGLE[1])
    filtered = np.sqrt(np.array([node.covariance[diagonal] for node in nodes]))
    assert (smoothed.sigma <= filtered * (1.0 + 1e-6)).all()
