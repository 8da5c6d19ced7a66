"""Decisions while they are made, for the viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from behaviours.decisions import Decision, parts
from garbi_map.view.decisions import Said, Tick

if TYPE_CHECKING:
    from rerun import RecordingStream


def tick_of(decision: Decision) -> Tick:
    """A decision as the viewer reads it in a log."""
    tick = Tick(decision.now_ns, {name: Said(level, words, values) for level, name, words, values in parts(decision)})
    if decision.pose is not None:
        tick.position = decision.pose.position
        tick.quaternion = Rotation.from_matrix(decision.pose.rotation).as_quat()
    tick.allowed = decision.allowed
    if decision.volume is not None:
        occupied, free = decision.volume
        states = np.r_[np.ones(len(occupied)), np.zeros(len(free))]
        tick.volume = np.c_[np.r_[occupied, free], states].astype(np.float32)
    return tick


class DecisionSender:
    """Sends decisions, one at a time."""

    def __init__(self) -> None:
        self._sender: Any = None

    def __call__(self, recording: RecordingStream, decision: Decision) -> None:
        """One tick; what is drawn of the vehicle goes before the first."""
        from garbi_map.view.decision_view import begin

        if self._sender is None:
            self._sender = begin(recording)
        self._sender.send([tick_of(decision)])
