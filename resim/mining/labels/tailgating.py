"""Tailgating, minor, moderate and severe (Kaefer 2022, 4.5.6.4 and Table 4.3).

Required: half the speedometer reading in metres, in towns the way of one second. Readings taken: it is violated where
the distance, centre to centre along the lane, is below it (the printed difference has the wrong sign); exactly 100 km/h
below 30 % is moderate; 80 km/h belongs to the upper band. Who enters ahead gives three seconds (above 160 km/h at that
moment one): labels start after them, unless the follower itself changed lane, or the distance was restored in between.
A label is as long as severity and leader stay the same. All limits are such of noisy values (`smoothing.below`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import changes, joined, stretches
from resim.mining.settings import MiningSettings, TailgatingSettings
from resim.mining.smoothing import below

LABELS = ("tailgating_minor", "tailgating_moderate", "tailgating_severe")
KMH = 3.6


def required_distance(v: Floats, urban: Bools) -> Floats:
    """Give the least distances (K,) [m] to the leader at speeds v (K,) [m/s] (Kaefer 2022, Eq. 4.1)."""
    return np.where(urban, v, 0.5 * KMH * v)


def severity(
    t: Floats, distance: Floats, v: Floats, urban: Bools, run: NDArray[np.intp], rules: TailgatingSettings
) -> NDArray[np.int8]:
    """Give 0 for none, 1 minor, 2 moderate, 3 severe (K,) by distances [m] and speeds [m/s], noise apart (Table 4.3).

    run (K,): what counts the leaders, inf away where there is none.
    """

    def under(values: Floats) -> Bools:
        return below(t, values, run)

    required = required_distance(v, urban)
    out = np.zeros(len(v), np.int8)
    out[under(distance - required)] = 1
    upper = (out > 0) & ~under(v - rules.minor_below)
    out[upper & under(distance - rules.moderate_share * required)] = 2
    out[upper & under(distance - rules.severe_share * required) & under(rules.severe_above - v)] = 3
    return out


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who keeps too little distance."""
    rules, samples, flow = settings.tailgating, features.samples, features.flow
    distance = flow.distance if rules.distance == "centre" else flow.gap
    led = (flow.leader >= 0) & features.with_lane[flow.leader] & samples.kinds(frozenset(settings.kinds))
    urban = _urban(features, rules)
    run = leader_runs(features)
    away = np.where(led, distance, np.inf)
    codes = severity(samples.t, away, samples.v, urban, changes(run, led, urban), rules)
    codes[privileged(features, run, led & (codes == 0), rules)] = 0
    group = 4 * run + codes
    first, last = stretches(codes > 0, group)
    for start, end in joined(first, last, samples.t, group, 0.0, rules.shortest):
        span = slice(start, end + 1)
        nearest = start + int(np.argmin(distance[span] - required_distance(samples.v[span], urban[span])))
        required = float(required_distance(samples.v[nearest : nearest + 1], urban[nearest : nearest + 1])[0])
        figures = {
            "distance_m": float(distance[nearest]), "required_m": required, "v_mps": float(samples.v[nearest]),
            "share": float(distance[nearest]) / required, "duration_s": float(samples.t[end] - samples.t[start]),
        }  # fmt: skip
        partner = int(samples.owner[flow.leader[start]])
        yield LabelledManeuver(
            LABELS[codes[start] - 1], int(samples.owner[start]), start, end, start, partner, figures
        )


def _urban(features: Features, rules: TailgatingSettings) -> Bools:
    if rules.place != "map":
        return np.full(len(features.samples), rules.place == "town")
    return np.asarray(
        (features.row >= 0) & features.lanes.urban(features.row, features.limit, rules.slow_limit)
    )


def leader_runs(features: Features) -> NDArray[np.intp]:
    """Give what counts (K,) the changes of leader, and of the piece of the track."""
    samples, leader = features.samples, features.flow.leader
    return changes(np.where(leader >= 0, samples.owner[leader], -1), samples.piece_of)


def privileged(features: Features, run: NDArray[np.intp], kept: Bools, rules: TailgatingSettings) -> Bools:
    """Say in which samples (K,) a follower may still restore the distance to who entered ahead.

    run (K,): by leader. kept (K,): where the distance is kept.
    """
    samples = features.samples
    starts = np.flatnonzero(np.r_[len(run) > 0, np.diff(run) != 0])
    entered = entries(features, starts)
    allowed = np.where(samples.v[starts] > rules.fast, rules.restore_fast, rules.restore)
    until = np.where(entered, samples.t[starts] + allowed, -np.inf)
    since = np.cumsum(kept)
    restored = since - (since[starts] - kept[starts])[run] > 0
    return np.asarray((samples.t < until[run] - 1e-9) & ~restored)


def entries(features: Features, starts: NDArray[np.intp]) -> Bools:
    """Say at which of the samples where a leader is new (R,) that one entered ahead.

    It did where it crossed into the lane just then, or stands between the follower and its leader of before, and was
    there before; not where the follower itself changed lane, nor where the track begins.
    """
    samples, leader = features.samples, features.flow.leader
    out = np.zeros(len(starts), dtype=bool)
    first = np.isin(starts, samples.piece)
    new = leader[starts]
    known = ~first & (new >= 0) & (features.passed[starts] == 0) & (features.kind[starts] != 2)
    at = np.flatnonzero(known)
    ahead, before = new[at], leader[starts[at] - 1]
    there = ~np.isin(ahead, samples.piece[:-1])  # it has a sample before this one
    crossed = features.passed[ahead] != 0
    behind_old = (before >= 0) & (leader[ahead] >= 0)
    behind_old &= samples.owner[leader[ahead]] == samples.owner[before]
    out[at] = there & (crossed | behind_old)
    return out


FAMILIES.add(
    LabelFamily(
        "tailgating", LABELS, find, "too little distance to the leader, by how much of what is required",
        "Kaefer 2022, 4.5.6.4, Table 4.3",
    )
)  # fmt: skip
