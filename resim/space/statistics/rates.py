"""How often something happens: events over what was driven, with exact Poisson intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv

from resim.core.geometry import Floats
from resim.core.intervals import CONFIDENCE, exact
from resim.core.spec import NumberOrNan


@dataclass(frozen=True)
class IntervalEstimate:
    """A number with its interval, NaN where nothing is known.

    Attributes:
        value: The estimate.
        low: Lower end.
        high: Upper end.
        confidence: Of the interval, two-sided.
    """

    value: NumberOrNan
    low: NumberOrNan
    high: NumberOrNan
    confidence: float = CONFIDENCE

    def overlaps(self, other: IntervalEstimate) -> bool:
        """Say whether both intervals have a number in common."""
        return bool(self.low <= other.high and other.low <= self.high)


UNKNOWN = IntervalEstimate(np.nan, np.nan, np.nan)
LEAST_DRIVES = 30
"""Drives from which on intervals of rates hold at their level also where one drive in ten has most of what comes."""
LEAST_ALIKE = 6.0
"""Drives of like length that drives are worth (`worth`), from which on upper ends hold also where few are a thousand
times as long as others."""


def poisson_limits(count: ArrayLike, confidence: float = CONFIDENCE) -> tuple[Floats, Floats]:
    """Give the exact interval (low, high) of the expected number of events of which `count` were seen, arrays.

    F. Garwood, Fiducial limits for the Poisson distribution, Biometrika 28 (1936), continued to fractions.
    """
    seen, tail = np.asarray(count, dtype=float), 0.5 - 0.5 * confidence
    low = np.where(seen > 0.0, gammaincinv(np.maximum(seen, 1e-300), tail), 0.0)
    return np.asarray(low), np.asarray(gammaincinv(seen + 1.0, 1.0 - tail))


def rate(
    count: float, driven: float, spread: float = 1.0, confidence: float = CONFIDENCE
) -> IntervalEstimate:
    """Give the rate of events over what was driven, in its unit.

    spread: how many events come at once, by variance over mean (`spread_of`): their interval is that of count / spread
    occasions. NaN where nothing was driven.
    """
    if not driven > 0.0:
        return IntervalEstimate(np.nan, np.nan, np.nan, confidence)
    low, high = poisson_limits(count / spread, confidence)
    return IntervalEstimate(
        count / driven, float(low) * spread / driven, float(high) * spread / driven, confidence
    )


def worth(lengths: Floats) -> float:
    """Give how many drives of like length drives of such lengths (D,) are worth, NaN where one is not known.

    L. Kish, Survey Sampling, 1965, of weights.
    """
    return float(lengths.sum() ** 2 / (lengths**2).sum()) if lengths.sum() > 0.0 else np.nan


def for_drives(estimate: IntervalEstimate, drives: int, lengths: Floats) -> IntervalEstimate:
    """Give a rate as it is known of a number of drives, of such lengths (D,).

    Of fewer than LEAST_DRIVES, or worth fewer than LEAST_ALIKE, it has no upper end (NaN): others may have most of what
    comes.
    """
    enough = drives >= LEAST_DRIVES and worth(lengths) >= LEAST_ALIKE
    return estimate if enough else replace(estimate, high=np.nan)


def spread_of(per_occasion: Sequence[int] | np.ndarray) -> float:
    """Give by how much the variance of a number of events is larger than its mean, as they come several at an occasion.

    per_occasion (O,): how many come at each. A sum of Poisson many occasions of size m has mean L E[m] and variance
    L E[m²].
    """
    sizes = np.asarray(per_occasion, dtype=float)
    return float((sizes**2).sum() / sizes.sum()) if sizes.sum() > 0.0 else 1.0


def spread_by(number: ArrayLike, lengths: Floats | None = None) -> float:
    """Give `spread_of` what comes at occasions, by the number (K,) of the occasion of each.

    lengths: of drives, of which number is the row (`scatter`).
    """
    if lengths is None:
        return spread_of(np.unique(number, return_counts=True)[1])
    sizes = np.bincount(np.asarray(number, dtype=np.intp), minlength=len(lengths)).astype(float)
    return scatter(sizes, lengths) / float(sizes.sum()) if sizes.sum() > 0.0 else 1.0


def scatter(sizes: Floats, lengths: Floats | None) -> float:
    """Give the variance of a sum of what comes in drives (D,), as it is divided by the sum of their lengths (C,).

    It is that of Poisson many drives, and where these differ in length that of the divisor on top: where long drives
    bring no more than short ones, how many long ones there are changes the rate (a ratio estimate: W. Cochran, Sampling
    Techniques, 1977, chapter 6). That is added whether or not more comes in longer ones, so that it never falls as
    sizes rise. Lengths of which one is not finite say nothing.
    """
    alone = float((sizes**2).sum())
    if lengths is None or not np.isfinite(lengths).all() or not lengths.sum() > 0.0:
        return alone
    parts = lengths / lengths.sum()
    return alone + float(sizes.sum() ** 2) * max(float((parts**2).sum()) - 1.0 / len(parts), 0.0)


def share(count: float, of: float, confidence: float = CONFIDENCE) -> IntervalEstimate:
    """Give a share with its exact interval (Clopper and Pearson 1934), also of a mean of `of` numbers in [0, 1].

    Of such numbers the interval is on the safe side: none varies more than 0 and 1 with the same mean. NaN of none.
    """
    if not of > 0.0:
        return IntervalEstimate(np.nan, np.nan, np.nan, confidence)
    low, high = exact(count / of, of, confidence=confidence)
    return IntervalEstimate(count / of, float(low), float(high), confidence)
