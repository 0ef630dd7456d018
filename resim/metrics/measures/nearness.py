"""How near boxes come: PMD, TPMD, PET."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.metrics.measures.contact import distance, first_contact
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.horizon import later
from resim.metrics.measures.pairs import CompletePairs, Pairs
from resim.metrics.measures.times import planned_contact
from resim.metrics.measures.values import MeasureValues, StateArray, stated

PARTS = 16
SAME = 1e-6  # m; distances this near to each other are one
HALVINGS = 10


PMD = MeasureDefinition(
    name="PMD",
    unit="m",
    worst="low",
    kind="quantitative",
    source="Wagner 2021, 3.2.3.1",
    meaning="predicted minimum distance between both boxes",
    of=lambda inputs: pmd(inputs.pairs),
    by_scene=True,
    unseen=lambda absent: absent.apart(),
)


def pmd(pairs: Pairs) -> MeasureValues:
    """Give the predicted minimum distance (S, K) [m] between both boxes over the horizon, 0 where they touch.

    PMD = min over t of d(EGO(t), TO(t)) (Wagner 2021, 3.2.3.1): the EGO as planned, the object on its driven path or
    with acceleration and yaw rate kept. Steps that can hold the minimum are cut in PARTS, and those again. Always a
    value.
    """
    return PMD.values(*_nearest(pairs)[0])


TPMD = MeasureDefinition(
    name="TPMD",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Wagner 2021, 3.2.3.1",
    meaning="time until that distance is reached",
    of=lambda inputs: tpmd(inputs.pairs),
    by_scene=True,
    unseen=lambda absent: absent.contact(0.0),
)


def tpmd(pairs: Pairs) -> MeasureValues:
    """Give the time to PMD (S, K) [s]: when the distance of `pmd` is reached first. Always a value."""
    return TPMD.values(*_nearest(pairs)[1])


@lru_cache(maxsize=1)
def _nearest(pairs: Pairs) -> tuple[tuple[Floats, StateArray], tuple[Floats, StateArray]]:
    """Least distance [m] and when [s] it is reached, values and states (S, K): one search gives both."""
    times = np.full(pairs.state.shape[:2], np.nan)

    def of(p: CompletePairs) -> tuple[Floats, StateArray]:
        near, when = _nearest_of(p)
        times[p.scene, p.column] = when
        return stated(near, conflict=np.ones(len(near), dtype=bool))

    near = pairs.measured(PMD, of)
    return (near.value, near.state), (times, near.state)


def _nearest_of(p: CompletePairs) -> tuple[Floats, Floats]:
    """Least distance (P,) [m], and when (P,) [s] it is reached first."""
    t = p.t
    near, at = _apart(p, t), t
    a, b = p.planned(t), p.expected(t)
    sway = np.hypot(*np.moveaxis(np.diff(b[..., :2] - a[..., :2], axis=1), 2, 0))
    for box, size in ((a, p.ego_size), (b, p.size)):
        sway = sway + 0.5 * np.hypot(*size.T)[:, None] * np.abs(wrap_angle(np.diff(box[..., 2], axis=1)))
    least = near.min(axis=1)
    can = 0.5 * (near[:, :-1] + near[:, 1:] - sway) < least[:, None] - SAME
    best, when = least, at[np.arange(len(at)), _first(near, least)]
    row, j = np.nonzero(can)
    low, h = t[row, j], p.h[row]
    for _ in range(2):
        fine = low[:, None] + h[:, None] * np.linspace(0.0, 1.0, PARTS + 1)
        d = _apart(p.rows(row), fine)
        k = d.argmin(axis=1)
        value, time = d[np.arange(len(d)), k], fine[np.arange(len(d)), k]
        order = np.lexsort((time, value))[::-1]  # the nearest of a pair is written last
        order = order[value[order] < best[row[order]] - SAME]
        best, when = best.copy(), when.copy()
        best[row[order]], when[row[order]] = value[order], time[order]
        low, h = np.maximum(time - h / PARTS, 0.0), 2.0 * h / PARTS
        low = np.minimum(low, p.horizon - h)
    contact = planned_contact(p)
    touch = np.isfinite(contact)
    return np.where(touch, 0.0, best), np.where(touch, contact, when)


def _apart(p: CompletePairs, t: Floats) -> Floats:
    return distance(p.planned(t), p.expected(t), p.ego_size, p.size)


def _first(near: Floats, least: Floats) -> Floats:
    return np.asarray((near <= least[:, None] + SAME).argmax(axis=1))


PET = MeasureDefinition(
    name="PET",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Allen et al. 1978",
    meaning="post-encroachment time: between one leaving a place and the other reaching it",
    of=lambda inputs: pet(inputs.driven),
    open_beyond=later,
)


def pet(pairs: Pairs) -> MeasureValues:
    """Give the post-encroachment time (S, K) [s]: between one leaving a place and the other coming to it.

    PET = min |t2 - t1| over times t1, t2 at which the EGO's box at t1 and the object's at t2 share a point (Allen et
    al. 1978, without a conflict area that somebody has to draw; on straight crossing paths it is the time between
    one leaving and the other entering the overlap of the swept areas). Give driven paths (`Pairs.path`, and the
    driven path as plan) for the measure proper; predicted ones give the predicted PET. 0 where the boxes touch;
    NO_CONFLICT where the swept areas of the horizon do not overlap. To be found, a place must be shared for longer
    than a step of time shifts.
    """
    return pairs.measured(PET, _pet)


def _pet(p: CompletePairs) -> tuple[Floats, StateArray]:
    low = np.full(len(p.plan), np.nan)
    earliest = _least_shift(p)
    unknown = np.isfinite(earliest)
    sign = np.ones(len(p.plan))
    for k in range(p.steps):
        for side in (1.0, -1.0) if k else (1.0,):
            rows = np.flatnonzero(unknown & (earliest <= k))
            rows = rows[_share(p.rows(rows), np.full(len(rows), side * k * p.h[0]))]
            low[rows], sign[rows], unknown[rows] = (k - 1) * p.h[0], side, False
    found = np.flatnonzero(np.isfinite(low))
    q, one = p.rows(found), np.maximum(low[found], 0.0)
    two = low[found] + p.h[0]
    for _ in range(HALVINGS):
        middle = 0.5 * (one + two)
        good = _share(q, sign[found] * middle)
        one, two = np.where(good, one, middle), np.where(good, middle, two)
    low[found] = two
    return stated(low, conflict=np.isfinite(low))


def _least_shift(p: CompletePairs) -> Floats:
    """Fewest steps (P,) between the circles around both boxes being at one place, less one; inf: never at one."""
    from resim.metrics.measures import kernel  # compiled: numba is imported where it is used only

    a, b = p.planned(p.t), p.expected(p.t)
    reach = 0.5 * (np.hypot(*p.ego_size.T) + np.hypot(*p.size.T))
    for path in (a, b):
        reach = reach + np.hypot(*np.moveaxis(np.diff(path[..., :2], axis=1), 2, 0)).max(axis=1)
    return np.asarray(kernel.least_shift(*kernel.plain(a, b, reach)) - 1.0)


def _share(p: CompletePairs, shift: Floats) -> Bools:
    """Whether the EGO at t and the object at t + shift touch, both within the horizon."""
    n = p.steps
    h = (p.horizon - np.abs(shift)) / n
    t = np.maximum(-shift, 0.0)[:, None] + h[:, None] * np.arange(n + 1)
    other = p.expected(t + shift[:, None])
    return np.isfinite(first_contact(p.planned(t), other, h, p.ego_size, p.size))
