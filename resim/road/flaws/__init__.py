"""What is wrong in an OpenDRIVE map, told element by element: flaws(network)."""

from __future__ import annotations

from resim.road.flaws import lanes, links, planview, unread
from resim.road.flaws.flaw import SEVERITIES, Flaw, Severity
from resim.road.opendrive import RoadNetwork

MAP_CODES = frozenset(
    {
        "CURVE_START",
        "ELEMENT_HOLE",
        "ELEMENT_OVERLAP",
        "EMPTY_ELEMENT",
        "INCLUDE",
        "KINK",
        "LANE_GAP",
        "LANE_STEP",
        "LATE_SECTION",
        "LATE_WIDTH",
        "LINE_GAP",
        "LINK_INSIDE",
        "MISSING_JUNCTION",
        "MISSING_LANE",
        "MISSING_ROAD",
        "NEGATIVE_LIMIT",
        "NEGATIVE_WIDTH",
        "NO_DRIVING_LANE",
        "NO_WIDTH",
        "ONE_SIDED",
        "REVISION",
        "ROAD_GAP",
        "ROAD_LENGTH",
        "SECTION_BEYOND_END",
        "SPEED_SIGN",
        "STRETCHED",
        "TWO_CURVES",
        "TWO_WIDTHS",
        "UNKNOWN_RANGE",
        "UNKNOWN_RULE",
        "UNKNOWN_TYPE",
        "UNREAD_ACCESS",
        "UNREAD_HEIGHT",
        "UNREAD_RECORD",
        "WIDE_LANE",
    }
)
"""Every code that a flaw can have."""

__all__ = ["MAP_CODES", "SEVERITIES", "Flaw", "Severity", "flaws"]


def flaws(network: RoadNetwork) -> tuple[Flaw, ...]:
    """Give every flaw of the map, errors first, then by code, the largest value first.

    error: places are lost, or traffic cannot go on as the file means it. warning: positions or limits near
    the place are in doubt. note: nothing to fear, but the file does not say what it should. Codes: see
    `planview`, `lanes`, `links` and `unread`. The same map gives the same flaws in the same order.
    """
    found = {*planview.flaws(network), *lanes.flaws(network), *links.flaws(network), *unread.flaws(network)}
    return tuple(sorted(found, key=Flaw.order))
