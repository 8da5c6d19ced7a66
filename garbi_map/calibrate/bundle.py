"""One adjustment of everything: camera, port, laser, window, and where the target was, from corners and stripes.

What is held is held with no error, unless a prior says how well it is known; so the covariance that comes out holds the
target's poses and, with a prior, the camera's own uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.least_squares import covariance_of, minimise
from garbi_map.calibrate.scanner import Scanner
from garbi_map.log.records import Floats
from garbi_map.rig import Camera

UNSEEN = 1e3  # px: the residual of what cannot be projected
OUTLIER = 4.0  # sigma
STEP = 1e-6  # of a pose, rad or m


@dataclass(frozen=True)
class Corners:
    """Seen points of the target: view (n,) number, point (n, 3) m target frame, pixel (n, 2)."""

    view: NDArray[np.int64]
    point: Floats
    pixel: Floats


@dataclass(frozen=True)
class StripePoints:
    """The stripe on the target.

    view (n,) number of the pose, image (n,) number of the image
    u, v (n,) px; alpha (n,) rad and rate (n,) rad/s of the encoder at the image's stamp
    origin, normal (n, 3) of the face that it lies on, target frame
    """

    view: NDArray[np.int64]
    image: NDArray[np.int64]
    u: Floats
    v: Floats
    alpha: Floats
    rate: Floats
    origin: Floats
    normal: Floats

    def part(self, which: NDArray) -> StripePoints:
        """Those of an index or a mask."""
        return StripePoints(**{name: getattr(self, name)[which] for name in self.__dataclass_fields__})


@dataclass(frozen=True)
class Poses:
    """Camera <- target: rotation of m views, translation (m, 3) m."""

    rotation: Rotation
    translation: Floats

    def moved(self, step: Floats) -> Poses:
        """Turned and shifted by (m, 6): a rotation vector on the camera's side, then metres."""
        return Poses(Rotation.from_rotvec(step[:, :3]) * self.rotation, self.translation + step[:, 3:])


@dataclass(frozen=True)
class Prior:
    """What is known beforehand: names, mean (k,), covariance (k, k)."""

    names: tuple[str, ...]
    mean: Floats
    covariance: Floats


@dataclass(frozen=True)
class Adjusted:
    """What came out.

    free, covariance   names, and their (k, k) with everything else marginalised, to first order: what propagates
    bend               (k, k) to be added for the parameters' own errors: see Bundle.bend
    corner, stripe     residuals (n, 2) and (s,) px, of all observations
    corner_good, stripe_good   (n,) and (s,): which were used
    corner_sigma, stripe_sigma   px, as estimated; the stripe's includes what the rows of an image have in common
    """

    scanner: Scanner
    poses: Poses
    free: tuple[str, ...]
    covariance: Floats
    bend: Floats
    corner: Floats
    stripe: Floats
    corner_good: NDArray[np.bool_]
    stripe_good: NDArray[np.bool_]
    corner_sigma: float
    stripe_sigma: float

    def sigma(self, name: str) -> float:
        """1 sigma of a free parameter, in its unit."""
        at = self.free.index(name)
        return float(np.sqrt(self.own_covariance[at, at]))

    @property
    def own_covariance(self) -> Floats:
        """(k, k) of the parameters' own errors, to second order."""
        return self.covariance + self.bend


@dataclass
class Bundle:
    """The adjustment: observations, what is free, what is known beforehand."""

    scanner: Scanner
    poses: Poses
    free: tuple[str, ...]
    corners: Corners
    stripes: StripePoints | None = None
    priors: Sequence[Prior] = ()
    sigma: list[float] = field(default_factory=lambda: [0.2, 0.2])  # px, of corners and stripes, to begin with
    _seen: tuple[Camera, Floats, Floats] | None = field(default=None, init=False, repr=False)

    def fit(self) -> Adjusted:
        """Robust first, then without the outliers, with the noise as the residuals show it."""
        size = len(self.free) + 6 * len(self.poses.translation)
        x = np.zeros(size)
        good = np.ones(len(self.corners.view), bool), np.ones(self._stripe_count, bool)
        for turn in range(4):
            robust = turn < 2
            evaluate, jacobian = self._problem(good)
            x = minimise(evaluate, jacobian, x, robust, len(self._prior_rows()[1]))
            corner, stripe = self.residuals(*self._at(x))
            self.sigma = self._noise(corner, stripe, good, None if robust else jacobian(x))
            if turn < 3:
                good = (
                    np.linalg.norm(corner, axis=1) < OUTLIER * np.sqrt(1.5) * self.sigma[0],
                    np.abs(stripe) < OUTLIER * self.sigma[1],
                )
        self._share_of_images(stripe, good[1])
        evaluate, jacobian = self._problem(good)
        slope = jacobian(x)
        everything = covariance_of(slope)
        scanner, poses = self._at(x)
        count = len(self.free)
        return Adjusted(
            scanner,
            poses,
            self.free,
            everything[:count, :count],
            self.bend(evaluate, slope, x, everything),
            corner,
            stripe,
            *good,
            *self.sigma,
        )

    def bend(self, evaluate: Callable[[Floats], Floats], slope: csr_array, x: Floats, covariance: Floats) -> Floats:
        """What the free parameters' (k, k) mean squared error has beyond first order.

        Along a weakly determined direction (beta, theta and gamma are nearly one) the valley of the cost is curved: a
        step of t sigmas along it brings c t^2 in the others, c = -C J' r'' / 2 with r'' the residuals' second
        difference over one sigma; so 2 sum c c' + (sum c)(sum c)' for independent t (Beale, J. R. Stat. Soc. B 22,
        1960, is about that curvature). Points in space follow the valley, and know little of it.
        """
        count = len(self.free)
        own = covariance[:count, :count]
        if not count or not np.isfinite(covariance).all():
            return np.zeros((count, count))
        scale = np.sqrt(np.diag(own))
        values, vectors = np.linalg.eigh(own / scale[:, None] / scale)
        steps = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        steps = covariance[:, :count] @ np.linalg.lstsq(own, steps)[0]  # the poses come along
        middle = 2.0 * evaluate(x)
        second = np.stack([evaluate(x + step) + evaluate(x - step) - middle for step in steps.T], axis=1)
        shift = -0.5 * (covariance @ (slope.T @ second))[:count]
        return np.asarray(2.0 * shift @ shift.T + np.outer(shift.sum(axis=1), shift.sum(axis=1)))

    @property
    def _stripe_count(self) -> int:
        return 0 if self.stripes is None else len(self.stripes.view)

    def _at(self, x: Floats) -> tuple[Scanner, Poses]:
        count = len(self.free)
        values = self.scanner.values()
        scanner = self.scanner.changed({name: values[name] + x[i] for i, name in enumerate(self.free)})
        return scanner, self.poses.moved(x[count:].reshape(-1, 6))

    def residuals(self, scanner: Scanner, poses: Poses) -> tuple[Floats, Floats]:
        """Corners (n, 2) and stripes (s,), px.

        A stripe's is the angle by which it misses the sheet over that angle per column: the column's own error, to
        second order, as long as both are differentiated."""
        stripe = np.empty(0)
        if self.stripes is not None:
            assert scanner.laser is not None
            if self._seen is None or self._seen[0] != scanner.camera:  # most steps move the laser or the poses only
                self._seen = scanner.camera, *_sights(scanner.camera, self.stripes)
            points = _on_faces(scanner.camera, poses, self.stripes, *self._seen[1:])
            alpha = self.stripes.alpha + scanner.latency * self.stripes.rate
            middle, behind, ahead = scanner.laser.off_sheet(points, np.tile(alpha, 3)).reshape(3, -1)
            stripe = middle / (ahead - behind)
        return corner_residuals(scanner, poses, self.corners), np.nan_to_num(stripe, nan=UNSEEN)

    def _problem(self, good: tuple[NDArray, NDArray]):  # type: ignore[no-untyped-def]
        prior_slope, prior_mean = self._prior_rows()
        corner_good, stripe_good = good
        count, views = len(self.free), len(self.poses.translation)

        def stacked(corner: Floats, stripe: Floats) -> Floats:
            return np.concatenate([(corner[corner_good] / self.sigma[0]).ravel(), stripe[stripe_good] / self.sigma[1]])

        def evaluate(x: Floats) -> Floats:
            return np.append(stacked(*self.residuals(*self._at(x))), prior_slope @ x[:count] + prior_mean)

        def jacobian(x: Floats) -> csr_array:
            scanner, poses = self._at(x)

            def both(scanner: Scanner, poses: Poses) -> Floats:
                return stacked(*self.residuals(scanner, poses))

            seen = [np.repeat(self.corners.view[corner_good], 2)]
            if self.stripes is not None:
                seen.append(self.stripes.view[stripe_good])
            view = np.concatenate(seen)
            slope = np.empty((len(view), count + 6))
            steps = step_sizes(self.free)
            for i in range(count):
                h = np.zeros_like(x)
                h[i] = steps[i]
                ahead, behind = self._at(x + h)[0], self._at(x - h)[0]
                slope[:, i] = (both(ahead, poses) - both(behind, poses)) / (2 * steps[i])
            for axis in range(6):  # a residual knows one pose only: all views move at once
                h = np.zeros((views, 6))
                h[:, axis] = STEP
                offset = x[count:].reshape(-1, 6)
                change = (both(scanner, self.poses.moved(offset + h)) - both(scanner, self.poses.moved(offset - h))) / (
                    2 * STEP
                )
                slope[:, count + axis] = change
            place = np.empty(slope.shape, np.int64)
            place[:, :count] = np.arange(count)
            place[:, count:] = count + 6 * view[:, None] + np.arange(6)
            ends = np.arange(len(view) + 1) * slope.shape[1]
            seen_rows = csr_array((slope.ravel(), place.ravel(), ends), shape=(len(view), len(x)))
            prior_rows = np.pad(prior_slope, ((0, 0), (0, len(x) - count)))
            return csr_array(vstack([seen_rows, csr_array(prior_rows)]))

        return evaluate, jacobian

    def _prior_rows(self) -> tuple[Floats, Floats]:
        """Rows (r, k) of the priors, and their residuals (r,) where the fit starts, in sigmas."""
        values = self.scanner.values()
        slopes, means = [np.empty((0, len(self.free)))], [np.empty(0)]
        for prior in self.priors:
            known = [i for i, name in enumerate(prior.names) if name in self.free]
            if not known:
                continue
            root = np.linalg.inv(np.linalg.cholesky(prior.covariance[np.ix_(known, known)]))
            slope = np.zeros((len(known), len(self.free)))
            slope[:, [self.free.index(prior.names[i]) for i in known]] = root
            slopes.append(slope)
            means.append(root @ np.array([values[prior.names[i]] - prior.mean[i] for i in known]))
        return np.concatenate(slopes), np.concatenate(means)

    def _noise(
        self, corner: Floats, stripe: Floats, good: tuple[NDArray, NDArray], slope: Floats | None
    ) -> list[float]:
        """Sigma of corners and stripes, px: by their medians at first, then with the degrees of freedom they kept."""
        if slope is None:
            sigma = [1.4826 * float(np.median(np.abs(corner)))]
            sigma += [1.4826 * float(np.median(np.abs(stripe)))] if len(stripe) else [self.sigma[1]]
            return [max(value, 1e-6) for value in sigma]
        lever = np.asarray((slope * (slope @ covariance_of(slope))).sum(axis=1))
        corners = 2 * int(good[0].sum())
        found: list[float] = []
        for part, spent in ((corner[good[0]].ravel(), lever[:corners]), (stripe[good[1]], lever[corners:])):
            left = len(part) - float(spent[: len(part)].sum())
            found.append(max(float(np.sqrt((part**2).sum() / left)), 1e-6) if left > 1 else self.sigma[len(found)])
        return found

    def _share_of_images(self, stripe: Floats, good: NDArray) -> None:
        """Rows of one image may be wrong together; then they count for fewer."""
        if self.stripes is None:
            return
        _, number = np.unique(self.stripes.image[good], return_inverse=True)
        count = np.bincount(number)
        mean = np.bincount(number, stripe[good]) / count
        if len(count) >= 5:
            excess = float(np.mean(count * mean**2)) / self.sigma[1] ** 2
            self.sigma[1] *= np.sqrt(max(1.0, excess))


def step_sizes(names: Sequence[str]) -> list[float]:
    """Steps for differences, in each parameter's unit."""
    pixels = ("alpha_u", "alpha_v", "u0", "v0")
    return [1e-3 if name.rsplit(".", 1)[1] in pixels else 1e-6 for name in names]


def corner_residuals(scanner: Scanner, poses: Poses, corners: Corners) -> Floats:
    """Seen minus expected (n, 2), px."""
    turn = poses.rotation.as_matrix()[corners.view]
    points = np.einsum("nij,nj->ni", turn, corners.point) + poses.translation[corners.view]
    return np.nan_to_num(corners.pixel - scanner.camera.project(points), nan=UNSEEN)


def stripe_in_rig(scanner: Scanner, poses: Poses, stripes: StripePoints) -> Floats:
    """Points (n, 3) m, rig frame, where the rays of the stripe's pixels meet the target."""
    camera = scanner.camera
    return _on_faces(camera, poses, stripes, *camera.rays(stripes.u, stripes.v))


def _on_faces(camera: Camera, poses: Poses, stripes: StripePoints, origin: Floats, direction: Floats) -> Floats:
    """Points (..., n, 3) m, rig frame, where rays (..., n, 3) meet the faces that the stripe's n points lie on."""
    normal = np.einsum("nij,nj->ni", poses.rotation.as_matrix()[stripes.view], stripes.normal)
    shift = np.einsum("ni,ni->n", stripes.normal, stripes.origin)
    shift += np.einsum("ni,ni->n", normal, poses.translation[stripes.view])
    before = shift - np.einsum("ni,...ni->...n", normal, origin)
    reach = before / np.einsum("ni,...ni->...n", normal, direction)
    return np.asarray((origin + reach[..., None] * direction) @ camera.rotation.T + camera.centre)


def _sights(camera: Camera, stripes: StripePoints) -> tuple[Floats, Floats]:
    """Origins and directions (3, n, 3) of the rays of the stripe's pixels and of half a column on either side."""
    u = stripes.u + np.array([[0.0], [-0.5], [0.5]])
    origin, direction = camera.rays(u.ravel(), np.tile(stripes.v, 3))
    return origin.reshape(3, -1, 3), direction.reshape(3, -1, 3)


def diagonal_prior(sigmas: Mapping[str, tuple[float, float]]) -> Prior:
    """Independent priors: name -> (mean, sigma)."""
    mean, sigma = np.array(list(sigmas.values()), float).T
    return Prior(tuple(sigmas), mean, np.diag(sigma**2))
