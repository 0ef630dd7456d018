"""How far errors spread: drift and white noise by maximum likelihood, with what they depend on.

The likelihood takes finite records as they are: no autocovariance has to be corrected for the mean that was taken
out of each. Features are tried one after the other, the one with the largest score first, and stay if the fit with
them earns it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from resim.core.geometry import Bools, Floats
from resim.perception.training.clusters import FEWEST, between_drives, by_drive, certain, larger
from resim.perception.training.whiten import log_likelihood

SURE = 3.3
"""Standard errors, of many drives, by which a dependence differs from none to be in a model: once in a thousand by
chance."""
WORTH = 2.0
"""Standard errors by which its score differs from none for a dependence to be tried."""
GAIN = 10.8
"""Twice the log-likelihood that a part has to earn: the same."""
LASTING, LONGEST = 1e4, 1e7
"""Correlation time over the duration of the longest record, and in s, at most: an offset that an object has for good.
"""
LEAST = 1e-3
"""Share of the whole spread below which a part is none."""


@dataclass(frozen=True, eq=False)
class SpreadProblem:
    """Residuals (R, T) with where they are known, steps [s], what they may depend on (R, T, F, not negative), and
    the drive of each row."""

    residual: Floats
    known: Bools
    steps: Floats
    features: Floats
    group: NDArray[np.intp]


@dataclass(frozen=True)
class Spreads:
    """drift, noise: log of the standard deviation at features 0, and slopes by feature index; tau [s].

    se: standard errors by name ("drift", "noise", "tau" (of its log), "drift.0", ...); drift and noise None: none.
    """

    drift: float | None
    noise: float | None
    tau: float
    drift_by: dict[int, float] = field(default_factory=dict)
    noise_by: dict[int, float] = field(default_factory=dict)
    se: dict[str, float] = field(default_factory=dict)
    loglik: float = 0.0

    def levels(self, features: Floats) -> tuple[Floats, Floats]:
        """Give the standard deviations of drift and noise (R, T)."""
        parts = []
        for level, by in ((self.drift, self.drift_by), (self.noise, self.noise_by)):
            log = np.full(features.shape[:2], -np.inf if level is None else level)
            for f, slope in by.items():
                log = log + slope * features[..., f]
            parts.append(np.exp(np.where(np.isfinite(log), log, -np.inf)))
        return parts[0], parts[1]


def fit_spreads(problem: SpreadProblem, *, select: bool = True, final: bool = True) -> Spreads | None:
    """Fit; None where the residuals are all but nothing.

    select: whether features may enter. final: whether what is not needed goes, and standard errors are given.
    """
    known = problem.known
    if known.sum() < 3 or (scale := float(np.std(problem.residual[known]))) < 1e-9:
        return None
    fitter = _Fitter(problem, scale)
    best = fitter.best() if final else fitter.both()
    if select:
        best = fitter.with_features(best)
    return fitter.result(best, errors=final)


@dataclass(frozen=True, eq=False)
class _FreeParameters:
    """Names of the free parameters, and their values."""

    names: tuple[str, ...]
    values: Floats
    loglik: float


class _Fitter:
    """Parameters by name: "drift", "noise" (logs, of the scaled residual), "tau" (log), "drift.f", "noise.f"."""

    def __init__(self, problem: SpreadProblem, scale: float) -> None:
        self.problem, self.scale = problem, scale
        known = problem.known
        used = problem.features[known]
        self.middle, width = used.mean(axis=0), used.std(axis=0)
        self.width = np.where(width > 1e-6 * (1.0 + np.abs(self.middle)), width, 0.0)
        safe = np.where(self.width > 0.0, self.width, 1.0)
        z = (problem.features - self.middle) / safe
        self.z = np.where(known[..., None], z, 0.0)
        self.y = np.where(known, problem.residual, 0.0) / scale
        self.drives = len(np.unique(problem.group[known.any(axis=1)]))
        duration = float(np.max(np.where(known, np.cumsum(problem.steps, axis=1), 0.0)))
        step = float(np.median(problem.steps[:, 1:][known[:, 1:]])) if known[:, 1:].any() else 0.04
        self.limits = {"tau": (np.log(0.5 * step), np.log(np.clip(LASTING * duration, 2.0 * step, LONGEST)))}
        self.tau_0 = np.log(np.clip(0.1 * duration, 2.0 * step, 2.0))

    def both(self) -> _FreeParameters:
        """Drift and noise."""
        return self.fit(("drift", "noise", "tau"), np.array([-0.3, -1.0, self.tau_0]))

    def best(self) -> _FreeParameters:
        """Drift and noise, or the one of them that is enough."""
        both = self.both()
        alone = [
            self.fit(("noise",), np.array([0.0])),
            self.fit(("drift", "tau"), np.array([0.0, both.values[2]])),
        ]
        enough = [s for s in alone if 2.0 * (both.loglik - s.loglik) < GAIN]
        levels = dict(zip(both.names, both.values, strict=True))
        if levels["noise"] < np.log(LEAST):
            return alone[1]
        return max(enough, key=lambda s: s.loglik) if enough else both

    def fit(self, names: tuple[str, ...], start: Floats) -> _FreeParameters:
        """Maximise the likelihood over these parameters."""
        bounds = [self.limits.get(n, (-9.0, 4.0) if n in ("drift", "noise") else (-1.5, 1.5)) for n in names]

        def value(p: Floats) -> tuple[float, Floats]:
            total = self.rows(names, np.vstack([p, p + 1e-5 * np.eye(len(p))])).sum(axis=1)
            return -float(total[0]), -(total[1:] - total[0]) / 1e-5

        found = minimize(
            value, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60, "ftol": 1e-9}
        )
        return _FreeParameters(names, np.asarray(found.x), -float(found.fun))

    def rows(self, names: tuple[str, ...], sets: Floats) -> Floats:
        """Give the log-likelihood (B, R) of each row for sets (B, P)."""
        p = self.problem
        log = {
            "drift": np.full((len(sets), *self.y.shape), -20.0),
            "noise": np.full((len(sets), *self.y.shape), -20.0),
        }
        tau = np.ones(len(sets))
        for k, name in enumerate(names):
            part, _, feature = name.partition(".")
            if part == "tau":
                tau = np.exp(sets[:, k])
            elif feature:
                log[part] = log[part] + sets[:, k, None, None] * self.z[..., int(feature)]
            else:
                log[part] = log[part] + 20.0 + sets[:, k, None, None]
        return log_likelihood(self.y, p.known, p.steps, np.exp(log["drift"]), np.exp(log["noise"]), tau)

    def row_scores(self, state: _FreeParameters) -> Floats:
        """Give the derivative (R, P) of each row's log-likelihood by the parameters."""
        n = len(state.values)
        sets = np.vstack([state.values + 1e-4 * np.eye(n), state.values - 1e-4 * np.eye(n)])
        rows = self.rows(state.names, sets)
        return np.asarray((rows[:n] - rows[n:]).T / 2e-4)

    def with_features(self, state: _FreeParameters) -> _FreeParameters:
        """Let features in, one after the other, the most telling first, as long as one keeps its word."""
        for _ in range(4):
            more = next((m for m in self.trials(state) if self.earned(m, state)), None)
            if more is None:
                break
            state = more
        return state

    def trials(self, state: _FreeParameters) -> Iterator[_FreeParameters]:
        """Give the fits with one dependence more, in the order of their scores."""
        free = [
            f"{part}.{f}"
            for part in ("drift", "noise")
            if part in state.names
            for f in np.flatnonzero(self.width > 0.0)
            if f"{part}.{f}" not in state.names
        ]
        scores = dict(zip(free, self.gains(state, free), strict=True))
        for name in sorted(free, key=lambda n: -scores[n]):
            if scores[name] > WORTH:
                yield self.fit((*state.names, name), np.append(state.values, 0.0))

    def earned(self, more: _FreeParameters, state: _FreeParameters) -> bool:
        """Whether the last parameter surely differs from none, by the likelihood and by how drives differ."""
        return 2.0 * (more.loglik - state.loglik) >= GAIN and bool(
            abs(more.values[-1]) >= certain(SURE, self.drives) * self.errors(more)[-1]
        )

    def gains(self, state: _FreeParameters, free: list[str]) -> list[float]:
        """Give by how many standard errors the scores of these parameters, at 0, differ from none.

        What the scores of the state's own explain of it is taken out, as they vary from row to row.
        """
        if not free:
            return []
        n = len(state.values)
        rows = self.row_scores(
            _FreeParameters((*state.names, *free), np.append(state.values, np.zeros(len(free))), state.loglik)
        )
        own = rows[:, n:] - rows[:, :n] @ np.linalg.lstsq(rows[:, :n], rows[:, n:], rcond=None)[0]
        spread = np.sqrt(np.maximum((own**2).sum(axis=0), 1e-12))
        return [float(z) for z in np.abs(own.sum(axis=0)) / spread]

    def information(self, state: _FreeParameters) -> Floats:
        """Give minus the second derivatives (R, P, P) of each row's log-likelihood."""
        n, d = len(state.values), 2e-3
        eye = d * np.eye(n)
        one, other = np.triu_indices(n)
        sets = np.concatenate(
            [state.values + a * eye[one] + b * eye[other] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        )
        parts = np.array_split(sets, max(1, len(sets) // 12))
        pp, pm, mp, mm = np.split(np.concatenate([self.rows(state.names, part) for part in parts]), 4)
        h = np.zeros((pp.shape[1], n, n))
        h[:, one, other] = h[:, other, one] = -(pp - pm - mp + mm).T / (4.0 * d * d)
        return h

    def errors(self, state: _FreeParameters) -> Floats:
        """Give the standard errors (P,): the larger of the model's and those between drives."""
        return np.sqrt(np.diag(self.covariance(state)))

    def covariance(self, state: _FreeParameters) -> Floats:
        rows = self.information(state)
        h = rows.sum(axis=0)
        floor = 1e-6 * max(float(np.trace(h)), 1e-6)
        values, vectors = np.linalg.eigh(0.5 * (h + h.T))
        model: Floats = (vectors / np.maximum(values, floor)) @ vectors.T
        if self.drives < FEWEST:
            return model
        known = self.problem.known.any(axis=1)
        scores, information = (
            by_drive(v[known], self.problem.group[known]) for v in (self.row_scores(state), rows)
        )
        return larger(model, between_drives(scores, information))

    def result(self, state: _FreeParameters, *, errors: bool) -> Spreads:
        """Give the parameters in the units of residuals and features."""
        at = dict(zip(state.names, state.values.tolist(), strict=True))
        covariance = self.covariance(state) if errors else np.zeros((len(at), len(at)))
        place = {n: k for k, n in enumerate(state.names)}
        out: dict[str, dict[int, float]] = {"drift": {}, "noise": {}}
        level: dict[str, float | None] = {"drift": None, "noise": None}
        se = {}
        for part in out:
            if part not in at:
                continue
            log, direction = at[part] + float(np.log(self.scale)), np.zeros(len(place))
            direction[place[part]] = 1.0
            for name, value in at.items():
                if name.startswith(part + "."):
                    f = int(name.partition(".")[2])
                    out[part][f] = value / float(self.width[f])
                    log -= out[part][f] * float(self.middle[f])
                    direction[place[name]] = -float(self.middle[f] / self.width[f])
                    se[name] = float(np.sqrt(covariance[place[name], place[name]]) / self.width[f])
            level[part] = log
            se[part] = float(np.sqrt(direction @ covariance @ direction))
        if "tau" in at:
            se["tau"] = float(np.sqrt(covariance[place["tau"], place["tau"]]))
        return Spreads(
            level["drift"],
            level["noise"],
            float(np.exp(at.get("tau", 0.0))),
            out["drift"],
            out["noise"],
            se,
            state.loglik,
        )
