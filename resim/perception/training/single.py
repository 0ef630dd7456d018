"""Single statistics of what is left of the errors: tails, whiteness in time, independence of objects, one latency."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from resim.core.geometry import Floats
from resim.perception.model import Assumption, FailedAssumption, Quantity
from resim.perception.parameters import UNITS
from resim.perception.training.clusters import FEWEST, between_drives, by_drive, drive_effect
from resim.perception.training.errors import NEGLIGIBLE
from resim.perception.training.residuals import Residuals

CLIP = 5.0
"""Standard deviations to which errors count for tails."""
NORMAL = 0.0027
"""Share of normal errors beyond 3 standard deviations."""
LEAST_SHARE = 0.05
"""Least correlation, and least change of a standard deviation, that is told."""
LEAST_LEVEL = 0.1
"""Least change of a standard deviation from drive to drive that is told."""
FEWEST_SAMPLES = 10
"""Samples of an object below which the size of its errors says little."""
LEAST_LATE = 0.005
"""Least variation [s] of a latency that is told."""


ONE_DRIVE = "one drive"
"""On what errors are together that all objects of a drive share."""


@dataclass(frozen=True, eq=False)
class SingleStatistic:
    """One statistic that is 0 in a model that fits.

    Attributes:
        quantity: Of which errors.
        assumption: What it tests.
        r: The residuals.
        value: The statistic.
        p: The chance of one so large where the model fits.
        on: Over what.
        count: 1, or 0 where there was nothing to test.
    """

    quantity: Quantity
    assumption: Assumption
    r: Residuals
    value: float = 0.0
    p: float = 1.0
    on: str = ""
    count: int = 1

    def failures(self, level: float) -> Iterator[FailedAssumption]:
        """Give the misfit, where there is one."""
        if self.p < level and (told := self.told()) is not None:
            size, unit, text = told
            yield FailedAssumption(
                quantity=self.quantity, assumption=self.assumption, on=self.on, size=size, unit=unit, p=self.p,
                text=text,
            )  # fmt: skip

    def told(self) -> tuple[float, str, str] | None:
        """Give size, unit and words; None for what is too small."""
        name, unit, r = self.quantity, UNITS[self.quantity], self.r
        typical = float(np.sqrt(np.mean(r.spread[r.known] ** 2)))
        if self.assumption == "tails":
            far, share = _beyond(r)
            if share <= NORMAL:
                return None
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
        if self.on == ONE_DRIVE and self.assumption == "spread":
            size = float(np.exp(0.5 * np.sqrt(max(self.value, 0.0)))) - 1.0
            text = (
                f"{name} errors are larger in some drives than in others, by {size:.0%} from drive to drive, as by "
                "weather; in the model all drives are alike"
            )
            return (size, "", text) if size > LEAST_LEVEL else None
        if self.on == ONE_DRIVE:
            size = float(np.sqrt(max(self.value, 0.0)))
            text = (
                f"{name} errors of all objects of a drive have an offset in common, which differs from drive to drive "
                f"by {size:.3g} {unit}, as by a calibration; in the model the errors of each object are its own"
            )
            return (size, unit, text) if size >= NEGLIGIBLE[self.quantity] else None
        if abs(self.value) < LEAST_SHARE:
            return None
        size = abs(self.value) * typical
        if self.assumption == "together":
            size = float(np.sqrt(abs(self.value))) * typical
            text = (
                f"{name} errors of objects in one list are correlated ({self.value:+.2f}), in the model they "
                f"are not: {size:.3g} {unit} of {typical:.3g} {unit} is common to them, as from a latency that varies"
            )
        else:
            text = (
                f"{name} errors do not vary in time as in the model: those {self.on} apart keep a correlation of "
                f"{self.value:+.2f} beyond the model's, {size:.3g} {unit} of {typical:.3g} {unit}"
            )
        return size, unit, text


def _scaled(r: Residuals) -> Floats:
    """Give the errors (R, T) over their own standard deviation: spreads taken from the variogram may be another's."""
    own = float(np.sqrt(np.mean(r.z[r.known] ** 2))) if r.known.any() else 1.0
    return np.asarray(r.z / max(own, 1e-9))


def _beyond(r: Residuals) -> tuple[float, float]:
    """Give the error that one in a thousand exceeds, and the share beyond 3 standard deviations; outliers count."""
    sizes = np.concatenate([np.abs(_scaled(r)[r.known]), np.full(int(r.outlier.sum()), np.inf)])
    errors = np.abs(r.fitted.residual[r.known | r.outlier])
    return float(np.quantile(errors, 0.999)), float(np.mean(sizes > 3.0))


def _mean(
    quantity: Quantity, assumption: Assumption, r: Residuals, sums: Floats, weights: Floats,
    variance: float, *, one_sided: bool, on: str = "",
) -> SingleStatistic:  # fmt: skip
    """Give the mean of something over its weight.

    sums, weights: (R,) by row; variance: of the sum by the model.
    """
    rows = weights > 0.0
    drives = r.drive[rows]
    total, weight = float(sums.sum()), float(weights.sum())
    if len(np.unique(drives)) < FEWEST:
        return SingleStatistic(quantity, assumption, r, on=on, count=0)
    value = total / weight
    by, weigh = by_drive(sums[rows] - value * weights[rows], drives), by_drive(weights[rows], drives)
    se = max(
        np.sqrt(variance) / weight, float(np.sqrt(between_drives(by[:, None], weigh[:, None, None])[0, 0]))
    )
    z = value / se
    p = float(student.sf(z if one_sided else abs(z), len(by) - 1)) * (1.0 if one_sided else 2.0)
    return SingleStatistic(quantity, assumption, r, value, p, on)


def tails(quantity: Quantity, r: Residuals) -> SingleStatistic:
    """The fourth Hermite polynomial of errors, which their variance does not move, clipped: only heavy tails count."""
    z = np.clip(_scaled(r), -CLIP, CLIP)
    value = np.where(
        r.known, z**4 - 6.0 * z**2 + 3.0, np.where(r.outlier, CLIP**4 - 6.0 * CLIP**2 + 3.0, 0.0)
    )
    number = (r.known | r.outlier).sum(axis=1).astype(float)
    return _mean(quantity, "tails", r, value.sum(axis=1), number, 24.0 * number.sum(), one_sided=True)


def white(quantity: Quantity, r: Residuals, lag: int) -> SingleStatistic:
    """Products of errors a lag apart."""
    both = r.known[:, lag:] & r.known[:, :-lag]
    z = _scaled(r)
    products = np.where(both, z[:, lag:] * z[:, :-lag], 0.0).sum(axis=1)
    number = both.sum(axis=1).astype(float)
    return _mean(
        quantity, "white", r, products, number, number.sum(), one_sided=False, on=f"{lag * r.step:.2g} s"
    )


def together(quantity: Quantity, r: Residuals) -> SingleStatistic:
    """Products of errors of two objects in one list; a list's are laid to the first row of its drive."""
    sums, pairs, scaled = np.zeros(len(r.drive)), np.zeros(len(r.drive)), _scaled(r)
    for drive in np.unique(r.drive):
        rows = np.flatnonzero(r.drive == drive)
        known = r.known[rows]
        lists = np.unique(np.round(r.t[rows][known], 6), return_inverse=True)[1]
        z = scaled[rows][known]
        one, square, number = (np.bincount(lists, v) for v in (z, z**2, np.ones(len(z))))
        sums[rows[0]], pairs[rows[0]] = ((one**2 - square) / 2.0).sum(), (number * (number - 1.0) / 2.0).sum()
    return _mean(quantity, "together", r, sums, pairs, pairs.sum(), one_sided=True)


def common_offset(quantity: Quantity, r: Residuals) -> SingleStatistic:
    """Do the mean errors of objects differ more from drive to drive than within one? Each object has the weight that
    the model gives its mean."""
    constant = r.columns["constant"]
    known = np.einsum("rt,rt->r", constant, constant)
    mean = np.einsum("rt,rt->r", constant, r.z) / np.maximum(known, 1e-300)
    return _of_drives(quantity, "together", r, mean, known)


def common_spread(quantity: Quantity, r: Residuals) -> SingleStatistic:
    """Do the sizes of errors differ more from drive to drive than from object to object within one?"""
    number = r.known.sum(axis=1).astype(float)
    square = np.where(r.known, np.minimum(r.z**2, CLIP**2), 0.0).sum(axis=1)
    level = np.log(np.maximum(square / np.maximum(number, 1.0), 1e-3))
    return _of_drives(quantity, "spread", r, level, np.where(number < FEWEST_SAMPLES, 0.0, number))


def _of_drives(
    quantity: Quantity, assumption: Assumption, r: Residuals, mean: Floats, weight: Floats
) -> SingleStatistic:
    """Give how much drives add to the variance of means (R,) of objects."""
    found = drive_effect(mean, weight, r.drive)
    if found is None:
        return SingleStatistic(quantity, assumption, r, on=ONE_DRIVE, count=0)
    p, value = found
    return SingleStatistic(quantity, assumption, r, value, p, ONE_DRIVE)


def latencies(quantity: Quantity, r: Residuals) -> SingleStatistic:
    """How far apart the latencies of single objects are, beyond chance: their squares less what noise makes of them."""
    x = np.stack([r.columns["constant"], r.columns["latency"]], axis=-1)
    normal, right = np.einsum("rti,rtj->rij", x, x), np.einsum("rti,rt->ri", x, r.z)
    safe = np.maximum(normal[:, 0, 0], 1e-12)
    score = right[:, 1] - normal[:, 0, 1] * right[:, 0] / safe
    known = np.maximum(normal[:, 1, 1] - normal[:, 0, 1] ** 2 / safe, 0.0)
    score = score - known * score.sum() / max(float(known.sum()), 1e-12)
    known = np.where(known > 1e-3 * known.max(initial=0.0), known, 0.0)
    sums = np.where(known > 0.0, score**2 - known, 0.0)
    return _mean(quantity, "latency", r, sums, known**2, float(2.0 * (known**2).sum()), one_sided=True)
