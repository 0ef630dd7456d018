"""What a time to react weighs (Eq. 4.6), and the risk of objects that depend on each other (Eq. 4.9)."""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from resim.core.compiled import inner


@inner
def _weight(t, pnr, most, slope):
    """Eq. 4.6."""
    if slope == 0.0:
        g = (most - t) / (most - pnr)
    else:
        tail = math.exp(-slope * (most - pnr))
        g = (math.exp(-slope * (t - pnr)) - tail) / (1.0 - tail)
    return min(1.0, max(0.0, g))


@inner
def _weight_sum(t, pnr, most, slope):
    """The integral of Eq. 4.6 from 0 to t."""
    one = min(t, pnr)
    if t <= pnr:
        return one
    end = min(t, most)
    if slope == 0.0:
        return one + (0.5 * (end - pnr) * (2.0 * most - end - pnr)) / (most - pnr)
    tail = math.exp(-slope * (most - pnr))
    whole = (1.0 - math.exp(-slope * (end - pnr))) / slope
    return one + (whole - tail * (end - pnr)) / (1.0 - tail)


@inner
def weights(points, times, h, swept):
    """What it weighs (points + 1,) that nothing helps, then that the last evasion begins at time 0, h, ...

    times: T_PNR, T_max [s] and the slope m. swept: the mean over the step that begins there.
    """
    pnr, most, slope = times[0], times[1], times[2]
    out = np.ones(points + 1)
    for j in range(points):
        if swept:
            out[j + 1] = (
                _weight_sum((j + 1) * h, pnr, most, slope) - _weight_sum(j * h, pnr, most, slope)
            ) / h
        else:
            out[j + 1] = _weight(j * h, pnr, most, slope)
    return out


@inner
def dependent(mass, table):
    """r_dep = E[max over objects of g], exact for independent objects: mass (K, G) of each g = table (G,), falling."""
    reached = np.zeros(mass.shape[0])  # probability of each object to have a g of at least the current value
    total = before = 0.0
    for j in range(len(table)):
        none = 1.0
        for k in range(mass.shape[0]):
            reached[k] += mass[k, j]
            none *= max(1.0 - reached[k], 0.0)
        total += table[j] * (1.0 - none - before)
        before = 1.0 - none
    return min(1.0, max(0.0, total))
