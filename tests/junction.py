"""A junction of our own: from the west straight on to the east, or by a quarter of a circle to the north."""

from __future__ import annotations

from math import pi
from pathlib import Path

RADIUS, ARM = 20.0, 120.0
"""m of the turn to the left, and of each road that meets here."""

ROAD = """<road id="{id}" length="{length}" junction="{junction}"><link>{link}</link><planView>
<geometry s="0" x="{x}" y="{y}"
hdg="{heading}" length="{length}">{shape}</geometry></planView><lanes><laneSection s="0">{left}<center><lane id="0"
type="none"/></center><right><lane id="-1" type="driving"><link>{lanes}</link><width sOffset="0" a="3.5" b="0" c="0"
d="0"/></lane></right></laneSection></lanes></road>"""
OTHER_WAY = (
    """<left><lane id="1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></left>"""
)
THROUGH = """<predecessor elementType="road" elementId="{0}" contactPoint="end"/><successor elementType="road"
elementId="{1}" contactPoint="start"/>"""
LANES = '<predecessor id="-1"/><successor id="-1"/>'


def arm(name: str, x: float, y: float, heading: float, end: str) -> str:
    """A straight road whose end ("predecessor", "successor") is at the junction."""
    link = f'<{end} elementType="junction" elementId="9"/>'
    return ROAD.format(
        id=name, length=ARM, junction="-1", link=link, x=x, y=y, heading=heading, shape="<line/>", left=OTHER_WAY,
        lanes="",
    )  # fmt: skip


def inside(name: str, length: float, shape: str, to: str) -> str:
    """A road through the junction, from road 1 on."""
    return ROAD.format(
        id=name, length=length, junction="9", link=THROUGH.format("1", to), x=0.0, y=0.0, heading=0.0, shape=shape,
        left="", lanes=LANES,
    )  # fmt: skip


def write_junction(path: Path) -> Path:
    """Write the map: roads 1 from the west, 2 to the east, 3 to the north; 10 leads straight on, 11 to the left."""
    roads = [
        arm("1", -ARM, 0.0, 0.0, "successor"),
        arm("2", RADIUS, 0.0, 0.0, "predecessor"),
        arm("3", RADIUS, RADIUS, 0.5 * pi, "predecessor"),
        inside("10", RADIUS, "<line/>", "2"),
        inside("11", 0.5 * pi * RADIUS, f'<arc curvature="{1.0 / RADIUS}"/>', "3"),
    ]
    ways = "".join(
        f'<connection id="{k}" incomingRoad="1" connectingRoad="{road}" contactPoint="start">'
        '<laneLink from="-1" to="-1"/></connection>'
        for k, road in enumerate(("10", "11"))
    )
    path.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="junction"/>'
        f'{"".join(roads)}<junction id="9" name="nine">{ways}</junction></OpenDRIVE>',
        encoding="utf-8",
    )
    return path
