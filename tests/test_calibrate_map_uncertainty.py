"""What a rig's covariance means for a map: the spread of maps whose rigs are drawn from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs import make_rig
from scanned_floor import MOUNTS, Dive, dive, register_dive
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.map_uncertainty import CAREFUL, MapSamples, MapUncertainty, rig_errors
from garbi_map.calibrate.uncertainty import alpha_through
from garbi_map.log.records import Mount
from garbi_map.navigate import Trajectory
from garbi_map.rig import Rig
from garbi_map.seabed import AcceptedPoints, JudgedPoints, OutlierSettings, Seabed, SeabedSettings, build_seabed
from garbi_map.sweep import Sweep
from garbi_map.sweep.store import SweepStore
from tools.bench.uncertainty_rig import differences

FORWARD = Rotation.from_matrix([[0, 1, 0], [0, 0, 1], [1, 0, 0]])
"""Scanned floor's rig, which looks along its z, <- one that looks along its x, about whose z the laser turns."""
MOUNT = Mount(MOUNTS["rig"].translation, (Rotation.from_quat(MOUNTS["rig"].quaternion) * FORWARD).as_quat())
SETTINGS = SeabedSettings(cell=0.02, outliers=OutlierSettings(voxel=0.03))


def told(rig: Rig, sigma: dict[str, float]) -> Rig:
    """A rig whose file says how sure some of its parameters are, and the encoder's latency."""
    names = [*sigma, "laser.latency"]
    covariance = np.diag(np.square([*sigma.values(), 1e-3]))
    return replace(rig, extra={"laser": {"calibration": {"free": names, "covariance": covariance.tolist()}}})


def made(one: Dive, true: Rig, used: Rig, folder: Path) -> tuple[Seabed, MapUncertainty]:
    """The map of a dive that one rig saw and another triangulates, registered by itself."""
    store = SweepStore(folder)
    for sweep in one.store:
        seen = FORWARD.inv().apply(sweep.points)
        u, v = true.project(seen).T
        store.add(replace(sweep, points=used.triangulate(u, v, alpha_through(true.laser, seen)).points))
    store.finish([])
    log = replace(one.log, mounts={**one.log.mounts, "rig": MOUNT})
    registered, _ = register_dive(Dive(store, log, one.floor))
    judged: list[JudgedPoints] = []

    def posed() -> Iterator[tuple[Sweep, Trajectory]]:
        for sweep in store:
            yield sweep, registered.inside.at(sweep.stamp_ns).mounted(MOUNT)

    def take(points: AcceptedPoints) -> None:
        assert isinstance(points, JudgedPoints)
        judged.append(points)

    seabed, _ = build_seabed(posed, SETTINGS, MOUNT, take, used.eyes)
    samples = MapSamples(seabed)
    for points in judged:
        samples.add(points)
    return seabed, samples.uncertainty(registered.trajectory.at, MOUNT, used)


def test_maps_of_drawn_rigs_differ_as_stated(tmp_path: Path) -> None:
    """Rms over the cells and over as many draws at right angles as there are parameters, each registered anew."""
    rig = told(make_rig(), {"camera.u0": 0.5, "laser.y": 1e-3, "laser.delta": 4e-4, "laser.beta": 1e-3})
    one = dive(tmp_path / "dive", 12.0)
    right, stated = made(one, rig, rig, tmp_path / "right")
    assert stated.told
    errors = rig_errors(rig)[0]
    assert errors.names == ("camera.u0", "laser.y", "laser.delta", "laser.beta")
    directions = np.linalg.qr(np.random.default_rng(3).standard_normal((4, 4)))[0]
    squared = []
    for number, z in enumerate(2.0 * directions):
        wrong, _ = made(one, rig, errors.at(z), tmp_path / str(number))
        squared.append([np.mean(part**2) for part in differences(right, wrong)])
    displaced, bent = np.sqrt(np.mean(squared, axis=0))
    known = right.known
    assert displaced / np.sqrt(np.mean(stated.displaced[known] ** 2)) == pytest.approx(1.0, abs=0.4)
    assert bent / np.sqrt(np.mean(stated.bent[known] ** 2)) == pytest.approx(1.0, abs=0.5)
    assert (stated.bent[known] < stated.displaced[known]).mean() > 0.9


def test_what_is_not_told_is_a_careful_calibration(tmp_path: Path) -> None:
    """Without a covariance in the rig file; and both uncertainties of the seabed grow by what they should."""
    errors, known = rig_errors(make_rig())
    assert not known and errors.names == tuple(CAREFUL)
    np.testing.assert_allclose(errors.sigma, list(CAREFUL.values()))
    one = dive(tmp_path / "dive", 4.0)
    seabed, doubt = made(one, make_rig(), make_rig(), tmp_path / "map")
    assert not doubt.told
    carried = doubt.carried_into(seabed, 0.1)
    assert carried.absolute is not None
    cells = seabed.known
    inside, earth = carried.uncertainty[cells], carried.absolute[cells]
    np.testing.assert_allclose(inside**2, (seabed.uncertainty**2 + doubt.bent**2)[cells], rtol=1e-4)
    assert (earth > 0.1).all() and np.isfinite(earth).all() and (doubt.displaced[cells] > 1e-5).all()
    assert np.isnan(carried.absolute[~cells]).all()
