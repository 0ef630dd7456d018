"""Traffic lights, signs and priorities of a cross in its SUMO net: as sumolib reads it, and as vehicles obey it."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
import pytest
from lxml import etree
from road.crossing import LIGHTS, NODE, WAYS, controller, cross, light, read, signal

from resim.road.opendrive.signals import kind_of
from resim.road.sumo import sumo_net


@pytest.fixture
def made(written, tmp_path):
    def make(**parts):
        return sumo_net(written(*cross(**parts)), cache=tmp_path / "nets")

    return make


def connection(net, side):
    origin, target = WAYS[side]
    (found,) = net.getEdge(origin).getConnections(net.getEdge(target))
    return found


def states(net):
    return "".join(connection(net, side).getState() for side in "wesn")


def goes_before(net, one, other):
    """Whether the second of two ways must let the first go, and the first not the second."""
    node = net.getNode(NODE)
    first, second = (connection(net, side) for side in (one, other))
    return node.forbids(first, second) and not node.forbids(second, first)


def why(converted):
    return {(left.kind, left.id): left.why for left in converted.conversion.rules.left_out}


@pytest.fixture
def drive(started_sumo):
    """Drives vehicles from sides of the cross; gives when each comes into the junction, and its lowest speed."""

    def run(converted, sides, *, until=100.0):
        libsumo = started_sumo(converted.simulated)
        libsumo.vehicletype.setSpeedDeviation("DEFAULT_VEHTYPE", 0.0)
        for side in sides:
            libsumo.route.add(side, WAYS[side])
            libsumo.vehicle.add(side, side, departSpeed="10", departPos="5")
        entered, slowest = {}, defaultdict(lambda: np.inf)
        while libsumo.simulation.getTime() < until:
            libsumo.simulationStep()
            for side in libsumo.vehicle.getIDList():
                slowest[side] = min(slowest[side], libsumo.vehicle.getSpeed(side))
                if libsumo.vehicle.getRoadID(side).startswith(":"):
                    entered.setdefault(side, libsumo.simulation.getTime())
        return entered, slowest

    return run


MINOR = {
    "give way on W": ({"W": signal("x", 205)}, "s", "w"),
    "give way on S": ({"S": signal("x", 205)}, "w", "s"),
    "stop on W": ({"W": signal("x", 206)}, "s", "w"),
    "stop on S": ({"S": signal("x", 206)}, "w", "s"),
    "priority road S": ({"S": signal("x", 306)}, "s", "w"),
    "priority road W": ({"W": signal("x", "52.25a", country="AUT")}, "w", "s"),
    "a sign for the lane named": (
        {"W": signal("x", 205, orientation="-", inside='<validity fromLane="-1" toLane="-1"/>')}, "s", "w",
    ),
    "a sign within the junction": ({"inside": signal("x", 205, s=1.0)}, "s", "w"),
    "a sign elsewhere, referred to": (
        {"E": signal("x", 205), "W": '<signalReference id="x" s="85" t="0" orientation="+"/>'}, "s", "w",
    ),
    "priority sn": ({"junction": '<priority high="sn" low="we"/>'}, "s", "w"),
    "priority we": ({"junction": '<priority high="we" low="sn"/>'}, "w", "s"),
    "of two that contradict the first": (
        {"junction": '<priority high="sn" low="we"/><priority high="we" low="sn"/>'}, "s", "w",
    ),
    "priority before signs": (
        {"W": signal("x", 306), "S": signal("y", 205), "junction": '<priority high="sn" low="we"/>'}, "s", "w",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", MINOR)
def test_who_goes_first(made, drive, case):
    parts, first, second = MINOR[case]
    converted = made(**parts)
    assert goes_before(read(converted), first, second)
    entered, _ = drive(converted, [first, second])
    assert entered[first] < entered[second]


def test_vehicles_stop_at_a_stop_sign_and_not_where_they_only_give_way(made, drive):
    def signed(kind):
        return made(W=signal("x", kind), E=signal("y", kind, s=2, orientation="-"))

    stop, yields = signed(206), signed(205)
    assert (states(read(stop)), states(read(yields))) == ("ssMM", "mmMM")
    assert drive(stop, ["w"])[1]["w"] < 0.1
    assert drive(yields, ["w"])[1]["w"] > 1.0


ALL_STOP = {
    name: signal(name, 206, s=s, orientation=facing)
    for name, s, facing in (("W", 88, "+"), ("S", 88, "+"), ("E", 2, "-"), ("N", 2, "-"))
}


def test_where_all_stop_the_first_to_come_goes_first(made, drive):
    converted = made(**ALL_STOP)
    assert read(converted).getNode(NODE).getType() == "allway_stop"
    slowest = drive(converted, ["w", "s"])[1]
    assert max(slowest.values()) < 0.1


@pytest.mark.parametrize(("first", "high", "second", "low"), [("w", "we", "s", "sn"), ("s", "sn", "w", "we")])
def test_where_all_stop_a_priority_holds_all_the_same(made, first, high, second, low):
    net = read(made(**ALL_STOP, junction=f'<priority high="{high}" low="{low}"/>'))
    assert states(net) == "ssss"
    assert goes_before(net, first, second)


def test_lights_without_controllers_have_the_program_of_netconvert(made):
    converted = made(**LIGHTS)
    rules = converted.conversion.rules
    assert (rules.lights, rules.left_out) == (4, ())
    (program,) = rules.programs
    assert (program.id, program.connections, program.controllers) == (NODE, 4, ())
    assert program.remark == "no controller switches its lights"
    assert green(read(converted)) == [{"w", "e"}, {"s", "n"}] or green(read(converted)) == [
        {"s", "n"}, {"w", "e"},
    ]  # fmt: skip


def green(net):
    """The sides that have green, phase by phase, without those of yellow."""
    (light,) = net.getTrafficLights()
    (program,) = light.getPrograms().values()
    index = {side: connection(net, side).getTLLinkIndex() for side in WAYS}
    return [
        {side for side, k in index.items() if phase.state[k] in "gG"}
        for phase in program.getPhases() if "y" not in phase.state
    ]  # fmt: skip


def test_controllers_are_green_in_turn_in_the_order_of_the_junction(made):
    three = (
        controller("A", "ls") + controller("B", "ln", sequence=1) + controller("C", "lw", "le", sequence=2)
    )
    named = "".join(f'<controller id="{name}" sequence="{k}"/>' for k, name in enumerate("CAB"))
    converted = made(**LIGHTS, controllers=three, junction=named)
    assert converted.conversion.rules.programs[0].controllers == ("C", "A", "B")
    assert green(read(converted)) == [{"w", "e"}, {"s"}, {"n"}]
    own = made(**LIGHTS, controllers=three)
    assert green(read(own)) == [{"s"}, {"n"}, {"w", "e"}]


def test_controllers_that_switch_all_lights_make_no_program(made):
    rules = made(
        **LIGHTS, controllers=controller("A", "lw") + controller("B", "lw", "le", "ls", "ln")
    ).conversion.rules
    assert rules.programs[0].controllers == ()
    assert rules.programs[0].remark == "controller B switches all its lights"


def test_lights_without_a_controller_leave_the_program_to_netconvert(made):
    rules = made(**LIGHTS, controllers=controller("A", "lw") + controller("B", "le", "ls")).conversion.rules
    assert rules.programs[0].controllers == ()
    assert rules.programs[0].remark == "no controller switches its lights ln"


def test_two_controllers_give_what_netconvert_gives(made):
    """Its own program for this cross is one of the two that are right, letter by letter."""

    def phases(converted):
        (light,) = read(converted).getTrafficLights()
        (program,) = light.getPrograms().values()
        return {(phase.duration, phase.state) for phase in program.getPhases()}

    both = controller("A", "lw", "le") + controller("B", "ls", "ln")
    assert phases(made(**LIGHTS, controllers=both)) == phases(made(**LIGHTS))


def test_vehicles_wait_at_red(made, drive):
    both = controller("A", "lw", "le") + controller("B", "ls", "ln", sequence=1)
    entered, slowest = drive(made(**LIGHTS, controllers=both), "wesn")
    assert max(entered["w"], entered["e"]) < 15.0
    assert min(slowest["w"], slowest["e"]) > 9.9
    assert min(entered["s"], entered["n"]) > 45.0
    assert max(slowest["s"], slowest["n"]) < 0.1


def test_ways_without_a_light_of_their_own_give_way_to_those_with(made):
    converted = made(W=light("lw"))
    net = read(converted)
    assert net.getNode(NODE).getType() == "traffic_light"
    assert [connection(net, side).getTLSID() for side in "wesn"] == [NODE, "", "", ""]
    assert goes_before(net, "w", "s")
    assert goes_before(net, "w", "n")


LEFT_OUT = {
    "a sign that nobody knows": ({"W": signal("x", 999)}, ("sign", "x"), "not known as a light or sign"),
    "a light for pedestrians": ({"W": signal("x", 1000002)}, ("sign", "x"), "not known as a light or sign"),
    "a sign far away": ({"W": signal("x", 205, s=30)}, ("sign", "x"), "no junction follows within 50 m"),
    "a sign where no junction follows": (
        {"W": signal("x", 205, s=2, orientation="-")}, ("sign", "x"), "no junction follows, or no way",
    ),
    "a light for no lane": (
        {"W": light("x", inside='<validity fromLane="0" toLane="0"/>')}, ("traffic light", "x"), "no lane of vehicles",
    ),
    "a sign without a place": ({"W": signal("x", 205, s="far")}, ("sign", "x"), "s='far'"),
    "a sign that faces nowhere": ({"W": signal("x", 205, orientation="up")}, ("sign", "x"), "orientation='up'"),
    "a reference to nothing": (
        {"W": '<signalReference id="x" s="85" t="0" orientation="+"/>'}, ("sign", "x"), "is not in the map",
    ),
    "a sign at a traffic light": (
        {"W": light("l") + signal("x", 205)}, ("sign", "x"), "traffic lights rule its junction",
    ),
    "a priority at a traffic light": (
        {"W": light("l"), "junction": '<priority high="we" low="sn"/>'},
        ("priority", "junction 9: we before sn"), "traffic lights rule their junction",
    ),
    "a speed that no sign shows": ({"W": signal("x", 274)}, ("speed sign", "x"), "no speed that a sign can show"),
    "a controller of nothing": ({"controllers": controller("c")}, ("controller", "c"), "names no signal"),
    "a controller of a sign": (
        {"W": signal("x", 205), "controllers": controller("c", "x")}, ("controller", "c"), "no traffic light",
    ),
    "a priority of ways that do not meet": (
        {"junction": '<priority high="we" low="ew"/>'}, ("priority", "junction 9: we before ew"), "do not meet",
    ),
    "a priority of no road": (
        {"junction": '<priority high="we" low="?"/>'}, ("priority", "junction 9: we before ?"), "leads over road ?",
    ),
    "a priority that contradicts": (
        {"junction": '<priority high="we" low="sn"/><priority high="sn" low="we"/>'},
        ("priority", "junction 9: sn before we"), "another priority says the opposite",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", LEFT_OUT)
def test_what_is_left_out_and_why(made, case):
    parts, name, reason = LEFT_OUT[case]
    assert reason in why(made(**parts))[name]


def test_what_is_taken_over_is_counted(made):
    limit = speed_sign("v", 30, s=10.0)
    priority = '<priority high="we" low="sn"/>'
    rules = made(W=signal("x", 306) + limit, S=signal("y", 206), junction=priority).conversion.rules
    assert (rules.lights, rules.signs, rules.speed_signs, rules.priorities, rules.left_out) == (
        0,
        2,
        1,
        1,
        (),
    )


def speed_sign(name, value, **place):
    return signal(name, 274, **place).replace("<signal ", f'<signal value="{value}" ')


def test_the_speed_sign_that_holds_in_the_middle_of_an_edge_is_its_limit(made):
    """Each road of the cross is one edge each way, with its middle at s = 45 m."""
    signs = [speed_sign("a", 30, s=10), speed_sign("b", 70, s=20), speed_sign("c", 80, s=80)]
    signs += [speed_sign("d", 20, s=60, orientation="-"), speed_sign("e", 10, s=70, orientation="-")]
    converted = made(W="".join(signs))
    net = read(converted)
    assert [net.getEdge(name).getSpeed() for name in ("W.0", "-W.0")] == pytest.approx([70 / 3.6, 20 / 3.6])
    reason = "it holds in the middle of no edge"
    assert why(converted) == {("speed sign", name): reason for name in "ace"}
    assert converted.conversion.rules.speed_signs == 2


def test_rules_move_no_lane(made):
    """Where vehicles may wait halfway is another matter: a traffic light has more such places."""

    def lanes(converted):
        root = etree.parse(str(converted.path)).getroot()
        return {lane.get("id"): dict(lane.attrib) for lane in root.iter("lane")}

    plain = lanes(made())
    assert lanes(made(**LIGHTS)) == plain
    assert lanes(made(W=signal("x", 206), junction='<priority high="sn" low="we"/>')) == plain


@pytest.mark.parametrize(
    ("attributes", "kind"),
    [
        ('type="1000001" country="OpenDRIVE"', "light"),
        ('type="1000011" subtype="30"', "light"),
        ('type="206" country="DE"', "stop"),
        ('type="206" country="OpenDRIVE"', "stop"),
        ('type="206" country="NO"', "priority"),
        ('type="B2" country="SWE"', "stop"),
        ('type="R1-1" country="US"', "stop"),
        ('type="206" country="US"', None),
        ('type="Yield"', "give way"),
        ('type="1000002"', None),
        ("", None),
    ],
)
def test_kinds_of_signals(attributes, kind):
    assert kind_of(etree.fromstring(f"<signal {attributes}/>")) == kind
