from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import fresnel

from resim.road.opendrive import load

ROUND_TRIP = [
    "xodr/esmini/e6mini.xodr", "xodr/esmini/curves.xodr", "xodr/esmini/fabriksgatan.xodr",
    "xodr/alks/alks_road_different_curvatures.xodr", "xodr/carla/Town04.xodr", "mcity/mcity.xodr",
    "ngsim/USA_US101-22_1_T-1.xodr",
]  # fmt: skip


def places(net, n, seed, *, inside=0.98):
    """n random places on driving lanes: road, lane, s, t."""
    rng = np.random.default_rng(seed)
    lanes = [
        (road.id, lane.id, section.start, min(section.end, road.length))
        for road in net.roads.values() for section in road.sections for lane in section.lanes.values()
        if lane.drivable and lane.id and section.end > section.start and road.length > section.start
    ]  # fmt: skip
    pick = rng.integers(0, len(lanes), n)
    road, lane, start, end = (np.array([lanes[i][k] for i in pick]) for k in range(4))
    s = start + rng.random(n) * (end - start) * (1 - 1e-9)
    t = (rng.random(n) - 0.5) * inside * net.lane_width(road, lane, s)
    return road, lane, s, t


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from("12"), st.floats(0.001, 0.999), st.sampled_from([-3, -2, -1, 1]), st.floats(-0.49, 0.49)
)
def test_round_trip_on_the_proving_ground(proving_ground, road, share, lane, across):
    net = proving_ground
    s = share * net.roads[road].length
    t = across * float(net.lane_width(road, lane, s))
    found = net.to_road(*net.to_xy(road, lane, s, t))
    assert found.road[0] == road
    if abs(t) > 0 and net.lane_width(road, lane, s) > 0.01:
        assert found.lane[0] == lane
        assert (
            found.on_road[0]
            == net.roads[road].sections[net.roads[road].section_index(s)].lanes[lane].drivable
        )
        assert found.t[0] == pytest.approx(t, abs=1e-6)
    assert found.s[0] == pytest.approx(s, abs=1e-6)


@settings(max_examples=200, deadline=None)
@given(st.floats(-200, 2400), st.floats(-400, 1500))
def test_any_point_goes_there_and_back(proving_ground, x, y):
    found = proving_ground.to_road(x, y)
    back = proving_ground.to_xy(found.road, found.lane, found.s, found.t)
    np.testing.assert_allclose(np.ravel(back), [x, y], atol=1e-6)


@pytest.mark.parametrize("name", ROUND_TRIP)
def test_round_trip_on_real_maps(shared_map, name):
    net = shared_map(name)
    x, y = net.to_xy(*places(net, 3000, 1))
    found = net.to_road(x, y)
    assert found.on_road.mean() > 0.999
    x2, y2 = net.to_xy(found.road, found.lane, found.s, found.t)
    assert np.hypot(x2 - x, y2 - y).max() < 1e-6


def test_beyond_the_ends_along_the_tangents(proving_ground):
    x, y = proving_ground.to_xy("1", -1, -25.0, 0.5)
    np.testing.assert_allclose([x, y], [-25.0, -1.25], atol=1e-12)
    found = proving_ground.to_road(x, y)
    assert (found.road[0], found.lane[0], bool(found.on_road[0])) == ("1", -1, False)
    np.testing.assert_allclose([found.s[0], found.t[0]], [-25.0, 0.5], atol=1e-9)


def test_off_the_lanes_gives_the_nearest_driving_lane(proving_ground):
    found = proving_ground.to_road([100.0, 100.0, 100.0], [-30.0, 20.0, -8.0])
    np.testing.assert_array_equal(found.lane, [-2, 1, -3])  # the last one on the shoulder
    assert not found.on_road.any()
    np.testing.assert_allclose(found.t, [-30.0 + 5.25, 20.0 - 1.75, 0.25], atol=1e-9)


def test_nan_positions_stay_nan_and_empty_stays_empty(proving_ground):
    found = proving_ground.to_road([np.nan, 5.0], [0.0, -1.0])
    assert np.isnan(found.s[0])
    assert not found.on_road[0]
    assert found.on_road[1]
    assert len(proving_ground.to_road([], [])) == 0


def test_heading_chooses_among_overlapping_lanes(shared_map):
    net = shared_map("xodr/esmini/fabriksgatan.xodr")
    road, lane, s, _ = places(net, 2000, 3)
    inside = np.array([net.roads[r].junction is not None for r in road])
    road, lane, s = road[inside], lane[inside], s[inside]
    x, y = net.to_xy(road, lane, s, 0.0)
    heading = net.lane_heading(road, lane, s)
    found = net.to_road(x, y, heading=heading)
    off = np.angle(np.exp(1j * (net.lane_heading(found.road, found.lane, found.s) - heading)))
    assert np.abs(off).max() < 0.5
    blind = net.to_road(x, y)
    other = np.angle(np.exp(1j * (net.lane_heading(blind.road, blind.lane, blind.s) - heading)))
    assert np.abs(off).mean() <= np.abs(other).mean()


def test_answers_do_not_depend_on_the_batch(shared_map):
    net = shared_map("xodr/carla/Town04.xodr")
    x, y = net.to_xy(*places(net, 200, 5))
    whole = net.to_road(x, y)
    for i in range(0, 200, 17):
        one = net.to_road(x[i], y[i])
        assert (one.road[0], one.lane[0], one.s[0], one.t[0]) == (
            whole.road[i], whole.lane[i], whole.s[i], whole.t[i])  # fmt: skip


def spiral_end(start, rate, length):
    """The end of a spiral by Fresnel integrals, straight from the textbook."""
    a = np.sqrt(np.pi / abs(rate))
    s1, c1 = fresnel((start + rate * length) / (np.sqrt(np.pi * abs(rate)) * np.sign(rate)))
    s0, c0 = fresnel(start / (np.sqrt(np.pi * abs(rate)) * np.sign(rate)))
    z = a * ((c1 - c0) + 1j * np.sign(rate) * (s1 - s0)) * np.exp(-1j * start**2 / (2 * rate))
    return z.real, z.imag


@pytest.mark.parametrize(
    ("start", "end", "length"),
    [(0.0, 0.01, 100.0), (0.02, -0.01, 80.0), (-0.3, 0.4, 60.0), (-2.8, 6.4, 0.0091), (0.0, 3.0, 20.0)],
)
def test_spirals_are_exact(one_road, start, end, length):
    net = load(one_road(
        f'<geometry s="0" x="0" y="0" hdg="0" length="{length}">'
        f'<spiral curvStart="{start}" curvEnd="{end}"/></geometry>'
    ))  # fmt: skip
    x, y = net.to_xy("7", 0, length, 0.0)
    np.testing.assert_allclose([x, y], spiral_end(start, (end - start) / length, length), atol=1e-9)


@pytest.mark.parametrize("change", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
def test_spirals_of_hardly_any_rate_are_arcs(one_road, change):
    net = load(one_road(
        '<geometry s="0" x="0" y="0" hdg="0" length="200">'
        f'<spiral curvStart="0.02" curvEnd="{0.02 + change}"/></geometry>'
    ))  # fmt: skip
    x, y = net.to_xy("7", 0, 200.0, 0.0)
    np.testing.assert_allclose([x, y], [50 * np.sin(4.0), 50 * (1 - np.cos(4.0))], atol=1e-8 + 2e4 * change)


def test_poly3_goes_by_arc_length(one_road):
    b, c, d = 0.1, 0.004, -2e-5
    length = quad(lambda u: np.hypot(1.0, b + 2 * c * u + 3 * d * u * u), 0, 90)[0]
    net = load(one_road(
        f'<geometry s="0" x="0" y="0" hdg="0" length="{length}"><poly3 a="0" b="{b}" c="{c}" d="{d}"/></geometry>'
    ))  # fmt: skip
    for u in (10.0, 45.0, 90.0):
        s = quad(lambda p: np.hypot(1.0, b + 2 * c * p + 3 * d * p * p), 0, u)[0]
        np.testing.assert_allclose(net.to_xy("7", 0, s, 0.0), [u, b * u + c * u * u + d * u**3], atol=1e-7)


def test_normalized_parampoly3_goes_by_arc_length(proving_ground):
    """Equal steps of s are equal steps on the curve, though not of the parameter."""
    s = np.linspace(1.0, 802.0, 4001)
    x, y = proving_ground.to_xy("2", 0, s, 0.0)
    gaps = np.hypot(np.diff(x), np.diff(y))
    np.testing.assert_allclose(gaps, np.diff(s), rtol=1e-6)


def test_parampoly3_with_arc_length_range_takes_s_as_parameter(one_road):
    net = load(one_road(
        '<geometry s="0" x="1" y="2" hdg="0" length="50">'
        '<paramPoly3 pRange="arcLength" aU="0" bU="1" cU="0" dU="0" aV="0" bV="0" cV="1e-3" dV="0"/></geometry>'
    ))  # fmt: skip
    np.testing.assert_allclose(net.to_xy("7", 0, 30.0, 0.0), [31.0, 2.9], atol=1e-12)


@pytest.mark.parametrize("lane", [-2, -1, 1])
@pytest.mark.parametrize("road", ["1", "2"])
def test_heading_and_curvature_are_the_derivatives_of_the_lane_centre(proving_ground, road, lane):
    net, h = proving_ground, 0.05
    s = np.linspace(1.0, net.roads[road].length - 1.0, 900)
    elements = [g.s for g in net.roads[road].geometries] + [900.0, 1020.0]
    s = s[np.abs(s[:, None] - np.array(elements)).min(axis=1) > 0.2]
    way = 1.0 if lane < 0 else -1.0
    z0, z1, z2 = (
        np.array([1, 1j]) @ np.array(net.to_xy(road, lane, s + k * way * h, 0.0)) for k in (-1, 0, 1)
    )
    heading = net.lane_heading(road, lane, s)
    np.testing.assert_allclose(np.angle((z2 - z0) * np.exp(-1j * heading)), 0.0, atol=1e-6)
    turn = np.angle((z2 - z1) / (z1 - z0)) / (0.5 * np.abs(z2 - z0))
    np.testing.assert_allclose(net.curvature(road, lane, s), turn, atol=2e-7)


def test_taper_curvature_includes_the_widening(proving_ground):
    s, h = np.array([930.0, 960.0, 1000.0]), 0.5
    x, y = (np.array([proving_ground.to_xy("1", -3, s + k * h, 0.0)[i] for k in (-1, 0, 1)]) for i in (0, 1))
    second = (y[2] - 2 * y[1] + y[0]) / h**2
    slope = (y[2] - y[0]) / (2 * h)
    np.testing.assert_allclose(
        proving_ground.curvature("1", -3, s), second / (1 + slope**2) ** 1.5, atol=1e-7
    )
    assert (np.diff(x, axis=0) > 0).all()


def test_left_hand_traffic_drives_the_other_way(one_road):
    net = load(
        one_road('<geometry s="0" x="0" y="0" hdg="0" length="9"><line/></geometry>', attributes='rule="LHT"')
    )
    assert abs(net.lane_heading("7", -1, 5.0)) == pytest.approx(np.pi)


def test_borders_make_widths(one_road):
    lanes = (
        '<laneSection s="0"><left><lane id="1" type="driving"><border sOffset="0" a="3" b="0.01" c="0" d="0"/>'
        '</lane></left><right><lane id="-1" type="driving"><border sOffset="0" a="-3.5" b="0" c="0" d="0"/></lane>'
        '<lane id="-2" type="driving"><border sOffset="0" a="-6" b="0" c="0" d="0"/></lane></right></laneSection>'
    )
    net = load(one_road('<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>', lanes=lanes))
    np.testing.assert_allclose(net.lane_width("7", [1, -1, -2], 50.0), [3.5, 3.5, 2.5])
    np.testing.assert_allclose(net.to_xy("7", -2, 50.0, 0.0)[1], -4.75)


def test_lane_offset_and_elevation(one_road):
    lanes = (
        '<laneOffset s="0" a="0" b="0" c="0" d="0"/><laneOffset s="40" a="0" b="0.1" c="0" d="0"/>'
        '<laneSection s="0"><right><lane id="-1" type="driving"><width sOffset="0" a="4" b="0" c="0" d="0"/>'
        "</lane></right></laneSection>"
    )
    extra = '<elevationProfile><elevation s="10" a="1" b="0.5" c="0" d="0"/></elevationProfile>'
    net = load(
        one_road(
            '<geometry s="0" x="0" y="0" hdg="0" length="99"><line/></geometry>', lanes=lanes, extra=extra
        )
    )
    np.testing.assert_allclose(net.to_xy("7", [0, -1], 50.0, 0.0)[1], [1.0, -1.0])
    np.testing.assert_allclose(net.z("7", [10.0, 20.0]), [1.0, 6.0])


def test_superelevation_and_lane_height(one_road):
    lanes = (
        '<laneOffset s="0" a="1" b="0" c="0" d="0"/><laneSection s="0"><left><lane id="1" type="sidewalk">'
        '<width sOffset="0" a="2" b="0" c="0" d="0"/><height sOffset="20" inner="0.1" outer="0.3"/></lane></left>'
        '<right><lane id="-1" type="driving"><width sOffset="0" a="4" b="0" c="0" d="0"/></lane></right>'
        "</laneSection>"
    )
    extra = (
        '<elevationProfile><elevation s="0" a="1" b="0.5" c="0" d="0"/></elevationProfile><lateralProfile>'
        '<superelevation s="10" a="0.1" b="0.002" c="0" d="0"/></lateralProfile>'
    )
    net = load(one_road(
        '<geometry s="0" x="0" y="0" hdg="0" length="99"><line/></geometry>', lanes=lanes, extra=extra
    ))  # fmt: skip
    roll = np.sin(0.1 + 0.002 * 20.0)
    np.testing.assert_allclose(net.z("7", 30.0, [0.0, 2.0, -3.0]), 16.0 + np.array([0.0, 2.0, -3.0]) * roll)
    np.testing.assert_allclose(net.z("7", 30.0, 0.5, lane=-1), 16.0 - 0.5 * roll)
    np.testing.assert_allclose(net.z("7", 30.0, [-1.0, 0.0, 1.0], lane=1),
                               16.0 + np.array([1.0, 2.0, 3.0]) * roll + np.array([0.1, 0.2, 0.3]))  # fmt: skip
    assert net.z("7", 10.0, 0.0, lane=1) == pytest.approx(6.0 + 2.0 * np.sin(0.1))
    assert net.z("7", 5.0, lane=1, t=0.0) == pytest.approx(3.5 + 2.0 * np.sin(0.09))


def test_a_width_wins_over_a_border(one_road):
    lanes = (
        '<laneSection s="0"><right><lane id="-1" type="driving"><border sOffset="0" a="-9" b="0" c="0" d="0"/>'
        '<width sOffset="0" a="3" b="0" c="0" d="0"/></lane><lane id="-2" type="driving">'
        '<border sOffset="0" a="-5" b="0" c="0" d="0"/></lane></right></laneSection>'
    )
    net = load(one_road('<geometry s="0" x="0" y="0" hdg="0" length="9"><line/></geometry>', lanes=lanes))
    np.testing.assert_allclose(net.lane_width("7", [-1, -2], 5.0), [3.0, 2.0])


def test_a_parameter_range_left_out_is_normalized(one_road):
    net = load(one_road(
        '<geometry s="0" x="0" y="0" hdg="0" length="50">'
        '<paramPoly3 aU="0" bU="50" cU="0" dU="0" aV="0" bV="0" cV="0" dV="0"/></geometry>'
    ))  # fmt: skip
    np.testing.assert_allclose(net.to_xy("7", 0, 30.0, 0.0), [30.0, 0.0], atol=1e-9)


def test_records_may_stand_in_any_order(one_road):
    lanes = (
        '<laneOffset s="40" a="1" b="0" c="0" d="0"/><laneOffset s="0" a="0.5" b="0" c="0" d="0"/>'
        '<laneSection s="0"><right><lane id="-1" type="driving"><width sOffset="20" a="4" b="0" c="0" d="0"/>'
        '<width sOffset="0" a="2" b="0" c="0" d="0"/></lane></right></laneSection>'
    )
    net = load(one_road('<geometry s="0" x="0" y="0" hdg="0" length="99"><line/></geometry>', lanes=lanes))
    np.testing.assert_allclose(net.to_xy("7", 0, [10.0, 50.0], 0.0)[1], [0.5, 1.0])
    np.testing.assert_allclose(net.lane_width("7", -1, [10.0, 50.0]), [2.0, 4.0])


def test_lane_shapes_of_the_proving_ground(proving_ground):
    shapes = {(s.road, s.section, s.lane): s for s in proving_ground.lane_shapes(step=2.0)}
    lane = shapes["1", 0, -1]
    assert (lane.type, lane.mark, lane.centre.shape) == ("driving", "broken", (451, 2))
    np.testing.assert_allclose(lane.left[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(lane.right[:, 1], -3.5, atol=1e-12)
