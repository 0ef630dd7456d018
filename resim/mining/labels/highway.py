"""Entering and leaving a highway, where the map says what is a ramp or a motorway (Kaefer 2022, 4.5.6.9).

By lane types (entry, onRamp, mwyEntry; exit, offRamp, mwyExit), and by road types (motorway next to another one that is
told). On maps that say neither nothing is judged: `regions` says it there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver, drove
from resim.mining.settings import MiningSettings

ENTER, EXIT = "enter_highway", "exit_highway"
ON = ("entry", "onRamp", "mwyEntry")
OFF = ("exit", "offRamp", "mwyExit")
UNKNOWN, ON_RAMP, OFF_RAMP, MAIN, OTHER = range(5)


def classes(features: Features) -> NDArray[np.int8]:
    """Give what kind of road each lane (L,) is of: UNKNOWN, ON_RAMP, OFF_RAMP, MAIN (motorway), OTHER."""
    lanes = features.lanes
    told = ~np.isin(lanes.road_type, ["", "unknown"]) & (lanes.junction < 0)
    out = np.where(told, np.where(lanes.road_type == "motorway", MAIN, OTHER), UNKNOWN)
    on, off = np.isin(lanes.kind, ON), np.isin(lanes.kind, OFF)
    ramped = np.unique(lanes.road[on | off])  # a road with a ramp's lane beside is a highway
    beside = np.isin(lanes.road, ramped) & (lanes.kind == "driving") & (lanes.road_type != "town")
    out = np.where(beside, MAIN, out)
    return np.where(on, ON_RAMP, np.where(off, OFF_RAMP, out)).astype(np.int8)


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who enters or leaves a highway."""
    samples, of = features.samples, classes(features)
    if not (np.isin(of, [ON_RAMP, OFF_RAMP]).any() or {MAIN, OTHER} <= set(of.tolist())):
        return
    on = np.flatnonzero((features.row >= 0) & samples.kinds(frozenset(settings.kinds)))
    on = on[of[features.row[on]] != UNKNOWN]
    if not len(on):
        return
    code, group = of[features.row[on]], samples.piece_of[on]
    new = np.ones(len(on), dtype=bool)
    new[1:] = (np.diff(code) != 0) | (np.diff(group) != 0)
    start = np.flatnonzero(new)
    last = np.append(start[1:], len(on)) - 1
    for one, two in zip(range(len(start) - 1), range(1, len(start)), strict=True):
        if group[start[one]] != group[start[two]]:
            continue
        pair = code[start[one]], code[start[two]]
        entered = int(on[start[two]])
        if pair in ((ON_RAMP, MAIN), (OTHER, MAIN)):
            begin = int(on[start[one]]) if pair[0] == ON_RAMP else int(on[last[one]])
            yield drove(features, ENTER, begin, entered, entered)
        elif pair in ((MAIN, OFF_RAMP), (MAIN, OTHER)):
            end = int(on[last[two]]) if pair[1] == OFF_RAMP else entered
            begin = entered if pair[1] == OFF_RAMP else int(on[last[one]])
            yield drove(features, EXIT, begin, end, entered)


FAMILIES.add(
    LabelFamily(
        "highway", (ENTER, EXIT), find, "from a ramp, or a road of another type, onto a motorway, and off it",
        "Kaefer 2022, 4.5.6.9",
    )
)  # fmt: skip
