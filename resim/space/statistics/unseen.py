"""How likely the next scenario is of a kind that was not seen, and how many kinds there are at least.

Good, The population frequencies of species (Biometrika 40, 1953); Esty, A normal limit law for a nonparametric
estimator of the coverage of a random sample (Annals of Statistics 11, 1983); Chao, Nonparametric estimation of the
number of classes (Scandinavian Journal of Statistics 11, 1984).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from resim.core.intervals import CONFIDENCE
from resim.space.statistics.rates import IntervalEstimate, poisson_limits, share, spread_by
from resim.space.traces import Ints


@dataclass(frozen=True)
class KindsBound:
    """How many kinds there are at least, by Chao's lower bound: there may be many more, which no data can tell.

    Attributes:
        seen: Kinds that were seen.
        at_least: Chao's estimate of all, which is one of a lower bound.
        high: Upper end of the 95 % interval of that bound, not of the number of kinds.
    """

    seen: int
    at_least: float
    high: float


def unseen_share(counts: Ints, spread: float = 1.0, confidence: float = CONFIDENCE) -> IntervalEstimate:
    """Give the probability that the next one is of a kind not seen, from how often each kind was seen (C,).

    Good and Turing's f1 / n. The interval is the hull of Esty's normal one and of the exact Poisson one of f1: the
    first is [0, 0] without kinds seen once or twice, the second leaves out how the unseen share varies itself. Of
    Esty's variance, f1 + 2 f2 - f1² / n, the last term is left out and one kind seen twice is added. The upper end has
    the correction of a score interval (Brown, Cai and DasGupta, Interval estimation in exponential families,
    Statistica Sinica 13, 2003), so that it holds its level on its own, too, and for few scenarios. spread: how many
    kinds seen once come at one occasion (`spread_of`). [0, 1] of nothing.
    """
    f1, f2 = float((counts == 1).sum()), float((counts == 2).sum())
    return _interval(f1, 2.0 * f2, float(counts.sum()), spread, confidence)


def unseen_by_drive(kind: Ints, drive: Ints, confidence: float = CONFIDENCE) -> IntervalEstimate:
    """Give the probability that the next scenario, of another drive, is of a kind not seen.

    kind, drive: numbers (K,) of each. As `unseen_share`, where what comes in one drive alone takes the place of kinds
    seen once: the share of a drive that all others do not have. Drives have kinds of their own, each of which may come
    several times in one, and each drive is one draw: of the next one all may be new, as far as so many drives alike
    leave it open. With a single drive nothing is known of the next one. Of what comes in one drive alone the most that
    is of one drive come at once: by their mean, weighted by size, one more elsewhere would make the upper end smaller.
    """
    kinds, which = np.unique(kind, return_inverse=True)
    span = 1 + int(drive.max(initial=0))
    drives = np.bincount(np.unique(which * span + drive) // span, minlength=len(kinds))[which]
    alone = drive[drives == 1]
    spread = max(float(np.bincount(alone).max(initial=0)), spread_by(drive))
    return _interval(float(len(alone)), float((drives == 2).sum()), float(len(kind)), spread, confidence)


def _interval(f1: float, twice: float, n: float, spread: float, confidence: float) -> IntervalEstimate:
    """The interval of the unseen share. f1, twice: scenarios of kinds seen once, and twice; n: all of them."""
    if n == 0.0:
        return IntervalEstimate(np.nan, 0.0, 1.0, confidence)
    z = float(ndtri(0.5 + 0.5 * confidence))
    more = f1 + twice + 2.0
    below = f1 - z * np.sqrt(spread * more)
    above = f1 + spread * (0.5 * z**2 + z * np.sqrt(more / spread + 0.25 * z**2))
    low, high = (float(limit) * spread for limit in poisson_limits(f1 / spread, confidence))
    low, high = min(low, below) / n, max(high, above) / n
    return IntervalEstimate(f1 / n, max(low, 0.0), min(high, 1.0), confidence)


def kinds_at_least(counts: Ints) -> KindsBound:
    """Give Chao's lower bound of the number of kinds, bias-corrected, from how often each was seen (C,).

    The interval is the log-normal one of Chao 1987, with the variance of Chao and Shen 2010; it is of the bound.
    """
    seen, n = int((counts > 0).sum()), float(counts.sum())
    if n == 0.0:
        return KindsBound(0, 0.0, np.inf)
    f1, f2 = float((counts == 1).sum()), float((counts == 2).sum())
    factor = (n - 1.0) / n
    if f2 > 0.0:
        more, r = factor * f1**2 / (2.0 * f2), f1 / f2
        variance = f2 * (0.5 * factor * r**2 + factor**2 * r**3 + 0.25 * factor**2 * r**4)
    else:
        more = factor * f1 * (f1 - 1.0) / 2.0
        whole = seen + more
        variance = factor * f1 * (f1 - 1.0) / 2.0 + factor**2 * f1 * (2.0 * f1 - 1.0) ** 2 / 4.0
        variance = max(variance - factor**2 * f1**4 / (4.0 * whole), 0.0)
    # of none that are expected to be missing the 95 % limit of the missing ones is that of no event
    if more <= 0.0:
        return KindsBound(seen, float(seen), seen + float(poisson_limits(max(f1, 0.0))[1]))
    spread = np.exp(1.96 * np.sqrt(np.log1p(variance / more**2)))
    return KindsBound(seen, seen + more, seen + more * float(spread))


def more_needed(counts: Ints, limit: float, confidence: float = CONFIDENCE) -> float:
    """Give how many more scenarios bring the upper end of the unseen share down to a limit, about.

    The share falls with m more as f1 / n (1 - f1 / (n f0 + f1))^m (Chao and Jost 2012), with f0 from Chao's bound, so
    that it falls no faster; the interval is then the exact one of that many kinds seen once. 0 where it is there.
    """
    n, f1 = float(counts.sum()), float((counts == 1).sum())
    least = float(poisson_limits(0.0, confidence)[1]) / limit  # with no kind seen once
    if n == 0.0:
        return least
    f0 = kinds_at_least(counts).at_least - float((counts > 0).sum())
    fall = f1 / (n * f0 + f1) if f1 > 0.0 else 1.0

    def high(m: float) -> float:
        expected = f1 / n * (1.0 - fall) ** m if f1 > 0.0 else 0.0
        return float(poisson_limits(expected * (n + m), confidence)[1]) / (n + m)

    if unseen_share(counts, confidence=confidence).high <= limit:
        return 0.0
    low, top = 0.0, max(least, n)
    while high(top) > limit:
        top *= 2.0
        if top > 1e12:
            return np.inf
    for _ in range(100):
        middle = 0.5 * (low + top)
        low, top = (middle, top) if high(middle) > limit else (low, middle)
    return float(np.ceil(max(top, 1.0)))


@dataclass(frozen=True)
class HeldOutCheck:
    """The unseen share that one half predicts, against what the other half brought.

    Attributes:
        predicted: From the first half.
        found: Share of the second half that is of kinds not in the first, with its exact interval.
        agree: Whether both intervals have a number in common.
        of: Scenarios of the second half.
    """

    predicted: IntervalEstimate
    found: IntervalEstimate
    agree: bool
    of: int


def held_out(kind: Ints, drive: Ints) -> HeldOutCheck | None:
    """Check the unseen share of the first half of scenarios, kinds (K,) in order of time, against the second half.

    drive (K,): number of the drive of each, which is one draw. None for fewer than four.
    """
    if len(kind) < 4:
        return None
    half = len(kind) // 2
    first, second = kind[:half], kind[half:]
    predicted = unseen_by_drive(first, drive[:half])
    spread = spread_by(drive[half:])
    new = float((~np.isin(second, first)).sum())
    found = share(new / spread, len(second) / spread)
    return HeldOutCheck(predicted, found, predicted.overlaps(found), len(second))
