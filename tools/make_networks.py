"""Makes the maps in networks/, byte for byte the same each time: python tools/make_networks.py.

The motorway and the town are described in motorway.py and urban.py; here the proving ground:

Road 1: 1200 m straight, clothoid, 400 m radius left, clothoid, 300 m straight. Two driving lanes -1 and -2
and the shoulder -3; from 900 m on lane -3 opens to a third driving lane over 120 m and -4 is the shoulder.
Lane 1 is the oncoming driving lane, lane 2 its shoulder. 130 km/h, from 1200 m on 100 km/h.
Road 2: goes on with the same lanes along two paramPoly3 (an S of 800 m), 100 km/h.
"""

from __future__ import annotations

import sys
from pathlib import Path

from map_parts import finished, mark
from motorway import motorway
from scenariogeneration import xodr
from urban import urban

HERE = Path(__file__).resolve().parents[1]
WIDTH, SHOULDER = 3.5, 2.5
WIDENING, TAPER = 900.0, 120.0
STRAIGHT, CLOTHOID, ARC, RUNOUT, RADIUS = 1200.0, 120.0, 300.0, 300.0, 400.0
S_HALF, S_OFFSET = 400.0, 20.0


def lane(kind: xodr.LaneType, width: float, line: str, *, opening: float = 0.0) -> xodr.Lane:
    """A lane, or one that opens from nothing to `width` over the first `opening` metres (3 f² - 2 f³)."""
    if opening:
        made = xodr.Lane(kind, 0.0, 0.0, 3.0 * width / opening**2, -2.0 * width / opening**3)
        made.add_lane_width(width, 0.0, 0.0, 0.0, opening)
    else:
        made = xodr.Lane(kind, width)
    made.add_roadmark(mark(line))
    return made


def section(s: float, driving: int, *, opening: float = 0.0) -> xodr.LaneSection:
    centre = xodr.Lane()
    centre.add_roadmark(mark("solid"))
    made = xodr.LaneSection(s, centre)
    made.add_left_lane(lane(xodr.LaneType.driving, WIDTH, "solid"))
    made.add_left_lane(lane(xodr.LaneType.shoulder, SHOULDER, "none"))
    for number in range(1, driving + 1):
        last = number == driving
        made.add_right_lane(lane(xodr.LaneType.driving, WIDTH, "solid" if last else "broken",
                                 opening=opening if last else 0.0))  # fmt: skip
    made.add_right_lane(lane(xodr.LaneType.shoulder, SHOULDER, "none"))
    return made


def lanes_of_road_1() -> xodr.Lanes:
    before, after = section(0.0, 2), section(WIDENING, 3, opening=TAPER)
    linker = xodr.LaneLinker()
    for left, right in zip(before.leftlanes, after.leftlanes, strict=True):
        linker.add_link(left, right)
    for old, new in ((0, 0), (1, 1), (2, 3)):
        linker.add_link(before.rightlanes[old], after.rightlanes[new])
    lanes = xodr.Lanes()
    lanes.add_lanesection(before, linker)
    lanes.add_lanesection(after, linker)
    return lanes


def road_1() -> xodr.Road:
    view = xodr.PlanView(0.0, 0.0, 0.0)
    bend = 1.0 / RADIUS
    view.add_geometry(xodr.Line(STRAIGHT))
    view.add_geometry(xodr.Spiral(0.0, bend, length=CLOTHOID))
    view.add_geometry(xodr.Arc(bend, length=ARC))
    view.add_geometry(xodr.Spiral(bend, 0.0, length=CLOTHOID))
    view.add_geometry(xodr.Line(RUNOUT))
    road = xodr.Road(1, view, lanes_of_road_1(), name="proving ground")
    road.add_type(xodr.RoadType.motorway, 0.0, speed=130, speed_unit="km/h")
    road.add_type(xodr.RoadType.motorway, STRAIGHT, speed=100, speed_unit="km/h")
    return road


def road_2() -> xodr.Road:
    view = xodr.PlanView()
    view.add_geometry(xodr.ParamPoly3(0, S_HALF, 0, 0, 0, 0, 0, S_OFFSET))
    view.add_geometry(xodr.ParamPoly3(0, S_HALF, 0, 0, 0, 0, 3 * S_OFFSET, -S_OFFSET))
    lanes = xodr.Lanes()
    lanes.add_lanesection(section(0.0, 3))
    road = xodr.Road(2, view, lanes, name="S of cubics")
    road.add_type(xodr.RoadType.motorway, 0.0, speed=100, speed_unit="km/h")
    return road


def proving_ground() -> bytes:
    """Give the file."""
    first, second = road_1(), road_2()
    first.add_successor(xodr.ElementType.road, 2, xodr.ContactPoint.start)
    second.add_predecessor(xodr.ElementType.road, 1, xodr.ContactPoint.end)
    for road in (first, second):
        road.add_elevation(0.0, 0.0, 0.0, 0.0, 0.0)
    placed = xodr.OpenDrive("proving_ground")
    placed.add_road(first)
    placed.add_road(second)
    placed.adjust_roads_and_lanes()
    return finished("proving_ground", (first, second))


MAPS = {"proving_ground": proving_ground, "motorway": motorway, "urban": urban}
"""By name of the file in networks/."""


def main() -> int:
    for name, made in MAPS.items():
        target = HERE / "networks" / f"{name}.xodr"
        target.write_bytes(made())
        print(target.relative_to(HERE))
    return 0


if __name__ == "__main__":
    sys.exit(main())
