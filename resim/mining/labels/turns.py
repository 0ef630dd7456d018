"""Ways through junctions: turns, straight on and U-turns, from the junction's own connections (Kaefer 2022, 4.5.6.8).

He draws boxes where vehicles enter and leave (those: `regions`); a map's junctions say the same. A way is labelled from
the first to the last sample inside, if the vehicle was seen outside before and after; which way it is, the turning of
the lanes says. Only junctions with a connection that turns tightly count: a fork or a merge of a motorway is no
crossing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.mining.features import BREAKS, Features
from resim.mining.lane_map import MinedLanes
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import stretches
from resim.mining.settings import MiningSettings, TurnSettings

LABELS = ("turn_left", "turn_right", "straight", "u_turn")


def crossings(lanes: MinedLanes, rules: TurnSettings) -> Bools:
    """Say of each junction (J,) whether a lane of any connection turns as at a crossing: far enough, and tightly."""
    inside = np.flatnonzero((lanes.junction >= 0) & (lanes.lanes > 0))
    out = np.zeros(int(lanes.junction.max(initial=-1)) + 1, dtype=bool)
    _, of = np.unique(
        np.stack([lanes.road[inside], lanes.network.lane_table.lane[inside]]), axis=1, return_inverse=True
    )
    of = of.ravel()  # the sections of one lane of a road
    turn = np.abs(np.bincount(of, lanes.turn[inside]))
    length = np.bincount(of, lanes.stations.length[inside])
    tight = (turn > rules.straight) & (length <= rules.radius * turn)
    out[lanes.junction[inside[tight[of]]]] = True
    return out


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find the ways through junctions."""
    samples, rules = features.samples, settings.turn
    counts = crossings(features.lanes, rules)
    if not counts.any():
        return
    on = np.flatnonzero((features.row >= 0) & samples.kinds(frozenset(settings.kinds)))
    junction = features.junction[on]
    inside = (junction >= 0) & counts[junction]
    group = samples.piece_of[on]
    first, last = stretches(inside, group * (len(counts) + 1) + junction)
    turning = _turning(features, on)
    broken = np.cumsum(features.kind[on] == BREAKS)
    for a, b in zip(first.tolist(), last.tolist(), strict=True):
        if a == 0 or b + 1 == len(on) or group[a - 1] != group[a] or group[b + 1] != group[b]:
            continue  # not seen outside before or after
        if features.row[on[a - 1]] == features.row[on[b + 1]]:
            continue  # in and back again
        if broken[b + 1] != broken[a - 1] or not features.with_lane[on[[a - 1, b + 1]]].all():
            continue  # the map says no way from one to the other, or it is not driven as the lanes are
        angle = float(turning[b + 1] - turning[a - 1])
        figures = {"turned_rad": angle, "duration_s": float(samples.t[on[b]] - samples.t[on[a]])}
        start, end = int(on[a]), int(on[b])
        yield LabelledManeuver(
            _named(angle, rules.straight, rules.u_turn),
            int(samples.owner[start]),
            start,
            end,
            start,
            figures=figures,
        )


def _turning(features: Features, on: np.ndarray) -> Floats:
    """Sums of the turns [rad] of the lanes from sample to sample."""
    heading = features.lane_heading[on]
    return np.concatenate([[0.0], np.cumsum(wrap_angle(np.diff(heading)))])[: len(on)]


def _named(angle: float, straight: float, u_turn: float) -> str:
    if abs(angle) >= u_turn:
        return "u_turn"
    if abs(angle) <= straight:
        return "straight"
    return "turn_left" if angle > 0.0 else "turn_right"


FAMILIES.add(
    LabelFamily(
        "turns", LABELS, find, "a way through a junction, by how far its lanes turn", "Kaefer 2022, 4.5.6.8"
    )
)
