"""Parts of the maps that tools/make_networks.py makes: lanes, roads with links, and the finished file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import cos, pi, sin
from xml.etree import ElementTree

from lxml import etree
from scenariogeneration import xodr

GEO_REFERENCE = "+proj=tmerc +lat_0=48.0 +lon_0=11.0 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs"
DATE = "2025-01-01T00:00:00"
BROKEN = {"width": 0.15, "length": 6.0, "space": 12.0}
Cubics = Sequence[tuple[float, float, float, float, float]]
"""Of a lane's width: sOffset [m], a, b, c, d."""
Curve = xodr.Line | xodr.Arc | xodr.Spiral


def mark(kind: str) -> xodr.RoadMark:
    if kind == "broken":
        return xodr.RoadMark(xodr.RoadMarkType.broken, rule=xodr.MarkRule.none, **BROKEN)
    return xodr.RoadMark(getattr(xodr.RoadMarkType, kind), width=0.15)


def lane(
    kind: str,
    widths: float | Cubics,
    line: str = "none",
    *,
    before: int | None = None,
    after: int | None = None,
) -> xodr.Lane:
    """A lane of constant width [m] or of cubics, with the lanes of its links."""
    cubics = [(0.0, widths, 0.0, 0.0, 0.0)] if isinstance(widths, float) else widths
    made = xodr.Lane(getattr(xodr.LaneType, kind), *cubics[0][1:])
    for s, *cubic in cubics[1:]:
        made.add_lane_width(*cubic, s)
    made.add_roadmark(mark(line))
    for name, other in (("predecessor", before), ("successor", after)):
        if other is not None:
            made.add_link(name, other)
    return made


def opening(width: float, length: float) -> Cubics:
    """From nothing to a width over a length [m], and on with it: 3 f² - 2 f³."""
    return [
        (0.0, 0.0, 0.0, 3.0 * width / length**2, -2.0 * width / length**3),
        (length, width, 0.0, 0.0, 0.0),
    ]


def closing(width: float, length: float) -> Cubics:
    """From a width to nothing over a length [m]; `opening` driven the other way."""
    return [(0.0, width, 0.0, -3.0 * width / length**2, 2.0 * width / length**3)]


def section(
    s: float, right: Sequence[xodr.Lane], left: Sequence[xodr.Lane] = (), centre: str = "solid"
) -> xodr.LaneSection:
    middle = xodr.Lane()
    middle.add_roadmark(mark(centre))
    made = xodr.LaneSection(s, middle)
    for one in left:
        made.add_left_lane(one)
    for one in right:
        made.add_right_lane(one)
    return made


Place = tuple[float, float, float]
"""x, y [m], heading [rad]."""


def road(
    number: int,
    start: Place,
    curves: Sequence[Curve],
    sections: Sequence[xodr.LaneSection],
    *,
    junction: int = -1,
    name: str = "",
    kind: str = "town",
    limit: float = 50.0,
) -> xodr.Road:
    """A road from a place on; limit [km/h]."""
    view = xodr.PlanView(*start)
    for curve in curves:
        view.add_geometry(curve)
    view.adjust_geometries()
    lanes = xodr.Lanes()
    for one in sections:
        lanes.add_lanesection(one)
    made = xodr.Road(number, view, lanes, road_type=junction, name=name)
    made.add_type(getattr(xodr.RoadType, kind), 0.0, speed=limit, speed_unit="km/h")
    made.add_elevation(0.0, 0.0, 0.0, 0.0, 0.0)
    return made


def link(
    one: xodr.Road, *, before: tuple[str, int, str] | None = None, after: tuple[str, int, str] | None = None
) -> None:
    """Say what a road comes from and goes on into: kind ("road", "junction"), id, contact point ("start", "end")."""
    for told, add in ((before, one.add_predecessor), (after, one.add_successor)):
        if told is not None:
            kind, number, contact = told
            place = getattr(xodr.ContactPoint, contact) if kind == "road" else None
            add(getattr(xodr.ElementType, kind), number, place)


def end_of(one: xodr.Road) -> Place:
    view = one.planview
    return view.x_end, view.y_end, view.h_end


def bend(angle: float, tangent: float, share: float = 0.5) -> list[Curve]:
    """A turn by an angle [rad] of +-90° from one leg to the other, each of so many metres: clothoid, arc, clothoid.

    share: of the angle that the clothoids turn. Both legs are as long as the shape of radius 1 times the radius.
    """
    sign, turn = (1.0, abs(angle)) if angle > 0.0 else (-1.0, abs(angle))
    spiral, arc = (
        share * turn,
        (1.0 - share) * turn,
    )  # a clothoid of radius 1 turns half its length: two of them
    view = xodr.PlanView(0.0, 0.0, 0.0)
    for curve in (
        xodr.Spiral(0.0, 1.0, length=spiral),
        xodr.Arc(1.0, length=arc),
        xodr.Spiral(1.0, 0.0, length=spiral),
    ):
        view.add_geometry(curve)
    view.adjust_geometries()
    radius = tangent / view.x_end
    k = sign / radius
    return [
        xodr.Spiral(0.0, k, length=spiral * radius),
        xodr.Arc(k, length=arc * radius),
        xodr.Spiral(k, 0.0, length=spiral * radius),
    ]


def curves_to(start: Place, end: Place) -> list[Curve]:
    """The way from a place to another one that lies straight ahead or around a corner of 90°."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    along, aside = dx * cos(start[2]) + dy * sin(start[2]), dy * cos(start[2]) - dx * sin(start[2])
    if abs(aside) < 1e-9:
        return [xodr.Line(along)]
    leg = min(along, abs(aside))
    first, last = along - leg, abs(aside) - leg
    turn = bend(0.5 * pi if aside > 0.0 else -0.5 * pi, leg)
    return [*([xodr.Line(first)] if first > 1e-9 else []), *turn, *([xodr.Line(last)] if last > 1e-9 else [])]


def finished(
    name: str,
    roads: Sequence[xodr.Road],
    junctions: Sequence[xodr.Junction] = (),
    besides: Mapping[int, Sequence[etree._Element]] | None = None,
    controllers: Mapping[str, Sequence[str]] | None = None,
    junction_of_controllers: int = 0,
) -> bytes:
    """Give the file. scenariogeneration dates the header and leaves an empty lateralProfile: mended here.

    besides: by road the elements <objects> and <signals>; controllers: by id the signals that each switches.
    """
    network = xodr.OpenDrive(name, revMajor="1", revMinor="6", geo_reference=GEO_REFERENCE)
    for one in roads:
        network.add_road(one)
    for one in junctions:
        network.add_junction(one)
    root = etree.fromstring(ElementTree.tostring(network.get_element()))
    header = root.find("header")
    assert header is not None
    header.set("date", DATE)
    for profile in root.findall("road/lateralProfile"):
        profile.getparent().remove(profile)
    for number, elements in (besides or {}).items():
        for element in elements:
            root.find(f"road[@id='{number}']").append(element)
    first = root.find("junction")
    for number, signals in (controllers or {}).items():
        controller = etree.Element("controller", id=number, name=f"group {number}")
        for signal in signals:
            etree.SubElement(controller, "control", signalId=signal)
        first.addprevious(controller)
        root.find(f"junction[@id='{junction_of_controllers}']").append(etree.Element("controller", id=number))
    etree.indent(root, "  ")
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8") + b"\n"
