"""Turns the <lanes> of a road into lane sections."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import TypeVar

from lxml.etree import _Element

from resim.core.errors import InputError
from resim.road.opendrive.model import Cubic, Height, Lane, LaneSection, RoadMark
from resim.road.opendrive.sections import both_sides
from resim.road.opendrive.signs import SPEED_UNITS
from resim.road.opendrive.xml import Reader

Record = TypeVar("Record", Height, RoadMark)
Coefficients = tuple[float, float, float, float]


class LaneReader(Reader):
    """Reads lane sections and what they share with roads: polynomials and speeds."""

    def sections(self, road: _Element, length: float, where: str) -> tuple[LaneSection, ...]:
        """Read the lane sections of a road of this length [m]."""
        elements = road.findall("lanes/laneSection")
        if not elements:
            raise self.error(where, "has no laneSection")
        starts = [self.number(e, "s", f"{where}, laneSection {i}") for i, e in enumerate(elements)]
        if starts[0] < 0.0:
            raise self.error(where, f"laneSection starts at s={starts[0]:g}, before the road")
        single = [element.get("singleSide") in ("true", "1") for element in elements]
        for i, (before, after) in enumerate(pairwise(starts)):
            if after < before:
                raise self.error(where, f"laneSections start at s={starts}, which does not increase")
            if after == before and not (single[i] and single[i + 1]):
                raise self.error(where, f"two laneSections start at s={after:g}")
        lanes = [self._lanes(element, f"{where}, laneSection {i}") for i, element in enumerate(elements)]
        for i in range(1, len(lanes)):
            if single[i]:
                lanes[i - 1], lanes[i] = both_sides(lanes[i - 1], lanes[i], starts[i] - starts[i - 1])
        ends = [*starts[1:], max(length, starts[-1])]
        return tuple(LaneSection(*section) for section in zip(starts, ends, lanes, strict=True))

    def _lanes(self, section: _Element, where: str) -> dict[int, Lane]:
        lanes = [self._lane(element, where) for element in section.iterfind("*/lane")]
        ids = [lane.id for lane in lanes]
        if len(set(ids)) != len(ids):
            raise self.error(where, f"a lane id is a duplicate among {ids}")
        for inner, outer in pairwise(sorted({0, *ids}, key=abs)):
            before = outer - 1 if outer > 0 else outer + 1
            if before not in (0, *ids):
                raise self.error(where, f"lane {before} is missing between lane {inner} and lane {outer}")
        return {lane.id: lane for lane in sorted(lanes, key=lambda lane: lane.id)}

    def _lane(self, element: _Element, where: str) -> Lane:
        lane_id = self.integer(element, "id", where)
        at = f"{where}, lane {lane_id}"
        heights, lost = self._readable(element, "height", self._height)
        marks, unmarked = self._readable(element, "roadMark", self._mark)
        return Lane(
            id=lane_id, type=element.get("type", "none"),
            widths=self.cubics(element, "width", "sOffset", at),
            borders=self.cubics(element, "border", "sOffset", at),
            marks=tuple(sorted(marks, key=lambda mark: mark.s_offset)),
            speeds=tuple(sorted(
                ((self.number(e, "sOffset", at), self.speed(e, at)) for e in element.iterfind("speed")),
                key=lambda record: record[0],
            )),
            predecessor=self._lane_link(element, "predecessor", at),
            successor=self._lane_link(element, "successor", at),
            heights=tuple(sorted(heights, key=lambda height: height.s)),
            reversed=element.get("direction") == "reversed", unread=(*lost, *unmarked),
        )  # fmt: skip

    def _readable(
        self, lane: _Element, tag: str, read: Callable[[_Element, str], Record]
    ) -> tuple[list[Record], list[str]]:
        """The records of this tag, and what is wrong with those that cannot be read.

        For records that move no lane: no map is refused because of them.
        """
        found, unread = [], []
        for i, element in enumerate(lane.iterfind(tag)):
            try:
                found.append(read(element, f"{tag} {i}"))
            except InputError as error:
                unread.append(error.problem)
        return found, unread

    def _height(self, element: _Element, where: str) -> Height:
        s, inner, outer = (self.number(element, name, where) for name in ("sOffset", "inner", "outer"))
        return Height(s, inner, outer)

    def _mark(self, element: _Element, where: str) -> RoadMark:
        return RoadMark(
            self.number(element, "sOffset", where, 0.0), element.get("type", "none"),
            element.get("color", "standard"),
            self.number(element, "width", where) if "width" in element.attrib else None,
        )  # fmt: skip

    def lane_offsets(self, road: _Element, where: str) -> tuple[Cubic, ...]:
        """Read the lane offsets. Before the first there is none: a record says so where that is not at 0."""
        found = self.cubics(road, "lanes/laneOffset", "s", where)
        return (Cubic(0.0, 0.0, 0.0, 0.0, 0.0), *found) if found and found[0].s > 0.0 else found

    def _lane_link(self, lane: _Element, tag: str, where: str) -> int | None:
        element = lane.find(f"link/{tag}")
        return None if element is None else self.integer(element, "id", where)

    def cubics(self, parent: _Element, tag: str, s: str, where: str) -> tuple[Cubic, ...]:
        """Read the polynomials at `tag`, in order of the attribute `s` [m]."""
        found = []
        for i, element in enumerate(parent.iterfind(tag)):
            at = f"{where}, {tag.rpartition('/')[2]} {i}"
            found.append(Cubic(self.number(element, s, at), *self.coefficients(element, "", at)))
        return tuple(sorted(found, key=lambda cubic: cubic.s))

    def coefficients(self, element: _Element, suffix: str, where: str) -> Coefficients:
        """Read the attributes a, b, c, d with this suffix."""
        a, b, c, d = (self.number(element, name + suffix, where) for name in "abcd")
        return a, b, c, d

    def speed(self, element: _Element, where: str) -> float:
        """Read the attribute max as a speed [m/s]: inf for no limit, NaN where undefined or below zero."""
        text = element.get("max", "undefined")
        if text in ("no limit", "undefined"):
            return math.inf if text == "no limit" else math.nan
        unit = element.get("unit", "m/s")
        if unit not in SPEED_UNITS:
            raise self.error(where, f"speed unit {unit!r} is none of {', '.join(SPEED_UNITS)}")
        speed = self.number(element, "max", where)
        return speed * SPEED_UNITS[unit] if speed >= 0.0 else math.nan
