from __future__ import annotations

import copy
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from resim.core.errors import InputError
from resim.road.flaws import flaws
from resim.road.opendrive import RoadNetwork, load
from resim.road.opendrive.reader import ModelReader
from resim.road.opendrive.xml import parse_bytes
from resim.road.path import lane_path

LINE = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>'
BOMB = """<?xml version="1.0"?><!DOCTYPE lolz [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;">]>
<OpenDRIVE><header name="&b;"/></OpenDRIVE>"""
FETCH = """<?xml version="1.0"?><!DOCTYPE x SYSTEM "http://127.0.0.1:9/evil.dtd"><OpenDRIVE/>"""
STEAL = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]>
<OpenDRIVE><header><geoReference>&f;</geoReference></header></OpenDRIVE>"""


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("   \n", "empty"),
        ("s,t\n1,2", "not well-formed"),
        ("<OpenDRIVE><road></OpenDRIVE>", "not well-formed"),
        ("<osm/>", "root element is <osm>"),
        ("<OpenDRIVE/>", "no road"),
        (BOMB, "DOCTYPE"),
        (FETCH, "DOCTYPE"),
        (STEAL, "DOCTYPE"),
        (STEAL.encode("utf-16"), "DOCTYPE"),
    ],
)
def test_what_is_no_safe_opendrive_is_refused_with_the_file_and_the_reason(tmp_path, text, says):
    path = tmp_path / "bad.xodr"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=says) as error:
        load(path)
    assert str(path) in str(error.value)


def test_missing_file(tmp_path):
    with pytest.raises(InputError, match=r"none\.xodr: cannot be read"):
        load(tmp_path / "none.xodr")


@pytest.mark.parametrize(
    ("geometry", "says"),
    [
        ('<geometry s="0" x="0" y="0" hdg="0"><line/></geometry>', "road 7, geometry 0: .* lacks .* length"),
        (LINE.replace('x="0"', 'x="east"'), "road 7, geometry 0: x='east'"),
        (LINE.replace('hdg="0"', 'hdg="nan"'), "hdg='nan' .* not a finite number"),
        (LINE.replace("<line/>", ""), "none of line, arc"),
        (LINE.replace("<line/>", "<arc/>"), "<arc> lacks the attribute curvature"),
        (LINE.replace('length="100"', 'length="-1"'), "negative"),
        (LINE + LINE, "geometry at s=0.0 follows one at s=0.0"),
        ("", "planView has no geometry"),
        (LINE.replace('x="0"', 'x="1e200"'), "road 7, geometry 0: x='1e200' of <geometry> is beyond 1e\\+12"),
        (
            LINE.replace('length="100"', 'length="1e9"'),
            "road 7: its last element ends at s=1e\\+09 m, beyond 1000 km",
        ),
    ],
)
def test_bad_geometry_is_named(one_road, geometry, says):
    with pytest.raises(InputError, match=says):
        load(one_road(geometry))


@pytest.mark.parametrize(
    ("lanes", "says"),
    [
        ('<laneSection s="0"><right><lane id="one"/></right></laneSection>', "id='one' .* not an integer"),
        ('<laneSection s="0"><right><lane id="-2"/></right></laneSection>', "lane -1 is missing"),
        ('<laneSection s="0"><left><lane id="1"/><lane id="1"/></left></laneSection>', "is a duplicate"),
        ('<laneSection s="5"/><laneSection s="0"/>', "does not increase"),
        ('<laneSection s="-5"/><laneSection s="0"/>', "starts at s=-5, before the road"),
        (
            '<laneSection s="0"/><laneSection s="7"/><laneSection s="7"/>',
            "road 7: two laneSections start at s=7",
        ),
        ("<nothing/>", "has no laneSection"),
    ],
)
def test_bad_lanes_are_named(one_road, lanes, says):
    with pytest.raises(InputError, match=says):
        load(one_road(LINE, lanes=lanes))


def test_zero_length_geometry_with_nan_curvature_is_passed_over(one_road):
    nothing = (
        '<geometry s="0" x="9" y="9" hdg="0" length="0"><spiral curvStart="nan" curvEnd="nan"/></geometry>'
    )
    net = load(one_road(nothing + LINE))
    assert net.roads["7"].length == 100.0


def test_a_namespace_changes_nothing(tmp_path, proving_ground):
    text = proving_ground.path.read_text()
    path = tmp_path / "with_namespace.xodr"
    path.write_text(
        text.replace(
            "<OpenDRIVE>", '<OpenDRIVE xmlns="http://code.asam.net/simulation/standard/opendrive_schema">'
        )
    )
    assert load(path).roads == proving_ground.roads


def test_a_namespace_with_a_prefix_changes_nothing(tmp_path, proving_ground):
    text = proving_ground.path.read_text().replace("<", "<odr:").replace("<odr:/", "</odr:")
    text = text.replace("<odr:?", "<?").replace("<odr:!--", "<!--").replace("<odr:![CDATA", "<![CDATA")
    path = tmp_path / "prefixed.xodr"
    path.write_text(text.replace("<odr:OpenDRIVE", '<odr:OpenDRIVE xmlns:odr="http://a.b/c"', 1))
    assert load(path).roads == proving_ground.roads


def test_the_geo_reference_may_stand_in_cdata(one_road):
    path = one_road(LINE)
    path.write_text(path.read_text().replace(
        '<header revMajor="1" revMinor="6"/>',
        '<header revMajor="1" revMinor="8"><geoReference>\n<![CDATA[+proj=utm +zone=32 +datum=WGS84]]></geoReference>'
        '<license name="x" resource="y"/></header>',
    ))  # fmt: skip
    net = load(path)
    assert net.geo_reference == "+proj=utm +zone=32 +datum=WGS84"
    assert net.header.revision == (1, 8)


def test_a_file_too_large_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "city.xodr"
    with path.open("wb") as file:
        file.truncate(123_000_000)
    with pytest.raises(
        InputError, match=r"city\.xodr: has 123.0 MB; files of up to 100 MB .* Give only the part"
    ):
        load(path)


def test_ids_that_stand_twice_are_named(one_road):
    path = one_road(LINE)
    text = path.read_text()
    road = text[text.index("<road") : text.index("</OpenDRIVE>")]
    for twice, says in ((road, "road 7: the id is a duplicate"),
                        ('<junction id="3" name=""/>' * 2, "junction 3: the id is a duplicate")):  # fmt: skip
        path.write_text(text.replace("</OpenDRIVE>", twice + "</OpenDRIVE>"))
        with pytest.raises(InputError, match=says):
            load(path)


def test_what_the_proving_ground_says(proving_ground):
    net = proving_ground
    assert net.header.revision == (1, 6)
    assert net.geo_reference.startswith("+proj=tmerc")
    assert list(net.roads) == ["1", "2"]
    road = net.roads["1"]
    assert [sorted(s.lanes) for s in road.sections] == [[-3, -2, -1, 0, 1, 2], [-4, -3, -2, -1, 0, 1, 2]]
    assert road.sections[0].lanes[-3].successor == -4
    assert road.successor.id == "2"
    assert road.successor.contact == "start"
    assert road.sections[0].lanes[-1].marks[0].type == "broken"
    np.testing.assert_allclose(net.speed_limit("1", -1, [10.0, 1300.0]) * 3.6, [130.0, 100.0])
    np.testing.assert_allclose(net.lane_width("1", -3, [899.0, 900.0, 960.0, 1020.0]), [2.5, 0.0, 1.75, 3.5])


def test_odd_sections_and_a_road_that_follows_itself_do_no_harm(one_road):
    lane = '<right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>'
    lanes = "".join(f'<laneSection s="{s}">{lane}</laneSection>' for s in (0, 50, 100, 150))
    itself = '<link><successor elementType="road" elementId="7" contactPoint="start"/></link>'
    net = load(one_road(LINE, lanes=lanes, extra=itself))
    found = net.to_road([1.0, 50.0, 120.0], [-1.0, -1.0, -1.0])
    np.testing.assert_array_equal(found.on_road, [True, True, False])
    np.testing.assert_allclose(found.s, [1.0, 50.0, 120.0])
    assert all(np.isfinite(shape.centre).all() for shape in net.lane_shapes())
    path = lane_path(net, "7", -1, 10.0, 200.0)
    assert path.ends
    assert path.end == pytest.approx(90.0)


def test_a_lane_without_width_holds_nothing(one_road):
    net = load(
        one_road(LINE, lanes='<laneSection s="0"><right><lane id="-1" type="driving"/></right></laneSection>')
    )
    assert not net.to_road([5.0, 5.0], [0.0, -1.0]).on_road.any()


@pytest.mark.parametrize(("unit", "factor"), [("m/s", 1.0), ("km/h", 1 / 3.6), ("mph", 0.44704)])
def test_speed_units_and_lane_speed_over_road_speed(one_road, unit, factor):
    lanes = (
        '<laneSection s="0"><right><lane id="-1" type="driving"><width sOffset="0" a="3" b="0" c="0" d="0"/>'
        '<speed sOffset="50" max="30" unit="m/s"/></lane></right></laneSection>'
    )
    extra = f'<type s="20" type="town"><speed max="50" unit="{unit}"/></type>'
    net = load(one_road(LINE, lanes=lanes, extra=extra))
    limit = net.speed_limit("7", -1, [10.0, 30.0, 60.0])
    assert math.isnan(limit[0])
    np.testing.assert_allclose(limit[1:], [50 * factor, 30.0])


def test_no_limit_is_nan(one_road):
    net = load(one_road(LINE, extra='<type s="0" type="motorway"><speed max="no limit"/></type>'))
    assert np.isnan(net.speed_limit("7", -1, 5.0))


LANE = '<lane id="{}" type="driving"{}><width sOffset="0" a="{}" b="{}" c="0" d="0"/></lane>'


def test_a_section_of_one_side_leaves_the_other_as_it_was(one_road):
    net = load(one_road(LINE, lanes=(
        f'<laneSection s="0"><left>{LANE.format(1, "", 3, 0.01)}</left>'
        f'<right>{LANE.format(-1, "", 4, 0)}</right></laneSection><laneSection s="40" singleSide="true">'
        f'<right>{LANE.format(-1, "", 5, 0)}{LANE.format(-2, "", 2, 0)}</right></laneSection>'
        f'<laneSection s="70" singleSide="true"><left>{LANE.format(1, "", 6, 0)}</left></laneSection>'
    )))  # fmt: skip
    assert [sorted(section.lanes) for section in net.roads["7"].sections] == [
        [-1, 1],
        [-2, -1, 1],
        [-2, -1, 1],
    ]
    np.testing.assert_allclose(net.lane_width("7", 1, [10.0, 50.0, 80.0]), [3.1, 3.5, 6.0])
    np.testing.assert_allclose(net.lane_width("7", -1, [10.0, 50.0, 80.0]), [4.0, 5.0, 5.0])
    assert net.roads["7"].sections[1].lanes[1].predecessor == 1
    assert net.roads["7"].sections[1].lanes[-2].successor == -2


def test_a_reversed_lane_is_driven_the_other_way(one_road):
    net = load(one_road(LINE, lanes=(
        f'<laneSection s="0" layer="permanent"><right>{LANE.format(-1, "", 3, 0)}'
        f"""{LANE.format(-2, ' direction="reversed"', 3, 0)}{LANE.format(-3, ' direction="both"', 3, 0)}"""
        "</right></laneSection>"
    )))  # fmt: skip
    np.testing.assert_allclose(np.abs(net.lane_heading("7", [-1, -2, -3], 50.0)), [0.0, np.pi, 0.0])
    found = net.to_road(50.0, -3.0, heading=np.pi)
    assert found.lane[0] == -2
    path = lane_path(net, "7", -2, 80.0, 50.0)
    assert path.at(10.0).x == pytest.approx(70.0)
    assert not path.ends


def test_newer_elements_do_no_harm(one_road):
    extra = (
        '<lateralProfile><crossSectionSurface><tOffset><coefficients s="0" a="0" b="0" c="0" d="0"/></tOffset>'
        '</crossSectionSurface></lateralProfile><objects/><surface/><railroad/><userData code="x" value="y"/>'
    )
    assert load(one_road(LINE, extra=extra)).lane_width("7", -1, 5.0) == 3.5


JUNCTIONS = """<OpenDRIVE><header revMajor="1" revMinor="7"/>{roads}
<junction id="1" name="direct" type="direct"><connection id="0" incomingRoad="1" linkedRoad="2" contactPoint="end">
<laneLink from="-1" to="1" overlapZone="0"/></connection></junction>
<junction id="2" name="virtual" type="virtual" mainRoad="1" sStart="20" sEnd="30" orientation="-">
<connection id="0" type="virtual"><predecessor elementType="road" elementId="1" elementS="20" elementDir="+"/>
</connection><connection id="1" incomingRoad="1" connectingRoad="3" contactPoint="start">
<laneLink from="-1" to="-1"/></connection></junction></OpenDRIVE>"""


def test_direct_and_virtual_junctions(tmp_path):
    road = (
        '<road id="{}" length="50" junction="{}"><link>{}</link><planView><geometry s="0" x="{}" y="{}" hdg="{}" '
        f'length="50"><line/></geometry></planView><lanes><laneSection s="0"><left>{LANE.format(1, "", 3, 0)}</left>'
        f"<right>{LANE.format(-1, '', 3, 0)}</right></laneSection></lanes></road>"
    )
    direct = '<{} elementType="junction" elementId="1"/>'
    middle = '<predecessor elementType="road" elementId="1" elementS="20" elementDir="+"/>'
    path = tmp_path / "junctions.xodr"
    path.write_text(JUNCTIONS.format(roads=(
        road.format(1, -1, direct.format("successor"), 0, 0, 0)
        + road.format(2, -1, direct.format("successor"), 100, 0, math.pi)
        + road.format(3, 2, middle, 20, 0, -0.5)
    )))  # fmt: skip
    net = load(path)
    assert {j.id: j.type for j in net.junctions.values()} == {"1": "direct", "2": "virtual"}
    (direct_way,) = net.junctions["1"].connections
    assert (direct_way.connecting, direct_way.contact, direct_way.lane_links) == ("2", "end", ((-1, 1),))
    (side_way,) = net.junctions["2"].connections
    assert (side_way.incoming, side_way.connecting) == ("1", "3")
    assert net.roads["3"].predecessor.s == 20.0
    along = lane_path(net, "1", -1, 30.0, 40.0)
    assert along.at(40.0).x == pytest.approx(70.0)
    back = lane_path(net, "3", 1, 30.0, 60.0)
    assert back.ends
    assert back.end == pytest.approx(30.0)


def test_unknown_road_and_lane_are_named(proving_ground):
    with pytest.raises(InputError, match="has no road '9'"):
        proving_ground.to_xy("9", -1, 0.0, 0.0)
    with pytest.raises(InputError, match=r"road 1 has no lane -4 at s=100\.000 m. Its lanes there are -3"):
        proving_ground.to_xy("1", [-1, -4], [0.0, 100.0], 0.0)


ODD = [
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e308",
    "1e-300",
    "-1e9",
    "abc",
    "7",
    "1e5",
    "-0.5",
    "true",
    "99999999999999999999",
]


@settings(max_examples=120, deadline=None, derandomize=True)
@given(st.data())
def test_a_damaged_map_is_refused_in_words_or_read(data):
    path = Path(__file__).parent / "maps" / "every_record.xodr"
    root = etree.fromstring(path.read_bytes())
    elements = list(root.iter())[1:]
    element = elements[data.draw(st.integers(0, len(elements) - 1))]
    change = data.draw(st.sampled_from(["drop", "twice", "lose", "odd", "odd", "odd"]))
    if change == "drop":
        element.getparent().remove(element)
    elif change == "twice":
        element.addnext(copy.deepcopy(element))
    elif element.attrib:
        name = data.draw(st.sampled_from(sorted(element.attrib)))
        if change == "lose":
            del element.attrib[name]
        else:
            element.set(name, data.draw(st.sampled_from(ODD)))
    told = None
    try:
        reader = ModelReader(path, parse_bytes(etree.tostring(root), path))
        net = RoadNetwork(path, reader.header(), None, reader.roads(), reader.junctions())
    except InputError as error:
        told = str(error)
    if told is not None:
        assert str(path) in told
        return
    flaws(net)
    assert len(net.to_road([0.0, 50.0, -100.0], [0.0, 1.0, 20.0])) == 3


ALL = [
    "ngsim/USA_US101-5_1_T-1.xodr", "ngsim/USA_US101-10_1_T-1.xodr", "ngsim/USA_US101-12_1_T-1.xodr",
    "ngsim/USA_US101-22_1_T-1.xodr", "ngsim/USA_Lanker-1_17_T-1.xodr", "mcity/mcity.xodr",
    "xodr/carla/Town04.xodr", "xodr/edge_cases/od_newmarket.xodr", "xodr/edge_cases/sumo_pRange.xodr",
    "xodr/edge_cases/sumo_ticket9448.xodr", "xodr/edge_cases/sumo_connections_4arm.xodr",
    *(f"xodr/esmini/{name}.xodr" for name in (
        "curve_r100", "curves", "direct_junction_simple", "e6mini", "fabriksgatan", "highway_exit",
        "highway_example_with_merge_and_split", "highway_split", "jolengatan", "multi_lanesections",
        "soderleden", "straight_500m", "two_plus_one")),
    *(f"xodr/alks/alks_road_{name}.xodr" for name in (
        "straight", "left_radius_250m", "right_radius_1000m", "different_curvatures")),
]  # fmt: skip


@pytest.mark.parametrize("name", ALL)
def test_real_maps_evaluate_everywhere_and_find_every_lane_again(shared_map, name):
    net = shared_map(name)
    shapes = net.lane_shapes(step=5.0)
    assert all(np.isfinite(s.centre).all() and np.isfinite(s.left).all() for s in shapes)
    inner = [s for s in shapes if s.type == "driving" and np.hypot(*(s.left - s.right).T).min() > 0.1]
    middle = np.array([s.centre[len(s.centre) // 2] for s in inner])
    found = net.to_road(middle[:, 0], middle[:, 1])
    assert found.on_road.all()
    back = np.stack(net.to_xy(found.road, found.lane, found.s, found.t), axis=1)
    np.testing.assert_allclose(back, middle, atol=1e-4)  # some of these lie on kinks and gaps between roads
