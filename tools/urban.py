"""The map networks/urban.xodr: two junctions of a town, one with traffic lights and one with signs.

Junction 10, with lights, at the origin: the main road (1 from the west, 2 to the east) has two lanes each way, the
side road (3 from the south, 4 to the north) one. Junction 20, at x = 300 m, without lights: the side road 6 from the
south ends at the main road (2, 5) and stops there. Road 1 has a parking lane on its right; road 3 comes through an S
of clothoids and arcs. Sidewalks along all; crosswalks at the lights, at s = 120 m of road 5 and at s = 180 m of road 4,
without lights. 50 km/h, road 4 and road 6 30 km/h.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

from lxml import etree
from map_parts import Place, bend, curves_to, end_of, finished, lane, link, road, section
from scenariogeneration import xodr

WIDTH, PARKING, WALK = 3.5, 2.3, 2.0
HALF = 20.0
"""m from the middle of a junction to where its roads begin."""
EAST = 300.0
LIGHT, STOP, PRIORITY = "1000001", "206", "306"
Way = tuple[int, int, int, tuple[tuple[int, int], ...]]
"""A way through a junction: its road, that it comes from, that it leads to, and the lanes that it joins."""


def _side(
    driving: int, links: Sequence[tuple[int | None, int | None]], outside: Sequence[xodr.Lane] = ()
) -> list[xodr.Lane]:
    made = [
        lane("driving", WIDTH, "solid" if n == driving - 1 else "broken", before=before, after=after)
        for n, (before, after) in enumerate(links)
    ]
    return [*made, *outside, lane("sidewalk", WALK)]


def _arm(
    number: int,
    start: Place,
    curves: list[object],
    each: int,
    name: str,
    *,
    parking: bool = False,
    limit: float = 50.0,
) -> xodr.Road:
    none = [(None, None)] * each
    right = _side(each, none, [lane("parking", PARKING, "solid")] if parking else [])
    centre = "solid" if each > 1 else "broken"
    return road(
        number, start, curves, [section(0.0, right, _side(each, none), centre)], name=name, limit=limit
    )


def _place(arms: dict[int, xodr.Road], number: int, at: str, lane_id: int, *, leaving: bool) -> Place:
    """Where the inner border of a lane is at an end of an arm, and its heading as traffic passes it there."""
    view = arms[number].planview
    x, y, h = (
        (view.x_end, view.y_end, view.h_end) if at == "end" else (view.x_start, view.y_start, view.h_start)
    )
    inner = (abs(lane_id) - 1) * WIDTH * (1.0 if lane_id > 0 else -1.0)
    left_x, left_y = -round(_sin(h), 12), round(_cos(h), 12)
    inward = at == "end"  # the arm's own direction leads into the junction
    heading = h if inward == leaving else h + pi
    return x + inner * left_x, y + inner * left_y, heading


def _sin(angle: float) -> float:
    return {0: 0.0, 1: 1.0, 2: 0.0, 3: -1.0}[round(angle / (0.5 * pi)) % 4]


def _cos(angle: float) -> float:
    return _sin(angle + 0.5 * pi)


def _junction(
    name: str, number: int, arms: dict[int, xodr.Road], ends: dict[int, str], ways: Sequence[Way]
) -> tuple[xodr.Junction, list[xodr.Road]]:
    """A junction and its roads. ends: which end of each arm is here."""
    made, roads = xodr.Junction(name, number), []
    for own, come, go, lanes in ways:
        start = _place(arms, come, ends[come], lanes[0][0], leaving=True)
        end = _place(arms, go, ends[go], lanes[0][1], leaving=False)
        right = [lane("driving", WIDTH, before=before, after=after) for before, after in lanes]
        inside = road(
            own, start, curves_to(start, end), [section(0.0, right, centre="none")], junction=number
        )
        link(inside, before=("road", come, ends[come]), after=("road", go, ends[go]))
        connection = xodr.Connection(come, own, xodr.ContactPoint.start)
        for n, (before, _) in enumerate(lanes, start=1):
            connection.add_lanelink(before, -n)
        made.add_connection(connection)
        roads.append(inside)
    return made, roads


LIT: tuple[Way, ...] = (
    (101, 1, 2, ((-1, -1), (-2, -2))),
    (102, 1, 4, ((-1, -1),)),
    (103, 1, 3, ((-2, 1),)),
    (104, 2, 1, ((1, 1), (2, 2))),
    (105, 2, 3, ((1, 1),)),
    (106, 2, 4, ((2, -1),)),
    (107, 3, 4, ((-1, -1),)),
    (108, 3, 1, ((-1, 1),)),
    (109, 3, 2, ((-1, -2),)),
    (110, 4, 3, ((1, 1),)),
    (111, 4, 2, ((1, -1),)),
    (112, 4, 1, ((1, 2),)),
)
SIGNED: tuple[Way, ...] = (
    (201, 2, 5, ((-1, -1), (-2, -2))),
    (202, 2, 6, ((-2, 1),)),
    (203, 5, 2, ((1, 1), (2, 2))),
    (204, 5, 6, ((1, 1),)),
    (205, 6, 2, ((-1, 1),)),
    (206, 6, 5, ((-1, -2),)),
)


def _signal(number: int, s: float, kind: str, t: float, orientation: str) -> etree._Element:
    light = kind == LIGHT
    return etree.Element(
        "signal",
        s=f"{s:g}",
        t=f"{t:g}",
        id=str(number),
        name=f"signal {number}",
        dynamic="yes" if light else "no",
        orientation=orientation,
        zOffset="3",
        country="OpenDRIVE" if light else "DE",
        type=kind,
        subtype="-1",
        value="-1",
    )


def _crosswalk(number: int, s: float, half: float) -> etree._Element:
    """A crosswalk of 4 m over a road that is 2 half [m] wide."""
    made = etree.Element(
        "object",
        id=str(number),
        type="crosswalk",
        name=f"crosswalk {number}",
        s=f"{s:g}",
        t="0",
        zOffset="0",
        hdg="0",
        orientation="none",
        length="4",
        width=f"{2.0 * half:g}",
        height="0",
    )
    outline = etree.SubElement(etree.SubElement(made, "outlines"), "outline", id="0", closed="true")
    for n, (u, v) in enumerate(((-2.0, -half), (2.0, -half), (2.0, half), (-2.0, half))):
        etree.SubElement(outline, "cornerLocal", u=f"{u:g}", v=f"{v:g}", z="0", height="0", id=str(n))
    return made


def _beside(objects: Sequence[etree._Element], signals: Sequence[etree._Element]) -> list[etree._Element]:
    out = []
    for tag, children in (("objects", objects), ("signals", signals)):
        if children:
            parent = etree.Element(tag)
            parent.extend(children)
            out.append(parent)
    return out


def urban() -> bytes:
    """Give the file."""
    main, side = 2 * WIDTH, WIDTH
    arms = {
        1: _arm(1, (-320.0, 0.0, 0.0), [xodr.Line(300.0)], 2, "main road, west", parking=True),
        2: _arm(2, (HALF, 0.0, 0.0), [xodr.Line(EAST - 2.0 * HALF)], 2, "main road, between the junctions"),
        4: _arm(4, (0.0, HALF, 0.5 * pi), [xodr.Line(280.0)], 1, "side road, north", limit=30),
        5: _arm(5, (EAST + HALF, 0.0, 0.0), [xodr.Line(300.0)], 2, "main road, east"),
        6: _arm(6, (EAST, -220.0, 0.5 * pi), [xodr.Line(200.0)], 1, "side road, south-east", limit=30),
    }
    curves = [
        xodr.Line(80.0),
        *bend(0.5 * pi, 70.0),
        xodr.Line(30.0),
        *bend(-0.5 * pi, 70.0),
        xodr.Line(80.0),
    ]
    x, y, _ = end_of(_arm(3, (0.0, 0.0, 0.5 * pi), list(curves), 1, ""))
    arms[3] = _arm(3, (-x, -HALF - y, 0.5 * pi), curves, 1, "side road, south")
    lit, inside = _junction("lights", 10, arms, {1: "end", 2: "start", 3: "end", 4: "start"}, LIT)
    signed, more = _junction("signs", 20, arms, {2: "end", 5: "start", 6: "end"}, SIGNED)
    for number, before, after in (
        (1, None, 10),
        (2, 10, 20),
        (3, None, 10),
        (4, 10, None),
        (5, 20, None),
        (6, None, 20),
    ):
        link(
            arms[number],
            before=None if before is None else ("junction", before, ""),
            after=None if after is None else ("junction", after, ""),
        )
    long3 = arms[3].planview.get_total_length()
    besides = {
        1: _beside([_crosswalk(1, 294.0, main + PARKING)], [_signal(1, 290.0, LIGHT, -main - 1.0, "+")]),
        2: _beside(
            [_crosswalk(2, 6.0, main)],
            [_signal(2, 10.0, LIGHT, main + 1.0, "-"), _signal(11, 250.0, PRIORITY, -main - 1.0, "+")],
        ),
        3: _beside(
            [_crosswalk(3, round(long3, 3) - 6.0, side)],
            [_signal(3, round(long3, 3) - 10.0, LIGHT, -side - 1.0, "+")],
        ),
        4: _beside(
            [_crosswalk(4, 6.0, side), _crosswalk(6, 180.0, side)], [_signal(4, 10.0, LIGHT, side + 1.0, "-")]
        ),
        5: _beside([_crosswalk(5, 120.0, main)], [_signal(12, 10.0, PRIORITY, main + 1.0, "-")]),
        6: _beside([], [_signal(13, 196.0, STOP, -side - 1.0, "+")]),
    }
    roads = [*(arms[n] for n in sorted(arms)), *inside, *more]
    return finished("urban", roads, [lit, signed], besides, {"1": ["1", "2"], "2": ["3", "4"]}, 10)
