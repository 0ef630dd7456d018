"""Ways through the junctions of a map, read from the file's own links."""

from __future__ import annotations

import numpy as np
from lxml import etree


def turns(net):
    """Every way through a junction as the file has it: lanes (road, id) before, on and after a connecting road."""
    root = etree.parse(str(net.path)).getroot()
    roads = {road.get("id"): road for road in root.iter("road")}

    def linked(road, tag):
        found = road.find(f"link/{tag}")
        return None if found is None or found.get("elementType") != "road" else tuple(map(found.get, LINK))

    LINK = ("elementId", "contactPoint")
    for road in roads.values():
        before, after = linked(road, "predecessor"), linked(road, "successor")
        if road.get("junction") == "-1" or before is None or after is None or before[0] == after[0]:
            continue
        if len(road.findall("lanes/laneSection")) > 1 or roads[before[0]].get("junction") != "-1" or (
            roads[after[0]].get("junction") != "-1"
        ):  # fmt: skip
            continue
        for lane in road.iterfind("lanes/laneSection/right/lane"):
            one, two = lane.find("link/predecessor"), lane.find("link/successor")
            if lane.get("type") == "driving" and one is not None and two is not None:
                yield (
                    (before, int(one.get("id"))),
                    (road.get("id"), int(lane.get("id"))),
                    (after, int(two.get("id"))),
                )


def driven(net, turn, far=40.0):
    """Positions and headings along the lanes' centres, 1 m apart, from before the junction to behind it."""
    (before, lane0), (inside, lane1), (after, lane2) = turn
    out = []
    for (name, contact), lane, comes in ((before, lane0, True), (after, lane2, False)):
        road = net.roads[name]
        run = np.arange(0.5, min(far, road.length - 0.5))
        s = road.length - run if contact == "end" else run
        s = s[::-1] if comes else s
        x, y = net.to_xy(name, lane, s, 0.0)
        out.append((x, y, np.resize(net.lane_heading(name, lane, s), len(x))))
    s = np.arange(0.5, net.roads[inside].length)
    x, y = net.to_xy(inside, lane1, s, 0.0)
    out.insert(1, (x, y, net.lane_heading(inside, lane1, s)))
    return np.concatenate(out, axis=1)
