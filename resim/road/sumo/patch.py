"""Writes over what netconvert made: exact shapes, lengths and widths of lanes and junctions, and stop signs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
import shapely
import shapely.ops
from lxml import etree

from resim.core.errors import ConversionError
from resim.core.geometry import Floats
from resim.road.sumo.plain import Ends, PlainNetwork, SumoConnection
from resim.road.sumo.plainxml import shape_text
from resim.road.sumo.shapes import length

SHORTEST = 0.1
"""SUMO takes no lane shorter than this [m]; its shape may be."""

MINOR_OR_MAJOR = ("m", "M")
"""States of connections without a traffic light; at all-way stops they have another."""

Via = Mapping[Ends, tuple[str, ...]]


def patch(net: Path, made: PlainNetwork) -> tuple[etree._Element, Via]:
    """Give the net with exact geometry, and the internal lanes of each connection (from lane, to lane) that it has.

    Raises ConversionError where netconvert left a lane out: it must not, all of them were named.
    """
    root = etree.parse(str(net)).getroot()
    lanes = {str(lane.get("id")): lane for lane in root.iter("lane")}
    if lost := [own for name, own in made.lanes.items() if name not in lanes]:
        raise ConversionError(
            f"netconvert made no lane of {lost[0].stretch.key} ({len(lost)} lanes are missing)"
        )
    for name, own in made.lanes.items():
        _write(lanes[name], own.line, own.width)
    via = _via(root)
    for connection in made.connections:
        inner = via.get(connection.ends, ())
        if inner:
            _write_inner([lanes[name] for name in inner], connection)
    _write_junctions(root, made)
    return root, via


def mark_stops(root: etree._Element, stops: Collection[Ends]) -> None:
    """Let vehicles stop before these connections: netconvert has stop signs for all minor ways of a node only.

    Who goes first is as netconvert has worked it out.
    """
    for element in root.iterfind("connection"):
        if element.get("state") in MINOR_OR_MAJOR and connection_ends(element) in stops:
            element.set("state", "s")


def connection_ends(element: etree._Element) -> Ends:
    """Give the lanes that a connection of the net leads from and to."""
    return f"{element.get('from')}_{element.get('fromLane')}", f"{element.get('to')}_{element.get('toLane')}"


def _write(lane: etree._Element, line: Floats, width: float) -> None:
    lane.set("shape", shape_text(line))
    lane.set("length", f"{max(length(line), SHORTEST):.6f}")
    lane.set("width", f"{width:.6f}")


def _write_inner(lanes: list[etree._Element], connection: SumoConnection) -> None:
    """A connection's line over its internal lanes: two where netconvert lets vehicles wait halfway."""
    given = [float(lane.get("length", "0")) for lane in lanes]
    cuts = np.cumsum([0.0, *given]) / max(sum(given), 1e-9)
    whole = shapely.linestrings(connection.line)
    for lane, low, high in zip(lanes, cuts[:-1], cuts[1:], strict=True):
        part = shapely.ops.substring(whole, low, high, normalized=True) if len(lanes) > 1 else whole
        line = shapely.get_coordinates(part)
        _write(lane, line if len(line) > 1 else np.repeat(line, 2, axis=0), connection.width)
        if connection.way:
            names = " ".join(f"{key.road}_{key.section}_{key.lane}" for key in connection.way)
            for param in lane.findall("param"):
                lane.remove(param)
            etree.SubElement(lane, "param", key="origId", value=names)


def _via(root: etree._Element) -> dict[tuple[str, str], tuple[str, ...]]:
    """The internal lanes of each connection between lanes that are not internal."""
    after: dict[str, str] = {}
    found: dict[tuple[str, str], tuple[str, ...]] = {}
    for element in root.iterfind("connection"):
        (start, target), inner = connection_ends(element), element.get("via")
        if inner is None:
            continue
        if start.startswith(":"):
            after[start] = inner
        else:
            found[start, target] = (inner,)
    return {ends: (*inner, after[inner[0]]) if inner[0] in after else inner for ends, inner in found.items()}


def _write_junctions(root: etree._Element, made: PlainNetwork) -> None:
    """Each junction's area: the hull of the lane ends and junction lanes there."""
    points: dict[str, list[Floats]] = defaultdict(list)
    target = {}
    for piece in made.pieces.all:
        for index in range(len(piece.lanes)):
            own = made.lanes[f"{piece.id}_{index}"]
            target[own.id] = piece.target
            points[piece.origin].append(_across(own.line[0], own.line[1], own.width))
            points[piece.target].append(_across(own.line[-1], own.line[-2], own.width))
    for connection in made.connections:
        points[target[connection.origin]].append(connection.line)
    for junction in root.iterfind("junction"):
        name = junction.get("id", "")
        if name in points:
            hull = shapely.convex_hull(shapely.multipoints(np.concatenate(points[name])))
            junction.set("shape", shape_text(shapely.get_coordinates(hull)))


def _across(end: Floats, inner: Floats, width: float) -> Floats:
    """Both borders (2, 2) [m] of a lane at its end."""
    along = end - inner
    norm = float(np.hypot(*along))
    left = np.array([-along[1], along[0]]) * (0.5 * width / norm if norm > 0.0 else 0.0)
    return np.stack([end + left, end - left])
