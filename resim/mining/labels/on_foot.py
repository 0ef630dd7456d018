"""Pedestrians who run onto the road, stay on it or are a crowd, and cyclists along it: rows of Kaefer's catalogs.

He says no numbers. Who plays or works on the road is told from who walks along it by staying where it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from resim.core.geometry import Bools
from resim.mining.features import Features
from resim.mining.labels.others import CROSSING, SHORTEST, STILL, lasting, slanted
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.samples import Ints
from resim.mining.settings import MiningSettings, OnFootSettings

RUNNING, STAYING, CROWD, CYCLING = "running_onto_road", "staying_on_road", "through_crowd", "cycling_on_road"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who runs onto the road or stays on it, who drives through a crowd, and cyclists along driven lanes."""
    samples, rules = features.samples, settings.on_foot
    on_foot = samples.kinds(frozenset({"pedestrian"}))
    on_road = features.row >= 0
    for one in found:
        if one.label == CROSSING and on_foot[one.start]:
            fastest = one.start + int(np.argmax(np.abs(samples.v[one.start : one.end + 1])))
            v = float(abs(samples.v[fastest]))
            if v >= rules.running:
                yield LabelledManeuver(
                    RUNNING, one.object, one.start, one.end, one.start, figures={"v_mps": v}
                )
    moves = np.abs(samples.v) > STILL
    cycles = on_road & moves & ~slanted(features) & samples.kinds(frozenset({"bicycle"}))
    cases = [(CYCLING, cycles, SHORTEST)]
    if on_foot.any():
        cases.append((STAYING, on_foot & on_road & _stays(features, rules), 0.0))
        drives = moves & samples.kinds(frozenset(settings.kinds))
        cases.append((CROWD, _crowded(features, on_foot, drives, rules), SHORTEST))
    for label, holds, shortest in cases:
        yield from lasting(features, label, holds, shortest)


def _stays(features: Features, rules: OnFootSettings) -> Bools:
    """Whether (K,) somebody stays: is within `staying_radius` of there `staying` [s] later, and on the road until then.

    All of that time is part of it.
    """
    samples = features.samples
    later = _later(samples.t, samples.piece, rules.staying)
    known = later >= 0
    way = np.hypot(samples.x[later] - samples.x, samples.y[later] - samples.y)
    off = np.cumsum(features.row < 0)
    begins = np.flatnonzero(known & (way <= rules.staying_radius) & (off[later] == off))
    count = np.zeros(len(off) + 1, dtype=np.intp)
    count[begins] += 1
    np.subtract.at(count, later[begins] + 1, 1)
    return np.asarray(np.cumsum(count[:-1]) > 0)


def _later(t: np.ndarray, piece: Ints, seconds: float) -> Ints:
    """The first sample (K,) of the same piece that is `seconds` later, -1 for none."""
    out = np.full(len(t), -1, dtype=np.intp)
    for low, high in zip(piece[:-1].tolist(), piece[1:].tolist(), strict=True):
        at = low + np.searchsorted(t[low:high], t[low:high] + seconds - 1e-9)
        out[low:high] = np.where(at < high, at, -1)
    return out


def _crowded(features: Features, on_foot: Bools, drives: Bools, rules: OnFootSettings) -> Bools:
    """Whether (K,) a vehicle that moves has `crowd` pedestrians or more within `crowd_radius` [m]."""
    samples, out = features.samples, np.zeros(len(drives), dtype=bool)
    far = 10.0 * rules.crowd_radius  # what is at other times is further away than this
    places = np.stack([samples.x, samples.y, far * samples.step], axis=1)
    drives = drives & np.isin(samples.step, np.unique(samples.step[on_foot]))
    tree = cKDTree(places[on_foot])
    out[drives] = tree.query_ball_point(places[drives], rules.crowd_radius, return_length=True) >= rules.crowd
    return out


FAMILIES.add(
    LabelFamily(
        "on foot", (RUNNING, STAYING, CROWD, CYCLING), find,
        "pedestrians who run onto the road or stay on it, vehicles amid many of them, and cyclists along driven lanes",
        "Kaefer 2022, Appendix 1; our numbers",
    )
)  # fmt: skip
