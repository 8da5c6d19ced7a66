"""What camera and encoder said of the points of a dive, so that another rig can be asked what it would have made of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.field_rig import RigUnknowns
from garbi_map.calibrate.scanner import LATENCY
from garbi_map.calibrate.uncertainty import alpha_through
from garbi_map.log.records import Floats, Mount, Stamps
from garbi_map.rig import Rig
from garbi_map.sweep import Angle
from garbi_map.sweep.store import SweepStore

_MOMENT_NS = 10_000_000
"""To either side, over which the laser's rate is taken."""
_BESIDE = 1e-3
"""rad from the sheet at its mean time, beyond which a patch was not lit in one go."""
_UNSURE = 2.0
"""Times the usual sigma of the laser's angle beyond which a profile is left out."""
_STEP = 0.05
"""Of a parameter's prior sigma, to either side, over which derivatives are taken."""


@dataclass(frozen=True)
class Views:
    """n points of m profiles: column u (n,) and row v (n,) px, sigma (n,) m, profile (n,); stamp_ns (m,), sweep (m,)."""

    u: Floats
    v: Floats
    sigma: NDArray[np.float32]
    profile: NDArray[np.int32]
    stamp_ns: Stamps
    sweep: NDArray[np.int64]

    def part(self, which: NDArray[np.int64]) -> Views:
        """Some of the points, of all profiles."""
        chosen = {name: getattr(self, name)[which] for name in ("u", "v", "sigma", "profile")}
        return replace(self, **chosen)


def load_views(store: SweepStore, rig: Rig, begin_ns: int, end_ns: int, most: int) -> Views:
    """The profiles of [begin, end] of sweeps that were triangulated with a rig, thinned evenly to at most `most` points."""
    chosen = [entry for entry in store.entries if entry.end_ns >= begin_ns and entry.begin_ns <= end_ns]
    stride = max(1, -(-sum(entry.points for entry in chosen) // most))
    parts = []
    profiles = 0
    for entry in chosen:
        sweep = store.load(entry.index)
        here = (sweep.stamp_ns >= begin_ns) & (sweep.stamp_ns <= end_ns)
        keep = np.flatnonzero(here[sweep.profile])[::stride]
        number = np.cumsum(here) - 1 + profiles
        parts.append(
            Views(
                rig.project(sweep.points[keep])[:, 0],
                sweep.row[keep].astype(float),
                sweep.sigma[keep],
                number[sweep.profile[keep]].astype(np.int32),
                sweep.stamp_ns[here],
                np.full(int(here.sum()), entry.index, np.int64),
            )
        )
        profiles += int(here.sum())
    return Views(*(np.concatenate([getattr(part, name) for part in parts]) for name in Views.__dataclass_fields__))


@dataclass(frozen=True)
class UnknownScanner:
    """A scanner whose rig is known but for some corrections z (k,), on its vehicle.

    latency: s by which the encoder's stamps are late where that is not among the corrections.
    """

    unknowns: RigUnknowns
    angle: Angle
    mount: Mount
    latency: float = 0.0

    def surely_lit(self, views: Views) -> Views:
        """The views but for those where the laser slows down and turns.

        Few counts of the encoder tell of its angle there, and in the same places of every sweep: what they are off looks
        like a latency and a wrong delta.
        """
        sigma = self.angle.at(views.stamp_ns)[1]
        return views.part(np.flatnonzero((sigma <= _UNSURE * np.nanmedian(sigma))[views.profile]))

    def points(self, views: Views, z: Floats) -> Floats:
        """The points (n, 3) m in base_link that the corrected rig makes of the views; NaN where it makes none."""
        alpha = self._alpha(views.stamp_ns, z)
        seen = self.unknowns.at(z).triangulate(views.u, views.v, alpha[views.profile]).points
        return self._turn.apply(seen) + self.mount.translation

    def changes(self, points: Floats, stamp_ns: Stamps, z: Floats) -> Floats:
        """By how much points (n, 3) in base_link, made with z, at stamps (n,), move with a unit of each correction.

        (n, 4, k): m, and last the share by which their noise grows, that of a column's error in the image; zero where the
        rig does not see the point.
        """
        unknowns = self.unknowns
        rig, given = unknowns.at(z), unknowns.offsets(z)
        seen = self._in_rig(points)
        u, v = rig.project(seen).T
        # not that of the moment: where a patch was lit for long, the sheet lies beside its mean at its mean time
        alpha = alpha_through(rig.laser, seen)
        before, after = (self._alpha(stamp_ns + side * _MOMENT_NS, z) for side in (-1, 1))
        out = np.zeros((len(points), 4, len(unknowns.names)))
        for k, (name, sigma) in enumerate(zip(unknowns.names, unknowns.sigma, strict=True)):
            if name == LATENCY:
                rate = (after - before) / (2e-9 * _MOMENT_NS)
                out[:, :3, k] = rig.triangulate(u, v, alpha).d_dalpha * rate[:, None]
                continue
            step = max(_STEP * float(sigma), 1e-6)
            low, high = (
                unknowns.changed(given | {name: given[name] + side * step}).triangulate(u, v, alpha)
                for side in (-1.0, 1.0)
            )
            out[:, :3, k] = (high.points - low.points) / (2.0 * step)
            grown = np.linalg.norm(high.d_du, axis=1) / np.linalg.norm(low.d_du, axis=1)
            out[:, 3, k] = np.log(grown) / (2.0 * step)
        out = np.nan_to_num(out, posinf=0.0, neginf=0.0)
        out[:, :3] = np.einsum("ij,njk->nik", self._turn.as_matrix(), out[:, :3])
        return np.asarray(out @ unknowns.root)

    def lit(self, points: Floats, stamp_ns: Stamps, z: Floats) -> NDArray[np.bool_]:
        """Whether the sheet made with z passes through points (n, 3) in base_link at stamps (n,)."""
        off = alpha_through(self.unknowns.at(z).laser, self._in_rig(points)) - self._alpha(stamp_ns, z)
        return np.abs(np.remainder(off + np.pi, 2.0 * np.pi) - np.pi) < _BESIDE

    def _alpha(self, stamp_ns: Stamps, z: Floats) -> Floats:
        return self.angle.at(stamp_ns + self._late_ns(z))[0]

    def _in_rig(self, points: Floats) -> Floats:
        return np.asarray(self._turn.inv().apply(points - self.mount.translation), np.float64)

    @property
    def _turn(self) -> Rotation:
        return Rotation.from_quat(self.mount.quaternion)

    def _late_ns(self, z: Floats) -> int:
        return round(self.unknowns.offsets(z).get(LATENCY, self.latency) * 1e9)
