"""Rewrites an OpenDRIVE document so that netconvert takes it well, without moving any geometry."""

from __future__ import annotations

from bisect import bisect_right
from copy import deepcopy
from math import ceil
from pathlib import Path

import numpy as np
from lxml import etree

from resim.road.opendrive.lanes import reexpanded
from resim.road.opendrive.model import Cubic
from resim.road.opendrive.xml import Reader, parse_bytes

VERSION = 1
LONGEST = 100.0
SHORTEST_GEOMETRY = 1e-9
POLYNOMIALS = ("width", "border")
HELD = ("roadMark", "speed", "access", "material", "rule", "height")
"""Records of a lane that hold from their sOffset until the next one of their kind."""


def prepared(text: bytes, path: Path) -> bytes:
    """Give the OpenDRIVE text rewritten for netconvert; `path` names it in errors.

    Lane sections longer than 100 m are split evenly into parts of 50 to 100 m, but on roads of a junction,
    which become junction-internal lanes. Left lanes are put in descending order, as netconvert numbers them
    by their place. Spirals of constant curvature become arcs; elements without length go. Raises InputError
    as `resim.road.opendrive.load` does.
    """
    root = parse_bytes(text, path)
    reader = Reader(path)
    for road in root.iterfind("road"):
        where = f"road {road.get('id')}"
        end = _mend_geometry(road, reader, where)
        for side in road.iterfind("lanes/laneSection/*"):
            side[:] = sorted(side, key=lambda lane: _descending(lane, reader, where))
        if road.get("junction", "-1") in ("-1", ""):
            _split_sections(road, end, reader, where)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8")


def _descending(lane: etree._Element, reader: Reader, where: str) -> int:
    return -reader.integer(lane, "id", where) if lane.tag == "lane" else 0


def _mend_geometry(road: etree._Element, reader: Reader, where: str) -> float:
    """Mend the planView; give its end s [m]."""
    end = 0.0
    for geometry in road.findall("planView/geometry"):
        length = reader.number(geometry, "length", where)
        if length <= SHORTEST_GEOMETRY:
            _parent(geometry).remove(geometry)
            continue
        end = reader.number(geometry, "s", where) + length
        for spiral in geometry.findall("spiral"):
            start, stop = (reader.number(spiral, name, where) for name in ("curvStart", "curvEnd"))
            if start == stop:
                arc = etree.Element("line") if start == 0.0 else etree.Element("arc", curvature=repr(start))
                geometry.replace(spiral, arc)
    return end


def _split_sections(road: etree._Element, end: float, reader: Reader, where: str) -> None:
    sections = road.findall("lanes/laneSection")
    starts = [reader.number(section, "s", where) for section in sections]
    for section, start, stop in zip(sections, starts, [*starts[1:], end], strict=True):
        count = ceil((stop - start) / LONGEST - 1e-9)
        if count < 2:
            continue
        cuts = [(stop - start) * k / count for k in range(count)]
        parent = _parent(section)
        place = parent.index(section)
        parts = [_part(section, start, cuts, k, reader, where) for k in range(count)]
        parent[place : place + 1] = parts


def _part(
    section: etree._Element, start: float, cuts: list[float], k: int, reader: Reader, where: str
) -> etree._Element:
    """Give part k of a section that is cut at these s [m] from its start."""
    part = deepcopy(section)
    part.set("s", repr(start + cuts[k]))
    stop = cuts[k + 1] if k + 1 < len(cuts) else float("inf")
    for lane in part.iterfind("*/lane"):
        for tag in POLYNOMIALS:
            _shift_polynomials(lane, tag, cuts[k], stop, reader, where)
        for tag in HELD:
            _shift_held(lane, tag, cuts[k], stop, reader, where)
        if lane.get("id") != "0":
            _link(lane, "predecessor", inner=k > 0)
            _link(lane, "successor", inner=k + 1 < len(cuts))
    return part


def _shift_polynomials(
    lane: etree._Element, tag: str, cut: float, stop: float, reader: Reader, where: str
) -> None:
    """Write the polynomials anew from the cut on, and those that begin before `stop` relative to it."""
    elements = lane.findall(tag)
    if not elements:
        return
    names = ("sOffset", "a", "b", "c", "d")
    records = sorted(
        (Cubic(*(reader.number(e, n, where) for n in names)) for e in elements), key=lambda c: c.s
    )
    inside = [c for c in records if cut < c.s < stop]
    first = reexpanded(records, np.array([cut]))[0].tolist()
    new = [(0.0, *first), *((c.s - cut, *c[1:]) for c in inside)]
    place = lane.index(elements[0])
    for element in elements:
        lane.remove(element)
    for i, values in enumerate(new):
        attributes = {name: repr(value) for name, value in zip(names, values, strict=True)}
        lane.insert(place + i, etree.Element(tag, attributes))


def _shift_held(lane: etree._Element, tag: str, cut: float, stop: float, reader: Reader, where: str) -> None:
    """Keep the records that hold at the cut and those that begin before `stop`."""
    elements = lane.findall(tag)
    offsets = [reader.number(e, "sOffset", where, 0.0) for e in elements]
    holding = max((s for s in offsets if s <= cut), default=None)
    for element, offset in zip(elements, offsets, strict=True):
        if offset == holding:
            element.set("sOffset", "0.0")
        elif cut < offset < stop:
            element.set("sOffset", repr(offset - cut))
        else:
            lane.remove(element)


def _link(lane: etree._Element, tag: str, *, inner: bool) -> None:
    """Link the lane to the one of its own id in the neighbouring part, where there is such a part."""
    if not inner:
        return
    link = lane.find("link")
    if link is None:
        link = etree.Element("link")
        lane.insert(0, link)
    target = link.find(tag)
    if target is None:
        target = etree.Element(tag)
        link.insert(0 if tag == "predecessor" else len(link), target)
    target.set("id", str(lane.get("id")))


def _parent(element: etree._Element) -> etree._Element:
    parent = element.getparent()
    assert parent is not None
    return parent


def section_of(starts: list[float], s: float) -> int:
    """Give the index of the section that holds at s [m], which may be rounded to centimetres."""
    return max(bisect_right(starts, s + 0.01) - 1, 0)
