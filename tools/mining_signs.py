"""What a map says around the grounds of plants, read from the OpenDRIVE file itself: torn lines, what lies beside the
driven lanes, where roads get or lose lanes, crossings at the ends of roads, lights and stop signs.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from lxml import etree

from resim.road.opendrive import RoadNetwork

DRIVEN = ("driving", "entry", "exit", "onRamp", "offRamp")
TORN = 0.5
"""m between the end of one part of a road's line and the begin of the next, from which on it is torn."""
NEAR = 50.0
"""m before a junction in which lights and stop signs are those of its approach (scenarios/mining/labels.toml)."""
SHORT = 20.0
"""m from a crossing in which somebody backs up at it (scenarios/mining/labels.toml)."""
LIGHTS = ("1000001", "1000009", "1000010", "1000011")
STOP = "206"
RULING = (*LIGHTS, STOP, "205", "301", "306")
"""... with signs to give way, and of priority."""


class Signs(NamedTuple):
    """Of a way through a junction: whether that has lights, whether the lane before it has a stop sign, and whether the
    map has any light or sign of right of way.
    """

    lit: bool
    stop: bool
    told: bool


NO_SIGNS = Signs(False, False, False)


@cache
def roads(network: RoadNetwork) -> dict[str, etree._Element]:
    """Give the elements of roads by id."""
    root = etree.parse(str(network.path)).getroot()
    return {one.get("id"): one for one in root.iterfind("road")}


def sections(element: etree._Element) -> list[tuple[float, float, etree._Element]]:
    """Give the lane sections of a road: where they begin and end [m], and their elements."""
    found = element.findall("lanes/laneSection")
    starts = [float(one.get("s")) for one in found]
    return list(zip(starts, [*starts[1:], float(element.get("length"))], found, strict=True))


def torn(element: etree._Element) -> list[float]:
    """Give where [m] a road's line, of lines and arcs, goes on elsewhere than it ends."""
    out: list[float] = []
    end: complex | None = None
    for part in element.iterfind("planView/geometry"):
        s, x, y, heading, length = (float(part.get(name)) for name in ("s", "x", "y", "hdg", "length"))
        if end is not None and abs(complex(x, y) - end) > TORN:
            out.append(s)
        bend = float(part[0].get("curvature", 0.0))
        turn = bend * length
        chord = length * np.sinc(turn / (2.0 * np.pi)) * np.exp(1j * (heading + 0.5 * turn))
        end = complex(x, y) + chord if part[0].tag in ("line", "arc") else None
    return out


def beyond(element: etree._Element, first: float, last: float, outer: tuple[int, int]) -> tuple[str, str]:
    """Give the types of the lanes above the id outer[0] and below outer[1] from s = first to last [m].

    "" where there is none, "?" where they change.
    """
    told: tuple[set[str], set[str]] = set(), set()
    for begin, end, section in sections(element):
        if begin < last and end > first:
            kinds = {int(lane.get("id")): lane.get("type") for lane in section.iterfind(".//lane")}
            up, down = outer[0] + 1 or 1, outer[1] - 1 or -1
            told[0].add(kinds.get(up, ""))
            told[1].add(kinds.get(down, ""))
    up, down = (next(iter(kinds)) if len(kinds) == 1 else "?" for kinds in told)
    return up, down


def lane_counts(element: etree._Element, right: bool) -> list[tuple[float, int]]:
    """Give where [m] a road gets lanes that are driven one way, or (negative) loses them, by growing s."""
    counts = []
    for begin, _, section in sections(element):
        lanes = [(int(one.get("id")), one.get("type")) for one in section.iterfind(".//lane")]
        counts.append((begin, sum(kind in DRIVEN and n != 0 and (n < 0) == right for n, kind in lanes)))
    return [(s, after - before) for (_, before), (s, after) in pairwise(counts) if after != before]


def short_neighbours(network: RoadNetwork, element: etree._Element) -> bool:
    """Say whether a road goes on into another one that is shorter than SHORT: what is near may lie behind that."""
    every = roads(network)
    links = (element.find(f"link/{tag}") for tag in ("predecessor", "successor"))
    names = [one.get("elementId") for one in links if one is not None and one.get("elementType") == "road"]
    return any(float(every[name].get("length")) < SHORT for name in names if name in every)


def joined_ends(network: RoadNetwork, element: etree._Element, lane: int) -> tuple[bool, bool]:
    """Say whether ways of junctions at a road's begin and end lead from this lane, or to it."""
    out = [False, False]
    for road in roads(network).values():
        for tag in ("predecessor", "successor"):
            link = road.find(f"link/{tag}")
            if (
                road.get("junction") in (None, "-1")
                or link is None
                or link.get("elementId") != element.get("id")
            ):
                continue
            ids = {one.get("id") for one in road.iterfind(f".//lane/link/{tag}")}
            out[link.get("contactPoint") == "end"] |= str(lane) in ids
    return out[0], out[1]


def crossed_ends(element: etree._Element, counts: set[str]) -> tuple[bool, bool]:
    """Say whether a road begins and ends at one of these junctions."""
    links = (element.find(f"link/{tag}") for tag in ("predecessor", "successor"))
    begin, end = (
        link is not None and link.get("elementType") == "junction" and link.get("elementId") in counts
        for link in links
    )
    return begin, end


def signs_of(network: RoadNetwork, before: str, lane: int, inside: str) -> Signs:
    """Give the signs of a way from a lane of the road `before` over the road `inside` of a junction."""
    elements = roads(network)
    junction = elements[inside].get("junction")
    lit = False
    for element in elements.values():
        if element.get("junction") != junction:
            continue
        lit |= any(kind == "light" for kind in _signals(element, _lanes(element), np.inf))
        link = element.find("link/predecessor")
        if link is None or link.get("elementType") != "road":
            continue
        own = [one.find("link/predecessor") for one in element.iterfind(".//right/lane")]
        own = [int(one.get("id")) for one in own if one is not None]
        lit |= any(kind == "light" for kind in _signals(elements[link.get("elementId")], own, NEAR))
    root = elements[before].getroottree().getroot()
    told = any(one.get("type") in RULING for one in root.iterfind("road/signals/signal"))
    return Signs(lit, "stop" in list(_signals(elements[before], [lane], NEAR)), told)


def _lanes(element: etree._Element) -> list[int]:
    return [int(one.get("id")) for one in element.iterfind(".//lane") if one.get("type") in DRIVEN]


def _signals(element: etree._Element, lanes: list[int], near: float) -> Iterator[str]:
    """Lights and stop signs of lanes, up to `near` [m] before where these lead."""
    length = float(element.get("length"))
    kinds = _kinds(element.getroottree().getroot())
    for one in element.find("signals") if element.find("signals") is not None else ():
        kind = kinds.get(one.get("id"), "")
        only = [(int(v.get("fromLane")), int(v.get("toLane"))) for v in one.iterfind("validity")]
        for lane in lanes:
            fits = one.get("orientation") in ("none", "+" if lane < 0 else "-")
            fits &= not only or any(low <= lane <= high for low, high in only)
            left = length - float(one.get("s")) if lane < 0 else float(one.get("s"))
            if kind and fits and left <= near:
                yield kind


@cache
def _kinds(root: etree._Element) -> dict[str, str]:
    """What the signals of a map are, by id, for themselves and references to them."""
    return {
        one.get("id"): "light" if one.get("type") in LIGHTS else "stop" if one.get("type") == STOP else ""
        for one in root.iterfind("road/signals/signal")
    }
