"""Where the file says that lanes are, read and computed anew: what a net is measured against.

It shares no code with the reader, the evaluator and the sampler that the net was made with, so that a fault of theirs
shows in the error that is reported. Lines, arcs and spirals: their heading is summed up by Simpson's rule. Polynomials:
by chords. Records are found by their beginnings, at places that are never closer to one than SIDE.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np
from lxml.etree import _Element

from resim.core.geometry import Floats
from resim.road.opendrive.xml import parse
from resim.road.sumo.element import Element, number
from resim.road.sumo.shapes import LaneStretch, SampledStretches

SIDE, EMPTY = 1e-7, 1e-9
AT_ONCE = 64
"""Stretches of a road that share one reference line: more of them take more memory."""

SPECK, FAR_LANE, SWING = 1.0, 25.0, 0.1
"""On elements shorter than SPECK [m] a lane FAR_LANE [m] away is looked at every SWING [m], at most 200 times."""

Record = tuple[float, float, float, float, float]
"""Where it begins on the road [m], and a, b, c, d."""


class RawLane(NamedTuple):
    """A lane's records of width, or of its outer border where it has no widths."""

    records: list[Record]
    by_border: bool


class RawSection(NamedTuple):
    """Lanes by id from start to end [m]; of a single-sided one the other side is that of the one before."""

    start: float
    end: float
    lanes: dict[int, RawLane]


class RawLanes:
    """The lanes of a file, by road id."""

    def __init__(self, path: Path) -> None:
        self.roads = {str(element.get("id")): RawRoad(element) for element in parse(path).iterfind("road")}

    def lanes(self) -> Iterator[tuple[str, int, int, float, float]]:
        """Give road, section, lane, start and end [m] of every lane but those of id 0."""
        for name, road in self.roads.items():
            for k, section in enumerate(road.sections):
                yield from ((name, k, lane, section.start, section.end) for lane in section.lanes if lane)

    def sample(self, stretches: Sequence[LaneStretch], step: float) -> SampledStretches:
        """Give the centres and widths of the stretches, in driving direction, at places at most step [m] apart.

        At every record's beginning and at the ends, places lie SIDE [m] to either side of it.
        """
        of_road = defaultdict(list)
        for i, stretch in enumerate(stretches):
            of_road[stretch.road].append(i)
        parts: list[tuple[Floats, Floats, Floats]] = [(np.zeros(0),) * 3] * len(stretches)
        for name, all_of_it in of_road.items():
            for own in (all_of_it[low : low + AT_ONCE] for low in range(0, len(all_of_it), AT_ONCE)):
                found = self.roads[name].sample([stretches[i] for i in own], step)
                for i, part in zip(own, found, strict=True):
                    parts[i] = part
        first = np.concatenate([[0], np.cumsum([len(s) for s, _, _ in parts])]).astype(np.intp)
        s, xy, width = (np.concatenate(column) for column in zip(*parts, strict=True))
        return SampledStretches(first, s, xy, width)


class RawRoad:
    """One <road>: its elements, lane offsets and lanes as they are written."""

    def __init__(self, road: _Element) -> None:
        geometries = road.iterfind("planView/geometry")
        self.elements = [Element(g) for g in geometries if number(g, "length") > EMPTY]
        self.starts = [element.s for element in self.elements]
        self.length = self.elements[-1].s + self.elements[-1].length
        self.offsets = _records(road.iterfind("lanes/laneOffset"), "s", 0.0)
        self.sections = list(_sections(road, self.length))

    def sample(
        self, stretches: Sequence[LaneStretch], step: float
    ) -> Iterator[tuple[Floats, Floats, Floats]]:
        """Give s (K,), centre (K, 2) [m] and width (K,) [m] of each stretch of this road."""
        at = [self._places(stretch, step) for stretch in stretches]
        line_s, where = np.unique(np.concatenate(at), return_inverse=True)
        x, y, heading = self.line(line_s)[:, where]
        low = 0
        for stretch, s in zip(stretches, at, strict=True):
            own = slice(low, low := low + len(s))
            inner, outer = self.borders(stretch.section, stretch.lane, s)
            t = 0.5 * (inner + outer)
            xy = np.stack([x[own] - t * np.sin(heading[own]), y[own] + t * np.cos(heading[own])], axis=1)
            yield (
                (s, xy, np.abs(outer - inner))
                if stretch.forward
                else (s[::-1], xy[::-1], np.abs(outer - inner)[::-1])
            )

    def borders(self, section: int, lane: int, s: Floats) -> tuple[Floats, Floats]:
        """Give t (K,) [m] of the inner and the outer border of a lane at s (K,)."""
        inner = outer = (
            np.where(s < self.offsets[0][0], 0.0, _value(self.offsets, s)) if self.offsets else 0.0 * s
        )
        side = 1 if lane > 0 else -1
        for between in range(side, lane + side, side):
            own = self.sections[section].lanes[between]
            inner, value = outer, _value(own.records, s)
            outer = value if own.by_border else inner + side * value
        return inner, outer

    def line(self, s: Floats) -> Floats:
        """Give x, y [m] and heading [rad] (3, K) of the reference line at ascending s (K,)."""
        out = np.empty((3, len(s)))
        starts = np.searchsorted(s, self.starts)
        starts[0] = 0
        for element, low, high in zip(self.elements, starts, [*starts[1:], len(s)], strict=True):
            if low < high:
                out[:, low:high] = element.places(s[low:high] - element.s)
        return out

    def _places(self, stretch: LaneStretch, step: float) -> Floats:
        """The s (K,) [m], ascending, at which a stretch is looked at."""
        lanes = self.sections[stretch.section].lanes
        begins = {*self.starts} | {record[0] for record in self.offsets}
        side = 1 if stretch.lane > 0 else -1
        for between in range(side, stretch.lane + side, side):
            begins |= {record[0] for record in lanes[between].records}
        inside = sorted(s for s in begins if stretch.start < s < stretch.end)
        parts = []
        for low, high in pairwise([stretch.start, *inside, stretch.end]):
            if high - low > EMPTY:
                margin = min(SIDE, 0.25 * (high - low))
                count = (
                    max(ceil((high - low) / (step if high - low > SPECK else 0.1 * step)), self._specks(low))
                    + 1
                )
                parts.append(np.linspace(low + margin, high - margin, count))
        return np.concatenate(parts)

    def _specks(self, s: float) -> int:
        """How many places a sharp bend of few centimetres asks for."""
        element = self.elements[max(bisect_right(self.starts, s) - 1, 0)]
        if element.length > SPECK:
            return 1
        return max(min(ceil(max(map(abs, element.bend)) * element.length * FAR_LANE / SWING), 200), 1)


def _sections(road: _Element, length: float) -> Iterator[RawSection]:
    elements = road.findall("lanes/laneSection")
    starts = [number(element, "s") for element in elements]
    lanes: dict[int, RawLane] = {}
    for element, start, end in zip(elements, starts, [*starts[1:], length], strict=True):
        told = {int(str(lane.get("id"))): _lane(lane, start) for lane in element.iterfind("*/lane")}
        if element.get("singleSide") in ("true", "1"):
            sides = {lane > 0 for lane in told if lane}
            told |= {lane: own for lane, own in lanes.items() if lane and (lane > 0) not in sides}
        lanes = told
        yield RawSection(start, min(end, length), lanes)


def _lane(lane: _Element, start: float) -> RawLane:
    widths, borders = (_records(lane.iterfind(tag), "sOffset", start) for tag in ("width", "border"))
    return RawLane(widths or borders, bool(borders) and not widths)


def _records(elements: Iterator[_Element], s: str, start: float) -> list[Record]:
    found = [(start + number(e, s), *(number(e, name) for name in "abcd")) for e in elements]
    return sorted(found, key=lambda record: record[0])  # type: ignore[arg-type]


def _value(records: list[Record], s: Floats) -> Floats:
    """The value (K,) at s (K,): each record takes over where it begins, the first holds before as well."""
    out = np.zeros(len(s))
    for i, (start, a, b, c, d) in enumerate(records):
        here = s >= start if i else slice(None)
        ds = s[here] - start
        out[here] = a + b * ds + c * ds**2 + d * ds**3
    return out
