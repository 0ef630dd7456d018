"""Flaws of what is not read, or has no meaning that is known.

REVISION: not OpenDRIVE 1.4 to 1.8 (error where not 1.x). INCLUDE: another file belongs to the map, and is not read.
TWO_CURVES: an element of a reference line holds two curves; UNKNOWN_RANGE, UNKNOWN_RULE: the pRange of a paramPoly3,
or the side of the traffic, is no word of OpenDRIVE. All of these are errors: places or ways may be others. Warnings:
UNREAD_ACCESS (who may drive on a lane), NEGATIVE_LIMIT (a speed limit below zero, taken for none), UNREAD_HEIGHT
(crossfall, shapes and surfaces: x and y do not depend on them, z does).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from resim.road.flaws.flaw import Flaw, Severity
from resim.road.opendrive import RoadNetwork

OF_CODE: dict[str, Severity] = {
    "INCLUDE": "error", "TWO_CURVES": "error", "UNKNOWN_RANGE": "error", "UNKNOWN_RULE": "error",
    "UNREAD_ACCESS": "warning", "NEGATIVE_LIMIT": "warning", "UNREAD_HEIGHT": "warning",
}  # fmt: skip
MINOR = (4, 8)


def flaws(network: RoadNetwork) -> Iterator[Flaw]:
    """Give the flaws of the header and of what is left out."""
    major, minor = network.header.revision
    if major != 1 or not MINOR[0] <= minor <= MINOR[1]:
        text = f"the map declares OpenDRIVE {major}.{minor}; it is read as one of 1.4 to 1.8"
        yield Flaw(
            "error" if major != 1 else "warning", "REVISION", None, None, None, None, math.nan, "", text
        )
    for one in network.unread:
        s = None if math.isnan(one.s) else one.s
        yield Flaw(OF_CODE[one.code], one.code, one.road, None, one.lane, s, math.nan, "", one.text)
