"""Which lane goes on into which, and what becomes of it in the SUMO net: small maps with one trap each."""

from __future__ import annotations

import numpy as np
import pytest
from lxml import etree
from road.small_maps import lane, road, section

from resim.road.flaws import flaws
from resim.road.links import LaneKey, inner_roads, lane_graph, passed_lanes, ways
from resim.road.sumo import sumo_net


def connected(net):
    """(road, lane) pairs that the SUMO net joins, by `origId`."""
    root = etree.parse(str(net.path)).getroot()
    names = {}
    for each in root.iter("lane"):
        if (param := each.find("param[@key='origId']")) is not None:
            first, number = param.get("value").split()[0].rsplit("_", 1)
            names[each.get("id")] = (first.rsplit("_", 1)[0], int(number))
    return {
        (names[f"{c.get('from')}_{c.get('fromLane')}"], names[f"{c.get('to')}_{c.get('toLane')}"])
        for c in root.iterfind("connection") if not c.get("from").startswith(":")
    }  # fmt: skip


def simple(*numbers, **links):
    return section(*((n, lane(n, **links)) for n in numbers))


def test_links_count_from_either_side(written):
    net = written(
        road("a", 0, 0, 0, 50, section((-1, lane(-1, after=-1))), after="road:b:start"),
        road("b", 50, 0, 0, 50, section((-1, lane(-1)), (-2, lane(-2, before=-1)))),
    )
    graph = lane_graph(net)
    assert graph[LaneKey("a", 0, -1)] == (LaneKey("b", 0, -1),)
    net = written(
        road("a", 0, 0, 0, 50, simple(-1)),
        road("b", 50, 0, 0, 50, simple(-1, before=-1), before="road:a:end"),
    )
    assert lane_graph(net)[LaneKey("a", 0, -1)] == (LaneKey("b", 0, -1),)


def test_two_roads_that_merge_into_one_without_a_junction_are_joined(written, tmp_path):
    net = written(
        road("a", 0, 0, 0, 50, section((-1, lane(-1, after=-1))), after="road:c:start"),
        road("b", 0, -3.5, 0, 50, section((-1, lane(-1, after=-2))), after="road:c:start"),
        road("c", 50, 0, 0, 50, simple(-1, -2)),
    )
    converted = sumo_net(net, cache=tmp_path)
    assert connected(converted) == {(("a", -1), ("c", -1)), (("b", -1), ("c", -2))}
    assert converted.conversion.bad == ()


def test_left_lanes_and_roads_that_meet_with_equal_ends(written, tmp_path):
    net = written(
        road("a", 0, 0, 0, 50, section((1, lane(1, after=-1)), (-1, lane(-1, after=1))), after="road:b:end"),
        road(
            "b",
            100,
            0,
            np.pi,
            50,
            section((1, lane(1, after=-1)), (-1, lane(-1, after=1))),
            after="road:a:end",
        ),
    )
    assert connected(sumo_net(net, cache=tmp_path)) == {(("a", -1), ("b", 1)), (("b", -1), ("a", 1))}


def test_left_hand_traffic_goes_the_other_way(written, tmp_path):
    lhs = 'rule="LHT"'
    net = written(
        road(
            "a",
            0,
            0,
            0,
            50,
            section((1, lane(1, after=1)), (-1, lane(-1, after=-1))),
            after="road:b:start",
            rule=lhs,
        ),
        road("b", 50, 0, 0, 50, simple(1, -1), before="road:a:end", rule=lhs),
    )
    assert connected(sumo_net(net, cache=tmp_path)) == {(("a", 1), ("b", 1)), (("b", -1), ("a", -1))}


def test_a_reversed_lane_is_driven_against_its_side(written, tmp_path):
    way = section((-1, lane(-1, after=-1)), (-2, lane(-2, after=-2, extra='direction="reversed"')))
    net = written(
        road("a", 0, 0, 0, 50, way, after="road:b:start"), road("b", 50, 0, 0, 50, way, before="road:a:end")
    )
    assert connected(sumo_net(net, cache=tmp_path)) == {(("a", -1), ("b", -1)), (("b", -2), ("a", -2))}


def junction(*connections, kind=""):
    text = "".join(
        f'<connection id="{i}" incomingRoad="{incoming}" {name}="{other}" contactPoint="{contact}">'
        + "".join(f'<laneLink from="{a}" to="{b}"/>' for a, b in links) + "</connection>"
        for i, (incoming, name, other, contact, links) in enumerate(connections)
    )  # fmt: skip
    return f'<junction id="j" {kind}>{text}</junction>'


def crossing(*, leads_on=True):
    after = "road:b:start" if leads_on else ""
    return (
        road("a", 0, 0, 0, 50, simple(-1), after="junction:j"),
        road("w", 50, 0, 0, 20, section((-1, lane(-1, before=-1, after=-1 if leads_on else None))),
             before="road:a:end", after=after, junction="j"),
        road("b", 70, 0, 0, 50, simple(-1), before="junction:j"),
        junction(("a", "connectingRoad", "w", "start", [(-1, -1)])),
    )  # fmt: skip


def test_a_junction_lane_has_its_exact_shape(written, tmp_path):
    net = written(*crossing())
    graph = lane_graph(net)
    inner = inner_roads(net, passed_lanes(net, graph))
    assert inner == {"w"}
    assert list(ways(graph, LaneKey("a", 0, -1), inner)) == [(LaneKey("w", 0, -1), LaneKey("b", 0, -1))]
    converted = sumo_net(net, cache=tmp_path)
    lanes = {e.get("id"): e for e in etree.parse(str(converted.path)).getroot().iter("lane")}
    (name,) = converted.lanes["w", 0, -1]
    assert name.startswith(":")
    assert lanes[name].get("shape") == "50.000000,-1.750000 70.000000,-1.750000"
    assert float(lanes[name].get("length")) == pytest.approx(20.0)


def test_a_junction_road_that_leads_nowhere_is_an_edge(written, tmp_path):
    converted = sumo_net(written(*crossing(leads_on=False)), cache=tmp_path)
    assert not converted.lanes["w", 0, -1][0].startswith(":")
    assert connected(converted) == {(("a", -1), ("w", -1))}
    assert converted.conversion.bad == ()


def test_direct_junctions_join_roads(written, tmp_path):
    net = written(
        road("a", 0, 0, 0, 50, simple(-1, -2), after="junction:j"),
        road("b", 50, 0, 0, 50, simple(-1), before="junction:j"),
        road("c", 50, -3.5, 0, 50, simple(-1), before="junction:j"),
        junction(("a", "linkedRoad", "b", "start", [(-1, -1)]), ("a", "linkedRoad", "c", "start", [(-2, -1)]),
                 kind='type="direct"'),
    )  # fmt: skip
    assert connected(sumo_net(net, cache=tmp_path)) == {(("a", -1), ("b", -1)), (("a", -2), ("c", -1))}


def test_a_loop_gets_two_edges(written, tmp_path):
    ring = (
        f'<road id="ring" length="{200 * np.pi}" junction="-1"><link><predecessor elementType="road" elementId="ring" '
        'contactPoint="end"/><successor elementType="road" elementId="ring" contactPoint="start"/></link><planView>'
        f'<geometry s="0" x="0" y="0" hdg="0" length="{20 * np.pi}"><arc curvature="0.1"/></geometry></planView><lanes>'
        f"{simple(-1, before=-1, after=-1)}</lanes></road>"
    )
    converted = sumo_net(written(ring), cache=tmp_path)
    assert len(converted.lanes["ring", 0, -1]) == 2
    assert converted.conversion.connections == 2
    assert converted.conversion.worst < 0.001


def test_gaps_between_linked_lanes_are_told(written, tmp_path):
    net = written(
        road("a", 0, 0, 0, 50, section((-1, lane(-1, after=-1))), after="road:b:start"),
        road("b", 50, 2.0, 0, 50, simple(-1), before="road:a:end"),
    )
    (jump,) = sumo_net(net, cache=tmp_path).conversion.jumps
    assert (jump.gap, jump.x, jump.y) == (pytest.approx(2.0), 50.0, -1.75)


@pytest.mark.parametrize("names", [("a b", "a&amp;b"), ("1.2", "1_2"), ("_1", "#"), ("-1", "1"), (":j", "j")])
def test_roads_may_have_any_id(written, tmp_path, names):
    first, second = names
    net = written(
        road(first, 0, 0, 0, 50, section((-1, lane(-1, after=-1)), (1, lane(1, after=1))), after=f"road:{second}:start")
        if ":" not in first else road(first, 0, 0, 0, 50, simple(-1, 1)),
        road(second, 50, 0, 0, 50, simple(-1, 1)),
    )  # fmt: skip
    converted = sumo_net(net, cache=tmp_path)
    assert len(converted.lanes) == 4
    assert converted.conversion.bad == ()


def test_a_taper_keeps_its_exact_centre_line(written, tmp_path):
    opening = '<lane id="-1" type="driving"><width sOffset="0" a="0" b="0" c="0.0105" d="-0.00007"/></lane>'
    net = written(road("a", 0, 0, 0, 100, section((-1, opening))))
    converted = sumo_net(net, cache=tmp_path)
    (error,) = converted.conversion.lanes
    assert error.limit == 0.01
    assert error.worst < 0.001
    shape = next(etree.parse(str(converted.path)).getroot().iter("lane")).get("shape").split()
    x, y = np.array([p.split(",") for p in shape], dtype=float).T
    s = np.clip(x, 0, 100)
    np.testing.assert_allclose(y, -0.5 * (0.0105 * s**2 - 0.00007 * s**3), atol=1e-5)


def test_a_map_without_a_driving_lane_is_refused(written, tmp_path):
    from resim.core.errors import InputError

    net = written(road("a", 0, 0, 0, 50, section((-1, lane(-1, kind="sidewalk")))))
    with pytest.raises(InputError, match=r"map\.xodr: has no driving lane \(its lanes are: sidewalk\)"):
        sumo_net(net, cache=tmp_path)
    assert list(tmp_path.iterdir()) == [tmp_path / "map.xodr"]


@pytest.mark.parametrize("at", [50.0, 60.0])
def test_a_lane_section_at_the_end_of_its_road_or_beyond_cuts_no_link(written, tmp_path, at):
    on = section((-1, lane(-1, after=-1))) + section((-1, lane(-1, before=-1, after=-1)), s=at)
    net = written(
        road("a", 0, 0, 0, 50, on, after="road:b:start"),
        road("b", 50, 0, 0, 1e-7, simple(-1, before=-1, after=-1), before="road:a:end", after="road:c:start"),
        road("c", 50, 0, 0, 50, simple(-1, before=-1), before="road:b:end"),
    )
    assert connected(sumo_net(net, cache=tmp_path)) == {(("a", -1), ("c", -1))}


def test_a_link_into_the_middle_of_a_road_joins_no_ends_and_is_told_of(written, tmp_path):
    aside = road("b", 20, 0, -0.5, 30, simple(-1, before=-1), before="road:a")
    aside = aside.replace('elementId="a"', 'elementId="a" elementS="20" elementDir="+"')
    net = written(road("a", 0, 0, 0, 50, simple(-1)), aside)
    assert lane_graph(net) == {LaneKey("a", 0, -1): (), LaneKey("b", 0, -1): ()}
    assert connected(sumo_net(net, cache=tmp_path)) == set()
    (flaw,) = flaws(net)
    assert (flaw.severity, flaw.code, flaw.road, flaw.s) == ("warning", "LINK_INSIDE", "b", 0.0)
    assert "road b: its predecessor is road a at s=20.000 m, inside of it" in flaw.text


def through(number, junction, incoming, connecting):
    link = '<laneLink from="-1" to="-1"/>'
    return (
        f'<connection id="{number}" incomingRoad="{incoming}" connectingRoad="{connecting}" contactPoint="start">'
        f"{link}</connection>"
    )


def two_junctions_in_a_row(first, last):
    """A road, a connecting road of junction 5, one of junction 6, a road; `first` and `last` may be the same."""
    inner = simple(-1, before=-1, after=-1)
    return (
        road("8", 100, 0, 0, 10, inner, before=f"road:{first}:end", after="road:9:start", junction="5"),
        road("9", 110, 0, 0, 10, inner, before="road:8:end", after=f"road:{last}:start", junction="6"),
        f'<junction id="5">{through(0, 5, first, 8)}</junction><junction id="6">{through(0, 6, 8, 9)}</junction>',
    )


def test_a_way_may_lead_through_several_junctions(written, tmp_path):
    """Ends that only lanes join are one node: netconvert "could not insert connection" between others."""
    net = written(
        road("1", 0, 0, 0, 100, simple(-1), after="junction:5"),
        road("2", 120, 0, 0, 100, simple(-1), before="junction:6"), *two_junctions_in_a_row(1, 2),
    )  # fmt: skip
    converted = sumo_net(net, cache=tmp_path)
    assert connected(converted) == {(("1", -1), ("2", -1))}
    assert (converted.conversion.lost, converted.conversion.bad) == ((), ())


def test_a_road_may_come_back_to_itself_through_several_junctions(written, tmp_path):
    ring = road("1", 0, 0, 0, 100, simple(-1), before="junction:6", after="junction:5")
    converted = sumo_net(written(ring, *two_junctions_in_a_row(1, 1)), cache=tmp_path)
    assert connected(converted) == {(("1", -1), ("1", -1))}


@pytest.mark.parametrize(("before", "comes_from"), [(None, [-1]), (-2, [-2])])
def test_a_connection_without_lane_links_leaves_them_to_the_lanes(written, before, comes_from):
    """Lanes of the same id go on into each other only where the lanes of the connecting road do not say otherwise."""
    arm = road("1", 0, 0, 0, 50, section((-1, lane(-1)), (-2, lane(-2))), after="junction:9")
    way = road("2", 50, 0, 0, 20, section((-1, lane(-1, before=before))), before="road:1:end", junction="9")
    net = written(
        arm,
        way,
        '<junction id="9"><connection id="0" incomingRoad="1" connectingRoad="2" contactPoint="start"/></junction>',
    )
    graph = lane_graph(net)
    assert [n for n in (-1, -2) if LaneKey("2", 0, -1) in graph[LaneKey("1", 0, n)]] == comes_from


def test_a_connecting_road_that_names_no_road_is_joined_all_the_same(written, tmp_path):
    net = written(
        road("1", 0, 0, 0, 100, simple(-1), after="junction:5"), road("8", 100, 0, 0, 10, simple(-1), junction="7"),
        f'<junction id="5">{through(0, 5, 1, 8)}</junction><junction id="7"/>',
    )  # fmt: skip
    assert connected(sumo_net(net, cache=tmp_path)) == {(("1", -1), ("8", -1))}


def test_a_connection_that_netconvert_refuses_costs_that_connection_only(written, tmp_path, monkeypatch):
    """Refused for good: here as the ends are not joined, which is what joins them taken away."""
    from resim.road.sumo import plain

    monkeypatch.setattr(plain, "_together", lambda *_: [])
    net = written(
        road("1", 0, 0, 0, 100, simple(-1), after="junction:5"),
        road("2", 120, 0, 0, 100, simple(-1), before="junction:6"), *two_junctions_in_a_row(1, 2),
    )  # fmt: skip
    conversion = sumo_net(net, cache=tmp_path).conversion
    assert conversion.lost == ("road 1 section 0 lane -1 to road 2 section 0 lane -1",)
    missing = [(lane.road, lane.remark) for lane in conversion.lanes if lane.worst is None]
    assert missing == [(name, "netconvert makes no connection for the link across it") for name in ("8", "9")]
