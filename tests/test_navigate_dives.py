"""Dead reckoning on independent dives whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from garbi_map.log import LogSettings, open_log
from garbi_map.log.records import Floats, Navigation
from garbi_map.navigate import Trajectory, navigate


def load(folder: Path) -> Navigation:
    return open_log([folder / "dive.mcap"], LogSettings()).navigation()


def score(trajectory: Trajectory, folder: Path) -> tuple[float, Floats]:
    """Position rms, m, and attitude rms (3,), rad, after the rigid motion that attitudes and mean position ask for."""
    table = np.loadtxt(folder / "truth_trajectory.tum", dtype=np.longdouble)
    at = np.round(table[:, 0] * 1e9).astype(np.int64)
    inside = (at >= trajectory.stamp_ns[0]) & (at <= trajectory.stamp_ns[-1])
    position, rotation = table[inside, 1:4].astype(float), Rotation.from_quat(table[inside, 4:].astype(float))
    found = trajectory.at(at[inside])
    turn = (rotation * found.rotation.inv()).mean()
    left = position - turn.apply(found.position)
    left -= left.mean(axis=0)
    attitude = (rotation * (turn * found.rotation).inv()).as_rotvec()
    return float(np.sqrt((left**2).sum(axis=1).mean())), np.sqrt((attitude**2).mean(axis=0))


@pytest.mark.parametrize(("dive", "bound"), [("calm", 0.015), ("drift", 0.012), ("cheap", 0.04)])
def test_dead_reckoning_with_a_dvl(shared: Path, dive: str, bound: float) -> None:
    """Absolute trajectory error of a centimetre (four with the cheap suite); roll and pitch to half a milliradian."""
    folder = shared / "data" / "dives" / dive
    result = navigate(load(folder))
    position, attitude = score(result.trajectory, folder)
    assert position < bound
    assert attitude[:2].max() < (2e-3 if dive == "cheap" else 5e-4)
    assert result.report["sensors"]["dvl"]["rejected"] == 0


def test_roll_and_pitch_hold_without_dvl_pressure_and_attitude(shared: Path) -> None:
    """Rates and specific force alone: roll and pitch still to two milliradians on the swaying dive."""
    folder = shared / "data" / "dives" / "drift"
    log = load(folder)
    bare = replace(log, dvl=None, pressure=None, imu=replace(log.imu, attitude=np.full_like(log.imu.attitude, np.nan)))
    _, attitude = score(navigate(bare).trajectory, folder)
    assert attitude[:2].max() < 2e-3
