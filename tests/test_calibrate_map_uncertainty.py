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

from garbi_map.calibrate.map_uncertainty import CAREFUL, MapSamples, MapUncertainty, View, rig_errors
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
    samples, view = MapSamples(seabed), View(used, MOUNT)
    for points in judged:
        samples.add(points, view)
    return seabed, samples.uncertainty(registered.trajectory.at)


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


CELL, HEIGHT = 0.02, 1.4
"""m"""


def bare(places: list[float]) -> Seabed:
    """A flat floor of a square metre about each of these places along x."""
    shape = (50, round((max(places) - min(places) + 1.0) / CELL))
    zero, one = np.zeros(shape, np.float32), np.ones(shape, np.int32)
    return Seabed((min(places) - 0.5, -0.5), CELL, zero, zero, one, zero, zero, one)


def displacement(*looks: tuple[View, float]) -> list[float]:
    """By what the calibration displaces the floor, m, at each place that one or several views saw from straight above."""
    places = sorted({at for _, at in looks})
    samples = MapSamples(bare(places))
    eyes = np.array([[at, 0.0, HEIGHT] for _, at in looks]) - [view.mount.translation for view, _ in looks]
    n = len(looks)
    path = Trajectory(np.arange(n), eyes, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros((n, 6, 6)))
    across = np.arange(-0.24, 0.25, 0.02)
    floor = np.stack([*np.meshgrid(across, across), np.zeros((len(across),) * 2)], axis=-1).reshape(-1, 3)
    for number, (view, at) in enumerate(looks):
        none = np.zeros(len(floor))
        samples.add(
            JudgedPoints(
                np.full(len(floor), number), floor + np.array([at, 0.0, 0.0]), none.astype(np.float32),
                none.astype(np.float32), none.astype(np.uint8), gradient=np.zeros((len(floor), 2)), noise=none, pose=none,
            ),
            view,
        )  # fmt: skip
    doubt = samples.uncertainty(path.at)
    middle = [round((at - places[0] + 0.5) / CELL) for at in places]
    return [float(np.median(doubt.displaced[20:30, column - 5 : column + 5])) for column in middle]


def test_what_each_of_several_rigs_saw_bears_the_doubt_of_that_rig() -> None:
    """One is ten times less sure of its baseline, and mounted another way: where each looked alone, the map is as unsure as
    one of its own dives; where both looked, their errors, which have nothing to do with each other, average out."""
    far = Mount(MOUNT.translation + np.array([0.0, 0.3, 0.7]), MOUNT.quaternion)
    sure, unsure = (View(told(make_rig(), {"laser.y": sigma}), mount) for sigma, mount in ((1e-4, MOUNT), (1e-3, far)))
    (good,), (bad,) = displacement((sure, 0.0)), displacement((unsure, 0.0))
    assert good == pytest.approx(1e-4 * HEIGHT / 0.395, rel=0.2) and bad == pytest.approx(10 * good, rel=0.01)
    assert displacement((sure, 0.0), (unsure, 5.0)) == pytest.approx([good, bad], rel=0.01)
    assert displacement((sure, 0.0), (unsure, 0.0)) == pytest.approx([np.hypot(good, bad) / 2], rel=0.01)
    assert displacement((unsure, 0.0), (unsure, 0.0)) == pytest.approx([bad], rel=0.01)
