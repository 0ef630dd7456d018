"""Turns OpenDRIVE XML into the model: roads, lanes, junctions, header."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import cast

from lxml.etree import _Element

from resim.road.opendrive.model import (
    Connection,
    Cubic,
    Geometry,
    Header,
    Height,
    Junction,
    Lane,
    LaneSection,
    Link,
    Road,
    RoadMark,
    RoadType,
    Side,
)  # fmt: skip
from resim.road.opendrive.sections import both_sides
from resim.road.opendrive.signs import SPEED_UNITS, read_signs
from resim.road.opendrive.xml import Reader

SHORTEST = 1e-9
CURVES = ("line", "arc", "spiral", "poly3", "paramPoly3")
Coefficients = tuple[float, float, float, float]


class ModelReader(Reader):
    """Reads the elements of one file; every method raises InputError naming road, element and attribute."""

    def __init__(self, path: Path, root: _Element) -> None:
        super().__init__(path)
        self.root = root

    def header(self) -> Header:
        """Read <header>; a missing one gives revision 1.4."""
        header = self.root.find("header")
        if header is None:
            return Header((1, 4), "", None)
        revision = (int(self.number(header, "revMajor", "header", 1)),
                    int(self.number(header, "revMinor", "header", 4)))  # fmt: skip
        names = ("north", "south", "east", "west")
        extent = None
        if all(name in header.attrib for name in names):
            extent = tuple(self.number(header, name, "header") for name in names)
        return Header(revision, header.get("name", ""), cast(Coefficients | None, extent))

    def geo_reference(self) -> str | None:
        """Read the text of <geoReference>, None where there is none."""
        text = (self.root.findtext("header/geoReference") or "").strip()
        return text or None

    def roads(self) -> dict[str, Road]:
        """Read all roads, by id."""
        roads: dict[str, Road] = {}
        for element in self.root.iterfind("road"):
            road = self.road(element)
            if road.id in roads:
                raise self.error(f"road {road.id}", "the id stands twice")
            roads[road.id] = road
        if not roads:
            raise self.error("OpenDRIVE", "the map has no road")
        return roads

    def road(self, element: _Element) -> Road:
        """Read one <road>."""
        road_id = self.text(element, "id", "road")
        where = f"road {road_id}"
        geometries, empty = self._geometries(element, where)
        length = geometries[-1].s + geometries[-1].length
        junction = element.get("junction", "-1")
        return Road(
            id=road_id, name=element.get("name", ""), length=length,
            junction=None if junction in ("-1", "") else junction,
            left_hand=element.get("rule", "RHT").upper() == "LHT",
            geometries=geometries,
            sections=self._sections(element, length, where),
            lane_offsets=self._cubics(element, "lanes/laneOffset", "s", where),
            elevations=self._cubics(element, "elevationProfile/elevation", "s", where),
            types=self._types(element, where),
            predecessor=self._link(element, "predecessor", where),
            successor=self._link(element, "successor", where),
            superelevations=self._cubics(element, "lateralProfile/superelevation", "s", where),
            signs=read_signs(self, element, self._signals, where),
            declared_length=self.number(element, "length", where, math.nan), empty=empty,
        )  # fmt: skip

    def junctions(self) -> dict[str, Junction]:
        """Read all junctions, by id."""
        junctions: dict[str, Junction] = {}
        for element in self.root.iterfind("junction"):
            junction = self._junction(element)
            if junction.id in junctions:
                raise self.error(f"junction {junction.id}", "the id stands twice")
            junctions[junction.id] = junction
        return junctions

    @cached_property
    def _signals(self) -> dict[str, _Element]:
        """Every signal of the map by its id, for the references to it."""
        return {element.get("id", ""): element for element in self.root.iterfind("road/signals/signal")}

    def _geometries(self, road: _Element, where: str) -> tuple[tuple[Geometry, ...], tuple[float, ...]]:
        """The elements of the planView, and the s of those passed over because they have no length."""
        found, empty = [], []
        for i, element in enumerate(road.iterfind("planView/geometry")):
            at = f"{where}, geometry {i}"
            if self.number(element, "length", at) < 0.0:
                raise self.error(at, f"length={element.get('length')} is negative")
            if self.number(element, "length", at) > SHORTEST:
                found.append(self._geometry(element, at))
            else:
                empty.append(self.number(element, "s", at))
        if not found:
            raise self.error(where, "planView has no geometry of a length above zero")
        for before, after in pairwise(found):
            if after.s <= before.s:
                raise self.error(where, f"geometry at s={after.s} follows one at s={before.s}")
        return tuple(found), tuple(empty)

    def _geometry(self, element: _Element, where: str) -> Geometry:
        s, x, y, heading, length = (self.number(element, n, where) for n in ("s", "x", "y", "hdg", "length"))
        curve = next((child for child in element if child.tag in CURVES), None)
        if curve is None:
            raise self.error(where, f"none of {', '.join(CURVES)} inside")
        kind = str(curve.tag)
        start = end = 0.0
        u, v = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
        if kind == "arc":
            start = end = self.number(curve, "curvature", where)
        elif kind == "spiral":
            start, end = (self.number(curve, n, where) for n in ("curvStart", "curvEnd"))
        elif kind == "poly3":
            v = self._coefficients(curve, "", where)
        elif kind == "paramPoly3":
            u, v = self._coefficients(curve, "U", where), self._coefficients(curve, "V", where)
        normalized = kind == "paramPoly3" and curve.get("pRange", "normalized") != "arcLength"
        return Geometry(kind, s, x, y, heading, length, start, end, u, v, normalized)

    def _coefficients(self, element: _Element, suffix: str, where: str) -> Coefficients:
        a, b, c, d = (self.number(element, name + suffix, where) for name in "abcd")
        return a, b, c, d

    def _cubics(self, parent: _Element, tag: str, s: str, where: str) -> tuple[Cubic, ...]:
        found = []
        for i, element in enumerate(parent.iterfind(tag)):
            at = f"{where}, {tag.rpartition('/')[2]} {i}"
            found.append(Cubic(self.number(element, s, at), *self._coefficients(element, "", at)))
        return tuple(sorted(found, key=lambda cubic: cubic.s))

    def _types(self, road: _Element, where: str) -> tuple[RoadType, ...]:
        found = []
        for i, element in enumerate(road.iterfind("type")):
            at = f"{where}, type {i}"
            speed = element.find("speed")
            limit = math.nan if speed is None else self._speed(speed, at)
            found.append(RoadType(self.number(element, "s", at), element.get("type", "unknown"), limit))
        return tuple(sorted(found, key=lambda kind: kind.s))

    def _speed(self, element: _Element, where: str) -> float:
        """The speed [m/s], inf for no limit, NaN where undefined (negative numbers mean that, too)."""
        text = element.get("max", "undefined")
        if text in ("no limit", "undefined"):
            return math.inf if text == "no limit" else math.nan
        unit = element.get("unit", "m/s")
        if unit not in SPEED_UNITS:
            raise self.error(where, f"speed unit {unit!r} is none of {', '.join(SPEED_UNITS)}")
        speed = self.number(element, "max", where)
        return speed * SPEED_UNITS[unit] if speed >= 0.0 else math.nan

    def _link(self, road: _Element, tag: str, where: str) -> Link | None:
        element = road.find(f"link/{tag}")
        if element is None or "elementId" not in element.attrib:
            return None
        kind = element.get("elementType", "road")
        if kind not in ("road", "junction"):
            raise self.error(f"{where}, {tag}", f"elementType={kind!r} is neither road nor junction")
        contact = element.get("contactPoint")
        if contact not in (None, "start", "end"):
            raise self.error(f"{where}, {tag}", f"contactPoint={contact!r} is neither start nor end")
        s = self.number(element, "elementS", f"{where}, {tag}") if "elementS" in element.attrib else None
        return Link("road" if kind == "road" else "junction", str(element.get("elementId")),
                    cast(Side | None, contact), s)  # fmt: skip

    def _sections(self, road: _Element, length: float, where: str) -> tuple[LaneSection, ...]:
        elements = road.findall("lanes/laneSection")
        if not elements:
            raise self.error(where, "has no laneSection")
        starts = [self.number(e, "s", f"{where}, laneSection {i}") for i, e in enumerate(elements)]
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
            raise self.error(where, f"a lane id stands twice among {ids}")
        for inner, outer in pairwise(sorted({0, *ids}, key=abs)):
            before = outer - 1 if outer > 0 else outer + 1
            if before not in (0, *ids):
                raise self.error(where, f"lane {before} is missing between lane {inner} and lane {outer}")
        return {lane.id: lane for lane in sorted(lanes, key=lambda lane: lane.id)}

    def _lane(self, element: _Element, where: str) -> Lane:
        lane_id = self.integer(element, "id", where)
        at = f"{where}, lane {lane_id}"
        return Lane(
            id=lane_id, type=element.get("type", "none"),
            widths=self._cubics(element, "width", "sOffset", at),
            borders=self._cubics(element, "border", "sOffset", at),
            marks=self._marks(element, at),
            speeds=tuple(sorted(
                (self.number(e, "sOffset", at), self._speed(e, at)) for e in element.iterfind("speed")
            )),
            predecessor=self._lane_link(element, "predecessor", at),
            successor=self._lane_link(element, "successor", at),
            heights=tuple(sorted(
                Height(*(self.number(e, name, at) for name in ("sOffset", "inner", "outer")))
                for e in element.iterfind("height")
            )),
            reversed=element.get("direction") == "reversed",
        )  # fmt: skip

    def _marks(self, lane: _Element, where: str) -> tuple[RoadMark, ...]:
        return tuple(
            RoadMark(
                self.number(e, "sOffset", where, 0.0), e.get("type", "none"), e.get("color", "standard"),
                self.number(e, "width", where) if "width" in e.attrib else None,
            )
            for e in lane.iterfind("roadMark")
        )  # fmt: skip

    def _lane_link(self, lane: _Element, tag: str, where: str) -> int | None:
        element = lane.find(f"link/{tag}")
        return None if element is None else self.integer(element, "id", where)

    def _junction(self, element: _Element) -> Junction:
        junction_id = self.text(element, "id", "junction")
        where = f"junction {junction_id}"
        connections = tuple(
            self._connection(e, where) for e in element.iterfind("connection")
            if e.get("incomingRoad") and (e.get("connectingRoad") or e.get("linkedRoad"))
        )  # fmt: skip
        return Junction(junction_id, element.get("name", ""), element.get("type", "default"), connections)

    def _connection(self, element: _Element, where: str) -> Connection:
        at = f"{where}, connection {element.get('id', '?')}"
        contact = element.get("contactPoint", "start")
        if contact not in ("start", "end"):
            raise self.error(at, f"contactPoint={contact!r} is neither start nor end")
        links = tuple(
            (self.integer(e, "from", at), self.integer(e, "to", at)) for e in element.iterfind("laneLink")
        )
        return Connection(
            id=element.get("id", ""), incoming=self.text(element, "incomingRoad", at),
            connecting=element.get("connectingRoad") or self.text(element, "linkedRoad", at),
            contact=cast(Side, contact), lane_links=links,
        )  # fmt: skip
