"""What a dive knows of the rig, direction by direction, and the fewest parameters that have to change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from garbi_map.calibrate.field_joint import Evidence, HeldOut
from garbi_map.calibrate.field_rig import RigUnknowns
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.log.records import Floats

SEEN = 0.5
"""Share of the sigma beforehand below which a dive has told something of a parameter."""
COMMON = {"laser.delta": np.deg2rad(0.008), LATENCY: 5e-5}
"""1 sigma, rad and s, of what all matches of a dive have in common, and no count of them lessens: with right rigs, delta,
which is hardly more than a scale of ranges, comes out that far off on the average."""
_GAIN = 16.0
"""By how much the cost has to fall for a rig to be wrong: four sigmas of a parameter, all else refitted."""
_FURTHER = 6.63
"""By how much it has to fall for one more parameter of a wrong rig: 99 %, for what is left out is put on the others."""
_BETTER = 2.0
"""Standard errors by which the regions held out have to fit better: a second opinion, from few of them."""
_CAUCHY = 2.0
"""Sigmas beyond which a match held out loses its say."""


@dataclass(frozen=True)
class Finding:
    """What one dive says of k parameters of a rig.

    estimate (k,) and covariance (k, k): of what is to be added to them if all of them may be wrong, prior included;
    changed (k,): those that have to change; correction (k,): what to add to them, zero for the others;
    stretches: what they rest on; held_out: median distance between matched surfels of places held out, m, with the rig as
    given and corrected;
    better: by how many standard errors these places fit better; gain: by how much the cost of all falls, chi squared.
    """

    unknowns: RigUnknowns
    stretches: tuple[Evidence, ...]
    estimate: Floats
    covariance: Floats
    changed: tuple[bool, ...]
    correction: Floats
    held_out: tuple[float, float]
    better: float
    gain: float

    @property
    def sigma(self) -> Floats:
        """(k,) 1 sigma of each parameter after the dive."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def offered(self) -> bool:
        """Whether something is to be changed, and places that had no say in it agree."""
        return any(self.changed) and self.better > _BETTER

    @property
    def corrections(self) -> dict[str, float]:
        """What is to be added to which parameters; nothing where nothing is offered."""
        every = zip(self.unknowns.names, self.correction.tolist(), self.changed, strict=True)
        return {name: value for name, value, changed in every if changed and self.offered}

    @property
    def applied(self) -> Floats:
        """(k,) the same as z of the unknowns."""
        offered = np.array([self.corrections.get(name, 0.0) for name in self.unknowns.names])
        return np.linalg.solve(self.unknowns.root, offered)


def judge(unknowns: RigUnknowns, stretches: Sequence[Evidence]) -> Finding:
    """What all stretches of a dive together say."""
    whole = _Cost.of(
        unknowns,
        np.sum([one.information for one in stretches], axis=0),
        np.sum([one.pull for one in stretches], axis=0),
    )
    everything = tuple(True for _ in unknowns.names)
    changed = whole.fewest()
    before, after, better = _held_out(unknowns, stretches, changed)
    return Finding(
        unknowns,
        tuple(stretches),
        whole.least(everything),
        np.asarray(np.linalg.inv(whole.information), np.float64),
        changed,
        whole.least(changed),
        (before, after),
        better,
        whole.gain(changed),
    )


@dataclass(frozen=True)
class _Cost:
    """x' A x / 2 - pull' x of corrections x (k,) in their own units, prior included."""

    information: Floats
    pull: Floats

    @classmethod
    def of(cls, unknowns: RigUnknowns, information: Floats, pull: Floats) -> _Cost:
        """From what the dive says in units of the prior."""
        back = np.linalg.inv(unknowns.root)
        counted = back.T @ (information + np.eye(len(pull))) @ back
        estimate = np.linalg.solve(counted, back.T @ pull)
        common = np.diag([COMMON.get(name, 0.0) ** 2 for name in unknowns.names])
        honest = np.asarray(np.linalg.inv(np.linalg.inv(counted) + common), np.float64)
        return cls(honest, honest @ estimate)

    def least(self, free: Sequence[bool]) -> Floats:
        """The x that costs least where only these may change."""
        which = np.flatnonzero(free)
        x = np.zeros(len(self.pull))
        if len(which):
            x[which] = np.linalg.solve(self.information[np.ix_(which, which)], self.pull[which])
        return x

    def gain(self, free: Sequence[bool]) -> float:
        """By how much twice the cost falls then: chi squared where nothing is wrong."""
        return float(self.pull @ self.least(free))

    def fewest(self) -> tuple[bool, ...]:
        """The parameters that have to change: one more as long as it is worth it, then one less."""
        free = [False] * len(self.pull)

        def with_other(place: int) -> list[bool]:
            return [not own if k == place else own for k, own in enumerate(free)]

        while True:
            now = self.gain(free)
            gains = [self.gain(with_other(k)) - now if not own else -np.inf for k, own in enumerate(free)]
            best = int(np.argmax(gains))
            if gains[best] < (_FURTHER if any(free) else _GAIN):
                break
            free[best] = True
        while any(free):
            now = self.gain(free)
            losses = [now - self.gain(with_other(k)) if own else np.inf for k, own in enumerate(free)]
            least = int(np.argmin(losses))
            if losses[least] >= (_FURTHER if sum(free) > 1 else _GAIN):
                break
            free[least] = False
        return tuple(free)


def _held_out(
    unknowns: RigUnknowns, stretches: Sequence[Evidence], changed: Sequence[bool]
) -> tuple[float, float, float]:
    """Median distance, m, of matches that were held out, as given and corrected, and how much better, in standard errors."""
    given, corrected, gained = [], [], []
    for held in (held for one in stretches for held in one.held_out):
        x = _Cost.of(unknowns, held.information, held.pull).least(changed)
        z = np.linalg.solve(unknowns.root, x)
        before, after = held.offset, held.offset + held.slope @ z
        given.append(before)
        corrected.append(after)
        gained.append(_by_region(held, _cost(before / held.sigma) - _cost(after / held.sigma)))
    if not gained or not sum(len(part) for part in gained):
        return float("nan"), float("nan"), 0.0
    better = signed_rank(np.concatenate(gained))
    medians = [float(np.median(np.abs(np.concatenate(part)))) for part in (given, corrected)]
    return medians[0], medians[1], better


def signed_rank(differences: Floats) -> float:
    """How far differences (n,) are from being as often and as much above zero as below, in standard errors.

    Wilcoxon, Biometrics Bulletin 1 (1945): a region of stones, in which all distances are large, counts as one of many.
    """
    differences = differences[differences != 0.0]
    rank = np.argsort(np.argsort(np.abs(differences))) + 1.0
    error = float(np.sqrt(np.square(rank).sum()))
    return float((np.sign(differences) * rank).sum()) / error if error > 0 else 0.0


def _by_region(held: HeldOut, values: Floats) -> Floats:
    order = np.argsort(held.region, kind="stable")
    cuts = np.flatnonzero(np.diff(held.region[order])) + 1
    edges = [0, *cuts.tolist(), len(order)]
    return np.array([values[order[a:b]].sum() for a, b in pairwise(edges) if b > a])


def _cost(residual: Floats) -> Floats:
    return _CAUCHY**2 * np.log1p(np.square(residual / _CAUCHY))
