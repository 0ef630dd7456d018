"""Flaws of lane sections, lanes and signs.

NO_DRIVING_LANE: the map has no lane that vehicles drive on. SECTION_BEYOND_END: a section begins at or behind
the end of its road. NO_WIDTH: a lane has neither width nor border (note unless vehicles drive on it).
NEGATIVE_WIDTH: below -1 mm (error on a driven lane below -0.1 m). WIDE_LANE: over 20 m. SPEED_SIGN: a speed-limit
sign says no speed that a sign can show, and is passed over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from resim.core.geometry import Floats
from resim.road.flaws.flaw import Flaw, Severity
from resim.road.opendrive import Lane, LaneSection, Road, RoadNetwork
from resim.road.opendrive.model import Cubic

NEGATIVE, FOLDED = -1e-3, -0.1
WIDE = 20.0
SAMPLES = 33


def flaws(network: RoadNetwork) -> Iterator[Flaw]:
    """Give the flaws of all lanes and signs."""
    roads = network.roads.values()
    lanes = (lane for road in roads for section in road.sections for lane in section.lanes.values())
    if not any(lane.drivable and lane.id for lane in lanes):
        text = "the map has no lane that vehicles drive on"
        yield Flaw("error", "NO_DRIVING_LANE", None, None, None, None, math.nan, "", text)
    for road in roads:
        yield from _signs(road)
        for index, section in enumerate(road.sections):
            if section.start >= road.length:
                text = (
                    f"road {road.id}: its lane section {index} begins at s={section.start:.3f} m, the road "
                    f"ends at {road.length:.3f} m"
                )
                yield Flaw("warning", "SECTION_BEYOND_END", road.id, index, None, section.start,
                           section.start - road.length, "m", text)  # fmt: skip
            elif section.end > section.start:
                for lane in section.lanes.values():
                    if lane.id:
                        yield from _widths(network, road, index, section, lane)


def _signs(road: Road) -> Iterator[Flaw]:
    for sign in road.signs:
        if math.isnan(sign.speed):
            text = (
                f"road {road.id}: the speed-limit sign {sign.id} at s={sign.s:.3f} m ({sign.text}) shows no "
                "speed a sign can show, and is passed over"
            )
            yield Flaw("warning", "SPEED_SIGN", road.id, None, None, sign.s, math.nan, "", text)


def _widths(network: RoadNetwork, road: Road, index: int, section: LaneSection, lane: Lane) -> Iterator[Flaw]:
    where = f"road {road.id}, lane section {index}, lane {lane.id}"
    severity: Severity
    if not lane.widths and not lane.borders:
        severity = "error" if lane.drivable else "note"
        yield Flaw(severity, "NO_WIDTH", road.id, index, lane.id, section.start, math.nan, "",
                   f"{where} has neither width nor border")  # fmt: skip
        return
    s = _turning_points(section, lane, min(section.end, road.length))
    width = network.lane_width(road.id, lane.id, s)
    low, high = int(np.argmin(width)), int(np.argmax(width))
    if width[low] < NEGATIVE:
        severity = "error" if lane.drivable and width[low] < FOLDED else "warning"
        yield Flaw(severity, "NEGATIVE_WIDTH", road.id, index, lane.id, float(s[low]), float(width[low]), "m",
                   f"{where} is {width[low]:.3f} m wide at s={s[low]:.3f} m")  # fmt: skip
    if width[high] > WIDE:
        yield Flaw("warning", "WIDE_LANE", road.id, index, lane.id, float(s[high]), float(width[high]), "m",
                   f"{where} is {width[high]:.1f} m wide at s={s[high]:.3f} m")  # fmt: skip


def _turning_points(section: LaneSection, lane: Lane, end: float) -> Floats:
    """Every s at which the lane may be narrowest or widest; of a lane made by borders, some."""
    if not lane.widths:
        return np.linspace(section.start, end - 1e-9, SAMPLES)
    at = [section.start]
    ends = [record.s for record in lane.widths[1:]] + [end - section.start]
    for record, until in zip(lane.widths, ends, strict=True):
        inside = [0.0, *(ds for ds in _turns(record) if 0.0 < ds < until - record.s), until - record.s - 1e-9]
        at += [section.start + record.s + ds for ds in inside]
    s = np.array(at)
    return s[(s >= section.start) & (s < end)]


def _turns(record: Cubic) -> list[float]:
    """Every ds at which b + 2 c ds + 3 d ds² is zero; without the cancellation and overflow of the usual formula."""
    square, half, rest = 3.0 * record.d, record.c, record.b
    under = half * half - square * rest
    if under < 0.0:
        return []
    q = -(half + math.copysign(math.sqrt(under), half))
    return [top / below for top, below in ((q, square), (rest, q)) if below]
