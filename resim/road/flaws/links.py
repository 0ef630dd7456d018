"""Flaws of links.

MISSING_ROAD, MISSING_JUNCTION: a road's link, or a connection, names one that is not there, as in a map that was cut
out of a larger one (warning where a road is said to be part of that junction). MISSING_LANE: a link names a lane that
its road does not have there (error on driven lanes). LINK_INSIDE: a road's link is to a place inside of another road,
as at virtual junctions: it is not followed, and the SUMO net has no connection there. ONE_SIDED: a road goes on into
another, which does not link back. ROAD_GAP: the reference lines of linked roads end over 0.1 m apart (note: their
lanes may meet all the same). LANE_GAP: the centres of linked lanes end over 0.1 m apart, measured where both are
wider than 0.1 m.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from resim.road.flaws.flaw import Flaw
from resim.road.opendrive import Connection, Lane, Link, Road, RoadNetwork

APART = 0.1
NARROW = 0.1
JUST_INSIDE = 1e-9


class SectionEnd(NamedTuple):
    """One end of a lane section: road, index of the section, whether it is the end (else the start)."""

    road: str
    section: int
    at_end: bool


Joint = tuple[SectionEnd, int, SectionEnd, int]
"""A lane at an end, and the lane it goes on into."""


def flaws(network: RoadNetwork) -> Iterator[Flaw]:
    """Give the flaws of all links of roads, lanes and junctions."""
    joints: list[Joint] = []
    for road in network.roads.values():
        for at_end, link in ((False, road.predecessor), (True, road.successor)):
            if link is not None:
                yield from _road_link(network, road, at_end, link)
        yield from _lane_links(network, road, joints)
        if road.junction is not None and road.junction not in network.junctions:
            text = f"road {road.id}: it is part of junction {road.junction}, which is not in the map"
            yield Flaw("warning", "MISSING_JUNCTION", road.id, None, None, None, math.nan, "", text)
    for junction in network.junctions.values():
        for connection in junction.connections:
            where = f"junction {junction.id}, connection {connection.id}"
            yield from _connection(network, junction.id, connection, where, joints)
    yield from _lane_gaps(network, joints)


def _road_link(network: RoadNetwork, road: Road, at_end: bool, link: Link) -> Iterator[Flaw]:
    side, s = ("successor", road.length) if at_end else ("predecessor", 0.0)
    text = f"road {road.id}: its {side} is {link.kind} {link.id}"
    if link.id not in (network.roads if link.kind == "road" else network.junctions):
        code = f"MISSING_{link.kind.upper()}"
        yield Flaw("error", code, road.id, None, None, s, math.nan, "", f"{text}, which is not in the map")
        return
    if link.s is not None:
        yield Flaw("warning", "LINK_INSIDE", road.id, None, None, s, math.nan, "",
                   f"{text} at s={link.s:.3f} m, inside of it: no way leads over this link")  # fmt: skip
    if link.kind == "junction" or link.s is not None:
        return
    other, there = network.roads[link.id], _contact(link, at_end)
    back = other.successor if there else other.predecessor
    if back is not None and back.kind == "junction":
        linked = back.id == road.junction or _joined(network, back.id, {road.id, other.id})
    else:
        linked = back is not None and back.id == road.id
    end = "end" if there else "start"
    if not linked:
        says = (
            "which has no link there" if back is None else f"which continues to {back.kind} {back.id} there"
        )
        yield Flaw("warning", "ONE_SIDED", road.id, None, None, s, math.nan, "",
                   f"{text} at its {end}, {says}")  # fmt: skip
    if road.junction is None and other.junction is None:
        x, y, _ = network.reference_line([road.id, other.id], [s, other.length if there else 0.0])
        apart = float(np.hypot(x[1] - x[0], y[1] - y[0]))
        if apart > APART:
            yield Flaw("note", "ROAD_GAP", road.id, None, None, s, apart, "m",
                       f"{text}, whose {end} is {apart:.3f} m away")  # fmt: skip


def _joined(network: RoadNetwork, junction: str, roads: set[str]) -> bool:
    """Whether a connection of the junction is one of these two roads with each other, as direct ones are."""
    found = network.junctions.get(junction)
    return found is not None and any({c.incoming, c.connecting} == roads for c in found.connections)


def _contact(link: Link, at_end: bool) -> bool:
    """Whether the link leads to the other road's end; if it does not say, roads follow each other."""
    return link.contact == "end" if link.contact else not at_end


def _lane_links(network: RoadNetwork, road: Road, joints: list[Joint]) -> Iterator[Flaw]:
    """Look for the lanes that the road's lanes name; what is there goes into `joints`."""
    for index, section in enumerate(road.sections):
        for at_end in (False, True):
            target = _beyond(network, road, index, at_end)
            if target is None:
                continue
            lanes = network.roads[target.road].sections[target.section].lanes
            for lane in section.lanes.values():
                named = lane.successor if at_end else lane.predecessor
                if lane.id == 0 or named is None:
                    continue
                if named in lanes:
                    joints.append((SectionEnd(road.id, index, at_end), lane.id, target, named))
                else:
                    yield _missing_lane(road, index, at_end, lane, target, named)


def _missing_lane(road: Road, index: int, at_end: bool, lane: Lane, target: SectionEnd, named: int) -> Flaw:
    section = road.sections[index]
    text = (
        f"road {road.id}, lane section {index}, lane {lane.id}: its {'successor' if at_end else 'predecessor'} "
        f"is lane {named}, which road {target.road} has not in its section {target.section}"
    )
    return Flaw("error" if lane.drivable else "warning", "MISSING_LANE", road.id, index, lane.id,
                min(section.end, road.length) if at_end else section.start, math.nan, "", text)  # fmt: skip


def _beyond(network: RoadNetwork, road: Road, index: int, at_end: bool) -> SectionEnd | None:
    """The end that follows the section's end: of the next section, or of the linked road."""
    following = index + (1 if at_end else -1)
    if 0 <= following < len(road.sections):
        return SectionEnd(road.id, following, not at_end)
    link = road.successor if at_end else road.predecessor
    if link is None or link.kind != "road" or link.s is not None or link.id not in network.roads:
        return None
    return _road_end(network.roads[link.id], _contact(link, at_end))


def _road_end(road: Road, at_end: bool) -> SectionEnd:
    return SectionEnd(road.id, len(road.sections) - 1 if at_end else 0, at_end)


def _connection(
    network: RoadNetwork, junction: str, connection: Connection, where: str, joints: list[Joint]
) -> Iterator[Flaw]:
    absent = [name for name in (connection.incoming, connection.connecting) if name not in network.roads]
    for name in dict.fromkeys(absent):
        yield Flaw("error", "MISSING_ROAD", None, None, None, None, math.nan, "",
                   f"{where}: road {name} is not in the map")  # fmt: skip
    if absent:
        return
    incoming, connecting = network.roads[connection.incoming], network.roads[connection.connecting]
    sides = [at_end for at_end, link in ((False, incoming.predecessor), (True, incoming.successor))
             if link is not None and link.kind == "junction" and link.id == junction]  # fmt: skip
    enters = _road_end(connecting, connection.contact == "end")
    for start, to in connection.lane_links:
        leaves = [end for end in (_road_end(incoming, side) for side in sides or (True,))
                  if start in incoming.sections[end.section].lanes]  # fmt: skip
        for lane, road, there in ((start, incoming, bool(leaves)),
                                  (to, connecting, to in connecting.sections[enters.section].lanes)):  # fmt: skip
            if not there:
                yield Flaw("error", "MISSING_LANE", road.id, None, lane, None, math.nan, "",
                           f"{where}: road {road.id} has no lane {lane} there")  # fmt: skip
        if len(sides) == 1 and leaves and to in connecting.sections[enters.section].lanes:
            joints.append((leaves[0], start, enters, to))


def _lane_gaps(network: RoadNetwork, joints: list[Joint]) -> Iterator[Flaw]:
    """The joints whose lanes end apart, each pair once."""
    pairs = {frozenset(((a, lane), (b, other))): (a, lane, b, other) for a, lane, b, other in joints}
    once = [pair for pair in pairs.values() if all(_has_length(network, end) for end in (pair[0], pair[2]))]
    if not once:
        return
    places = [
        ([end.road for end, _ in own], [lane for _, lane in own], [_s(network, end) for end, _ in own])
        for own in ([(a, lane) for a, lane, _, _ in once], [(b, other) for _, _, b, other in once])
    ]
    (x, y), (x2, y2) = (network.to_xy(*place, 0.0) for place in places)
    narrow = np.minimum(*(network.lane_width(*place) for place in places)) < NARROW
    apart = np.where(narrow, 0.0, np.hypot(x2 - x, y2 - y))
    for i in np.flatnonzero(apart > APART).tolist():
        (end, lane, other, into), gap = once[i], float(apart[i])
        text = (
            f"road {end.road}, lane section {end.section}, lane {lane}: its {'end' if end.at_end else 'start'} is "
            f"{gap:.3f} m from lane {into} of road {other.road}, section {other.section}, which it is linked to"
        )
        yield Flaw("warning", "LANE_GAP", end.road, end.section, lane,
                   round(_s(network, end), 6), gap, "m", text)  # fmt: skip


def _s(network: RoadNetwork, end: SectionEnd) -> float:
    road = network.roads[end.road]
    section = road.sections[end.section]
    return min(section.end, road.length) - JUST_INSIDE if end.at_end else section.start


def _has_length(network: RoadNetwork, end: SectionEnd) -> bool:
    road = network.roads[end.road]
    section = road.sections[end.section]
    return min(section.end, road.length) - section.start > 2.0 * JUST_INSIDE
