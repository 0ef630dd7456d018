"""Maps on which maneuvers are planted: those that ship, public ones where they are, and maps drawn for two kinds.

Ramps, U-turns, parking lanes and stop signs are rare on the maps at hand: bends of a motorway with an entry and an exit
lane, junctions whose road bends back beside itself, and crossings with lights or with stop signs are drawn here.
"""

from __future__ import annotations

from math import cos, pi, sin
from pathlib import Path

import numpy as np

PUBLIC = (
    "carla/Town04.xodr", "esmini/e6mini.xodr", "alks/alks_road_different_curvatures.xodr", "esmini/fabriksgatan.xodr",
    "edge_cases/od_newmarket.xodr", "esmini/soderleden.xodr", "esmini/highway_exit.xodr",
    "esmini/highway_example_with_merge_and_split.xodr", "esmini/jolengatan.xodr",
    "alks/alks_road_left_radius_250m.xodr",
)  # fmt: skip
SHIPPED = ("motorway.xodr", "urban.xodr", "proving_ground.xodr")
HEAD = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="{0}"/>{1}</OpenDRIVE>'
LANE = '<lane id="{0}" type="{1}"><link>{2}</link><width sOffset="0" a="{3}" b="0" c="0" d="0"/></lane>'
SECTION = '<laneSection s="{0}">{1}<center><lane id="0" type="none"/></center>{2}</laneSection>'
GEOMETRY = '<geometry s="{0:.9f}" x="{1:.9f}" y="{2:.9f}" hdg="{3:.9f}" length="{4:.9f}">{5}</geometry>'
ROAD = (
    '<road id="{0}" length="{1:.9f}" junction="{2}"><link>{3}</link><type s="0" type="{4}"><speed max="{5}"'
    ' unit="m/s"/></type><planView>{6}</planView><lanes>{7}</lanes></road>'
)
END = '<{0} elementType="{1}" elementId="{2}" {3}/>'


def maps(shipped: Path, data: Path | None, scratch: Path, drawn: int, seed: int) -> list[Path]:
    """Give the maps, and draw so many of each sort of those that are drawn."""
    out = [shipped / name for name in SHIPPED]
    out += [data / "xodr" / name for name in PUBLIC if (data / "xodr" / name).is_file()] if data else []
    rng = np.random.default_rng([seed, 99])
    for k in range(drawn):
        out += [
            write_ramps(scratch / f"ramps_{k}.xodr", rng),
            write_u_turn(scratch / f"u_turn_{k}.xodr", rng),
            write_crossing(scratch / f"lights_{k}.xodr", rng, lights=True),
            write_crossing(scratch / f"stops_{k}.xodr", rng, lights=False),
        ]
    return out


def _lane(number: int, kind: str, width: float, links: str = "ps") -> str:
    link = f'<predecessor id="{number}"/>' * ("p" in links) + f'<successor id="{number}"/>' * ("s" in links)
    return LANE.format(number, kind, link, width)


def _line(
    s: float, x: float, y: float, heading: float, length: float, bend: float
) -> tuple[str, float, float, float]:
    """An arc (or a line), and where it ends."""
    shape = f'<arc curvature="{bend:.9f}"/>' if bend else "<line/>"
    text = GEOMETRY.format(s, x, y, heading, length, shape)
    after = heading + bend * length
    if bend:
        return text, x + (sin(after) - sin(heading)) / bend, y - (cos(after) - cos(heading)) / bend, after
    return text, x + length * cos(heading), y + length * sin(heading), heading


def write_ramps(file: Path, rng: np.random.Generator) -> Path:
    """A motorway in two bends: two or three lanes, an entry lane, later an exit lane, beside the right one."""
    main, width = int(rng.integers(2, 4)), float(rng.choice([3.5, 3.75]))
    bends = [float(rng.uniform(1.0 / 1500.0, 1.0 / 500.0)) * float(rng.choice([-1, 1])) for _ in range(2)]
    texts, at = [], (0.0, 0.0, float(rng.uniform(0.0, 2.0 * pi)))
    for k, bend in enumerate(bends):
        text, *end = _line(700.0 * k, *at, 700.0, bend)
        texts.append(text)
        at = tuple(end)
    sections = []
    lanes = [_lane(-n, "driving", width) for n in range(1, main + 1)]
    more = -main - 1
    for s, kind in ((0.0, ""), (200.0, "entry"), (500.0, ""), (850.0, "exit"), (1150.0, "")):
        own = [*lanes, _lane(more, kind, width, "")] if kind else lanes
        sections.append(SECTION.format(s, "", f"<right>{''.join(own)}</right>"))
    road = ROAD.format("7", 1400.0, "-1", "", "motorway", 38, "".join(texts), "".join(sections))
    file.write_text(HEAD.format(file.stem, road), encoding="utf-8")
    return file


def write_u_turn(file: Path, rng: np.random.Generator) -> Path:
    """A road in a bend to a junction, from where it leads on, or in half a circle back beside itself.

    Its two lanes are as far apart as the half circle is wide: a lane that nobody drives on lies between them.
    """
    radius, width = float(rng.uniform(5.0, 12.0)), 3.5
    bend = float(rng.uniform(1.0 / 300.0, 1.0 / 100.0)) * float(rng.choice([-1, 1]))
    heading, length, inside = (
        float(rng.uniform(0.0, 2.0 * pi)),
        float(rng.uniform(90.0, 140.0)),
        2.0 * radius + 10.0,
    )
    median = 2.0 * radius - width

    def lanes() -> str:
        left = f"<left>{LANE.format(2, 'driving', '', width)}{LANE.format(1, 'none', '', median)}</left>"
        return SECTION.format(0.0, left, f"<right>{LANE.format(-1, 'driving', '', width)}</right>")

    first, x, y, h = _line(0.0, 0.0, 0.0, heading, length, bend)
    on, x2, y2, h2 = _line(0.0, x, y, h, inside, 0.0)
    last, *_ = _line(0.0, x2, y2, h2, length, -bend)
    # the half circle's line is the right lane's left border: a circle to the left, its lane to the right of it
    circle, *_ = _line(0.0, x, y, h, pi * (radius - 0.5 * width), 1.0 / (radius - 0.5 * width))
    right = SECTION.format(0.0, "", "<right>{}</right>")
    ahead = right.format(LANE.format(-1, "driving", '<predecessor id="-1"/><successor id="-1"/>', width))
    round_ = right.format(LANE.format(-1, "driving", '<predecessor id="-1"/><successor id="2"/>', width))
    ends = END.format("predecessor", "road", "1", 'contactPoint="end"')
    on_end, onto = (
        END.format("successor", "road", "1", 'contactPoint="end"'),
        END.format("successor", "road", "2", 'contactPoint="start"'),
    )
    roads = [
        ROAD.format("1", length, "-1", END.format("successor", "junction", "9", ""), "town", 13.9, first, lanes()),
        ROAD.format("2", length, "-1", END.format("predecessor", "junction", "9", ""), "town", 13.9, last, lanes()),
        ROAD.format("10", inside, "9", ends + onto,
                    "town", 13.9, on, ahead),
        ROAD.format("11", pi * (radius - 0.5 * width), "9", ends + on_end,
                    "town", 13.9, circle, round_),
    ]  # fmt: skip
    ways = "".join(
        f'<connection id="{k}" incomingRoad="1" connectingRoad="{road}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for k, road in enumerate(("10", "11"))
    )
    file.write_text(
        HEAD.format(file.stem, "".join(roads) + f'<junction id="9" name="nine">{ways}</junction>'),
        encoding="utf-8",
    )
    return file


ARMS = 4
SIGNAL = (
    '<signal id="{0}" s="{1:.3f}" t="{2:.3f}" orientation="-" dynamic="{3}" country="{4}" type="{5}"'
    ' subtype="-1"/>'
)


def write_crossing(file: Path, rng: np.random.Generator, *, lights: bool) -> Path:
    """A crossing of four arms with a lane each way, parking lanes to the right of who leaves it, and short sections.

    With lights at all arms, or with stop signs at two opposite ones.
    """
    radius, width, parks = float(rng.uniform(9.0, 16.0)), 3.5, 2.4
    turned = float(rng.uniform(0.0, 2.0 * pi))
    headings = [turned + 0.5 * pi * k for k in range(ARMS)]
    out, ways = [], []
    for k, heading in enumerate(headings):
        length, short = float(rng.uniform(120.0, 180.0)), float(rng.uniform(4.0, 15.0))
        line, *_ = _line(0.0, radius * cos(heading), radius * sin(heading), heading, length, 0.0)
        left, right = (f"<left>{_lane(1, 'driving', width)}</left>", _lane(-1, "driving", width))
        first = SECTION.format(0.0, left, f"<right>{right}</right>")
        right += _lane(-2, "parking", parks, "")
        second = SECTION.format(short, left, f"<right>{right}</right>")
        link = END.format("predecessor", "junction", "9", "")
        road = ROAD.format(str(k), length, "-1", link, "town", 13.9, line, first + second)
        stops = not lights and k % 2 == 0
        kind = ("yes", "OpenDRIVE", "1000001") if lights else ("no", "DE", "206")
        signal = (
            SIGNAL.format(k + 1, float(rng.uniform(1.0, 4.0)), width + 1.0, *kind) if lights or stops else ""
        )
        out.append(road.replace("</road>", f"<signals>{signal}</signals></road>"))
    for k, heading in enumerate(headings):
        for way in (1, 2, 3):  # to the left of where it comes from: arms are counted anticlockwise
            to, name = (k + way) % ARMS, str(10 + ARMS * k + way)
            length, bend = (2.0 * radius, 0.0) if way == 2 else (0.5 * pi * radius, (way - 2) / radius)
            line, *_ = _line(0.0, radius * cos(heading), radius * sin(heading), heading + pi, length, bend)
            inner = _lane(-1, "driving", width, "").replace(
                "<link></link>", '<link><predecessor id="1"/><successor id="-1"/></link>'
            )
            ends = END.format("predecessor", "road", str(k), 'contactPoint="start"')
            ends += END.format("successor", "road", str(to), 'contactPoint="start"')
            section = SECTION.format(0.0, "", f"<right>{inner}</right>")
            out.append(ROAD.format(name, length, "9", ends, "town", 13.9, line, section))
            ways.append(
                f'<connection id="{len(ways)}" incomingRoad="{k}" connectingRoad="{name}" contactPoint="start">'
                '<laneLink from="1" to="-1"/></connection>'
            )
    text = "".join(out) + f'<junction id="9" name="nine">{"".join(ways)}</junction>'
    file.write_text(HEAD.format(file.stem, text), encoding="utf-8")
    return file
