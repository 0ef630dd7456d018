"""Refits the parameters of a prediction to what objects did: maximum likelihood over whole surfaces (Eq. 4.2, 4.3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats
from resim.metrics.risk.prediction import ObjectMotion, Surfaces, WalkerMotion

Ints = NDArray[np.intp]

AHEAD = 1.0
"""Time [s] over which an object's answer to its state is averaged, and from one of its scenes to the next."""

BLOCK = 5
"""Scenes of one object that count as one in the standard errors: the thesis takes scenes 5 s apart as independent."""

LEAST = 50
"""Points of a kind below which it is not fitted."""

BINS = 5

_BOUNDS: Mapping[str, tuple[float, float]] = {
    "a_most": (0.05, 15.0), "v_half": (1.0, 1000.0), "sigma_a0": (1e-3, 10.0), "sigma_a1": (1e-3, 3.0),
    "lateral_most": (0.05, 15.0), "sigma_lateral": (1e-3, 10.0), "sigma_w1": (1e-3, 3.0),
    "sigma_still": (1e-3, 10.0), "sigma_along": (1e-3, 10.0), "sigma_across": (1e-3, 10.0),
}  # fmt: skip
"""What is fitted, and how far it may go: beyond lies nothing that drives or walks. In the units of the motions."""

_STEP = 1e-5  # of the logarithm of a parameter, for the derivatives of means and standard deviations
_CURVED = 1e-6  # information per point of a parameter's logarithm below which the data say nothing about it
_RANGE = (0.005, 0.995)  # quantiles of the initial states that bound what a fit covers


@dataclass(frozen=True, eq=False)
class MotionPoints:
    """N scenes of objects of one kind: their state, and the mean of what they did over the next second.

    v [m/s], a0 [m/s²], w0 [rad/s]: state. a [m/s²], w [rad/s]: answers in the terms of CTRA; along, across [m/s²]:
    the change of velocity along the heading of the scene and across it. item, block: (N,) which object it was, and
    which stretch of BLOCK scenes of it.
    """

    v: Floats
    a0: Floats
    w0: Floats
    a: Floats
    w: Floats
    along: Floats
    across: Floats
    item: Ints
    block: Ints

    def __len__(self) -> int:
        return len(self.v)

    @classmethod
    def of_object(cls, v: Floats, heading: Floats, a: Floats, yaw_rate: Floats) -> MotionPoints:
        """Make the points of one object of its states (M,) at times AHEAD apart; heading not wrapped [rad]."""
        turn, now = np.diff(heading), np.asarray(v[:-1])
        number = np.arange(len(turn))
        return cls(
            v=now, a0=a[:-1], w0=yaw_rate[:-1], a=np.diff(v) / AHEAD, w=turn / AHEAD,
            along=(v[1:] * np.cos(turn) - now) / AHEAD, across=v[1:] * np.sin(turn) / AHEAD,
            item=np.zeros_like(number), block=number // BLOCK,
        )  # fmt: skip

    @classmethod
    def joined(cls, parts: Iterable[MotionPoints]) -> MotionPoints:
        """Give the points of several objects, each by `of_object`, in one."""
        every = list(parts)
        columns = {
            f.name: np.concatenate([getattr(p, f.name) for p in every]) for f in dataclasses.fields(cls)
        }
        columns["item"] = np.repeat(np.arange(len(every)), [len(p) for p in every])
        blocks = np.column_stack([columns["item"], columns["block"]])
        columns["block"] = np.unique(blocks, axis=0, return_inverse=True)[1].ravel()
        return cls(**columns)

    def answers(self, motion: ObjectMotion) -> Floats:
        """Give what was predicted (N, 2) in the terms of the motion."""
        pair = (self.along, self.across) if isinstance(motion, WalkerMotion) else (self.a, self.w)
        return np.stack(pair, axis=1)

    def origins(self, motion: ObjectMotion) -> Floats:
        """Give what the two means are functions of (N, 2)."""
        return np.stack([self.a0, self.v * self.w0 if isinstance(motion, WalkerMotion) else self.w0], axis=1)


@dataclass(frozen=True)
class MotionBin:
    """Points whose origin lies between low and high: mean and spread in the data, and as the motion has them."""

    what: str
    low: float
    high: float
    points: int
    mean: float
    mean_fitted: float
    spread: float
    spread_fitted: float


@dataclass(frozen=True, eq=False)
class Refit:
    """Parameters fitted to points. errors: standard errors by name, None where the data do not determine it.

    before, after: log-likelihood per point of the parameters that were, and of those that are. within_before,
    within: share of the points of which both answers lie within 3 sigma, which the samples of Eq. 4.5 span.
    """

    motion: ObjectMotion
    old: ObjectMotion
    points: MotionPoints
    errors: Mapping[str, float | None]
    before: float
    after: float
    within_before: float
    within: float
    bins: tuple[MotionBin, ...]

    @property
    def objects(self) -> int:
        """How many objects the points are of."""
        return len(np.unique(self.points.item))


def free(motion: ObjectMotion) -> list[str]:
    """Give the names of the parameters that are fitted."""
    return [f.name for f in dataclasses.fields(motion) if f.name in _BOUNDS]


def log_likelihood(motion: ObjectMotion, points: MotionPoints) -> float:
    """Give the mean over the points of the logarithm of the density of both answers (Eq. 4.3, 4.4)."""
    mu, sigma = _normal(motion, points)
    z = (points.answers(motion) - mu) / sigma
    return float(np.mean((-0.5 * np.log(2.0 * np.pi) - np.log(sigma) - 0.5 * z**2).sum(axis=1)))


def refit(points: MotionPoints, start: ObjectMotion) -> Refit:
    """Fit the parameters of a motion to points by maximum likelihood, from those of `start` on.

    Raises ResimError where the points are too few, not finite or do not vary.
    """
    _check(points, start)
    names = free(start)
    low, high = np.log([_BOUNDS[name] for name in names]).T
    begin = np.clip(np.log([getattr(start, name) for name in names]), low, high)

    def cost(q: Floats) -> tuple[float, Floats]:
        motion = _with(start, names, q)
        return -log_likelihood(motion, points), -_scores(motion, names, points)[0].mean(axis=0)

    found = minimize(
        cost, begin, jac=True, method="L-BFGS-B", bounds=list(zip(low, high, strict=True)),
        options={"maxiter": 2000, "ftol": 1e-13, "gtol": 1e-9},
    )  # fmt: skip
    q = np.asarray(found.x, dtype=np.float64)
    motion = _with(start, names, q)
    for name in ("sigma_a0", "sigma_lateral", "sigma_still"):
        if name in names and getattr(motion, name) <= 1.01 * _BOUNDS[name][0]:
            raise ResimError(f"the objects' motion follows their state without any spread ({name} is 0)")
    inside = (q > low + 1e-6) & (q < high - 1e-6)
    fitted = _with_ranges(motion, points)
    return Refit(
        motion=fitted, old=start, points=points, errors=_errors(motion, names, points, inside),
        before=log_likelihood(start, points), after=log_likelihood(fitted, points),
        within_before=_within(start, points), within=_within(fitted, points), bins=_bins(fitted, points),
    )  # fmt: skip


def _check(points: MotionPoints, start: ObjectMotion) -> None:
    if len(points) < LEAST:
        raise ResimError(f"{len(points)} points, at least {LEAST} are fitted")
    if not all(np.isfinite(getattr(points, f.name)).all() for f in dataclasses.fields(points)):
        raise ResimError("a state is not finite")
    for values, what in ((points.answers(start), "answers"), (points.origins(start), "states")):
        if (np.ptp(values, axis=0) < 1e-9).any():
            raise ResimError(f"the {what} of its {len(points)} points do not vary")


def _with(motion: ObjectMotion, names: list[str], q: Floats) -> ObjectMotion:
    return dataclasses.replace(motion, **dict(zip(names, np.exp(q).tolist(), strict=True)))


def _normal(motion: ObjectMotion, points: MotionPoints) -> tuple[Floats, Floats]:
    """Means and standard deviations (N, 2) of both answers."""
    inputs = motion.inputs(points.v, points.a0, points.w0)
    return inputs[:, ::2], inputs[:, 1::2]


def _within(motion: ObjectMotion, points: MotionPoints) -> float:
    mu, sigma = _normal(motion, points)
    return float((np.abs(points.answers(motion) - mu) <= 3.0 * sigma).all(axis=1).mean())


def _scores(motion: ObjectMotion, names: list[str], points: MotionPoints) -> tuple[Floats, Floats]:
    """Derivatives (N, P) of each point's log-likelihood by the logarithms of parameters, and their information (P, P).

    Means and standard deviations are differentiated numerically, so that their equations stand in one place.
    """
    mu, sigma = _normal(motion, points)
    off = points.answers(motion) - mu
    q = np.log([getattr(motion, name) for name in names])
    d_mu, d_sigma = (np.empty((len(names), len(points), 2)) for _ in range(2))
    for p in range(len(names)):
        step = _STEP * (np.arange(len(names)) == p)
        up, down = (_normal(_with(motion, names, q + s), points) for s in (step, -step))
        d_mu[p], d_sigma[p] = ((up[k] - down[k]) / (2.0 * _STEP) for k in range(2))
    score = (d_mu * off / sigma**2 + d_sigma * (off**2 / sigma**3 - 1.0 / sigma)).sum(axis=2)
    scaled_mu, scaled_sigma = ((d / sigma).reshape(len(names), -1) for d in (d_mu, d_sigma))
    return score.T, scaled_mu @ scaled_mu.T + 2.0 * scaled_sigma @ scaled_sigma.T


def _errors(
    motion: ObjectMotion, names: list[str], points: MotionPoints, inside: Bools
) -> dict[str, float | None]:
    """Standard errors that hold where the points of a block depend on each other, or are not quite normal."""
    score, information = _scores(motion, names, points)
    known = np.flatnonzero(inside & (np.diag(information) > _CURVED * len(points)))
    by_block = np.zeros((points.block.max() + 1, len(names)))
    np.add.at(by_block, points.block, score)
    bread = np.linalg.pinv(information[np.ix_(known, known)])
    covariance = bread @ by_block[:, known].T @ by_block[:, known] @ bread
    out: dict[str, float | None] = dict.fromkeys(names)
    for p, variance in zip(known.tolist(), np.diag(covariance).tolist(), strict=True):
        out[names[p]] = float(getattr(motion, names[p]) * np.sqrt(variance))
    return out


def _with_ranges(motion: ObjectMotion, points: MotionPoints) -> ObjectMotion:
    """The motion with the ranges of what it was fitted to."""

    def span(values: Floats) -> tuple[float, float]:
        low, high = np.quantile(values, _RANGE).tolist()
        return low, high

    v_most = float(np.quantile(np.abs(points.v), _RANGE[1]))
    along, across = span(points.a0), span(points.v * points.w0)
    if isinstance(motion, Surfaces):
        ranges = {"v_most": v_most, "a_range": along, "lateral_range": across}
    else:
        ranges = {"v_most": v_most, "along_range": along, "across_range": across}
    return dataclasses.replace(motion, **ranges)  # type: ignore[arg-type]


def _bins(motion: ObjectMotion, points: MotionPoints) -> tuple[MotionBin, ...]:
    """Points in bins of equal number by origin, for both answers."""
    mu, sigma = _normal(motion, points)
    answers, origins = points.answers(motion), points.origins(motion)
    out = []
    for k, what in enumerate(("along", "across") if isinstance(motion, WalkerMotion) else ("a", "w")):
        order = np.argsort(origins[:, k], kind="stable")
        for part in np.array_split(order, BINS):
            own, off = origins[part, k], answers[part, k] - mu[part, k]
            out.append(
                MotionBin(
                    what, float(own.min()), float(own.max()), len(part),
                    float(answers[part, k].mean()), float(mu[part, k].mean()),
                    float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(sigma[part, k] ** 2))),
                )
            )  # fmt: skip
    return tuple(out)
