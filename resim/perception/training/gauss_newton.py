"""Latency, averaging and bias at once: generalised least squares over lags that need not be whole samples.

Latency and bias are found together: at constant speed an offset along the way and a latency of the position look the
same, and their intervals say so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.perception.training.alignment import PRIOR, AlignmentProblem, AlignmentResult
from resim.perception.training.clusters import FEWEST, between_drives, by_drive, certain, larger, quantile
from resim.perception.training.whiten import whiten

SURE, SOME = 3.0, 2.0
"""Standard errors, of many drives, by which a bias differs from none to depend on a feature, and an averaging time to
be one."""
TINY = 1e-30
"""Variance where there is none: without noise rounding may leave less than 0."""
LATEST_OF_ALL = 3.0
"""Largest latency [s] that is found."""
_D_LATE, _D_OVER = 0.01, 0.02  # s, s²; steps of the derivatives


def align(task: AlignmentProblem, late: float, over: float = 0.0) -> AlignmentResult:
    """Refine the latency from a start, with the averaging time and the biases; features that tell nothing go.

    Gauss-Newton; late >= 0, 0 <= over <= 2 late.
    """
    solver = _Solver(task, late, over)
    solver.converge()
    while unsure := solver.unsure():
        for column in unsure:
            solver.drop(column)
        solver.converge(4)
    return solver.result()


@dataclass(frozen=True)
class _Column:
    """component -1: of all, column 0 the latency, 1 the square of the averaging time; else a bias: 0 the constant."""

    component: int
    column: int


class _Solver:
    def __init__(self, task: AlignmentProblem, late: float, over: float) -> None:
        self.task, self.late, self.square = task, late, over**2
        self.columns = [_Column(-1, 0)] + ([_Column(-1, 1)] if task.averages else [])
        self.middle, self.width = [], []
        features = task.features
        for c, component in enumerate(task.components):
            used = features[np.isfinite(component.measured) & np.isfinite(features).all(axis=-1)]
            middle = used.mean(axis=0) if len(used) else np.zeros(features.shape[-1])
            width = used.std(axis=0) if len(used) else np.zeros(features.shape[-1])
            self.middle.append(middle)
            self.width.append(np.where(width > 1e-6 * (1.0 + np.abs(middle)), width, 0.0))
            self.columns += [_Column(c, 0)] + [
                _Column(c, f + 1) for f in np.flatnonzero(self.width[c]).tolist()
            ]
        self.unsure_square: tuple[float, float] | None = None
        known = np.stack([np.isfinite(c.measured).any(axis=1) for c in task.components]).any(axis=0)
        self.used = np.flatnonzero(known)
        self.drives = len(np.unique(task.group[self.used]))

    @property
    def over(self) -> float:
        return float(np.sqrt(self.square))

    def converge(self, rounds: int = 12) -> None:
        """Step until the latency stays; bounds are kept, and a step that helps nobody is halved."""
        for _ in range(rounds):
            self.linearise()
            late = float(np.clip(self.late + np.clip(self.solution[0], -0.3, 0.3), 0.0, LATEST_OF_ALL))
            square = self.square
            if _Column(-1, 1) in self.columns:
                square = float(
                    np.clip(self.square + np.clip(self.solution[1], -0.5, 0.5), 0.0, 4.0 * late**2)
                )
            moved = max(abs(late - self.late), abs(np.sqrt(square) - self.over))
            self.late, self.square = late, square
            if moved < 1e-4:
                break
        self.linearise(settled=True)

    def linearise(self, *, settled: bool = False) -> None:
        """Set up the normal equations at the present latency, row by row, and solve them.

        settled: for the biases that belong to this latency, no step of it more.
        """
        late, over = self.late, self.over
        now, features = self.task.errors(late, over), self.task.features
        # errors fall as what is expected grows: derivative of the expected value by the latency, less that
        by_late = [
            (a - b) / _D_LATE for a, b in zip(now, self.task.errors(late + _D_LATE, over), strict=True)
        ]
        by_square = [np.zeros_like(e) for e in now]
        if _Column(-1, 1) in self.columns:
            wider = self.task.errors(late, float(np.sqrt(self.square + _D_OVER)))
            by_square = [(a - b) / _D_OVER for a, b in zip(now, wider, strict=True)]
        n = len(self.columns)
        rows = now[0].shape[0]
        self.normal, self.gradient = np.zeros((rows, n, n)), np.zeros((rows, n))
        self.white = []
        for c, component in enumerate(self.task.components):
            own = [k for k, column in enumerate(self.columns) if column.component in (-1, c)]
            design = np.stack(
                [self._column(self.columns[k], c, features, by_late, by_square) for k in own], axis=-1
            )
            known = np.isfinite(now[c]) & np.isfinite(design).all(axis=-1)
            table = np.concatenate([now[c][..., None], design], axis=-1)
            white = whiten(
                np.where(known[..., None], table, 0.0), known, self.task.steps, component.drift, component.noise,
                component.tau,
            )  # fmt: skip
            y, x = white[..., 0], white[..., 1:]
            self.white.append((own, y, x))
            self.normal[np.ix_(range(rows), own, own)] += np.einsum("rti,rtj->rij", x, x)
            self.gradient[:, own] += np.einsum("rti,rt->ri", x, y)
        self._solve(now, settled)

    def _column(
        self, column: _Column, c: int, features: Floats, by_late: list[Floats], by_square: list[Floats]
    ) -> Floats:
        if column.component < 0:
            return by_late[c] if column.column == 0 else by_square[c]
        if column.column == 0:
            return np.where(np.isfinite(features).all(axis=-1), 1.0, np.nan)
        f = column.column - 1
        return np.asarray((features[..., f] - self.middle[c][f]) / self.width[c][f])

    def _solve(self, now: list[Floats], settled: bool) -> None:
        n = len(self.columns)
        total = self.normal.sum(axis=0)
        held, pull = np.zeros(n), np.zeros(n)
        held[0], pull[0] = (1e12, 0.0) if self.task.fixed else (PRIOR**-2.0, -self.late * PRIOR**-2.0)
        scale = [max(float(np.sqrt(np.nanmean(e**2))), 1e-9) for e in now]
        for k, column in enumerate(self.columns):
            if column.component >= 0:
                held[k] = (100.0 * scale[column.component]) ** -2.0
            elif column.column == 1:
                held[k], pull[k] = 4.0**-2.0, -self.square * 4.0**-2.0
        hessian, right = total + np.diag(held), self.gradient.sum(axis=0) + pull
        inverse = _inverse(hessian)
        self.solution = self._within_bounds(hessian, inverse, right, settled)
        self.covariance = self._covariance(inverse, held)

    def _within_bounds(self, hessian: Floats, inverse: Floats, right: Floats, settled: bool) -> Floats:
        """Give the solution; where it steps out of a bound, that step ends there and the biases make up for it."""
        solution: Floats = inverse @ right
        least, most = np.zeros(2), np.zeros(2)
        if not settled:
            least = np.array([-self.late, -self.square])
            most = np.array([LATEST_OF_ALL - self.late, 4.0 * self.late**2 - self.square])
        lags = [k for k, column in enumerate(self.columns) if column.component < 0]
        if bound := [k for k in lags if not least[k] <= solution[k] <= most[k]]:
            free = [k for k in range(len(solution)) if k not in bound]
            solution[bound] = np.clip(solution[bound], least[bound], most[bound])
            rest = right[free] - hessian[np.ix_(free, bound)] @ solution[bound]
            solution[free] = _inverse(hessian[np.ix_(free, free)]) @ rest
        return solution

    def _covariance(self, model: Floats, held: Floats) -> Floats:
        """Give the larger of what the model of the errors says and what drives differ by."""
        if self.drives < FEWEST:
            return model
        left = self.gradient - np.einsum("rij,j->ri", self.normal, self.solution)
        scores, information = (
            by_drive(v[self.used], self.task.group[self.used]) for v in (left, self.normal)
        )
        return larger(model, between_drives(scores, information, np.diag(held)))

    def over_limits(self, se: Floats) -> tuple[float, float]:
        """Give where the averaging time is, 95 %; found too unsure to be one, it may still be one."""
        square, spread = self.square, float(se[1]) if _Column(-1, 1) in self.columns else 0.0
        if self.unsure_square is not None:
            square, spread = self.unsure_square
        half = quantile(self.drives)
        low, high = (float(np.sqrt(max(square + k * spread, 0.0))) for k in (-half, half))
        return (0.0 if self.unsure_square else low), high

    def unsure(self) -> list[_Column]:
        """Give what is to go: the feature, or the averaging, that tells least, with all that tell next to nothing."""
        se = np.sqrt(np.maximum(np.diag(self.covariance), TINY))
        sure, some = (certain(z, self.drives) for z in (SURE, SOME))
        unsure: dict[_Column, float] = {}
        for k, column in enumerate(self.columns):
            if column.component >= 0 and column.column > 0:
                unsure[column] = abs(float(self.solution[k])) / se[k]
            elif column.component < 0 and column.column == 1:
                unsure[column] = self.square / se[k] * sure / some
        nothing = [c for c, z in unsure.items() if z < 1.0]
        worst = min(unsure, key=lambda c: unsure[c], default=None)
        return nothing or ([worst] if worst is not None and unsure[worst] < sure else [])

    def drop(self, column: _Column) -> None:
        """Take a feature or the averaging out."""
        self.columns.remove(column)
        if column == _Column(-1, 1):
            self.unsure_square = self.square, float(np.sqrt(self.covariance[1, 1]))
            self.square = 0.0

    def result(self) -> AlignmentResult:
        """Give all in the units of quantities and features."""
        se = np.sqrt(np.maximum(np.diag(self.covariance), TINY))
        biases, errors, residuals, means = [], [], [], []
        now, features = self.task.errors(self.late, self.over), self.task.features
        for c in range(len(now)):
            bias, error = np.zeros(features.shape[-1] + 1), np.zeros(features.shape[-1] + 1)
            constant = np.zeros(len(self.columns))
            for k, column in enumerate(self.columns):
                if column.component != c:
                    continue
                if column.column == 0:
                    bias[0] += self.solution[k]
                    constant[k] = 1.0
                    means.append(float(se[k]))
                    continue
                f = column.column - 1
                bias[f + 1] = self.solution[k] / self.width[c][f]
                error[f + 1] = se[k] / self.width[c][f]
                bias[0] -= bias[f + 1] * self.middle[c][f]
                constant[k] = -self.middle[c][f] / self.width[c][f]
            error[0] = np.sqrt(max(float(constant @ self.covariance @ constant), TINY))
            residuals.append(now[c] - bias[0] - (features @ bias[1:] if bias[1:].any() else 0.0))
            biases.append(bias)
            errors.append(error)
        return AlignmentResult(
            self.late,
            self.over,
            float(se[0]),
            self.over_limits(se),
            tuple(biases),
            tuple(errors),
            tuple(means),
            tuple(residuals),
        )


def _inverse(matrix: Floats) -> Floats:
    """Give the inverse of a positive definite matrix, also where rounding has left it next to singular."""
    scale = np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale[None, :])
    values = np.maximum(values, len(values) * np.finfo(float).eps * values[-1])
    return np.asarray((vectors / values) @ vectors.T / scale[:, None] / scale[None, :])
