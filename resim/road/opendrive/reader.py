"""Turns OpenDRIVE XML into the model: roads, lanes, junctions, header."""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import cast

from lxml.etree import _Element

from resim.core.errors import InputError
from resim.road.opendrive.lanereader import Coefficients, LaneReader
from resim.road.opendrive.model import (
    CURVES,
    Connection,
    Controller,
    Geometry,
    Header,
    Junction,
    Link,
    Road,
    RoadType,
    Side,
)  # fmt: skip
from resim.road.opendrive.signals import read_controllers, read_signals, sequence
from resim.road.opendrive.signs import read_signs
from resim.road.opendrive.xml import CUT

SHORTEST = 1e-9
LONGEST = 1e6
"""Largest s [m] of a road."""

MOST_LANES = 4e6
"""Largest length [m] of all lanes together: what gigabytes of memory and SUMO's minutes are enough for."""

MOST_TURN = 1e3
"""Largest turn [rad] within one arc or spiral: every circle is looked through for each position on it."""


class ModelReader(LaneReader):
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
        offset, moved = header.find("offset"), (0.0, 0.0, 0.0)
        if offset is not None:
            x, y, turn = (self.number(offset, name, "header offset", 0) for name in ("x", "y", "hdg"))
            moved = (x, y, turn)
        return Header(revision, header.get("name", ""), cast(Coefficients | None, extent), moved)

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
                raise self.error(f"road {road.id}", "the id is a duplicate")
            roads[road.id] = road
        if not roads:
            raise self.error("OpenDRIVE", "the map has no road")
        total = sum(
            len(section.lanes) * max(min(section.end, road.length) - section.start, 0.0)
            for road in roads.values() for section in road.sections
        )  # fmt: skip
        if total > MOST_LANES:
            text = f"has {total / 1e3:.0f} km of lanes; maps of up to {MOST_LANES / 1e3:.0f} km are read"
            raise InputError(self.path, text, CUT)
        return roads

    def road(self, element: _Element) -> Road:
        """Read one <road>."""
        road_id = self.text(element, "id", "road")
        where = f"road {road_id}"
        geometries, empty = self._geometries(element, where)
        length = geometries[-1].s + geometries[-1].length
        if length > LONGEST:
            raise self.error(where, f"its last element ends at s={length:g} m, beyond {LONGEST / 1e3:g} km")
        junction = element.get("junction", "-1")
        return Road(
            id=road_id, name=element.get("name", ""), length=length,
            junction=None if junction in ("-1", "") else junction,
            left_hand=element.get("rule", "RHT").upper() == "LHT",
            geometries=geometries,
            sections=self.sections(element, length, where),
            lane_offsets=self.lane_offsets(element, where),
            elevations=self.cubics(element, "elevationProfile/elevation", "s", where),
            types=self._types(element, where),
            predecessor=self._link(element, "predecessor", where),
            successor=self._link(element, "successor", where),
            superelevations=self.cubics(element, "lateralProfile/superelevation", "s", where),
            signs=read_signs(self, element, self._signals, where),
            signals=read_signals(self, element, self._signals, where),
            declared_length=self.number(element, "length", where, math.nan), empty=empty,
        )  # fmt: skip

    def junctions(self) -> dict[str, Junction]:
        """Read all junctions, by id."""
        junctions: dict[str, Junction] = {}
        for element in self.root.iterfind("junction"):
            junction = self._junction(element)
            if junction.id in junctions:
                raise self.error(f"junction {junction.id}", "the id is a duplicate")
            junctions[junction.id] = junction
        return junctions

    def controllers(self) -> tuple[Controller, ...]:
        """Read what switches signals together, in its order."""
        return read_controllers(self.root)

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
            v = self.coefficients(curve, "", where)
        elif kind == "paramPoly3":
            u, v = self.coefficients(curve, "U", where), self.coefficients(curve, "V", where)
        turn = max(abs(start), abs(end)) * length
        if turn > MOST_TURN:
            raise self.error(where, f"its <{kind}> turns by up to {turn:g} rad, beyond {MOST_TURN:g} rad")
        normalized = kind == "paramPoly3" and curve.get("pRange", "normalized") != "arcLength"
        return Geometry(kind, s, x, y, heading, length, start, end, u, v, normalized)

    def _types(self, road: _Element, where: str) -> tuple[RoadType, ...]:
        found = []
        for i, element in enumerate(road.iterfind("type")):
            at = f"{where}, type {i}"
            speed = element.find("speed")
            limit = math.nan if speed is None else self.speed(speed, at)
            found.append(RoadType(self.number(element, "s", at), element.get("type", "unknown"), limit))
        return tuple(sorted(found, key=lambda kind: kind.s))

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

    def _junction(self, element: _Element) -> Junction:
        junction_id = self.text(element, "id", "junction")
        where = f"junction {junction_id}"
        connections = tuple(
            self._connection(e, where) for e in element.iterfind("connection")
            if e.get("incomingRoad") and (e.get("connectingRoad") or e.get("linkedRoad"))
        )  # fmt: skip
        priorities = tuple((e.get("high", ""), e.get("low", "")) for e in element.iterfind("priority"))
        controllers = tuple(e.get("id", "") for e in sorted(element.iterfind("controller"), key=sequence))
        kind = element.get("type", "default")
        return Junction(junction_id, element.get("name", ""), kind, connections, priorities, controllers)

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
