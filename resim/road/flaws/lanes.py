"""Flaws of lane sections, lanes and signs.

NO_DRIVING_LANE: the map has no lane that vehicles drive on. SECTION_BEYOND_END: a section begins at or behind the end
of its road (error over 0.5 m behind it). LATE_SECTION: the first section begins over 0.01 m behind the road's start
(error over 0.5 m), where the road has no lane. LATE_WIDTH: the first width or border of a lane begins over 0.01 m
behind the section's start; it is taken from there on. LANE_STEP: the centre of a lane that vehicles drive on jumps by
over 0.1 m to the side within its section. NO_WIDTH: a lane has neither width nor border (note unless vehicles drive
on it). NEGATIVE_WIDTH: below -1 mm (error on a driven lane below -0.1 m). WIDE_LANE: over 20 m. SPEED_SIGN: a
speed-limit sign says no speed that a sign can show, and is passed over. UNREAD_RECORD: a lane's height or road mark
cannot be read, and is passed over (note). UNKNOWN_TYPE: a lane's type is not a type of OpenDRIVE; nobody drives on it.
TWO_WIDTHS: a lane has widths and borders; the widths are taken.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from resim.core.geometry import Floats
from resim.road.flaws.flaw import Flaw, Severity
from resim.road.opendrive import LANE_TYPES, Lane, LaneSection, Road, RoadNetwork
from resim.road.opendrive.model import Cubic

NEGATIVE, FOLDED = -1e-3, -0.1
WIDE = 20.0
LATE, STEP, BROKEN = 0.01, 0.1, 0.5
JUST_BEFORE = 1e-9
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
        if (late := road.sections[0].start) > LATE:
            text = (
                f"road {road.id}: its first lane section begins at s={late:.3f} m, it has no lane before that"
            )
            yield Flaw(
                "error" if late > BROKEN else "warning",
                "LATE_SECTION",
                road.id,
                0,
                None,
                late,
                late,
                "m",
                text,
            )
        for index, section in enumerate(road.sections):
            if section.start >= road.length:
                text = (
                    f"road {road.id}: its lane section {index} begins at s={section.start:.3f} m, the road "
                    f"ends at {road.length:.3f} m"
                )
                beyond = section.start - road.length
                yield Flaw("error" if beyond > BROKEN else "warning", "SECTION_BEYOND_END", road.id, index, None,
                           section.start, beyond, "m", text)  # fmt: skip
            elif section.end > section.start:
                for lane in section.lanes.values():
                    yield from _unread(road, index, section, lane)
                    if lane.id:
                        yield from _widths(network, road, index, section, lane)
                    if lane.id and lane.drivable:
                        yield from _steps(network, road, index, section, lane)


def _signs(road: Road) -> Iterator[Flaw]:
    for sign in road.signs:
        if math.isnan(sign.speed):
            text = (
                f"road {road.id}: the speed-limit sign {sign.id} at s={sign.s:.3f} m ({sign.text}) shows no "
                "speed a sign can show, and is passed over"
            )
            yield Flaw("warning", "SPEED_SIGN", road.id, None, None, sign.s, math.nan, "", text)


def _unread(road: Road, index: int, section: LaneSection, lane: Lane) -> Iterator[Flaw]:
    where = f"road {road.id}, lane section {index}, lane {lane.id}"
    for problem in lane.unread:
        text = f"{where}, {problem}; it is ignored"
        yield Flaw("note", "UNREAD_RECORD", road.id, index, lane.id, None, math.nan, "", text)
    if not lane.id:
        return
    doubts = []
    if lane.type not in LANE_TYPES:
        doubts.append(("UNKNOWN_TYPE", f"type={lane.type!r} is not a type of OpenDRIVE; nobody drives on it"))
    if lane.widths and lane.borders:
        doubts.append(("TWO_WIDTHS", "it has widths and borders; the widths are used"))
    for code, says in doubts:
        yield Flaw("warning", code, road.id, index, lane.id, section.start, math.nan, "", f"{where}: {says}")


def _steps(network: RoadNetwork, road: Road, index: int, section: LaneSection, lane: Lane) -> Iterator[Flaw]:
    """Where the lane's centre jumps to the side; jumps of the reference line are told elsewhere."""
    begins = {record.s for record in road.lane_offsets}
    for other in section.lanes.values():
        if other.id * lane.id > 0 and abs(other.id) <= abs(lane.id):
            begins |= {section.start + record.s for record in other.widths or other.borders}
    at = np.array(sorted(s for s in begins if section.start < s < min(section.end, road.length)))
    if not len(at):
        return
    before, after = (_aside(network, road, lane, s) for s in (at - JUST_BEFORE, at))
    steps = np.abs(after - before)
    for s, step in zip(at[steps > STEP].tolist(), steps[steps > STEP].tolist(), strict=True):
        text = f"road {road.id}, lane section {index}, lane {lane.id} jumps to the side by {step:.3f} m at s={s:.3f} m"
        yield Flaw("warning", "LANE_STEP", road.id, index, lane.id, s, step, "m", text)


def _aside(network: RoadNetwork, road: Road, lane: Lane, s: Floats) -> Floats:
    """How far (K,) [m] the lane's centre lies to the left of the reference line."""
    (x, y), (x0, y0, heading) = network.to_xy(road.id, lane.id, s, 0.0), network.reference_line(road.id, s)
    return np.asarray(np.cos(heading) * (y - y0) - np.sin(heading) * (x - x0))


def _widths(network: RoadNetwork, road: Road, index: int, section: LaneSection, lane: Lane) -> Iterator[Flaw]:
    where = f"road {road.id}, lane section {index}, lane {lane.id}"
    severity: Severity
    if not lane.widths and not lane.borders:
        severity = "error" if lane.drivable else "note"
        yield Flaw(severity, "NO_WIDTH", road.id, index, lane.id, section.start, math.nan, "",
                   f"{where} has neither width nor border")  # fmt: skip
        return
    late = (lane.widths or lane.borders)[0].s
    if late > LATE:
        yield Flaw("warning", "LATE_WIDTH", road.id, index, lane.id, section.start, late, "m",
                   f"{where} has no width on its first {late:.3f} m; that of its first record is used")  # fmt: skip
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
