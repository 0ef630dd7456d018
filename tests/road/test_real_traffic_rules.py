"""Traffic lights and signs of real maps in their SUMO nets, counted here on the files themselves."""

from __future__ import annotations

from collections import defaultdict
from itertools import combinations

import numpy as np
import pytest
from lxml import etree
from road.crossing import read, signal

from resim.road.opendrive import load
from resim.road.sumo import sumo_net


@pytest.fixture(scope="module")
def real_net(shared_map, tmp_path_factory):
    nets = tmp_path_factory.mktemp("nets")
    return lambda name: (shared_map(name), sumo_net(shared_map(name), cache=nets))


def passed(converted):
    """For each connection of the net that is not internal: the traffic light, the lanes before and those inside."""
    root = etree.parse(str(converted.path)).getroot()
    origin = {
        lane.get("id"): [place.rsplit("_", 2) for place in lane.find("param").get("value").split()]
        for lane in root.iter("lane") if lane.find("param") is not None
    }  # fmt: skip
    for each in root.iterfind("connection"):
        if not each.get("from").startswith(":"):
            before = origin[f"{each.get('from')}_{each.get('fromLane')}"]
            yield each.get("tl"), before, origin.get(each.get("via"), [])


@pytest.mark.slow
def test_the_lights_of_town04_rule_the_lanes_that_the_file_names(real_net):
    """Counted here on the file: each lane of a road in a junction to which a reference to a light is."""
    network, converted = real_net("xodr/carla/Town04.xodr")
    lit = {
        (road.get("id"), validity.get("fromLane"))
        for road in etree.parse(str(network.path)).getroot().iter("road")
        for each in road.iterfind("signals/signalReference") for validity in each.iterfind("validity")
    }  # fmt: skip
    found = {True: set(), False: set()}
    for light, _, inside in passed(converted):
        found[light is not None] |= {(road, number) for road, _, number in inside}
    assert found[True] == lit
    assert not lit & found[False]
    rules = converted.conversion.rules
    assert (rules.lights, len(rules.programs), rules.left_out) == (43, 12, ())
    assert sum(len(program.controllers) for program in rules.programs) == 43


@pytest.mark.parametrize(
    ("name", "lights"), [("mcity/mcity.xodr", 38), ("ngsim/USA_Lanker-1_17_T-1.xodr", 3)]
)
def test_lights_before_a_junction_rule_the_ways_from_their_lanes(real_net, name, lights):
    network, converted = real_net(name)
    lit = defaultdict(set)
    for each in etree.parse(str(network.path)).getroot().iter("signal"):
        if each.get("type") in ("1000001", "1000011"):
            named = {v.get("fromLane") for v in each.iterfind("validity")}
            lit[each.getparent().getparent().get("id")] |= named or {str(number) for number in range(-9, 0)}
    wrong = [
        before for light, before, inside in passed(converted)
        if inside and network.roads[before[0][0]].sections[0].lanes[int(before[0][2])].type == "driving"
        and (light is not None) != (before[0][2] in lit[before[0][0]])
    ]  # fmt: skip
    assert wrong == []
    assert converted.conversion.rules.lights == lights


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("xodr/carla/Town04.xodr", marks=pytest.mark.slow),
        "mcity/mcity.xodr",
        "ngsim/USA_Lanker-1_17_T-1.xodr",
    ],
)
def test_no_two_ways_that_cross_are_green_without_one_that_gives_way(real_net, name):
    net = read(real_net(name)[1])
    assert net.getTrafficLights()
    for light in net.getTrafficLights():
        node, ways = net.getNode(light.getID()), defaultdict(list)
        for origin, target, index in light.getConnections():
            ways[index] += [c for c in origin.getOutgoing() if c.getToLane() == target]
        (program,) = light.getPrograms().values()
        for phase in program.getPhases():
            free = [way for index, own in ways.items() if phase.state[index] == "G" for way in own]
            for one, other in combinations(free, 2):
                assert not node.areFoes(node.getLinkIndex(one), node.getLinkIndex(other)), (
                    light.getID(),
                    phase,
                )
        assert all(any(phase.state[k] in "gG" for phase in program.getPhases()) for k in ways)


def test_nobody_passes_red_in_town04(real_net, started_sumo):
    _, converted = real_net("xodr/carla/Town04.xodr")
    net = read(converted)
    assert_all_obey(net, started_sumo(converted.simulated))


def assert_all_obey(net, libsumo):
    """Send a vehicle over every way with a light; who enters has no red, and some had to wait."""
    ways = [c for light in net.getTrafficLights() for c in light.getConnections()]
    index = {}
    for k, (origin, target, link) in enumerate(ways):
        edges = origin.getEdge().getID(), target.getEdge().getID()
        libsumo.route.add(str(k), edges)
        libsumo.vehicle.add(str(k), str(k), departLane=str(origin.getIndex()), departPos="base")
        index[str(k)] = (
            origin.getEdge().getID(),
            net.getNode(origin.getEdge().getToNode().getID()).getID(),
            link,
        )
    waited, entered, before = set(), set(), {}
    for _ in range(2000):
        seen = {
            light: libsumo.trafficlight.getRedYellowGreenState(light)
            for light in libsumo.trafficlight.getIDList()
        }
        libsumo.simulationStep()
        for name in libsumo.vehicle.getIDList():
            here = libsumo.vehicle.getRoadID(name)
            edge, light, link = index[name]
            if before.get(name) == edge and here.startswith(":"):
                now = libsumo.trafficlight.getRedYellowGreenState(light)
                assert {seen[light][link], now[link]} & set("gGy"), (name, light)
                entered.add(name)
            if here == edge and libsumo.vehicle.getSpeed(name) < 0.1:
                waited.add(name)
            before[name] = here
    assert entered == set(index)
    assert len(waited) > len(index) // 4


def test_signs_put_on_a_real_junction_hold_on_all_its_ways(real_net, shared_map, tmp_path):
    """esmini's crossing of four roads: a stop sign on one, give way on its opposite; the others go first."""
    root = etree.parse(str(shared_map("xodr/esmini/fabriksgatan.xodr").path)).getroot()
    for name, kind, s in (("2", 206, 300.0), ("3", 205, 110.0)):
        arm = next(each for each in root.iter("road") if each.get("id") == name)
        arm.append(etree.fromstring(f"<signals>{signal(name, kind, s=s)}</signals>"))
    path = tmp_path / "signed.xodr"
    path.write_bytes(etree.tostring(root))
    net = read(sumo_net(load(path), cache=tmp_path / "nets"))
    node = net.getNode("4.junction")
    edges = [edge for edge in node.getIncoming() if edge.getFunction() == ""]
    ways = [c for edge in edges for own in edge.getOutgoing().values() for c in own]
    ways = [c for c in ways if c.getFromLane().allows("passenger")]
    signed = [c for c in ways if c.getFrom().getID().startswith(("2.", "3."))]
    others = [c for c in ways if c not in signed]
    assert (len(signed), len(others)) == (6, 6)
    crossing = [
        (a, b) for a in signed for b in others if node.areFoes(node.getLinkIndex(a), node.getLinkIndex(b))
    ]
    assert crossing
    assert all(node.forbids(b, a) and not node.forbids(a, b) for a, b in crossing)
    assert {c.getState() for c in signed if c.getFrom().getID().startswith("2.")} == {"s"}


@pytest.mark.parametrize(
    "name", ["xodr/esmini/fabriksgatan.xodr", "xodr/edge_cases/sumo_connections_4arm.xodr"]
)
@pytest.mark.parametrize("seed", range(3))
def test_drawn_priorities_hold(shared_map, tmp_path, name, seed):
    """Which way goes over which road is read from the net; that of two opposite priorities the first holds is known."""
    root = etree.parse(str(shared_map(name).path)).getroot()
    junction = next(root.iter("junction"))
    inner = [each.get("id") for each in root.iter("road") if each.get("junction") == junction.get("id")]
    drawn = [
        tuple(pair) for pair in np.random.default_rng(seed).permuted([inner] * 12, axis=1)[:, :2].tolist()
    ]
    pairs = [pair for k, pair in enumerate(drawn) if pair[::-1] not in drawn[:k]]
    for high, low in pairs:
        etree.SubElement(junction, "priority", high=high, low=low)
    path = tmp_path / "drawn.xodr"
    path.write_bytes(etree.tostring(root))
    net = read(sumo_net(load(path), cache=tmp_path / "nets"))
    over = defaultdict(list)
    for edge in net.getEdges(withInternal=False):
        for way in (c for own in edge.getOutgoing().values() for c in own if c.getViaLaneID()):
            for place in net.getLane(way.getViaLaneID()).getParam("origId", "").split():
                over[place.rsplit("_", 2)[0]].append(way)
    assert judged(over, pairs) > 0


def judged(over, pairs):
    """How many pairs of ways that cross are in the order of the priorities: all, or this fails."""
    count = 0
    for high, low in pairs:
        for one, other in ((one, other) for one in over[high] for other in over[low]):
            node = one.getFrom().getToNode()
            if node.areFoes(node.getLinkIndex(one), node.getLinkIndex(other)):
                assert node.forbids(one, other), (high, low)
                assert not node.forbids(other, one), (high, low)
                count += 1
    return count
