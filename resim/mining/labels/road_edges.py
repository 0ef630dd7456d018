"""Where the road itself is the scene (Kaefer's catalogs): it gets or loses a lane, is left at its edge, or parked on.

Which lanes are driven, and which are for parking, the map says. He says no numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import Bools
from resim.mining.features import Features
from resim.mining.labels.others import STILL, slanted
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver, drove
from resim.mining.runs import stretches
from resim.mining.samples import Ints
from resim.mining.settings import MiningSettings

WIDER, NARROWER = "road_widens", "lane_ends"
DEPARTURE, PARKS, UNPARKS = "leave_road", "enter_parking", "leave_parking"
PARKING = "parking"


def find_lanes(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who drives over a place where its road, outside of junctions, gets lanes or loses some."""
    samples, lanes = features.samples, features.lanes
    driven = (features.row >= 0) & features.with_lane & (features.junction < 0)
    driven &= samples.kinds(frozenset(settings.kinds))
    one = np.flatnonzero(driven[:-1] & driven[1:] & (np.diff(samples.piece_of) == 0))
    table = lanes.network.lane_table
    before, after = features.row[one], features.row[one + 1]
    moved = (lanes.road[before] != lanes.road[after]) | (table.section[before] != table.section[after])
    for k, change in zip(
        one[moved].tolist(), (lanes.lanes[after] - lanes.lanes[before])[moved].tolist(), strict=True
    ):
        if change:
            label = WIDER if change > 0 else NARROWER
            yield LabelledManeuver(
                label, int(samples.owner[k]), k, k + 1, k + 1, figures={"lanes": float(abs(change))}
            )


def find_edges(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who comes from a driven lane beyond the edge of the road, and who parks beside or leaves there."""
    samples = features.samples
    wanted = samples.kinds(frozenset(settings.kinds))
    first, last = stretches((features.row < 0) & wanted, samples.piece_of)
    if not len(first):
        return
    piece = samples.piece_of
    entered, left = first > 0, last + 1 < len(samples)
    entered[entered] = piece[first[entered] - 1] == piece[first[entered]]
    left[left] = piece[last[left] + 1] == piece[last[left]]
    across = slanted(features)
    beside, in_junction = _beside(features, np.r_[first, last])
    barely = left & (samples.t[last] - samples.t[first] < settings.road_edge.shortest)
    elsewhere = barely | in_junction[: len(first)] | across[first - 1]
    for k, (start, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        moving = np.flatnonzero(np.abs(samples.v[start : end + 1]) > STILL) + start
        if entered[k] and beside[k] == PARKING:
            stops = int(moving[-1]) if len(moving) else start
            yield drove(features, PARKS, start - 1, stops, start)
        elif entered[k] and not elsewhere[k] and _off_road(features, start - 1, beside[k]):
            yield drove(features, DEPARTURE, start - 1, end, start)
        if left[k] and beside[len(first) + k] == PARKING:
            starts = int(moving[0]) if len(moving) else end
            yield drove(features, UNPARKS, starts, end + 1, end + 1)


def _beside(features: Features, at: Ints) -> tuple[list[str], Bools]:
    """The type of the lane that nobody drives on at samples, "" for none, parking first; and which are in junctions."""
    network = features.lanes.network
    found = network.lanes_at(features.samples.x[at], features.samples.y[at])
    out, inside = [""] * len(at), np.zeros(len(at), dtype=bool)
    for point, row in zip(found.point.tolist(), found.row.tolist(), strict=True):
        kind = network.lane_table.types[row]
        if network.lane_table.lane[row] != 0 and out[point] != PARKING:
            out[point] = kind
            inside[point] |= features.lanes.junction[row] >= 0
    return out, inside


def _off_road(features: Features, k: int, beside: str) -> bool:
    """Whether who is on no driven lane after sample k left at the side, and not in a junction or at a road's end."""
    samples = features.samples
    if features.junction[k] >= 0:
        return False
    if beside:
        return True
    road = features.lanes.road_of(features.row[k])
    step = 1.0 + float(np.hypot(samples.x[k + 1] - samples.x[k], samples.y[k + 1] - samples.y[k]))
    return bool(step < features.s[k] < road.length - step)


FAMILIES.add(
    LabelFamily(
        "lanes of the road", (WIDER, NARROWER), find_lanes, "the road gets lanes or loses some",
        "Kaefer 2022, Appendix 1",
    )
)  # fmt: skip
FAMILIES.add(
    LabelFamily(
        "edges of the road", (DEPARTURE, PARKS, UNPARKS), find_edges,
        "beyond the driven lanes, and from or onto a parking lane",
        "Kaefer 2022, Appendix 1",
    )
)  # fmt: skip
