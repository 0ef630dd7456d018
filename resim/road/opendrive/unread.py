"""What a file says and the reader leaves out, or cannot know the meaning of."""

from __future__ import annotations

import math
from collections.abc import Iterator

from lxml.etree import _Element

from resim.road.opendrive.model import CURVES, Unread

RANGES = (None, "arcLength", "normalized")
RULES = ("RHT", "LHT")
HEIGHTS = (
    "lateralProfile/crossfall",
    "lateralProfile/shape",
    "lateralProfile/crossSectionSurface",
    "surface/CRG",
)


def unread(root: _Element) -> tuple[Unread, ...]:
    """Give every such element of a map that has been read, in the order of the file."""
    found = [
        Unread("INCLUDE", None, None, math.nan, f"<include file={element.get('file')!r}> is not read")
        for element in root.iter("include")
    ]
    for road in root.iterfind("road"):
        name = road.get("id", "")
        found += [one._replace(road=name, text=f"road {name}{one.text}") for one in _of_road(road)]
    return tuple(found)


def _of_road(road: _Element) -> Iterator[Unread]:
    rule = road.get("rule", "RHT")
    if rule.upper() not in RULES:
        yield _one("UNKNOWN_RULE", math.nan, f": rule={rule!r} is neither RHT nor LHT; RHT is used")
    for element in road.iterfind("planView/geometry"):
        yield from _of_geometry(element)
    for tag in HEIGHTS:
        shaped = [e for e in road.iterfind(tag) if tag != HEIGHTS[0] or any(_value(e, n) for n in "abcd")]
        if shaped:
            text = f": <{shaped[0].tag}> is left out of heights; places in the plane do not depend on it"
            yield _one("UNREAD_HEIGHT", _value(shaped[0], "s"), text)
    for kind in road.iterfind("type"):
        yield from _negative(kind.findall("speed"), _value(kind, "s"), ", type")
    for section in road.iterfind("lanes/laneSection"):
        s = _value(section, "s")
        for lane in section.iterfind("*/lane"):
            yield from _of_lane(lane, s)


def _of_geometry(element: _Element) -> Iterator[Unread]:
    s = _value(element, "s")
    curves = [child for child in element if child.tag in CURVES]
    if len(curves) > 1:
        names = ", ".join(f"<{curve.tag}>" for curve in curves)
        yield _one("TWO_CURVES", s, f": the element at s={s:.3f} m holds {names}; the first is used")
    for curve in curves[:1]:
        if curve.tag == "paramPoly3" and curve.get("pRange") not in RANGES:
            says = f"pRange={curve.get('pRange')!r} is neither arcLength nor normalized; normalized is used"
            yield _one("UNKNOWN_RANGE", s, f": the element at s={s:.3f} m: {says}")


def _of_lane(lane: _Element, s: float) -> Iterator[Unread]:
    number = int(lane.get("id", "0"))
    where = f", lane {number} of the section at s={s:.3f} m"
    found = list(_negative(lane.findall("speed"), s, where))
    if (rules := lane.findall("access")) and number:
        who = ", ".join(
            dict.fromkeys(f"{e.get('rule', 'rule not said')} {e.get('restriction')}" for e in rules)
        )
        found.append(
            _one("UNREAD_ACCESS", s, f"{where}: its <access> ({who}) is left out: all may drive there")
        )
    yield from (one._replace(lane=number) for one in found)


def _negative(speeds: list[_Element], s: float, where: str) -> Iterator[Unread]:
    for speed in speeds:
        if _value(speed, "max") < 0.0:
            text = f"{where}: the speed limit {speed.get('max')} is below zero, and ignored"
            yield _one("NEGATIVE_LIMIT", s, text)


def _one(code: str, s: float, text: str) -> Unread:
    return Unread(code, None, None, s, text)


def _value(element: _Element, name: str) -> float:
    """The attribute as a number, NaN where it is none."""
    try:
        return float(element.get(name, ""))
    except ValueError:
        return math.nan
