"""The map networks/motorway.xodr: a motorway of two carriageways with an on-ramp, an off-ramp and curves.

Its line: 700 m straight, clothoid, radius 900 m left, clothoid, 500 m straight, clothoid, radius 800 m right,
clothoid, 550 m straight: 3,000 m. Driven with s: roads 1, 2 and 3, three lanes -1 to -3; at s = 350 m of the line
junction 10, where the on-ramp (road 4) joins as lane -4 (type entry), which ends after 250 m over 80 m; from 1,400 m on
the exit lane -4 opens over 80 m, and leaves at junction 20 (1,650 m) to the off-ramp (road 5).
Driven against s: road 9 beside it, lanes 2 to 4 behind a median of 4 m; of its three lanes the outer one ends over 150
m at s = 1,900 to 1,750 m, and opens again at 700 to 550 m. 130 km/h, on the ramps 60 km/h.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

from map_parts import closing, end_of, finished, lane, link, opening, road, section
from scenariogeneration import xodr

WIDTH, SHOULDER, MEDIAN = 3.75, 2.5, 4.0
INSIDE = 50.0
TAPER, DROP = 80.0, 150.0
MAIN = 3 * WIDTH


def _curves(length: float, radius: float, arc: float) -> list[xodr.Arc | xodr.Spiral]:
    k = 1.0 / radius
    return [xodr.Spiral(0.0, k, length=length), xodr.Arc(k, length=arc), xodr.Spiral(k, 0.0, length=length)]


LEFT, RIGHT = _curves(150.0, 900.0, 350.0), _curves(150.0, -800.0, 300.0)


def main_lanes(
    before: Sequence[int | None] = (-1, -2, -3), after: Sequence[int | None] = (-1, -2, -3)
) -> list[xodr.Lane]:
    lines = ("broken", "broken", "solid")
    return [
        lane("driving", WIDTH, line, before=b, after=a)
        for line, b, a in zip(lines, before, after, strict=True)
    ]


def _second() -> list[xodr.LaneSection]:
    """The lanes of road 2, s from its start: entry until 250 m, its end, three lanes, exit lane from 1,000 m on."""
    shoulder = SHOULDER
    return [
        section(
            0.0,
            [
                *main_lanes(),
                lane("entry", WIDTH, "solid", before=-1, after=-4),
                lane("shoulder", shoulder, after=-5),
            ],
        ),
        section(
            250.0,
            [
                *main_lanes(),
                lane("entry", closing(WIDTH, TAPER), "solid", before=-4),
                lane("shoulder", shoulder, before=-5, after=-4),
            ],
        ),
        section(250.0 + TAPER, [*main_lanes(), lane("shoulder", shoulder, before=-5, after=-5)]),
        section(
            1000.0,
            [
                *main_lanes(),
                lane("exit", opening(WIDTH, TAPER), "solid", after=-1),
                lane("shoulder", shoulder, before=-4),
            ],
        ),
    ]


def _opposite() -> list[xodr.LaneSection]:
    """The lanes of road 9, by s; they are driven the other way."""

    def lanes(outer: str) -> list[xodr.Lane]:
        both = {"before": 1, "after": 1}
        own = [lane("median", MEDIAN, "solid", **both)]
        own += [
            lane("driving", WIDTH, "broken" if n == 2 or outer != "none" else "solid", before=n, after=n)
            for n in (2, 3)
        ]
        return own

    def shoulder(before: int | None, after: int | None) -> xodr.Lane:
        return lane("shoulder", SHOULDER, before=before, after=after)

    def outer(widths: object, before: int | None, after: int | None) -> xodr.Lane:
        return lane("driving", widths, "solid", before=before, after=after)

    wide = WIDTH
    return [
        section(0.0, [], [*lanes("wide"), outer(wide, None, 4), shoulder(None, 5)]),
        section(550.0, [], [*lanes("closes"), outer(closing(wide, DROP), 4, None), shoulder(5, 4)]),
        section(700.0, [], [*lanes("none"), shoulder(5, 5)]),
        section(1750.0, [], [*lanes("opens"), outer(opening(wide, DROP), None, 4), shoulder(4, 5)]),
        section(1900.0, [], [*lanes("wide"), outer(wide, 4, None), shoulder(5, None)]),
    ]


def _ramp(
    number: int, start: tuple[float, float, float], curves: list[object], name: str, *, entry: bool
) -> xodr.Road:
    kind = "onRamp" if entry else "offRamp"
    links = {"after": -1} if entry else {"before": -1}
    lanes = [lane(kind, WIDTH, "solid", **links), lane("shoulder", 1.5)]
    return road(number, start, curves, [section(0.0, lanes)], name=name, kind="motorway", limit=60)


def _inside(
    number: int, start: tuple[float, float, float], lanes: list[xodr.Lane], junction: int, limit: float
) -> xodr.Road:
    return road(
        number,
        start,
        [xodr.Line(INSIDE)],
        [section(0.0, lanes)],
        junction=junction,
        kind="motorway",
        limit=limit,
    )


def motorway() -> bytes:
    """Give the file."""
    first = road(
        1,
        (0.0, 0.0, 0.0),
        [xodr.Line(350.0)],
        [section(0.0, [*main_lanes(before=(None,) * 3), lane("shoulder", SHOULDER)])],
        name="before the on-ramp",
        kind="motorway",
        limit=130,
    )
    through = _inside(101, (350.0, 0.0, 0.0), main_lanes(), 10, 130)
    joining = _inside(
        102, (350.0, -MAIN, 0.0), [lane("onRamp", WIDTH, "solid", before=-1, after=-4)], 10, 100
    )
    second = road(
        2,
        (400.0, 0.0, 0.0),
        [xodr.Line(300.0), *LEFT, xodr.Line(300.0)],
        _second(),
        name="between the ramps",
        kind="motorway",
        limit=130,
    )
    x, y, heading = end_of(second)
    onward = _inside(201, (x, y, heading), main_lanes(), 20, 130)
    leaving = _inside(
        202,
        (x + MAIN * sin(heading), y - MAIN * cos(heading), heading),
        [lane("offRamp", WIDTH, "solid", before=-4, after=-1)],
        20,
        100,
    )
    third = road(
        3,
        end_of(onward),
        [xodr.Line(150.0), *RIGHT, xodr.Line(550.0)],
        [section(0.0, [*main_lanes(after=(None,) * 3), lane("shoulder", SHOULDER)])],
        name="after the off-ramp",
        kind="motorway",
        limit=130,
    )
    # the on-ramp ends at (350, -MAIN) with heading 0: it is laid from there backwards, then turned round
    curves = [xodr.Line(120.0), *_curves(90.0, -160.0, 60.0), xodr.Line(60.0)]
    trial = _ramp(4, (0.0, 0.0, 0.0), list(curves), "on-ramp", entry=True)
    dx, dy, turned = end_of(trial)
    c, s = cos(-turned), sin(-turned)
    on_ramp = _ramp(
        4,
        (350.0 - c * dx + s * dy, -MAIN - s * dx - c * dy, -turned),
        [xodr.Line(120.0), *_curves(90.0, -160.0, 60.0), xodr.Line(60.0)],
        "on-ramp",
        entry=True,
    )
    off_ramp = _ramp(
        5, end_of(leaving), [*_curves(90.0, -140.0, 60.0), xodr.Line(150.0)], "off-ramp", entry=False
    )
    opposite = road(
        9,
        (0.0, 0.0, 0.0),
        [xodr.Line(700.0), *LEFT, xodr.Line(500.0), *RIGHT, xodr.Line(550.0)],
        _opposite(),
        name="other carriageway",
        kind="motorway",
        limit=130,
    )
    link(first, after=("junction", 10, ""))
    link(on_ramp, after=("junction", 10, ""))
    link(second, before=("junction", 10, ""), after=("junction", 20, ""))
    link(third, before=("junction", 20, ""))
    link(off_ramp, before=("junction", 20, ""))
    for one, before, after in ((through, 1, 2), (joining, 4, 2), (onward, 2, 3), (leaving, 2, 5)):
        link(one, before=("road", before, "end"), after=("road", after, "start"))
    entry, exit_ = xodr.Junction("on-ramp", 10), xodr.Junction("off-ramp", 20)
    _connect(entry, 1, 101, [(-1, -1), (-2, -2), (-3, -3)])
    _connect(entry, 4, 102, [(-1, -1)])
    _connect(exit_, 2, 201, [(-1, -1), (-2, -2), (-3, -3)])
    _connect(exit_, 2, 202, [(-4, -1)])
    roads = [first, second, third, on_ramp, off_ramp, opposite, through, joining, onward, leaving]
    return finished("motorway", roads, [entry, exit_])


def _connect(junction: xodr.Junction, incoming: int, connecting: int, lanes: list[tuple[int, int]]) -> None:
    made = xodr.Connection(incoming, connecting, xodr.ContactPoint.start)
    for one, other in lanes:
        made.add_lanelink(one, other)
    junction.add_connection(made)
