"""The requirement that a sweep implies: up to which value of a parameter enough runs pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import betaincinv, fdtrc

from resim.core.geometry import Bools, Floats
from resim.core.intervals import CONFIDENCE, Ints
from resim.sweeps.statistics.response import Levels

Side = Literal["under", "over", "between"]
Found = Literal["limit", "whole", "none", "unclear"]
Bounds = tuple[float | None, float | None]


@dataclass(frozen=True)
class Requirement:
    """Within which values of a parameter enough of the runs pass, all else as the sweep varies it.

    side: "under", up to a value; "over", from one on; "between" two. found: "limit" where a range is shown to hold, and
    the next levels are not; "whole" where the whole swept range is; "none" where no range can hold; else "unclear": too
    few runs to show it, or levels that differ by no more than chance.

    bounds: of the range that is shown: the lower end of the interval of its share is what is demanded or more.
    estimate: of the range whose share itself is. possible: of the range whose interval's upper end is. Each is (lowest,
    highest) value, of levels that were swept, never between them, None for an end of the range swept; there is none
    (None) where there is no such range. share, least: of the runs in `bounds`, or in `estimate` where nothing is shown,
    the share that passes and the lower end of its interval; runs: how many they are. beyond: the levels next to
    `bounds`; at: the shares of the runs at the bounds themselves.
    """

    side: Side
    found: Found
    bounds: Bounds | None = None
    estimate: Bounds | None = None
    possible: Bounds | None = None
    share: float | None = None
    least: float | None = None
    runs: int | None = None
    beyond: Bounds | None = None
    at: Bounds | None = None


def requirement(y: Floats, levels: Levels, demanded: float, side: Side, *, drawn: bool) -> Requirement:
    """Give the widest range of the parameter on this side in which the demanded share of runs passes.

    y (K, S): 1 where a run passes, by point and seed, NaN where there is none. "under" begins at the lowest level,
    "over" ends at the highest, "between" is free at both ends: the widest, of equal ones that with the most passing.
    drawn: whether the points are drawn from what the parameters may be, or are all that is asked about, as in a grid.

    Each range's share has an interval after Clopper and Pearson (Biometrika 26, 1934) for as many as are independent:
    points that were drawn, else runs; its level is such that with 95 % none of the ranges that compete is told wrongly
    (Bonferroni). So a requirement is told at its safe end: in fewer than 5 % of sweeps its true share is too low.
    """
    ranges = _ranges(y, levels, side, drawn)
    shown, estimate, possible = (
        ranges.widest(share >= demanded - 1e-12) for share in (ranges.least, ranges.share, ranges.most)
    )
    told = shown if shown is not None else estimate

    def bounds(k: int | None) -> Bounds | None:
        if k is None:
            return None
        first, last = int(ranges.first[k]), int(ranges.last[k])
        return (
            float(levels.low[first]) if first > 0 else None,
            float(levels.high[last]) if last < len(levels) - 1 else None,
        )

    found: Found = "unclear"
    if possible is None and (len(levels) > 1 or not levels.binned):
        found = "none"
    elif shown is not None and bounds(shown) == (None, None):
        found = "whole"
    elif shown is not None and _differ(y, levels):
        found = "limit"
    return Requirement(
        side,
        found,
        bounds=bounds(shown),
        estimate=bounds(estimate),
        possible=bounds(possible),
        share=None if told is None else float(ranges.share[told]),
        least=None if told is None else float(ranges.least[told]),
        runs=int(ranges.runs.max(initial=0.0)) if told is None else int(ranges.runs[told]),
        **_beside(y, levels, None if shown is None else (int(ranges.first[shown]), int(ranges.last[shown]))),
    )


def _beside(y: Floats, levels: Levels, shown: tuple[int, int] | None) -> dict[str, Bounds]:
    """The levels next to the bounds that are shown, and the shares at these themselves; None at an end of the range."""
    if shown is None:
        return {}
    (i, j), top = shown, len(levels) - 1
    at = [float(np.nanmean(y[levels.of == k])) for k in (i, j)]
    return {
        "beyond": (float(levels.high[i - 1]) if i else None, float(levels.low[j + 1]) if j < top else None),
        "at": (at[0] if i else None, at[1] if j < top else None),
    }


@dataclass(frozen=True, eq=False)
class _Ranges:
    """Ranges of levels that compete, (R,) each: first and last level, share that passes, its interval, runs, width."""

    first: Ints
    last: Ints
    share: Floats
    least: Floats
    most: Floats
    runs: Floats
    width: Floats

    def widest(self, holds: Bools) -> int | None:
        """Give the widest of those that hold (R,), of equal ones that with the most passing; None for none."""
        score = np.where(holds & (self.runs > 0.0), self.width + 1e-6 * self.share, -1.0)
        best = int(score.argmax())
        return best if score[best] >= 0.0 else None


def _ranges(y: Floats, levels: Levels, side: Side, drawn: bool) -> _Ranges:
    count = len(levels)
    first, last = np.triu_indices(count)
    if side == "under":
        first, last = np.zeros(count, dtype=int), np.arange(count)
    if side == "over":
        first, last = np.arange(count), np.full(count, count - 1)

    def within(values: Floats) -> Floats:
        sums = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(sums[last + 1] - sums[first])

    runs, passes, points = _by_level(y, levels)
    n, c = within(runs), within(passes)
    share = np.divide(c, n, out=np.zeros(len(n)), where=n > 0)
    independent = within(points) if drawn else n
    least, most = _interval(share, independent, len(n))
    width = (levels.high[last] - levels.low[first]) / max(levels.high[-1] - levels.low[0], 1e-300)
    return _Ranges(first, last, share, least, most, n, width)


def _by_level(y: Floats, levels: Levels) -> tuple[Floats, Floats, Floats]:
    """Of each level (G,): runs, passes, and points.

    Points that were drawn differ in what was not asked about, this parameter between them included, so that a second
    run of one tells nothing of those that were not drawn: points are what is independent (Kish, Survey Sampling, 1965),
    however alike those are that were drawn.
    """
    known = (levels.of >= 0) & np.isfinite(y).any(axis=1)
    of, count = levels.of[known], len(levels)
    n, c = np.isfinite(y[known]).sum(axis=1).astype(float), np.nansum(y[known], axis=1)
    points = np.bincount(of, minlength=count).astype(float)
    runs, passes = (np.asarray(np.bincount(of, values, count), dtype=float) for values in (n, c))
    return runs, passes, points


def _interval(share: Floats, n: Floats, tests: int) -> tuple[Floats, Floats]:
    """The interval (R,) low, high of shares of n: each end is wrong in 5 % of `tests` or fewer."""
    tail, c = (1.0 - CONFIDENCE) / max(tests, 1), share * n
    with np.errstate(invalid="ignore"):
        low = betaincinv(np.maximum(c, 1e-12), n - c + 1.0, tail)
        high = betaincinv(c + 1.0, np.maximum(n - c, 1e-12), 1.0 - tail)
    return np.where(c > 0.0, low, 0.0), np.where(c < n, high, 1.0)


def _differ(y: Floats, levels: Levels) -> bool:
    """Whether levels differ by more than chance would have them: analysis of variance of the points, 5 % (Fisher).

    Where each level is a single point, of its runs; of one run each, chance is not known, and nothing differs.
    """
    used = (levels.of >= 0) & np.isfinite(y).any(axis=1)
    y, of, count = y[used], levels.of[used], len(levels)
    values, group = np.nanmean(y, axis=1), of
    if len(values) == len(np.unique(of)):
        known = np.isfinite(y)
        values, group = y[known], np.broadcast_to(of[:, None], y.shape)[known]
    n = np.bincount(group, minlength=count)
    mean = np.bincount(group, values, count) / np.maximum(n, 1)
    between = float(np.sum(n * (mean - values.mean()) ** 2))
    within = float(np.sum((values - mean[group]) ** 2))
    levels_used = int((n > 0).sum())
    free = len(values) - levels_used
    if free < 1:
        return False
    if within <= 1e-12 * between:
        return between > 0.0
    return (
        float(fdtrc(levels_used - 1.0, free, between / (levels_used - 1.0) / (within / free)))
        < 1.0 - CONFIDENCE
    )
