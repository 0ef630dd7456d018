"""Does the share of seeds that agree reach what is demanded? A test that ends with the seed at which it can tell.

The probability ratio test of A. Wald (Sequential Analysis, 1947), with limits that are exact for the most seeds there
may be: Wald's hold for a test without an end, and decide later than they need to where there is one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count, islice
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import brentq

from resim.core.geometry import Floats

ERROR = 0.05
"""Probability of either wrong verdict, at most; beyond each end of the interval there is as much."""
_SAME = 1e-9

ShareAnswer = Literal["enough", "too few"]


@dataclass(frozen=True)
class StoppingPoint:
    """Where the test ended: `agreed` of `of` seeds, and what that tells; None where it is undecided."""

    agreed: int
    of: int
    told: ShareAnswer | None


class _Odds(NamedTuple):
    """After some seeds: probability to have ended either way, and of each number `first`, ... that is still open."""

    enough: float
    few: float
    first: int
    open: Floats


@dataclass(frozen=True)
class SequentialTest:
    """Tells a share of agreeing seeds of at most `demand` from one of at least `better`, in at most `most` seeds.

    It ends as "enough" once `above` more agree than slope * n, as "too few" once `below` fewer do. With independent
    seeds a share of `demand` or less is told to be enough with a probability of at most `ERROR`, and one of `better` or
    more to be too few likewise. Shares in between may be told to be either; any share may stay undecided.
    """

    demand: float
    most: int

    @property
    def better(self) -> float:
        """(1 + demand) / 2."""
        return 0.5 * (1.0 + self.demand)

    @property
    def fewest(self) -> int:
        """How many seeds there must be at least for the test to tell anything: all of them agree by chance seldom."""
        return math.ceil(math.log(ERROR) / math.log(self.demand))

    @property
    def slope(self) -> float:
        """The share at which neither hypothesis gains on the other."""
        return math.log(2.0) / self._ratio

    @property
    def _ratio(self) -> float:
        """By how much an agreement moves the logarithm of the likelihoods' ratio away from a disagreement."""
        return math.log(self.better / self.demand) + math.log(2.0)

    @cached_property
    def above(self) -> float:
        """The least with which the error is kept, however low the other limit."""
        return self._least(lambda offset: self._odds(self.demand, self.most, offset, math.inf).enough)

    @cached_property
    def below(self) -> float:
        """The least with which the error is kept, however high the other limit."""
        return self._least(lambda offset: self._odds(self.better, self.most, math.inf, offset).few)

    def stop(self, agrees: Sequence[bool]) -> StoppingPoint:
        """Give where the test ends, for seeds in their order."""
        agreed = 0
        for n, agree in enumerate(agrees, start=1):
            agreed += agree
            if agreed >= self.slope * n + self.above - _SAME:
                return StoppingPoint(agreed, n, "enough")
            if agreed <= self.slope * n - self.below + _SAME:
                return StoppingPoint(agreed, n, "too few")
        return StoppingPoint(agreed, len(agrees), None)

    def interval(self, stop: StoppingPoint) -> tuple[float, float]:
        """Give the interval of the true share after a stop, exact: `ERROR` of all cases lie beyond each of its ends.

        Ends are ordered by what they tell: the sooner it is enough, the higher; the sooner too few, the lower (P.
        Armitage, Numerical studies in the sequential estimation of a binomial parameter, Biometrika 45 (1958)). So
        "enough" has its lower end at `demand` or above, and "too few" its upper end at `better` or below.
        """
        return _root(lambda share: self._as_high(share, stop)), _root(
            lambda share: -self._as_low(share, stop)
        )

    def needed(self, stop: StoppingPoint) -> int:
        """Give how many seeds, if their share is the one seen, would tell in all but `ERROR` of cases.

        With Wald's limits, since his hold whatever the most.
        """
        wald = -math.log(ERROR) / self._ratio
        every = _walk(stop.agreed / stop.of, self.slope, wald, wald)
        return next(n for n, odds in enumerate(every) if odds.open.sum() <= ERROR)

    def _as_high(self, share: float, stop: StoppingPoint) -> float:
        """The probability of an end as high as this one, or higher, less `ERROR`."""
        if stop.told == "too few":
            return 1.0 - self._odds(share, stop.of - 1).few - ERROR
        odds = self._odds(share, stop.of)
        still = 0.0 if stop.told else float(odds.open[max(stop.agreed - odds.first, 0) :].sum())
        return odds.enough + still - ERROR

    def _as_low(self, share: float, stop: StoppingPoint) -> float:
        """The probability of an end as low as this one, or lower, less `ERROR`."""
        if stop.told == "enough":
            return 1.0 - self._odds(share, stop.of - 1).enough - ERROR
        odds = self._odds(share, stop.of)
        still = 0.0 if stop.told else float(odds.open[: max(stop.agreed - odds.first + 1, 0)].sum())
        return odds.few + still - ERROR

    def _odds(self, share: float, n: int, above: float | None = None, below: float | None = None) -> _Odds:
        """What n seeds of a share give; with the limits of the test where none are given."""
        limits = self.above if above is None else above, self.below if below is None else below
        return next(islice(_walk(share, self.slope, *limits), n, None))

    def _least(self, error: Callable[[float], float]) -> float:
        """The least offset with which an error, which falls with it, is kept."""
        low, high = 0.0, float(self.most)
        while high - low > 1e-6:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if error(middle) <= ERROR else (middle, high)
        return high


def _walk(share: float, slope: float, above: float, below: float) -> Iterator[_Odds]:
    """Give what 0, 1, 2, ... seeds come to that agree with the probability `share`."""
    odds = _Odds(0.0, 0.0, 0, np.ones(1))
    for n in count(1):
        yield odds
        grown = np.zeros(len(odds.open) + 1)
        grown[1:] = share * odds.open
        grown[:-1] += (1.0 - share) * odds.open
        agreed = odds.first + np.arange(len(grown))
        over, under = agreed >= slope * n + above - _SAME, agreed <= slope * n - below + _SAME
        left = agreed[~(over | under)]
        odds = _Odds(
            odds.enough + float(grown[over].sum()), odds.few + float(grown[under].sum()),
            int(left[0]) if len(left) else odds.first, grown[~(over | under)],
        )  # fmt: skip


def _root(rising: Callable[[float], float]) -> float:
    """Where a function that rises over [0, 1] is 0; the end of it that it stays beyond."""
    if rising(0.0) >= 0.0:
        return 0.0
    return 1.0 if rising(1.0) <= 0.0 else float(brentq(rising, 0.0, 1.0, xtol=1e-9))
