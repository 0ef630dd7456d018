"""Each flaw on a map made to have it, and none on maps that have none."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from resim.core.spec import to_json
from resim.road.flaws import SEVERITIES, flaws
from resim.road.opendrive import load

WIDTH = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'


def geometry(s, x, length, *, y=0, heading=0.0, curve="<line/>"):
    return f'<geometry s="{s}" x="{x}" y="{y}" hdg="{heading}" length="{length}">{curve}</geometry>'


def lane(number, inside=WIDTH, *, kind="driving", links=""):
    named = "".join(f'<{end} id="{to}"/>' for end, to in links)
    return f'<lane id="{number}" type="{kind}"><link>{named}</link>{inside}</lane>'


def section(right, s=0.0):
    return f'<laneSection s="{s}"><center><lane id="0"/></center><right>{right}</right></laneSection>'


def road(name, plan, lanes, *, links="", length=None, junction=-1, extra=""):
    declared = "" if length is None else f'length="{length}"'
    return (
        f'<road id="{name}" {declared} junction="{junction}"><link>{links}</link><planView>{plan}</planView>'
        f"<lanes>{lanes}</lanes>{extra}</road>"
    )


def link(end, other, contact="start", kind="road"):
    at = f'contactPoint="{contact}"' if kind == "road" else ""
    return f'<{end} elementType="{kind}" elementId="{other}" {at}/>'


@pytest.fixture
def found(tmp_path):
    """Gives the flaws of a map with these roads and junctions."""

    def ask(*inside):
        path = tmp_path / "flawed.xodr"
        path.write_text(f'<OpenDRIVE><header revMajor="1" revMinor="7"/>{"".join(inside)}</OpenDRIVE>')
        return flaws(load(path))

    return ask


def told(flaws):
    return [(flaw.severity, flaw.code) for flaw in flaws]


LINE, LANES = geometry(0, 0, 100), section(lane(-1))


def test_a_sound_road_has_none(found):
    assert found(road("1", LINE, LANES, length=100)) == ()


DOUBLE = '<paramPoly3 aU="0" bU="200" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0"/>'


@pytest.mark.parametrize(
    ("plan", "severity", "code", "s", "value", "says"),
    [
        (geometry(0, 0, 50) + geometry(50, 50.45, 50), "warning", "LINE_GAP", 50, 0.45, "jumps by 0.450 m"),
        (geometry(0, 0, 50) + geometry(50, 50, 50, y=2), "error", "LINE_GAP", 50, 2.0, "jumps by 2.000 m"),
        (geometry(0, 0, 50) + geometry(50, 50, 50, heading=0.05), "note", "KINK", 50, 0.05, "kink of 0.050 rad"),
        (geometry(0, 0, 50) + geometry(50, 50, 50, heading=6.0), "warning", "KINK", 50, 0.2832, "kink"),
        (geometry(0, 0, 60) + geometry(50, 50, 50), "warning", "ELEMENT_OVERLAP", 50, 10, "begins 10.000 m before"),
        (geometry(0, 0, 40) + geometry(50, 50, 50), "error", "ELEMENT_HOLE", 50, 10, "begins 10.000 m behind"),
        (geometry(0, 0, 49.8) + geometry(50, 50, 50), "warning", "ELEMENT_HOLE", 50, 0.2, "begins 0.200 m behind"),
        (geometry(4, 4, 96), "error", "ELEMENT_HOLE", 4, 4, "first element begins at s=4.000 m, not at 0"),
        (geometry(0, 0, 0) + LINE, "note", "EMPTY_ELEMENT", 0, 0, "has no length and is ignored"),
        (geometry(0, 0, 100, curve=DOUBLE), "warning", "STRETCHED", 0, 100, "is 200.000 m long, its length"),
        (geometry(0, 0, 99), "error", "ROAD_LENGTH", 99, 1, "declared as 100.000 m, its elements end at 99.000 m"),
        (geometry(0, 0, 99.7), "warning", "ROAD_LENGTH", 99.7, 0.3, "declared as 100.000 m"),
        (geometry(0, 0, 105), "warning", "ROAD_LENGTH", 105, 5, "declared as 100.000 m, its elements end at 105.000 m"),
    ],
)  # fmt: skip
def test_reference_lines(found, plan, severity, code, s, value, says):
    (flaw,) = found(road("1", plan, LANES, length=100))
    assert (flaw.severity, flaw.code, flaw.road, flaw.s) == (severity, code, "1", s)
    assert flaw.value == pytest.approx(value, abs=1e-4)
    assert flaw.text.startswith("road 1: ")
    assert says in flaw.text


def test_an_element_may_turn_by_itself(found):
    """The heading of a polynomial element is that of its curve, not of its axis."""
    curve = '<paramPoly3 pRange="arcLength" aU="0" bU="0" cU="0" dU="0" aV="0" bV="1" cV="0" dV="0"/>'
    plan = geometry(0, 0, 50) + geometry(50, 50, 50, heading=-math.pi / 2, curve=curve)
    assert found(road("1", plan, LANES)) == ()


def cubic(a, b=0.0, c=0.0, tag="width"):
    return f'<{tag} sOffset="0" a="{a}" b="{b}" c="{c}" d="0"/>'


@pytest.mark.parametrize(
    ("inside", "kind", "severity", "code", "s", "value"),
    [
        (cubic(0.75, -0.04, 0.0004), "driving", "error", "NEGATIVE_WIDTH", 50, -0.25),
        (cubic(0.75, -0.04, 0.0004), "shoulder", "warning", "NEGATIVE_WIDTH", 50, -0.25),
        (cubic(3.0, -0.0302), "driving", "warning", "NEGATIVE_WIDTH", 100, -0.02),
        (cubic(2.0, tag="border"), "driving", "error", "NEGATIVE_WIDTH", 0, -2.0),
        (cubic(3.0, 0.2), "driving", "warning", "WIDE_LANE", 100, 23.0),
        ("", "driving", "error", "NO_WIDTH", 0, math.nan),
        ("", "border", "note", "NO_WIDTH", 0, math.nan),
        ('<width sOffset="7" a="3" b="0" c="0" d="0"/>', "driving", "warning", "LATE_WIDTH", 0, 7.0),
        (
            cubic(3.0) + '<width sOffset="50" a="4" b="0" c="0" d="0"/>',
            "driving",
            "warning",
            "LANE_STEP",
            50,
            0.5,
        ),
    ],
)
def test_lanes(found, inside, kind, severity, code, s, value):
    other = road("2", geometry(0, 0, 9), LANES)  # with a lane to drive on
    (flaw,) = found(road("1", LINE, section(lane(-1, inside, kind=kind))), other)
    assert (flaw.severity, flaw.code, flaw.section, flaw.lane) == (severity, code, 0, -1)
    assert flaw.s == pytest.approx(s, abs=1e-6)
    assert flaw.value == pytest.approx(value, abs=1e-6, nan_ok=True)
    assert flaw.text.startswith("road 1, lane section 0, lane -1 ")


def test_a_section_behind_the_end_of_its_road(found):
    (flaw,) = found(road("1", LINE, LANES + section(lane(-1), 120)))
    assert (flaw.severity, flaw.code, flaw.section, flaw.value) == ("error", "SECTION_BEYOND_END", 1, 20.0)


def test_no_lane_to_drive_on(found):
    assert told(found(road("1", LINE, section(lane(-1, kind="sidewalk"))))) == [("error", "NO_DRIVING_LANE")]


def test_a_sign_that_shows_no_speed(found):
    sign = '<signal id="9" s="20" orientation="+" country="DE" type="274" value="13.9" unit="km/h"/>'
    (flaw,) = found(road("1", LINE, LANES, extra=f"<signals>{sign}</signals>"))
    assert (flaw.severity, flaw.code, flaw.s) == ("warning", "SPEED_SIGN", 20.0)
    assert "sign 9 at s=20.000 m (country=DE, type=274, value=13.9, unit=km/h)" in flaw.text


def test_flaws_can_be_written_as_json(found):
    (flaw,) = found(road("1", LINE, section(lane(-1, kind="sidewalk"))))
    assert json.loads(json.dumps(to_json(flaw), allow_nan=False)) == {
        "severity": "error", "code": "NO_DRIVING_LANE", "road": None, "section": None, "lane": None, "s": None,
        "value": None, "unit": "", "text": "the map has no lane that vehicles drive on",
    }  # fmt: skip


def test_links_to_what_is_not_there(found):
    links = link("predecessor", "77") + link("successor", "5", kind="junction")
    assert [(f.code, f.s) for f in found(road("1", LINE, LANES, links=links))] == [
        ("MISSING_JUNCTION", 100.0), ("MISSING_ROAD", 0.0)]  # fmt: skip


def pair(gap=0.0, y=0.0, *, back=True, to=-1, width=WIDTH, contact="start"):
    """Two roads, the second behind the first."""
    first = road(
        "1", LINE, section(lane(-1, links=[("successor", to)])), links=link("successor", "2", contact)
    )
    returns = link("predecessor", "1", "end") if back else ""
    return first, road("2", geometry(0, 100 + gap, 50, y=y), section(lane(-1, width)), links=returns)


def test_roads_that_follow_each_other(found):
    assert found(*pair()) == ()
    assert told(found(*pair(back=False))) == [("warning", "ONE_SIDED")]
    assert told(found(*pair(gap=0.5))) == [
        ("warning", "LANE_GAP"),
        ("note", "ROAD_GAP"),
        ("note", "ROAD_GAP"),
    ]
    (worst, *_) = found(*pair(y=-3.0))
    assert (worst.severity, worst.code, worst.lane, worst.value) == (
        "warning",
        "LANE_GAP",
        -1,
        pytest.approx(3.0),
    )
    assert "lane -1: its end is 3.000 m from lane -1 of road 2, section 0" in worst.text
    (flaw,) = found(*pair(to=-4))
    assert (flaw.code, flaw.severity, flaw.s) == ("MISSING_LANE", "error", 100.0)
    assert "its successor is lane -4, which road 2 has not in its section 0" in flaw.text


def test_the_contact_point_says_which_end(found):
    assert "ONE_SIDED" in {f.code for f in found(*pair(contact="end"))}
    assert any(f.code == "LANE_GAP" and f.value > 49.0 for f in found(*pair(contact="end")))


def test_lanes_of_no_width_need_not_meet(found):
    assert told(found(*pair(width=cubic(0.0, 0.1)))) == []


def test_sections_of_a_road(found):
    one = section(lane(-1, links=[("successor", -2)]))
    assert told(found(road("1", LINE, one + section(lane(-1) + lane(-2), 50)))) == [("warning", "LANE_GAP")]
    (flaw,) = found(road("1", LINE, one + section(lane(-1), 50)))
    assert (flaw.code, flaw.section, flaw.s) == ("MISSING_LANE", 0, 50.0)


def junction(*lane_links, incoming="1", connecting="3", kind="default"):
    named = "".join(f'<laneLink from="{a}" to="{b}"/>' for a, b in lane_links)
    role = "linkedRoad" if kind == "direct" else "connectingRoad"
    return (
        f'<junction id="5" name="" type="{kind}"><connection id="0" incomingRoad="{incoming}" {role}="{connecting}" '
        f'contactPoint="start">{named}</connection></junction>'
    )


def crossing(*lane_links, y=0.0, **connection):
    arm = road("1", LINE, LANES, links=link("successor", "5", kind="junction"))
    links = link("predecessor", "1", "end")
    way = road("3", geometry(0, 100, 20, y=y), section(lane(-1, links=[("predecessor", -1)])),
               links=links, junction=5)  # fmt: skip
    return arm, way, junction(*lane_links, **connection)


def test_junctions(found):
    assert found(*crossing((-1, -1))) == ()
    assert told(found(*crossing((-1, -1), connecting="9"))) == [("error", "MISSING_ROAD")]
    (first, second) = found(*crossing((-3, -2)))
    assert {first.text, second.text} == {
        "junction 5, connection 0: road 1 has no lane -3 there",
        "junction 5, connection 0: road 3 has no lane -2 there",
    }
    assert told(found(*crossing((-1, -1), y=0.4))) == [("warning", "LANE_GAP")]


def test_a_direct_junction_links_roads_without_one_between(found):
    first = road("1", LINE, LANES, links=link("successor", "5", kind="junction"))
    other = road("3", geometry(0, 100, 20), LANES, links=link("predecessor", "1", "end"))
    assert found(first, other, junction((-1, -1), kind="direct")) == ()


MANY = ["ngsim/USA_Lanker-1_17_T-1.xodr", "xodr/edge_cases/od_newmarket.xodr", "mcity/mcity.xodr"]
NONE = [
    "xodr/carla/Town04.xodr", "xodr/esmini/fabriksgatan.xodr", "xodr/esmini/e6mini.xodr",
    "xodr/esmini/highway_exit.xodr", "xodr/esmini/direct_junction_simple.xodr",
    "xodr/esmini/highway_example_with_merge_and_split.xodr", "xodr/alks/alks_road_different_curvatures.xodr",
]  # fmt: skip


@pytest.mark.parametrize("name", MANY)
def test_the_worst_comes_first_and_nothing_twice(shared_map, name):
    net = shared_map(name)
    all_of_them = flaws(net)
    ranks = [SEVERITIES.index(flaw.severity) for flaw in all_of_them]
    assert ranks == sorted(ranks)
    assert len({flaw.text for flaw in all_of_them}) == len(all_of_them)
    assert [flaw.text for flaw in all_of_them] == [flaw.text for flaw in flaws(load(net.path))]


@pytest.mark.parametrize("name", NONE)
def test_sound_maps_have_none(shared_map, name):
    assert flaws(shared_map(name)) == ()


def test_maps_of_our_own_have_none(proving_ground):
    assert flaws(proving_ground) == ()
    assert flaws(load(Path(__file__).parent / "maps" / "every_record.xodr")) == ()


def test_what_is_known_of_real_maps(shared_map):
    texts = [flaw.text for flaw in flaws(shared_map("xodr/edge_cases/od_newmarket.xodr"))]
    assert "road 112: its successor is junction 675, which is not in the map" in texts
    (jump, *_) = flaws(shared_map("xodr/edge_cases/sumo_imprecise_geometry.xodr"))
    assert (jump.code, round(jump.value, 3)) == ("LINE_GAP", 3.714)


def test_a_road_whose_lanes_begin_late(found):
    (flaw,) = found(road("1", LINE, section(lane(-1), s=30.0), length=100))
    assert (flaw.severity, flaw.code, flaw.value) == ("error", "LATE_SECTION", 30.0)


def test_there_is_no_lane_offset_before_the_first(found):
    """So all lanes jump where one begins that is not zero there; at a section's border links say where lanes go on."""
    offset = '<laneOffset s="40" a="0.7" b="0" c="0" d="0"/>'
    (flaw,) = found(road("1", LINE, offset + LANES, length=100))
    assert (flaw.severity, flaw.code, flaw.s, round(flaw.value, 6)) == ("warning", "LANE_STEP", 40.0, 0.7)
    smooth = offset.replace('a="0.7"', 'a="0"')
    assert found(road("1", LINE, smooth + LANES, length=100)) == ()


@pytest.mark.parametrize(
    ("record", "says"),
    [
        ('<height sOffset="0" inner="0.1"/>', "height 0: <height> lacks the attribute outer"),
        ('<height sOffset="0" outer="0.1"/>', "height 0: <height> lacks the attribute inner"),
        ('<height inner="0.1" outer="0.1"/>', "height 0: <height> lacks the attribute sOffset"),
        ('<height sOffset="0" a="0.1" b="0" c="0" d="0"/>', "height 0: <height> lacks the attribute inner"),
        ('<height sOffset="0" inner="nan" outer=""/>', "is not a finite number"),
        (
            '<roadMark sOffset="0" type="solid" width=""/>',
            "roadMark 0: width='' of <roadMark> is not a finite number",
        ),
        ('<roadMark sOffset="x" type="solid"/>', "roadMark 0: sOffset='x'"),
    ],
)
def test_records_that_move_no_lane_refuse_no_map(found, record, says):
    (flaw,) = found(road("1", LINE, section(lane(-1, WIDTH + record)), length=100))
    assert (flaw.severity, flaw.code, flaw.lane) == ("note", "UNREAD_RECORD", -1)
    assert says in flaw.text


def param(p_range="arcLength", **changed):
    values = {"aU": 0, "bU": 1, "cU": 0, "dU": 0, "aV": 0, "bV": 0, "cV": 0, "dV": 0, **changed}
    written = " ".join(f'{name}="{value}"' for name, value in values.items())
    return f'<paramPoly3 pRange="{p_range}" {written}/>'


BORDER = '<border sOffset="0" a="9" b="0" c="0" d="0"/>'
DENIED = '<access sOffset="0" rule="deny" restriction="passengerCar"/>'
SLOW = '<speed sOffset="0" max="-5" unit="m/s"/>'
PROFILE = '<lateralProfile><{} s="0" t="0" side="both" a="0.1" b="0" c="0" d="0"/></lateralProfile>'


@pytest.mark.parametrize(
    ("inside", "severity", "code", "says"),
    [
        (road("1", geometry(0, 0, 100, curve='<line/><arc curvature="0.01"/>'), LANES), "error", "TWO_CURVES",
         "holds <line>, <arc>; the first is used"),
        (road("1", LINE, LANES, extra='<include file="more.xml"/>'), "error", "INCLUDE", "'more.xml'"),
        (road("1", geometry(0, 0, 100, curve=param(p_range="foo", bU=100)), LANES), "error", "UNKNOWN_RANGE",
         "pRange='foo' is neither"),
        (road("1", LINE, LANES).replace("<road ", '<road rule="XYZ" '), "error", "UNKNOWN_RULE", "RHT is used"),
        (road("1", geometry(0, 0, 100, curve=param(aU=50)), LANES), "error", "CURVE_START", "50.000 m from"),
        (road("1", geometry(0, 0, 100, curve=param(aV=0.1)), LANES), "warning", "CURVE_START", "0.100 m from"),
        (road("1", geometry(0, 0, 100, curve=param(bU=0, bV=1)), LANES), "warning", "CURVE_START", "1.571 rad off"),
        (road("1", LINE, LANES, junction=5), "warning", "MISSING_JUNCTION", "part of junction 5"),
        (road("1", LINE, section(lane(-1) + lane(-2, kind="foo"))), "warning", "UNKNOWN_TYPE", "type='foo'"),
        (road("1", LINE, section(lane(-1, WIDTH + BORDER))), "warning", "TWO_WIDTHS", "the widths are used"),
        (road("1", LINE, section(lane(-1, WIDTH + DENIED))), "warning", "UNREAD_ACCESS", "(deny passengerCar)"),
        (road("1", LINE, section(lane(-1, WIDTH + SLOW))), "warning", "NEGATIVE_LIMIT", "limit -5 is below zero"),
        (road("1", LINE, LANES, extra='<type s="0" type="town"><speed max="-9"/></type>'), "warning", "NEGATIVE_LIMIT",
         "road 1, type: the speed limit -9"),
        (road("1", LINE, LANES, extra=PROFILE.format("shape")), "warning", "UNREAD_HEIGHT", "<shape> is left out"),
        (road("1", LINE, LANES, extra=PROFILE.format("crossfall")), "warning", "UNREAD_HEIGHT", "<crossfall>"),
    ],
)  # fmt: skip
def test_what_is_not_read_or_contradicts_itself_is_told(found, inside, severity, code, says):
    (flaw,) = found(inside)
    assert (flaw.severity, flaw.code) == (severity, code)
    assert says in flaw.text


def test_a_crossfall_of_zero_is_nothing(found):
    assert found(road("1", LINE, LANES, extra=PROFILE.format("crossfall").replace("0.1", "0"))) == ()


@pytest.mark.parametrize(("revision", "severity"), [((2, 0), "error"), ((1, 9), "warning"), ((1, 8), None)])
def test_a_revision_that_resim_does_not_know(tmp_path, revision, severity):
    path = tmp_path / "new.xodr"
    header = '<header revMajor="{}" revMinor="{}"/>'.format(*revision)
    path.write_text(f"<OpenDRIVE>{header}{road('1', LINE, LANES)}</OpenDRIVE>")
    assert told(flaws(load(path))) == ([(severity, "REVISION")] if severity else [])


@pytest.mark.parametrize(("s", "height"), [("-5", 0.2), ("0", 0.2), ("60", 0.0), ("1000", 0.0)])
def test_heights_may_begin_anywhere(tmp_path, s, height):
    record = f'<height sOffset="70" inner="0.4" outer="0.4"/><height sOffset="{s}" inner="0.2" outer="0.2"/>'
    path = tmp_path / "heights.xodr"
    path.write_text(
        f"<OpenDRIVE>{road('1', LINE, section(lane(-1, WIDTH + record)), length=100)}</OpenDRIVE>"
    )
    assert flaws(load(path)) == ()
    assert load(path).z("1", [50.0, 80.0], lane=-1).tolist() == [height, 0.4]
