"""Times positions to lanes and back, projections on a path, and conversion: python tools/bench/road.py [map.xodr ...].

conversion_ratio: our net, measured lane by lane, against netconvert's own import of the map, which is not.

Prints a table, and as the last line a JSON object with its figures.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from resim.road.opendrive import RoadNetwork, load
from resim.road.path import lane_path
from resim.road.sumo import sumo_net
from resim.road.sumo.netconvert import run_netconvert

HERE = Path(__file__).resolve().parents[2]
MAPS = [HERE / "networks" / "proving_ground.xodr", HERE.parent / "shared/data/xodr/carla/Town04.xodr"]
POINTS, STEP_POINTS = 100_000, 6


def best(call: Callable[[], object], repeat: int = 5, number: int = 1) -> float:
    """Give the shortest time [s] of one call."""
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        for _ in range(number):
            call()
        times.append((time.perf_counter() - start) / number)
    return min(times)


def places(net: RoadNetwork) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Give POINTS random places on driving lanes: road, lane, s, t."""
    rng = np.random.default_rng(1)
    lanes = [
        (road.id, lane.id, section.start, min(section.end, road.length))
        for road in net.roads.values()
        for section in road.sections
        for lane in section.lanes.values()
        if lane.drivable and lane.id and section.start < min(section.end, road.length)
    ]
    pick = rng.integers(0, len(lanes), POINTS)
    road, lane, start, end = (np.array([entry[k] for entry in lanes])[pick] for k in range(4))
    s = start + rng.random(POINTS) * (end - start) * (1.0 - 1e-9)
    return road, lane, s, 0.9 * (rng.random(POINTS) - 0.5) * net.lane_width(road, lane, s)


def measure(path: Path) -> dict[str, float]:
    start = time.perf_counter()
    net = load(path)
    net.to_road(0.0, 0.0)
    ready = time.perf_counter() - start
    place = places(net)
    x, y = net.to_xy(*place)
    found = net.to_road(x, y)
    x2, y2 = net.to_xy(found.road, found.lane, found.s, found.t)
    way = lane_path(net, str(place[0][0]), int(place[1][0]), float(place[2][0]), 800.0)
    near_x, near_y = way.xy(np.linspace(0.0, 200.0, STEP_POINTS), np.linspace(-4.0, 4.0, STEP_POINTS))
    return {
        "load_and_index_s": ready,
        "to_xy_points_per_s": POINTS / best(lambda: net.to_xy(*place)),
        "to_road_points_per_s": POINTS / best(lambda: net.to_road(x, y), repeat=3),
        "round_trip_max_m": float(np.hypot(x2 - x, y2 - y).max()),
        "project_6_points_us": 1e6 * best(lambda: way.project(near_x, near_y), number=2000),
        "at_us": 1e6 * best(lambda: way.at(33.3), number=2000),
        "lane_path_850_m_ms": 1e3
        * best(lambda: lane_path(net, str(place[0][0]), int(place[1][0]), float(place[2][0]), 800.0)),
    }


def conversion(path: Path) -> dict[str, float]:
    """Time the conversion, the cache, and netconvert's own import, once each."""
    net = load(path)
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        converted = sumo_net(net, cache=Path(folder))
        middle = time.perf_counter()
        sumo_net(net, cache=Path(folder))
        again = time.perf_counter()
        run_netconvert(path, ["--opendrive-files", str(path)], Path(folder) / "own.net.xml", time_limit=120.0)
        end = time.perf_counter()
        return {
            "convert_s": middle - begin,
            "convert_again_ms": 1e3 * (again - middle),
            "conversion_ratio": (middle - begin) / (end - again),
            "worst_lane_mm": 1e3 * converted.conversion.worst,
        }


def main(arguments: list[str]) -> int:
    maps = [Path(a) for a in arguments] or [path for path in MAPS if path.is_file()]
    figures = {path.stem: measure(path) | conversion(path) for path in maps}
    width = max(len(name) for name in figures)
    for name, row in figures.items():
        for key, value in row.items():
            print(f"{name:{width}}  {key:22} {value:14.4g}")
    print(json.dumps(figures))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
