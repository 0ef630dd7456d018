"""How much is missing until a limit could be met: at least so many hours more, if all goes as well as it can."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from resim.space.expected import ExposedScenarios
from resim.space.statistics.rates import poisson_limits
from resim.space.statistics.unseen import unseen_share

MOST = 1e12
"""Times the hours so far, above which nothing is told."""


def hours_for_kinds(seen: ExposedScenarios, unseen: float, confidence: float, hours: float) -> float:
    """Give how many hours more bring the upper end of the unseen share down to a limit, at least: if nothing new comes,
    and each scenario in a drive of its own.

    seen: all that was seen; unseen: the limit; confidence: one-sided; hours: driven so far. NaN where nothing was
    driven.
    """
    sizes = np.unique(seen.drive[seen.once()], return_counts=True)[1].astype(float)
    count, squares = float(sizes.sum()), float((sizes**2).sum())
    if not hours > 0.0 or not count:
        return np.nan

    def met(times: float) -> bool:
        more = (times - 1.0) * count
        spread = (squares + more) / (count + more)
        return unseen_share(np.array([count + more]), spread, 2.0 * confidence - 1.0).high <= unseen

    return (_least(met) - 1.0) * hours


def hours_for_accidents(
    seen: ExposedScenarios, accidents: float, alpha: float, driven: float, hours: float
) -> float:
    """Give how many hours more let a limit of accidents be met, at least, if no scenario is an accident, or new.

    accidents: limit, by what was driven, in its unit; alpha: what is left of the error for kinds that were not seen.
    Scenarios come as often as so far. NaN where nothing was driven, or nobody can say.
    """
    count = float(seen.counts().sum())
    if not driven > 0.0 or not hours > 0.0:
        return np.nan

    def met(times: float) -> bool:
        rate = float(poisson_limits(count * times, 1.0 - alpha)[1]) / (driven * times)
        return rate * unseen_share(np.array([count * times]), 1.0, 1.0 - alpha).high <= accidents

    return (_least(met) - 1.0) * hours


def _least(met: Callable[[float], bool]) -> float:
    """The least number of times, from 1 on, by which something is met; NaN above MOST."""
    if met(1.0):
        return 1.0
    low, high = 1.0, 2.0
    while not met(high):
        low, high = high, 2.0 * high
        if high > MOST:
            return np.nan
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if met(middle) else (middle, high)
    return low
