"""Cut-ins and cut-outs: lane changes with a time to collision below 2 s (Kaefer 2022, 4.5.6.3).

Readings taken: the one who changes lane is labelled; cut-in from the crossing to Kaefer's end, against the follower on
the lane that it is on at that sample; cut-out from Kaefer's start to the sample before the crossing, against its
leader; of doubles the first crossing counts. TTC is distance by closing speed (printed upside down); who does not close
in has none; one sample strictly below is enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.mining.features import Features
from resim.mining.labels.lane_change import LEFT, OPEN, LaneChangeLabel
from resim.mining.lane_map import Rows
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.settings import MiningSettings


def ttc(distance: Floats, v_behind: Floats, v_ahead: Floats) -> Floats:
    """Give times to collision [s] of distances [m] and speeds [m/s]; infinite for who does not close in."""
    closing = v_behind - v_ahead
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(closing > 0.0, distance / closing, np.inf)


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find the cut-ins and cut-outs among lane changes."""
    flow, centre = features.flow, settings.cut.distance == "centre"
    for change in found:
        if not isinstance(change, LaneChangeLabel) or change.label == OPEN:
            continue
        side = "left" if change.label == LEFT else "right"
        entered = slice(change.at, change.close_after + 1)
        behind = flow.follower, flow.distance_behind if centre else flow.gap_behind
        yield from _cut(features, settings, change, f"cut_in_{side}", entered, behind)
        left = slice(change.close_before, change.at)
        ahead = flow.leader, flow.distance if centre else flow.gap
        yield from _cut(features, settings, change, f"cut_out_{side}", left, ahead)


def _cut(
    features: Features,
    settings: MiningSettings,
    change: LaneChangeLabel,
    label: str,
    span: slice,
    of: tuple[Rows, Floats],
) -> Iterator[LabelledManeuver]:
    """The cut-in or cut-out of a lane change, if it is one; of: who is behind or ahead, and how far [m]."""
    other, distance = of[0][span], of[1][span]
    v, inwards = features.samples.v, label.startswith("cut_in")
    v_other = v[other]
    times = ttc(distance, v_other, v[span]) if inwards else ttc(distance, v[span], v_other)
    times = np.where(other >= 0, times, np.inf)
    if not len(times) or not times.min() < settings.cut.ttc:
        return
    worst = int(np.argmin(times))
    figures = {
        "ttc_s": float(times[worst]),
        "distance_m": float(distance[worst]),
        "closing_mps": float(abs(v_other[worst] - v[span][worst])),
        "lanes": abs(float(change.lanes)),
    }
    end = max(change.end, change.close_after)
    partner = int(features.samples.owner[other[worst]])
    yield LabelledManeuver(
        label, change.object, min(change.start, change.close_before), end, change.at, partner, figures
    )


FAMILIES.add(
    LabelFamily(
        "cut", ("cut_in_left", "cut_in_right", "cut_out_left", "cut_out_right"), find,
        "a lane change with a time to collision below 2 s to the new follower (cut-in) or the old leader (cut-out)",
        "Kaefer 2022, 4.5.6.3",
    )
)  # fmt: skip
