"""What `garbi calibrate field` computes with: derivatives, elimination, and the choice of what has to change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rigs import make_rig
from scipy.stats import norm, wilcoxon
from test_register_clocks import scanned

from garbi_map.calibrate.field_evidence import _Cost, judge, signed_rank
from garbi_map.calibrate.field_joint import Evidence, HeldOut, _Response
from garbi_map.calibrate.field_rig import FOCAL, INDEX, SLIP, RigUnknowns, unknowns
from garbi_map.calibrate.field_views import UnknownScanner, Views
from garbi_map.calibrate.field_words import sentences, table
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.register.normal_equations import NormalEquations, Tail


def looked_at(port: bool) -> tuple[UnknownScanner, Views]:
    """Everything that may be wrong of a rig, and what it saw."""
    scanner, sweep, angle = scanned(port)
    unknown = unknowns(scanner.rig, motor=True, focal=True, index=port, baseline_held=False)
    u = scanner.rig.project(sweep.points)[:, 0]
    number = np.zeros(len(sweep.stamp_ns), np.int64)
    views = Views(u, sweep.row.astype(float), sweep.sigma, sweep.profile, sweep.stamp_ns, number)
    return UnknownScanner(unknown, angle, scanner.mount), views


@pytest.mark.parametrize("port", [False, True])
def test_the_scanner_knows_how_each_parameter_moves_its_points(port):
    """Every derivative is the difference of two triangulations, about a rig that is corrected already."""
    scanner, views = looked_at(port)
    names = scanner.unknowns.names
    assert (INDEX in names) is port and FOCAL in names and LATENCY in names
    rng = np.random.default_rng(3)
    z = 0.2 * rng.normal(size=len(names))
    points = scanner.points(views, z)
    assert np.isfinite(points).all()
    found = scanner.changes(points, views.stamp_ns[views.profile], z)
    for k, name in enumerate(names):
        h = 0.02 * np.eye(len(names))[k]
        expected = (scanner.points(views, z + h) - scanner.points(views, z - h)) / 0.04
        # the angle at a moment comes from whole readings, a latency moves between them
        tolerance = 0.03 if name == LATENCY else 2e-3
        assert found[:, :3, k] == pytest.approx(expected, abs=tolerance * np.abs(expected).max() + 1e-9), name


@pytest.mark.parametrize("port", [False, True])
def test_a_point_is_lit_by_the_sheet_of_its_moment(port):
    """And no longer a tenth of a second later; a rig that is wrong is asked with what it makes of the points."""
    scanner, views = looked_at(port)
    z = 0.2 * np.random.default_rng(3).normal(size=len(scanner.unknowns.names))
    points, stamps = scanner.points(views, z), views.stamp_ns[views.profile]
    assert scanner.lit(points, stamps, z).all()
    assert not scanner.lit(points, stamps + 100_000_000, z).any()
    assert not scanner.lit(points, stamps, -z).any()


class Encoder:
    """Of few counts where the laser turns."""

    turns_ns = np.empty(0, np.int64)

    def at(self, stamp_ns):
        sigma = np.where(np.arange(len(stamp_ns)) < 3, 5e-5, 1e-5)
        return np.zeros(len(stamp_ns)), sigma


def test_profiles_whose_angle_few_counts_tell_are_left_out():
    """The first three of ten, in which the angle is five times as unsure as usual; the others stay as they are."""
    scanner, views = looked_at(False)
    sure = replace(scanner, angle=Encoder()).surely_lit(views)
    assert set(sure.profile) == set(range(3, 10))
    kept = views.profile >= 3
    assert (sure.u == views.u[kept]).all() and (sure.v == views.v[kept]).all()
    assert (sure.stamp_ns == views.stamp_ns).all()


def test_noise_grows_with_the_range():
    """A sheet that is turned away from the camera lights what is farther, and a column there is worth more metres."""
    scanner, views = looked_at(False)
    nothing = np.zeros(len(scanner.unknowns.names))
    k = scanner.unknowns.names.index("laser.delta")
    points = scanner.points(views, nothing)
    grown = scanner.changes(points, views.stamp_ns[views.profile], nothing)[:, 3, k]
    h = 0.02 * np.eye(len(nothing))[k]
    away = [np.linalg.norm(scanner.points(views, side * h) - scanner.mount.translation, axis=1) for side in (-1, 1)]
    assert (np.sign(grown) == np.sign(away[1] - away[0])).all()


def test_the_baseline_is_the_metric_scale():
    """Along the baseline the prior is a fifth of a millimetre, across it what may have slipped."""
    rig = make_rig()
    unknown = unknowns(rig, motor=True)
    covariance = unknown.root @ unknown.root.T
    place = [unknown.names.index(f"laser.{axis}") for axis in "xyz"]
    along = rig.laser.apex - rig.camera.centre
    along /= np.linalg.norm(along)
    own = covariance[np.ix_(place, place)]
    assert np.sqrt(along @ own @ along) == pytest.approx(2e-4)
    assert np.sort(np.sqrt(np.linalg.eigvalsh(own))) == pytest.approx([2e-4, SLIP["laser.x"], SLIP["laser.x"]])


def test_what_the_rig_file_knows_of_itself_widens_the_prior():
    """A covariance in the file is added to what may have slipped; one that is none is passed over."""
    rig = make_rig()
    entries = {"free": ["laser.delta", "laser.theta"], "covariance": [[1e-4, 2e-5], [2e-5, 4e-4]]}
    told = replace(rig, extra={"laser": {"calibration": entries}})
    plain, wide = (unknowns(one, motor=False) for one in (rig, told))
    added = wide.root @ wide.root.T - plain.root @ plain.root.T
    assert added[:2, :2] == pytest.approx(np.array(entries["covariance"]))
    assert added[2:, :] == pytest.approx(0.0, abs=1e-12)
    broken = replace(rig, extra={"laser": {"calibration": entries | {"covariance": [[1.0]]}}})
    assert unknowns(broken, motor=False).root == pytest.approx(plain.root)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
def test_what_is_left_after_elimination_is_what_the_whole_says(seed):
    """The reduced problem has the covariance and the solution of the whole one, less the prior."""
    rng = np.random.default_rng(seed)
    m, k, n = 6, 3, 40
    problem = NormalEquations(m + k)
    problem.add(rng.normal(size=n), 0.5, [], tail=Tail(np.arange(m + k), rng.normal(size=(n, m + k))))
    z = rng.normal(size=k)
    problem.add(z, 1.0, [], tail=Tail(np.arange(m, m + k), np.eye(k)))
    response = _Response(problem, z)
    step = problem.solve()[m:]
    total = response.information + np.eye(k)
    assert np.linalg.inv(total) == pytest.approx(problem.covariance(np.arange(m, m + k)), rel=1e-6)
    assert np.linalg.solve(total, response.pull) == pytest.approx(z + step, rel=1e-6, abs=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 3))
def test_the_fewest_parameters_that_explain_it_are_changed(seed, count):
    """Those that are off by twenty sigmas, whatever the correlations, and no other, where there is no noise."""
    rng = np.random.default_rng(seed)
    slope = rng.normal(size=(30, 5)) + 0.5 * rng.normal(size=(30, 1))
    information = slope.T @ slope
    wrong = rng.permutation(5)[:count]
    x = np.zeros(5)
    x[wrong] = 20.0 * np.sqrt(np.diag(np.linalg.inv(information)))[wrong]
    cost = _Cost(information, information @ x)
    chosen = cost.fewest()
    assert sorted(np.flatnonzero(chosen)) == sorted(wrong)
    assert cost.least(chosen) == pytest.approx(x)


def small() -> RigUnknowns:
    return RigUnknowns(make_rig(), ("laser.delta", "laser.gamma"), np.diag([np.deg2rad(0.5), np.deg2rad(0.2)]))


def evidence(z: np.ndarray, sure: float, agree: bool = True) -> Evidence:
    """Places that say z of delta, and nothing of gamma; those held out agree or say the opposite."""
    rng = np.random.default_rng(1)
    information = np.diag([sure, 0.0])
    slope = np.column_stack([rng.normal(size=400), np.zeros(400)]) * 1e-3
    offset = -slope @ (z if agree else -z) + 2e-5 * rng.normal(size=400)
    held = HeldOut(information, information @ z, offset, slope, np.full(400, 1e-4), np.arange(400) % 40)
    return Evidence(information, information @ z, (held, held), 1e-4, 1000)


def test_a_wrong_parameter_is_corrected_and_an_unseen_one_stays():
    """Delta comes to what the dive says; gamma keeps its value and its prior, and the words say so."""
    found = judge(small(), [evidence(np.array([1.0, 0.0]), 1e4)])
    assert found.offered and found.changed == (True, False)
    assert found.corrections["laser.delta"] == pytest.approx(np.deg2rad(0.5), rel=0.01)
    assert found.sigma[1] == pytest.approx(np.deg2rad(0.2), rel=1e-3)
    assert found.applied[1] == 0.0
    assert [line.verdict for line in table(found)] == ["corrected", "not seen: kept"]
    assert "fixes delta to 0.0094 degrees and says nothing, or little, about gamma" in sentences(found)[0]


def test_what_places_held_out_do_not_confirm_is_not_offered():
    """However sure the estimate is."""
    found = judge(small(), [evidence(np.array([1.0, 0.0]), 1e4, agree=False)])
    assert found.changed[0] and not found.offered and not found.corrections
    assert not found.applied.any()


def test_a_right_rig_is_left_alone():
    """A twentieth of a sigma beforehand is not enough where all matches of a dive are off in common."""
    found = judge(small(), [evidence(np.array([0.05, 0.0]), 1e6)])
    assert not any(found.changed) and not found.offered
    assert "agrees with this dive" in sentences(found)[-1]


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_the_signed_rank_is_that_of_the_book(seed):
    """Against scipy's normal approximation; no difference is no evidence."""
    values = np.random.default_rng(seed).standard_t(2, size=50) + 0.3
    known = wilcoxon(values, method="asymptotic", correction=False)
    assert 2.0 * norm.sf(abs(signed_rank(values))) == pytest.approx(known.pvalue, rel=1e-6)
    assert signed_rank(np.zeros(5)) == 0.0


def test_stretches_of_a_dive_are_added():
    """Two that say the same are surer than one, down to what they have in common."""
    one, two = (judge(small(), [evidence(np.array([1.0, 0.0]), 50.0)] * count) for count in (1, 2))
    assert two.sigma[0] < one.sigma[0]
    assert two.sigma[0] > np.deg2rad(0.008)
