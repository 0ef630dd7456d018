"""The requirement that a sweep implies: up to which value of a parameter enough runs pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import fdtrc

from resim.core.geometry import Floats
from resim.experiment.intervals import CONFIDENCE, Ints, wilson
from resim.experiment.response import LEAST, Levels

DRAWS = 1000
"""Bootstrap draws."""

Side = Literal["under", "over", "between"]
Found = Literal["limit", "whole", "none", "unclear"]


@dataclass(frozen=True)
class Requirement:
    """Within which values of a parameter enough of the runs pass, all else as the sweep varies it.

    side: "under", up to `high`; "over", from `low` on; "between" the two. found: "limit" where there are such bounds;
    "whole" where it holds in the whole range swept, "none" where it holds nowhere, "unclear" where a bound may be
    anywhere in the range, levels differ by no more than chance, or that cannot be told: with one run a level, or all
    points in one. low, high: the bounds, at levels that were swept, never between them, None where there is none;
    low_interval, high_interval: their 95 % intervals, an end None where no level may be enough. share: of the runs
    within the bounds that pass; runs: how many they are. low_share, high_share: of the runs at the bound itself.
    next_low, next_high: the levels beyond the bounds.
    """

    side: Side
    found: Found
    low: float | None = None
    high: float | None = None
    low_interval: tuple[float | None, float | None] | None = None
    high_interval: tuple[float | None, float | None] | None = None
    next_low: float | None = None
    next_high: float | None = None
    low_share: float | None = None
    high_share: float | None = None
    share: float | None = None
    runs: int | None = None


def requirement(y: Floats, levels: Levels, demanded: float, side: Side) -> Requirement:
    """Give the widest range of the parameter on this side in which the demanded share of runs passes.

    y (K, S): 1 where a run passes, by point and seed, NaN where there is none. "under" begins at the lowest level,
    "over" ends at the highest, "between" is free at both ends: the widest, of equal ones that with the most passing.
    The interval is a bootstrap over the points of each level; where levels are single points, over their runs. Few
    that agree never differ in a bootstrap: where a level has fewer than LEAST points, the interval reaches as far as
    Wilson's of all runs within a bound holds the demanded share, and "none" is "unclear" where some range's does.
    """
    n = np.isfinite(y).sum(axis=1)
    used = (levels.of >= 0) & (n > 0)
    of, n, c = levels.of[used], n[used], np.nansum(y, axis=1)[used]
    passes, runs = (np.asarray(np.bincount(of, m, len(levels)), dtype=float)[None] for m in (c, n))
    first, last = _widest(passes, runs, levels, demanded, side)
    i, j = int(first[0]), int(last[0])
    few = int(np.bincount(of, minlength=len(levels)).min()) < LEAST
    if i < 0:
        may = few and _widest(passes, runs, levels, demanded, side, possible=True)[0][0] >= 0
        told = not may and (len(levels) > 1 or not levels.binned)
        return Requirement(side, "none" if told else "unclear", runs=int(n.sum()))
    count = int(runs[0, i : j + 1].sum())
    share = float(passes[0, i : j + 1].sum()) / count
    if (i, j) == (0, len(levels) - 1):
        return Requirement(side, "whole", share=share, runs=count)
    firsts, lasts = _widest(*_draws(of, n, c, len(levels)), levels, demanded, side)
    top = len(levels) - 1
    lower, upper = i > 0, j < top
    low, high = _tails(np.where(firsts < 0, top + 1, firsts)), _tails(lasts)
    if few:
        low, high = _wider(passes[0], runs[0], demanded, (i, j), (low, high))
    vague = not _differ(y[used], of, len(levels))
    vague |= (lower and low[0] <= 0 and low[1] >= top) or (upper and high[0] <= 0 and high[1] >= top)
    at = (passes[0] / np.maximum(runs[0], 1.0)).tolist()
    return Requirement(
        side, "unclear" if vague else "limit",
        low=float(levels.low[i]) if lower else None,
        high=float(levels.high[j]) if upper else None,
        low_interval=_values(levels.low, low) if lower else None,
        high_interval=_values(levels.high, high) if upper else None,
        next_low=float(levels.high[i - 1]) if lower else None,
        next_high=float(levels.low[j + 1]) if upper else None,
        low_share=at[i] if lower else None, high_share=at[j] if upper else None,
        share=share, runs=count,
    )  # fmt: skip


def _differ(y: Floats, of: Ints, count: int) -> bool:
    """Whether levels differ by more than chance would have them: analysis of variance of the points, 5 % (Fisher).

    Where each level is a single point, of its runs; of one run each, chance is not known, and nothing differs.
    """
    values, group = np.nanmean(y, axis=1), of
    if len(values) == len(np.unique(of)):
        known = np.isfinite(y)
        values, group = y[known], np.broadcast_to(of[:, None], y.shape)[known]
    n = np.bincount(group, minlength=count)
    mean = np.bincount(group, values, count) / np.maximum(n, 1)
    between = float(np.sum(n * (mean - values.mean()) ** 2))
    within = float(np.sum((values - mean[group]) ** 2))
    levels = int((n > 0).sum())
    free = len(values) - levels
    if free < 1:
        return False
    if within <= 1e-12 * between:
        return between > 0.0
    return float(fdtrc(levels - 1.0, free, between / (levels - 1.0) / (within / free))) < 1.0 - CONFIDENCE


def _wider(
    passes: Floats,
    runs: Floats,
    demanded: float,
    at: tuple[int, int],
    ends: tuple[tuple[int, int], tuple[int, int]],
) -> tuple[tuple[int, int], tuple[int, int]]:
    """The ends of the lower and of the upper bound's interval, as far as Wilson's says; at: where the bounds are."""
    (i, j), (low, high) = at, ends
    up, down = i + _shown(passes[i:], runs[i:], demanded), j - _shown(passes[j::-1], runs[j::-1], demanded)
    sure_up, sure_down = up[0] if up[0] >= i else -1, down[0] if down[0] <= j else len(runs)
    return (
        (min(low[0], int(down[1])), max(low[1], int(sure_down))),
        (min(high[0], int(sure_up)), max(high[1], int(up[1]))),
    )


def _shown(passes: Floats, runs: Floats, demanded: float) -> Ints:
    """The farthest levels (2,) up to which Wilson's interval is above the demanded share, or holds it; -1 for none."""
    ends = np.stack(wilson(np.cumsum(passes), np.cumsum(runs))) >= demanded
    return np.where(ends.any(axis=1), ends.shape[1] - 1 - np.argmax(ends[:, ::-1], axis=1), -1)


def _widest(
    passes: Floats, runs: Floats, levels: Levels, demanded: float, side: Side, *, possible: bool = False
) -> tuple[Ints, Ints]:
    """First and last level of the widest range that holds, -1 for none; passes, runs (B, G): of each draw and level.

    possible: that Wilson's interval of the share reaches what is demanded is enough.
    """
    none = np.zeros((len(passes), 1))
    c, n = (np.concatenate([none, np.cumsum(counts, axis=1)], axis=1) for counts in (passes, runs))
    count = len(levels)
    first, last = np.triu_indices(count)
    if side == "under":
        first, last = np.zeros(count, dtype=int), np.arange(count)
    if side == "over":
        first, last = np.arange(count), np.full(count, count - 1)
    within, of = c[:, last + 1] - c[:, first], n[:, last + 1] - n[:, first]
    share = np.divide(within, of, out=np.zeros_like(within), where=of > 0)
    if possible:
        share = np.nan_to_num(wilson(within, of)[1])
    width = (levels.high[last] - levels.low[first]) / max(levels.high[-1] - levels.low[0], 1e-300)
    score = np.where((share >= demanded - 1e-12) & (of > 0), width + 1e-6 * share, -1.0)
    best = score.argmax(axis=1)
    found = score[np.arange(len(best)), best] >= 0.0
    return np.where(found, first[best], -1), np.where(found, last[best], -1)


def _draws(of: Ints, n: Ints, c: Floats, count: int) -> tuple[Floats, Floats]:
    """Passes and runs (B, G) of bootstrap draws of points within each level; of a single point, of its runs.

    of, n, c (K,): level, runs and passes of each point. Points with equal n and c are drawn together.
    """
    rng = np.random.default_rng(0)
    passes, runs = np.zeros((DRAWS, count)), np.zeros((DRAWS, count))
    for level in np.unique(of).tolist():
        mine = of == level
        kinds, counts = np.unique(np.stack([n[mine], c[mine]], axis=1), axis=0, return_counts=True)
        if counts.sum() == 1:
            runs[:, level] = kinds[0, 0]
            passes[:, level] = rng.binomial(int(kinds[0, 0]), kinds[0, 1] / kinds[0, 0], DRAWS)
            continue
        drawn = rng.multinomial(counts.sum(), counts / counts.sum(), DRAWS)
        runs[:, level], passes[:, level] = (drawn @ kinds).T
    return passes, runs


def _tails(places: Ints) -> tuple[int, int]:
    """The ends of the 95 % interval of places (B,) among the levels."""
    tails = [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE]
    low, high = np.quantile(places, tails, method="closest_observation").tolist()
    return int(low), int(high)


def _values(levels: Floats, places: tuple[int, int]) -> tuple[float | None, float | None]:
    """The levels (G,) at two places, None where there is none."""
    low, high = (float(levels[k]) if 0 <= k < len(levels) else None for k in places)
    return low, high
