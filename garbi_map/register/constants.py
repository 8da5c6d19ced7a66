"""Unknowns that do not change during a dive, by name: biases, scales, clocks, and whatever else a factor knows of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Constant:
    """An unknown of `width` numbers that are near zero: sigma is their prior's, each, in `unit`.

    patient: stays as it is while the motion is known to decimetres only and any constant would take the blame for it.
    """

    name: str
    sigma: float
    unit: str
    width: int = 1
    patient: bool = False


class Constants:
    """An ordered set of constants and their values; those that were not declared are zero and stay so."""

    def __init__(self, declared: Sequence[Constant] = ()) -> None:
        self.declared = tuple(declared)
        widths = [one.width for one in declared]
        ends = np.cumsum([0, *widths])
        self._places = {one.name: slice(int(ends[k]), int(ends[k + 1])) for k, one in enumerate(declared)}
        self.value = np.zeros(int(ends[-1]))
        self.sigma = np.repeat([one.sigma for one in declared], widths).astype(float)
        self.patient = np.flatnonzero(np.repeat([one.patient for one in declared], widths))

    def __contains__(self, name: str) -> bool:
        return name in self._places

    def __len__(self) -> int:
        return len(self.value)

    def place(self, name: str) -> slice:
        """Where a declared constant is among the values."""
        return self._places[name]

    def vector(self, name: str, width: int = 3) -> Floats:
        """The value (width,) of a constant."""
        return self.value[self._places[name]] if name in self else np.zeros(width)

    def number(self, name: str) -> float:
        """The value of a constant that is one number."""
        return float(self.vector(name, 1)[0])


@dataclass(frozen=True)
class Learnt:
    """What a dive says of a constant: value and 1 sigma (width,), and the prior's sigma, in `unit`."""

    value: Floats
    sigma: Floats
    prior: float
    unit: str


def learnt(windows: Sequence[tuple[Constants, Floats]]) -> dict[str, Learnt]:
    """What windows of one dive say of its constants, from their values and covariances: the mean by information."""
    out = {}
    for one in windows[0][0].declared:
        parts = [(constants.place(one.name), constants, covariance) for constants, covariance in windows]
        values = np.array([constants.value[place] for place, constants, _ in parts])
        information = np.array([1.0 / np.diag(covariance)[place] for place, _, covariance in parts])
        total = information.sum(axis=0)
        out[one.name] = Learnt((information * values).sum(axis=0) / total, 1.0 / np.sqrt(total), one.sigma, one.unit)
    return out
