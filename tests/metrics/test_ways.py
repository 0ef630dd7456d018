from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resim.core.errors import ResimError
from resim.metrics.risk import PUBLISHED, RiskParameters, Scenes, accident_risk
from resim.metrics.risk.lane_paths import LanePaths, _resampled, lane_paths
from resim.metrics.risk.prediction import WALKING
from resim.road.opendrive import load

CAR = (4.7, 1.9)
CURVE, ENTRY, STRAIGHT = 1450.0, 1740.0, 1950.0
"""Stations of the proving ground's road 1: in its curve, where oncoming traffic enters it, and where it is straight."""


def driven(network, lane, s, v, *, t=0.0, steps=40, step=0.1):
    """The plan (M + 1, 4) of who drives along a lane of road 1, t to the left of its centre."""
    at = s + v * step * np.arange(steps + 1)
    x, y = network.to_xy("1", lane, at, t)
    return np.stack([x, y, network.lane_heading("1", lane, at), np.full(len(at), v)], axis=1)


def on(network, lane, s, v, *, t=0.0, turned=0.0, rate=0.0):
    """The state of who is on a lane of road 1, its heading `turned` from the lane's."""
    x, y = network.to_xy("1", lane, s, t)
    return [float(x), float(y), float(network.lane_heading("1", lane, s)) + turned, v, 0.0, rate]


def both(network, plan, *states, sigma=True):
    """The risk of one scene without ways and with."""
    state = np.array([states], dtype=float)
    size = np.broadcast_to(CAR, (*state.shape[:2], 2)).copy()
    inputs = PUBLISHED.inputs(*np.moveaxis(state[..., 3:6], -1, 0)) * (
        [1, 1, 1, 1] if sigma else [1, 0, 1, 0]
    )
    made = Scenes(plan[None], np.array([CAR]), state, size, inputs)
    known = replace(made, ways=lane_paths(network, state, size, horizon=4.0))
    return accident_risk(made), accident_risk(known)


@pytest.mark.parametrize("s", [ENTRY, ENTRY - 20.0, ENTRY + 20.0])
def test_who_comes_towards_us_at_the_entry_of_a_curve_follows_it(network, s):
    """He turns as his lane does there, which is hardly: without ways he goes straight on, into the EGO's lane."""
    rate = 28.0 * float(network.curvature("1", 1, s))
    before, after = both(network, driven(network, -1, s - 150.0, 25.0), on(network, 1, s, 28.0, rate=rate))
    assert before.collision[0, 0] > 0.08
    assert after.collision[0, 0] < 0.1 * before.collision[0, 0]
    assert after.r_ind[0] < 0.1 * before.r_ind[0]


@pytest.mark.parametrize("rate", [0.0, 15.0 * 0.00249])
def test_a_neutral_driver_comes_to_where_the_lane_leads(network, rate):
    """60 m ahead in the curve somebody stands; before its entry, or turning as it does, one drives there."""
    s = 1240.0 if rate == 0.0 else CURVE
    standing = driven(network, -1, s + 50.0, 1e-3)
    before, after = both(network, standing, on(network, -1, s, 15.0, rate=rate), sigma=False)
    assert after.collision[0, 0] == pytest.approx(1.0)
    lane = network.to_road(standing[:1, 0], standing[:1, 1]).lane[0]
    assert lane == -1
    assert before.ttc[0, 0] == pytest.approx(after.ttc[0, 0], abs=0.1)


def test_on_a_straight_road_away_from_its_edges_nothing_changes(network):
    plan = driven(network, -1, STRAIGHT - 60.0, 20.0)
    before, after = both(
        network,
        plan,
        on(network, -1, STRAIGHT - 45.0, 12.0),
        on(network, -2, STRAIGHT - 45.0, 17.0, turned=0.03),
    )
    assert before.r_ind[0] > 0.3
    np.testing.assert_allclose(after.r_to, before.r_to, atol=1e-9)


@pytest.mark.parametrize("s", [STRAIGHT - 60.0, CURVE])
def test_who_cuts_in_is_still_seen(network, s):
    turn = 0.0 if s != CURVE else 14.0 * 0.00249
    cut_in = on(network, -2, s + 12.0, 14.0, turned=0.06, rate=turn + 0.03)
    before, after = both(network, driven(network, -1, s, 20.0), cut_in)
    assert after.r_ind[0] > 0.1
    assert after.r_ind[0] > 0.8 * before.r_ind[0]


ROADS = """<OpenDRIVE><header revMajor="1" revMinor="6"/>{}</OpenDRIVE>"""
ROAD = """<road id="{id}" length="500" junction="-1"><planView><geometry s="0" x="{x}" y="{y}" hdg="{hdg}" length="500">
<line/></geometry></planView><lanes><laneSection s="0"><center><lane id="0" type="none" level="false"/></center>
<right><lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right>
</laneSection></lanes></road>"""


@pytest.mark.parametrize(("apart", "is_one"), [(0.0, True), (0.6, True), (4.0, False)])
def test_asphalt_that_is_drawn_as_two_roads_has_no_edge_between_them(tmp_path, apart, is_one):
    """Two one-way roads side by side: who comes over the centre line is seen as on one road."""
    roads = ROAD.format(id=1, x=0, y=0, hdg=0), ROAD.format(id=2, x=500, y=apart, hdg=np.pi)
    (tmp_path / "two.xodr").write_text(ROADS.format("".join(roads)))
    network = load(tmp_path / "two.xodr")
    t = np.arange(41) * 0.1
    plan = np.stack([100.0 + 15.0 * t, -1.75 + 0.0 * t, 0.0 * t, 15.0 + 0.0 * t], axis=1)
    drifts = [180.0, 1.75 + apart, np.pi + (3.5 + apart) / 50.0, 15.0, 0.0, 0.0]
    before, after = both(network, plan, drifts)
    assert before.r_ind[0] > 0.03
    assert (after.r_ind[0] > 0.5 * before.r_ind[0]) == is_one


def test_who_overtakes_towards_us_is_still_seen(network):
    """An oncoming car that drifts over the centre line: there is room for it, and no edge."""
    drifts = on(network, 1, STRAIGHT, 15.0, turned=0.06, rate=0.0)
    before, after = both(network, driven(network, -1, STRAIGHT - 80.0, 15.0), drifts)
    assert after.collision[0, 0] == pytest.approx(before.collision[0, 0], abs=0.02)
    assert after.collision[0, 0] > 0.5


def test_nobody_leaves_the_road(network):
    """The EGO stands beside the road; a car that drifts to the edge is held there."""
    beside = driven(network, -3, STRAIGHT, 1e-3, t=-4.0)
    before, after = both(network, beside, on(network, -3, STRAIGHT - 40.0, 15.0, turned=-0.09))
    assert before.collision[0, 0] > 0.5
    assert after.collision[0, 0] == 0.0


def test_who_has_no_way_is_predicted_as_before(network):
    x, y, heading, *_ = on(network, -1, STRAIGHT, 10.0)
    far = [x + 500.0, y + 500.0, 0.0, 10.0, 0.0, 0.0]
    against = [x, y, heading + np.pi, 10.0, 0.0, 0.0]
    state = np.array([[far, against, on(network, -1, STRAIGHT, 10.0), far]])
    size = np.broadcast_to(CAR, (1, 4, 2)).copy()
    size[0, 3] = 0.0
    found = lane_paths(network, state, size, horizon=4.0)
    assert found.count.tolist() == [[0, 0, 1, 0]]
    before, after = both(network, driven(network, -1, STRAIGHT - 60.0, 20.0), against)
    assert after.r_ind[0] == before.r_ind[0] > 0.0


def test_who_walks_needs_no_way(network):
    state, size = np.array([[on(network, -1, STRAIGHT, 1.0)]]), np.array([[[0.5, 0.5]]])
    plan = driven(network, -1, STRAIGHT - 40.0, 15.0)[None]
    made = Scenes(
        plan,
        np.array([CAR]),
        state,
        size,
        np.array([[[0.0, 0.3, 0.0, 0.3]]]),
        np.full((1, 1), WALKING, np.uint8),
    )
    known = replace(made, ways=lane_paths(network, state, size, horizon=4.0))
    assert accident_risk(known).r_ind[0] == accident_risk(made).r_ind[0] > 0.0


def test_the_published_mode_knows_no_road(network):
    state, size = np.array([[on(network, -1, STRAIGHT, 10.0)]]), np.array([[CAR]])
    made = Scenes(driven(network, -1, 100.0, 10.0)[None], np.array([CAR]), state, size, np.zeros((1, 1, 4)),
                  ways=lane_paths(network, state, size, horizon=4.0))  # fmt: skip
    with pytest.raises(ResimError, match="published"):
        accident_risk(made, RiskParameters(mode="published"))
    with pytest.raises(ResimError, match="ways are those of"):
        replace(made, ways=LanePaths.none((3, 2)))


LANE = '<lane id="-1" type="driving">{}<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'


def road(name, x, y, line, length, *, before="", after="", junction="-1", lane=""):
    return (
        f'<road id="{name}" length="{length}" junction="{junction}"><link>{before}{after}</link><planView>'
        f'<geometry s="0" x="{x}" y="{y}" hdg="0" length="{length}">{line}</geometry></planView><lanes>'
        f'<laneSection s="0"><center><lane id="0" type="none"/></center><right>{LANE.format(lane)}</right>'
        "</laneSection></lanes></road>"
    )


@pytest.fixture
def fork(tmp_path):
    """A lane along x that at x = 60 m goes straight on (road 2) or to the left in a bend of 50 m (road 3)."""
    back = '<predecessor elementType="road" elementId="1" contactPoint="end"/>'
    linked = '<link><predecessor id="-1"/></link>'
    connections = "".join(
        f'<connection id="{i}" incomingRoad="1" connectingRoad="{i}" contactPoint="start"><laneLink from="-1" to="-1"/>'
        "</connection>" for i in (2, 3)
    )  # fmt: skip
    path = tmp_path / "fork.xodr"
    path.write_text(
        '<OpenDRIVE><header revMajor="1" revMinor="7"/>'
        + road("1", 0, 0, "<line/>", 60, after='<successor elementType="junction" elementId="j"/>')
        + road("2", 60, 0, "<line/>", 80, before=back, junction="j", lane=linked)
        + road("3", 60, 0, '<arc curvature="0.02"/>', 80, before=back, junction="j", lane=linked)
        + f'<junction id="j">{connections}</junction></OpenDRIVE>'
    )
    return load(path)


def test_where_the_lane_forks_samples_take_both_ways(fork):
    """Somebody stands on the one way or the other: half of the samples meet him."""
    state = np.array([[[45.0, -1.75, 0.0, 12.0, 0.0, 0.0]]])
    inputs = np.array([[[0.0, 0.3, 0.0, 0.005]]])
    known = lane_paths(fork, state, np.array([[CAR]]), horizon=4.0)
    assert known.count[0, 0] == 2
    hits = []
    for name in ("2", "3"):
        x, y = fork.to_xy(name, -1, 25.0, 0.0)
        pose = [float(x), float(y), float(fork.lane_heading(name, -1, 25.0)), 0.0]
        plan = np.tile(pose, (41, 1))[None]
        made = Scenes(plan, np.array([CAR]), state, np.array([[CAR]]), inputs, ways=known)
        hits.append(accident_risk(made).collision[0, 0])
        assert accident_risk(made).collision[0, 0] == hits[-1]
    np.testing.assert_allclose(hits, 0.5, atol=0.01)
    alone = accident_risk(replace(made, ways=None))
    assert alone.collision[0, 0] < 0.01


def test_order_of_objects_changes_nothing(network):
    plan = driven(network, -1, CURVE, 18.0)
    states = [
        on(network, -1, CURVE + 30.0, 12.0),
        on(network, -2, CURVE + 8.0, 17.0),
        on(network, 1, CURVE + 90.0, 14.0),
    ]
    (_, one), (_, other) = both(network, plan, *states), both(network, plan, *states[::-1])
    np.testing.assert_allclose(one.r_to[0], other.r_to[0, ::-1], atol=1e-12)


def test_a_measured_map_bends_no_more_than_its_road():
    """5 cm of noise in every metre of a straight lane, as roads made from recordings have it."""
    rng, x = np.random.default_rng(1), np.arange(200.0)
    y = rng.normal(0.0, 0.05, 200)
    width = np.full(200, 1.75)
    points = _resampled((x, y, np.arctan2(np.gradient(y), 1.0), width, width))
    assert np.abs(points[15:-15, 4]).max() < 0.002
    assert np.abs(points[15:-15, 3]).max() < 0.02


def test_contact_on_ways_is_not_missed_by_coarse_steps(network):
    rng = np.random.default_rng(6)
    for s in rng.uniform(1250.0, 1700.0, 8):
        v, speed = rng.uniform(15.0, 25.0), rng.uniform(6.0, 14.0)
        states = [
            on(network, -2, s + rng.uniform(8.0, 25.0), speed, turned=0.05, rate=speed * 0.0025),
            on(network, 1, s + 90.0, speed, turned=rng.uniform(0.0, 0.06)),
        ]
        state = np.array([states])
        size, inputs = (
            np.broadcast_to(CAR, (1, 2, 2)).copy(),
            PUBLISHED.inputs(*np.moveaxis(state[..., 3:6], -1, 0)),
        )
        known = lane_paths(network, state, size, horizon=4.0)
        coarse, fine = (
            accident_risk(
                Scenes(plan[None], np.array([CAR]), state, size, inputs, ways=known), RiskParameters(step=0.1 / part)
            )
            for part, plan in (
                (1, driven(network, -1, s, v)), (10, driven(network, -1, s, v, steps=400, step=0.01)),
            )
        )  # fmt: skip
        assert (coarse.collision >= fine.collision - 0.01).all()
        np.testing.assert_allclose(coarse.r_ind, fine.r_ind, atol=0.02)
