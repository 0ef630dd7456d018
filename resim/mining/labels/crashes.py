"""How collisions came about: crossing paths at junctions, and drifting into somebody beside (Kaefer's catalogs).

The kinds are those of the American crash statistics that his rows are taken from. Whose ways cross, the map says of the
lanes by which both came through the junction. Readings taken: who comes from the opposite direction comes within 45
degrees of it, and who comes from a side likewise; a right turn is across the path of somebody from the left while it
stands across its way, and into it after; what is none of these is other, unless both came from one direction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from resim.core.geometry import wrap_angle
from resim.mining.features import Features
from resim.mining.labels.collision import COLLISION
from resim.mining.labels.turns import crossings
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.settings import CrashSettings, MiningSettings

SIDESWIPE = "sideswipe"
LEFT_LATERAL, LEFT_OPPOSITE, LEFT_INTO = (
    "crash_left_across_lateral", "crash_left_across_opposite", "crash_left_into_path",
)  # fmt: skip
RIGHT_LATERAL, RIGHT_INTO = "crash_right_across_lateral", "crash_right_into_path"
STRAIGHT, OTHER = "crash_straight_crossing", "crash_other_crossing"
QUARTER = 0.25 * np.pi


class _Way(NamedTuple):
    """A way through a junction: its number, the heading at its start, and its turn [rad]."""

    junction: int
    heading: float
    turn: float


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find how collisions of vehicles came about."""
    collisions = [one for one in found if one.label == COLLISION]
    if not collisions:
        return
    samples = features.samples
    wanted = samples.kinds(frozenset(settings.kinds))
    counts = crossings(features.lanes, settings.turn)
    for one in collisions:
        own, other = one.start, samples.at(one.partner, int(samples.step[one.start]))
        if not (wanted[own] and wanted[other]):
            continue
        ways = [_way(features, settings.crash, k, counts) for k in (own, other)]
        label = ""
        if ways[0] is not None and ways[1] is not None and ways[0].junction == ways[1].junction:
            label = _crossing(features, settings, (own, other), (ways[0], ways[1]))
        elif _sideswipe(features, settings.crash, own, other):
            label = SIDESWIPE
        if label:
            yield LabelledManeuver(label, one.object, one.start, one.end, one.at, one.partner)


def _way(features: Features, rules: CrashSettings, k: int, counts: np.ndarray) -> _Way | None:
    """The way by which somebody came through a junction that it is in, or was `lately`."""
    samples, lanes = features.samples, features.lanes
    low = int(samples.piece[samples.piece_of[k]])
    own = np.arange(k, low - 1, -1)
    own = own[samples.t[own] >= samples.t[k] - rules.lately]
    junction = features.junction[own]
    inside = np.flatnonzero(junction >= 0)
    if not len(inside) or not counts[junction[inside[0]]]:
        return None
    last = int(own[inside[0]])
    row = int(features.row[last])
    table, network = lanes.network.lane_table, lanes.network
    road = lanes.road_of(row)
    s = table.start[row] if table.forward[row] else min(table.end[row], road.length) - 1e-9
    heading = float(network.lane_heading(road.id, int(table.lane[row]), s))
    through = (table.road == table.road[row]) & (table.lane == table.lane[row])
    return _Way(int(features.junction[last]), heading, float(np.nansum(lanes.turn[through])))


def _crossing(
    features: Features, settings: MiningSettings, at: tuple[int, int], ways: tuple[_Way, _Way]
) -> str:
    """How the paths of two at samples `at` cross, told of the first; "" where they do not, or of the other alone."""
    own, other = ways
    straight = settings.turn.straight
    side = float(wrap_angle(other.heading - own.heading))
    goes_on = abs(other.turn) <= straight
    if abs(side) < QUARTER and goes_on == (abs(own.turn) <= straight):
        return ""  # one behind the other, or side by side
    if abs(own.turn) <= straight:
        if not goes_on:
            return ""
        return STRAIGHT if QUARTER <= abs(side) <= 3.0 * QUARTER else OTHER
    if not goes_on or abs(side) < QUARTER:
        return OTHER
    if own.turn > 0.0:
        if abs(side) > 3.0 * QUARTER:
            return LEFT_OPPOSITE
        return LEFT_LATERAL if side < 0.0 else LEFT_INTO
    if side < 0.0 and side >= -3.0 * QUARTER:
        heading = features.samples.heading
        off = abs(float(wrap_angle(heading[at[0]] - heading[at[1]])))
        return RIGHT_LATERAL if off >= settings.crash.across else RIGHT_INTO
    return OTHER


def _sideswipe(features: Features, rules: CrashSettings, own: int, other: int) -> bool:
    """Whether two that go the same way touch at their sides: their boxes overlap more along than across.

    Along is midway between their headings, so that it is said of both or of none.
    """
    samples = features.samples
    between = float(wrap_angle(samples.heading[other] - samples.heading[own]))
    if abs(between) > rules.along:
        return False
    heading = samples.heading[own] + 0.5 * between
    dx, dy = samples.x[other] - samples.x[own], samples.y[other] - samples.y[own]
    along, across = (
        abs(dx * np.cos(heading) + dy * np.sin(heading)),
        abs(dy * np.cos(heading) - dx * np.sin(heading)),
    )
    size = [
        0.5 * (values[samples.owner[own]] + values[samples.owner[other]])
        for values in (samples.tracks.length, samples.tracks.width)
    ]
    return bool(size[0] - along > size[1] - across)


FAMILIES.add(
    LabelFamily(
        "crashes",
        (SIDESWIPE, LEFT_LATERAL, LEFT_OPPOSITE, LEFT_INTO, RIGHT_LATERAL, RIGHT_INTO, STRAIGHT, OTHER),
        find, "how a collision came about: drifting, or crossing paths at a junction",
        "Kaefer 2022, Appendix 1; our numbers",
    )
)  # fmt: skip
