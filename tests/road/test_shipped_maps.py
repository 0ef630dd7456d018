"""The maps that ship: made byte for byte by tools/make_networks.py, without flaws, exact in SUMO."""

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from resim.road.checked import check_map
from resim.road.links import lane_graph
from resim.road.opendrive import load
from resim.road.sumo import sumo_net

ROOT = Path(__file__).parents[2]
NAMES = ("proving_ground", "motorway", "urban")
EXACT = 0.001
"""Distance [m] of the net's centre lines from the map's, as docs/validation.md has it."""


def test_the_maps_are_what_the_tool_makes() -> None:
    words = "import make_networks as n, hashlib; print(*(hashlib.sha256(m()).hexdigest() for m in n.MAPS.values()))"
    made = subprocess.run(
        [sys.executable, "-c", words], cwd=ROOT / "tools", capture_output=True, text=True, check=True
    )
    hashed = [hashlib.sha256((ROOT / "networks" / f"{n}.xodr").read_bytes()).hexdigest() for n in NAMES]
    assert made.stdout.split() == hashed


@pytest.mark.parametrize("name", NAMES)
def test_a_map_has_no_flaw_and_is_exact_in_sumo(name: str) -> None:
    found = check_map(ROOT / "networks" / f"{name}.xodr")
    assert not found.flaws
    assert not found.problems
    assert max(lane.worst for lane in found.net.conversion.lanes) < EXACT


def test_the_motorway_has_ramps_and_curves() -> None:
    net = load(ROOT / "networks" / "motorway.xodr")
    kinds = {lane.type for road in net.roads.values() for s in road.sections for lane in s.lanes.values()}
    assert kinds >= {"driving", "entry", "exit", "onRamp", "offRamp", "shoulder", "median"}
    shapes = {g.kind for road in net.roads.values() for g in road.geometries}
    assert shapes == {"line", "spiral", "arc"}
    graph = lane_graph(net)
    onto = [key for key in graph if key.road == "4" and key.lane == -1]
    assert [str(after) for key in onto for after in graph[key]] == ["road 102 section 0 lane -1"]


def test_the_town_has_lights_signs_and_a_parking_lane() -> None:
    net = load(ROOT / "networks" / "urban.xodr")
    signals = [signal.kind for road in net.roads.values() for signal in road.signals]
    assert sorted(filter(None, signals)) == ["light"] * 4 + ["priority"] * 2 + ["stop"]
    rules = sumo_net(net).conversion.rules
    assert not rules.left_out
    assert net.roads["1"].sections[0].lanes[-3].type == "parking"
    crosswalks = (ROOT / "networks" / "urban.xodr").read_text().count('type="crosswalk"')
    assert crosswalks == 6


@pytest.mark.parametrize("name", ["motorway", "urban"])
def test_linked_roads_go_on_without_a_bend(name: str) -> None:
    net = load(ROOT / "networks" / f"{name}.xodr")
    for one, after in lane_graph(net).items():
        for other in after:
            if (
                not net.roads[one.road].sections[one.section].lanes[one.lane].drivable
                or one.road == other.road
            ):
                continue
            ends = [_end(net, key, leaving) for key, leaving in ((one, True), (other, False))]
            assert np.hypot(*(ends[0][:2] - ends[1][:2])) < 1e-6, (one, other)
            assert abs(np.angle(np.exp(1j * (ends[0][2] - ends[1][2])))) < 1e-6, (one, other)


def _end(net, key, leaving: bool) -> np.ndarray:
    road = net.roads[key.road]
    s = road.length if road.along(key.lane, key.section) == leaving else 0.0
    x, y = net.to_xy(key.road, key.lane, s, 0.0)
    return np.array([float(x), float(y), float(net.lane_heading(key.road, key.lane, s))])
