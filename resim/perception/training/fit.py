"""Does the model fit? Its assumptions, tested on what is left of the errors, and what a failure costs.

Every statistic is judged by how drives differ (`clusters`), and all of them share one risk: for a model that fits, the
probability that anything is told is ALPHA (Bonferroni over all tests). What is surely there but smaller than what
references can show (`NEGLIGIBLE`) is not told.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from scipy.stats import t as student

from resim.core.geometry import Floats
from resim.perception.model import Assumption, Fit, Misfit, Quantity
from resim.perception.parameters import PER, UNITS
from resim.perception.training.clusters import FEWEST, between_drives, by_drive
from resim.perception.training.errors import MEASURED, NEGLIGIBLE, ObjectErrors
from resim.perception.training.residuals import Own, Regression, Residuals, of_mean, of_spread, residuals_of
from resim.perception.training.samples import Samples

ALPHA = 0.05
"""Probability that something is told of a model that fits."""
CLIP = 5.0
"""Standard deviations to which errors count for tails."""
LAG = 0.5
"""Time [s] between errors that are to be independent, beside one list."""
LEAST_SHARE = 0.05
"""Least correlation, and least change of a standard deviation, that is told."""
LEAST_LATE = 0.005
"""Least variation [s] of a latency that is told."""

WORDS = {
    "range": "range", "bearing": "bearing", "relative_speed": "relative speed", "acceleration": "acceleration",
    "speed": "the object's speed", "ego_speed": "the EGO's speed", "braking": "braking", "time": "time in the drive",
}  # fmt: skip
FEATURES_OF = ("range", "bearing", "relative_speed", "acceleration", "speed")
OF = {"ego_speed": "m/s", "time": "s", **{name: UNITS[name] for name in FEATURES_OF}}


def fit_of(samples: Samples, objects: ObjectErrors, own: Mapping[str, Sequence[Own]]) -> Fit:
    """Test the model; own: samples with errors of their own, by quantity. Too few drives test nothing."""
    drives = len(np.unique(samples.drive))
    every = {
        q: residuals_of(samples, objects, q, own.get(q, ()))
        for q in MEASURED
        if objects.fitted[q].spreads is not None
    }
    if drives < FEWEST:
        return Fit(drives=drives)
    tests = [test for q, r in every.items() for test in _tests(q, r, objects)]
    misfits = [m for test in tests for m in test.failures(ALPHA / max(sum(t.count for t in tests), 1))]
    return Fit(
        drives=drives, tests=sum(t.count for t in tests), misfits=tuple(sorted(misfits, key=lambda m: m.p))
    )


def _tests(quantity: Quantity, r: Residuals, objects: ObjectErrors) -> Iterator[_Single | _Dependence]:
    yield _tails(quantity, r)
    lags = {1, max(round(LAG / r.step), 1)}
    yield from (_white(quantity, r, lag) for lag in sorted(lags))
    yield _together(quantity, r)
    yield _latencies(quantity, r)
    yield _Dependence(quantity, r, *of_mean(r), spread=False)
    yield _Dependence(quantity, r, *of_spread(r, objects), spread=True)


class _Single:
    """One statistic: the mean of something over its weight that is 0 in a model that fits.

    sums, weights: (R,) by row; variance: of the sum by the model.
    """

    count = 1

    def __init__(
        self, quantity: Quantity, assumption: Assumption, r: Residuals, sums: Floats, weights: Floats,
        variance: float, *, one_sided: bool, on: str = "",
    ) -> None:  # fmt: skip
        rows = weights > 0.0
        drives = r.drive[rows]
        total, weight = float(sums.sum()), float(weights.sum())
        self.quantity, self.assumption, self.on, self.r = quantity, assumption, on, r
        self.value, self.p = 0.0, 1.0
        if len(np.unique(drives)) < FEWEST:
            self.count = 0
            return
        self.value = total / weight
        by, weigh = by_drive(sums[rows] - self.value * weights[rows], drives), by_drive(weights[rows], drives)
        se = max(
            np.sqrt(variance) / weight,
            float(np.sqrt(between_drives(by[:, None], weigh[:, None, None])[0, 0])),
        )
        z = self.value / se
        self.p = float(student.sf(z if one_sided else abs(z), len(by) - 1)) * (1.0 if one_sided else 2.0)

    def failures(self, level: float) -> Iterator[Misfit]:
        """Give the misfit, where there is one."""
        if self.p < level and (told := self.told()) is not None:
            size, unit, text = told
            yield Misfit(
                quantity=self.quantity, assumption=self.assumption, on=self.on, size=size, unit=unit, p=self.p,
                text=text,
            )  # fmt: skip

    def told(self) -> tuple[float, str, str] | None:
        """Give size, unit and words; None for what is too small."""
        name, unit, r = self.quantity, UNITS[self.quantity], self.r
        typical = float(np.sqrt(np.mean(r.spread[r.known] ** 2)))
        if self.assumption == "tails":
            far, share = _beyond(r)
            text = (
                f"{name} errors have heavy tails: {share:.2%} lie beyond 3 standard deviations, in the model 0.27 %; "
                f"one in a thousand is over {far:.3g} {unit}, in the model over {3.29 * typical:.3g} {unit}"
            )
            return share, "", text
        if self.assumption == "latency":
            size = float(np.sqrt(max(self.value, 0.0)))
            late = r.fitted.aligned.late
            text = f"the latency of {name} differs from object to object, by {size:.3g} s about {late:.3g} s"
            return (size, "s", text) if size > LEAST_LATE else None
        if abs(self.value) < LEAST_SHARE:
            return None
        size = abs(self.value) * typical
        if self.assumption == "together":
            size = float(np.sqrt(abs(self.value))) * typical
            text = (
                f"{name} errors of objects in one list go together (correlation {self.value:+.2f}), in the model they "
                f"do not: {size:.3g} {unit} of {typical:.3g} {unit} is common to them, as from a latency that varies"
            )
        else:
            text = (
                f"{name} errors do not vary in time as the model says: those {self.on} apart keep a correlation of "
                f"{self.value:+.2f} beyond the model's, {size:.3g} {unit} of {typical:.3g} {unit}"
            )
        return size, unit, text


def _beyond(r: Residuals) -> tuple[float, float]:
    """Give the error that one in a thousand exceeds, and the share beyond 3 standard deviations; outliers count."""
    sizes = np.concatenate([np.abs(r.z[r.known]), np.full(int(r.outlier.sum()), np.inf)])
    errors = np.abs(r.fitted.residual[r.known | r.outlier])
    return float(np.quantile(errors, 0.999)), float(np.mean(sizes > 3.0))


def _tails(quantity: Quantity, r: Residuals) -> _Single:
    """The fourth Hermite polynomial of errors, which their variance does not move, clipped: only heavy tails count."""
    z = np.clip(r.z, -CLIP, CLIP)
    value = np.where(
        r.known, z**4 - 6.0 * z**2 + 3.0, np.where(r.outlier, CLIP**4 - 6.0 * CLIP**2 + 3.0, 0.0)
    )
    number = (r.known | r.outlier).sum(axis=1).astype(float)
    return _Single(quantity, "tails", r, value.sum(axis=1), number, 24.0 * number.sum(), one_sided=True)


def _white(quantity: Quantity, r: Residuals, lag: int) -> _Single:
    """Products of errors a lag apart."""
    both = r.known[:, lag:] & r.known[:, :-lag]
    products = np.where(both, r.z[:, lag:] * r.z[:, :-lag], 0.0).sum(axis=1)
    number = both.sum(axis=1).astype(float)
    return _Single(
        quantity, "white", r, products, number, number.sum(), one_sided=False, on=f"{lag * r.step:.2g} s"
    )


def _together(quantity: Quantity, r: Residuals) -> _Single:
    """Products of errors of two objects in one list; a list's are laid to the first row of its drive."""
    sums, pairs = np.zeros(len(r.drive)), np.zeros(len(r.drive))
    for drive in np.unique(r.drive):
        rows = np.flatnonzero(r.drive == drive)
        known = r.known[rows]
        lists = np.unique(np.round(r.t[rows][known], 6), return_inverse=True)[1]
        z = r.z[rows][known]
        one, square, number = (np.bincount(lists, v) for v in (z, z**2, np.ones(len(z))))
        sums[rows[0]], pairs[rows[0]] = ((one**2 - square) / 2.0).sum(), (number * (number - 1.0) / 2.0).sum()
    return _Single(quantity, "together", r, sums, pairs, pairs.sum(), one_sided=True)


def _latencies(quantity: Quantity, r: Residuals) -> _Single:
    """How far apart the latencies of single objects are, beyond chance: their squares less what noise makes of them."""
    x = np.stack([r.columns["constant"], r.columns["latency"]], axis=-1)
    normal, right = np.einsum("rti,rtj->rij", x, x), np.einsum("rti,rt->ri", x, r.z)
    safe = np.maximum(normal[:, 0, 0], 1e-12)
    score = right[:, 1] - normal[:, 0, 1] * right[:, 0] / safe
    known = np.maximum(normal[:, 1, 1] - normal[:, 0, 1] ** 2 / safe, 0.0)
    score = score - known * score.sum() / max(float(known.sum()), 1e-12)
    known = np.where(known > 1e-3 * known.max(initial=0.0), known, 0.0)
    sums = np.where(known > 0.0, score**2 - known, 0.0)
    return _Single(quantity, "latency", r, sums, known**2, float(2.0 * (known**2).sum()), one_sided=True)


class _Dependence:
    """What errors, or their spread, depend on beyond the model: the most telling first, then what it leaves."""

    def __init__(
        self, quantity: Quantity, r: Residuals, regression: Regression, base: list[str], *, spread: bool
    ) -> None:
        self.quantity, self.r, self.regression, self.base, self.spread = quantity, r, regression, base, spread
        self.drives = len(regression.normal)
        self.first = self.looked(base) if self.drives >= FEWEST else {}
        self.count = len(self.first)

    def looked(self, base: Sequence[str]) -> dict[str, tuple[float, Floats, Floats]]:
        """Give p, coefficients and standard errors of each that is not in the base."""
        out = {}
        for name in self.regression.names:
            known = any(name.startswith("braking") and b.startswith("braking") for b in base)
            if known or name in base or (found := self.regression.judged(base, name)) is None:
                continue
            z = found[0][-1] / found[1][-1]
            varies = self.spread and name == "latency"
            p = student.sf(z, self.drives - 1) if varies else 2.0 * student.sf(abs(z), self.drives - 1)
            out[name] = (float(p), *found)
        return out

    def failures(self, level: float) -> Iterator[Misfit]:
        """Give what is surely there, and no trifle."""
        base, looked = list(self.base), self.first
        while looked:
            name = min(looked, key=lambda n: looked[n][0])
            if name == "ego_speed" and looked.get("speed", (1.0,))[0] < level:
                name = (
                    "speed"  # both differ by the relative speed only; an object's own is the likelier cause
                )
            p, found, se = looked[name]
            if p >= level:
                return
            told = (
                self.of_spread(name, float(found[-1])) if self.spread else self.of_mean(name, base, found, se)
            )
            if told is not None:
                assumption: Assumption = "spread" if self.spread else "bias"
                assumption = "latency" if self.spread and name == "latency" else assumption
                size, unit, text = told
                yield Misfit(
                    quantity=self.quantity,
                    assumption=assumption,
                    on="braking" if name.startswith("braking") else name,
                    size=size,
                    unit=unit,
                    p=p,
                    text=text,
                )
            base.append(name)
            looked = self.looked(base)

    def of_mean(
        self, name: str, base: Sequence[str], found: Floats, se: Floats
    ) -> tuple[float, str, str] | None:
        """Give size, unit and words of a dependence of the mean."""
        own, slope = UNITS[self.quantity], float(found[-1])
        low, high = self.span(name)
        size = abs(slope) * (high - low)
        if size < NEGLIGIBLE[self.quantity]:
            return None
        if name.startswith("braking"):
            text = f"{self.quantity} error is off by {slope:+.3g} {own} while an object brakes"
        else:
            per = PER[own, OF[name]] if (own, OF[name]) in PER else f"{own}/{OF[name]}"
            scale = f" ({slope:+.1%})" if name == "speed" == self.quantity else ""
            text = (
                f"{self.quantity} error depends on {WORDS[name]}: {slope:+.3g} {per}{scale}, {size:.3g} {own} between "
                f"{low:.3g} and {high:.3g} {OF[name]}"
            )
        at = list(base).index("latency") if "latency" in base else None
        if at is not None and abs(found[at]) > max(3.0 * se[at], 0.01):
            late = self.r.fitted.aligned.late
            text += (
                f"; taken for latency: that would be about {late + found[at]:.3g} s instead of {late:.3g} s"
            )
        return size, own, text

    def of_spread(self, name: str, slope: float) -> tuple[float, str, str] | None:
        """Give size, unit and words of a dependence of the spread."""
        own, r = UNITS[self.quantity], self.r
        typical = float(np.sqrt(np.mean(r.spread[r.known] ** 2)))
        if name == "latency":
            size = float(np.sqrt(max(slope, 0.0)))
            text = f"the latency of {self.quantity} varies by {size:.3g} s from list to list"
            return (size, "s", text) if size > LEAST_LATE else None
        low, high = self.span(name)
        values = self.values(name)[r.known]
        ends = [float(np.sqrt(max(1.0 + slope * (end - values.mean()), 0.01))) for end in (low, high)]
        size = abs(ends[1] - ends[0]) * typical
        if abs(ends[1] - ends[0]) < LEAST_SHARE or size < NEGLIGIBLE[self.quantity]:
            return None
        if name == "braking":
            where = "while an object brakes, else"
        else:
            where = f"at {WORDS[name]} of {high:.3g} {OF[name]}, at {low:.3g} {OF[name]}"
        text = (
            f"spread of {self.quantity} errors depends on {WORDS[name]}: {ends[1]:.2f} times the model's {where} "
            f"{ends[0]:.2f} times, of {typical:.3g} {own}"
        )
        return size, own, text

    def values(self, name: str) -> Floats:
        """Give the variable (R, T) as it enters."""
        raw = self.r.raw[name]
        return np.abs(raw) if self.spread and name in ("bearing", "relative_speed", "acceleration") else raw

    def span(self, name: str) -> tuple[float, float]:
        """Give the values between which 90 % lie."""
        values = self.values(name)[self.r.known]
        if name.startswith("braking"):
            return 0.0, 1.0
        low, high = np.quantile(values, (0.05, 0.95))
        return float(low), float(high)
