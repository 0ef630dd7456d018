"""The page of a map: what it holds of the map and of its net's errors."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hostile import HOSTILE, harmless

from resim.core.geometry import Floats
from resim.report import write_map_page
from resim.report.map.colors import share
from resim.report.map.data import Picture
from resim.report.map.shapes import outer
from resim.report.map.tables import distance
from resim.road.flaws import Flaw
from resim.road.opendrive import Junction, RoadNetwork, load
from resim.road.sumo import Conversion, Jump, SumoNet

DATA = Path(__file__).parents[3] / "shared" / "data"
EVIL = "</script><b>&\"'x"


def page(network: RoadNetwork, folder: Path, conversion: Conversion | None = None) -> str:
    write_map_page(network, folder / "map.html", conversion=conversion)
    return (folder / "map.html").read_text(encoding="utf-8")


def data(html: str) -> dict[str, Any]:
    found = re.search(r'<script type="application/json" id="map-data">(.*?)</script>', html, re.DOTALL)
    assert found
    loaded: dict[str, Any] = json.loads(found.group(1))
    return loaded


def line(steps: list[int], origin: list[float]) -> Floats:
    return np.asarray(np.cumsum(np.array(steps).reshape(-1, 2), axis=0) / 100.0 + np.array(origin))


def rows(html: str) -> list[list[str]]:
    table = re.findall(r"<tr tabindex.*?</tr>", html, re.DOTALL)
    return [re.findall(r"<td>(.*?)</td>", row) for row in table]


def shared(name: str) -> RoadNetwork:
    path = DATA / name
    if not path.is_file():
        pytest.skip(f"{name} is not here")
    return load(path)


@pytest.fixture
def spoilt(net: SumoNet) -> Conversion:
    """The proving ground's conversion with a missing lane, two inexact ones and a gap."""
    lanes = sorted(net.conversion.lanes, key=lambda lane: (lane.type != "driving", lane.key))
    bad = [
        replace(lanes[0], worst=None, mean=None, sumo=(), remark="lost <here>"),
        replace(lanes[1], worst=2.5, mean=0.1),
        replace(lanes[-1], worst=0.0123, mean=0.001),
    ]
    rest = [replace(lane, worst=0.0004) for lane in lanes[2:-1]]
    return Conversion((*bad, *rest), net.conversion.connections, (Jump("a_0", "b<_1", 0.42, 10.0, -3.0),))


def test_every_lane_and_its_error_is_there_once(network: RoadNetwork, net: SumoNet, tmp_path: Path) -> None:
    found = data(page(network, tmp_path, net.conversion))
    roads = [road["id"] for road in found["roads"]]
    lanes = [(roads[lane[0]], lane[1], lane[2]) for lane in found["lanes"]]
    there = [lane for lane in lanes if lane[2] != 0]
    assert sorted(there) == sorted(tuple(lane.key) for lane in net.conversion.lanes)
    errors = {lane: error for lane, error in zip(lanes, found["errors"], strict=True) if error}
    assert {lane: error[0] for lane, error in errors.items()} == {
        tuple(lane.key): lane.worst for lane in net.conversion.lanes
    }


def test_a_lane_says_type_way_sizes_and_limit(network: RoadNetwork, tmp_path: Path) -> None:
    found = data(page(network, tmp_path))
    road, section, lane, kind, way, length, least, most, limit = next(
        lane for lane in found["lanes"] if found["roads"][lane[0]]["id"] == "1" and lane[2] == -1
    )
    own = network.roads["1"].sections[section]
    assert found["types"][kind]["name"] == own.lanes[-1].type == "driving"
    assert (road, lane, way) == (0, -1, 1)
    assert length == pytest.approx(100.0 * (own.end - own.start), rel=0.01)
    assert least <= most == pytest.approx(100.0 * network.lane_width("1", -1, own.start + 1.0), abs=30.0)
    speed = network.speed_limit("1", -1, own.start + 1.0)
    assert limit == ("" if np.isnan(speed) else f"{3.6 * speed:.0f} km/h")


@pytest.mark.parametrize("name", ["", "xodr/esmini/fabriksgatan.xodr", "xodr/esmini/two_plus_one.xodr"])
def test_lines_are_those_of_the_map_within_three_centimetres(
    name: str, network: RoadNetwork, tmp_path: Path
) -> None:
    network = shared(name) if name else network
    found, picture = data(page(network, tmp_path)), Picture(network, None)
    assert len(found["lines"]) == len(found["centres"]) == len(picture.shapes)
    for shape, border, centre in zip(picture.shapes, found["lines"], found["centres"], strict=True):
        for steps, exact in ((border, outer(shape)), (centre, shape.centre)):
            drawn = shapely.linestrings(line(steps, found["origin"]))
            assert shapely.distance(drawn, shapely.points(exact)).max() < 0.03


def test_road_marks_begin_where_the_map_says(network: RoadNetwork, tmp_path: Path) -> None:
    found, shapes = data(page(network, tmp_path)), Picture(network, None).shapes
    assert found["marks"]
    for k, first, last, kind, _, _ in found["marks"]:
        shape, n = shapes[k], len(found["lines"][k]) // 2
        marks = network.roads[shape.road].sections[shape.section].lanes[shape.lane].marks
        assert 0 <= first < last < n
        assert kind in {mark.type for mark in marks} - {"none"}
        if len(marks) == 1:
            assert (first, last) == (0, n - 1)


def test_junctions_have_an_area_around_their_lanes(tmp_path: Path) -> None:
    network = shared("xodr/esmini/fabriksgatan.xodr")
    found = data(page(network, tmp_path))
    assert [j["id"] for j in found["junctions"]] == list(network.junctions)
    area = shapely.union_all(
        [shapely.Polygon(line(r, found["origin"])) for r in found["junctions"][0]["rings"]]
    )
    inside = [s for s in network.lane_shapes() if network.roads[s.road].junction is not None]
    assert all(shapely.contains(area, shapely.linestrings(s.centre)) for s in inside)
    assert area.area < 3000.0


def test_a_direct_junction_has_its_type_and_an_area(tmp_path: Path) -> None:
    (junction,) = data(page(shared("xodr/esmini/direct_junction_simple.xodr"), tmp_path))["junctions"]
    assert junction["type"] == "direct"
    assert junction["rings"]


def test_what_is_not_exact_is_listed_worst_first(
    network: RoadNetwork, spoilt: Conversion, tmp_path: Path
) -> None:
    html = page(network, tmp_path, spoilt)
    listed = rows(html)
    assert [row[5] for row in listed[:3]] == ["missing", "2.50 m", "12.30 mm"]
    assert listed[0][11] == "lost &lt;here&gt;"
    assert listed[3] == ["420.00 mm", "a_0", "b&lt;_1", "10.00", "−3.00"]
    assert "Lanes for vehicles that are missing or not exact: 2</b>" in html
    assert "14 lanes within their limit, 2 beyond, 1 not in the net" in html
    assert data(html)["gaps"] == [["a_0", "b<_1", 0.42, 10.0, -3.0]]


def test_a_good_net_says_so_with_its_largest_error(
    network: RoadNetwork, net: SumoNet, tmp_path: Path
) -> None:
    html = page(network, tmp_path, net.conversion)
    assert f"All {len(net.conversion.lanes)} lanes are in the SUMO net within their limit</b>" in html
    assert f"the largest error is <b>{distance(net.conversion.worst)}</b>" in html
    assert rows(html) == []


def test_without_a_net_there_is_no_choice_of_colours(network: RoadNetwork, tmp_path: Path) -> None:
    html = page(network, tmp_path)
    assert 'data-mode="error"' not in html.split("<script", 1)[0]
    assert data(html)["errors"] is None
    assert "no SUMO net" in html


def test_names_of_the_map_cannot_break_the_page(
    network: RoadNetwork, spoilt: Conversion, tmp_path: Path
) -> None:
    roads = {EVIL: replace(network.roads["1"], id=EVIL, name=EVIL)}
    header = replace(network.header, name=EVIL)
    junctions = {EVIL: Junction(EVIL, EVIL, "default", ())}
    evil = RoadNetwork(network.path, header, EVIL, roads, junctions)
    lanes = tuple(replace(lane, road=EVIL, junction=EVIL, remark=EVIL) for lane in spoilt.lanes)
    html = page(evil, tmp_path, replace(spoilt, lanes=lanes))
    assert "<b>&" not in html
    assert html.count("</script>") == 3  # the map's data, what draws it, what looks after the tables
    found = data(html)
    assert (found["roads"][0]["name"], found["junctions"][0]["id"]) == (EVIL, EVIL)


def test_the_page_loads_nothing_and_is_the_same_every_time(
    network: RoadNetwork, net: SumoNet, tmp_path: Path
) -> None:
    html = page(network, tmp_path, net.conversion)
    assert page(load(network.path), tmp_path, net.conversion) == html
    assert not re.search(r"\b(src|href)\s*=|@import|url\(|https?://|fetch\(", html)
    assert str(tmp_path) not in html
    assert str(network.path.parent) not in html


def test_header_says_what_the_map_is(network: RoadNetwork, tmp_path: Path) -> None:
    html = page(network, tmp_path)
    assert "<h1>proving_ground.xodr</h1>" in html
    assert "<dt>roads</dt><dd>2, 2.84 km</dd>" in html
    assert "<dt>lanes</dt><dd>17</dd>" in html
    assert "+proj=tmerc" in html


def test_a_large_map_makes_a_small_page(tmp_path: Path) -> None:
    html = page(shared("xodr/carla/Town04.xodr"), tmp_path)
    assert len(html.encode()) < 1_000_000
    assert sum(lane[2] != 0 for lane in data(html)["lanes"]) == 924


def test_a_road_of_ten_kilometres_is_a_handful_of_points(tmp_path: Path) -> None:
    found = data(page(shared("xodr/alks/alks_road_straight.xodr"), tmp_path))
    assert max(len(steps) for steps in found["lines"]) < 50


def test_the_scale_runs_from_a_tenth_of_a_millimetre_to_ten_metres() -> None:
    assert [share(error) for error in (0.0, 1e-4, 10.0, 1e3)] == [0.0, 0.0, 1.0, 1.0]
    assert share(0.01) == pytest.approx(0.4)
    assert [distance(error) for error in (None, 0.0005, 1.5)] == ["–", "0.50 mm", "1.50 m"]


def test_nothing_in_a_map_or_its_net_makes_elements(
    network: RoadNetwork, spoilt: Conversion, tmp_path: Path
) -> None:
    own = network.roads["1"]
    section = own.sections[0]
    lanes = {k: replace(lane, type=HOSTILE) if k else lane for k, lane in section.lanes.items()}
    roads = {
        HOSTILE: replace(
            own, id=HOSTILE, name=HOSTILE, sections=(replace(section, lanes=lanes), *own.sections[1:])
        )
    }
    junctions = {HOSTILE: Junction(HOSTILE, HOSTILE, HOSTILE, ())}
    path = network.path.with_name(HOSTILE.replace("/", ""))
    evil = RoadNetwork(path, replace(network.header, name=HOSTILE), HOSTILE, roads, junctions)
    bad = tuple(
        replace(n, road=HOSTILE, type=HOSTILE, junction=HOSTILE, remark=HOSTILE) for n in spoilt.lanes
    )
    gaps = (Jump(HOSTILE, HOSTILE, 0.42, 10.0, -3.0),)
    conversion = replace(spoilt, lanes=bad, jumps=gaps, lost=(HOSTILE,))
    flaws = [Flaw("error", HOSTILE, HOSTILE, 0, -1, 0.0, 1.0, HOSTILE, HOSTILE)]
    write_map_page(evil, tmp_path / "map.html", conversion=conversion, flaws=flaws)
    harmless((tmp_path / "map.html").read_text(encoding="utf-8"))
