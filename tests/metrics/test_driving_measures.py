"""Comfort on tracks and rules between vehicles and of the road."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from shapely import affinity

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.metrics import measures as c
from resim.metrics.measures import MeasureValues, Pairs, State
from resim.metrics.measures.driving import slope
from resim.metrics.measures.motion import ctra
from resim.metrics.risk import PUBLISHED, RiskParameters, Scenes, accident_risk
from resim.road.opendrive import load

CAR = (4.7, 1.9)


def tracks(x, y, heading, v, *, t=None, size=CAR, valid=None, yaw_rate=None, a=None):
    x, y, heading, v = (
        np.atleast_2d(np.asarray(o, dtype=float)) for o in np.broadcast_arrays(x, y, heading, v)
    )
    n = len(x)
    t = np.arange(x.shape[1]) * 0.04 if t is None else t
    valid = np.ones(x.shape, dtype=bool) if valid is None else valid
    x, y, heading, v = (np.where(valid, o, np.nan) for o in (x, y, heading, v))
    ids, kind = np.array([str(i) for i in range(n)]), np.array(["car"] * n)
    return Tracks(
        t, ids, kind, x, y, heading, v, np.full(n, size[0]), np.full(n, size[1]), valid, yaw_rate, a
    )  # fmt: skip


T = np.arange(0.0, 6.0, 0.04)


def test_acceleration_and_jerk_of_a_parabola_are_exact():
    v = 20 + 1.5 * T - 0.4 * T**2
    m = c.longitudinal_acceleration(tracks(0 * T, 0, 0, v, t=T))
    full = m.state[0] == State.VALUE
    # half a window at either end is not filled; one sample may be missing
    assert full[5:-5].all()
    assert not full[:5].any()
    assert not full[-5:].any()
    np.testing.assert_allclose(m.value[0, 6:-6], (1.5 - 0.8 * T)[6:-6], atol=1e-9)
    assert (m.state[0, ~full] == State.NOT_DEFINED).all()
    jerk = c.longitudinal_jerk(tracks(0 * T, 0, 0, v, t=T))
    np.testing.assert_allclose(jerk.value[0, 12:-12], -0.8, atol=1e-9)


def test_lateral_acceleration_of_a_circle_is_v_squared_over_r():
    circle = ctra(np.array([[0, 0, 3.0, 10.0, 0, 0.3]]), T[None])[0]  # the heading passes pi
    turning = tracks(
        circle[:, 0], circle[:, 1], np.mod(circle[:, 2] + math.pi, 2 * math.pi) - math.pi, 10.0, t=T
    )
    lateral = c.lateral_acceleration(turning)
    np.testing.assert_allclose(lateral.value[lateral.state == State.VALUE], 3.0, atol=1e-9)
    assert (lateral.state == State.VALUE).sum() > 130
    jerk = c.lateral_jerk(turning)
    np.testing.assert_allclose(jerk.value[jerk.state == State.VALUE], 0.0, atol=1e-9)
    right = c.lateral_acceleration(tracks(0 * T, 0, -0.2 * T, 10.0, t=T))
    assert right.worst_value()[0] == pytest.approx(-2.0)


def test_measured_values_go_before_derived_ones():
    a, rate = np.full((1, len(T)), -3.0), np.full((1, len(T)), 0.1)
    rate[0, 7] = np.nan
    measured = tracks(0 * T, 0, 0, 20.0, t=T, a=a, yaw_rate=rate)
    assert (c.longitudinal_acceleration(measured).value == -3.0).all()
    lateral = c.lateral_acceleration(measured)
    assert lateral.state[0, 7] == State.NOT_DEFINED
    assert lateral.value[0, 8] == pytest.approx(2.0)


def test_noise_comes_out_as_loud_as_said():
    rng = np.random.default_rng(0)
    for window in (0.5, 1.0):
        noisy = slope(np.arange(20000) * 0.04, rng.normal(0, 0.05, (1, 20000)), window=window)
        expected = 0.05 * math.sqrt(12 * 0.04 / window**3)
        assert np.nanstd(noisy) == pytest.approx(expected, rel=0.15)


def test_no_slope_across_gaps_and_none_without_samples():
    valid = np.ones((1, len(T)), dtype=bool)
    valid[0, 60:90] = False
    m = c.longitudinal_acceleration(tracks(0 * T, 0, 0, 20 + T, t=T, valid=valid))
    assert (m.state[0, 60:90] == State.NOT_COMPUTED).all()
    assert (m.state[0, [50, 58, 59, 90, 91]] != State.NOT_COMPUTED).all()
    assert (m.state[0, [59, 90]] == State.NOT_DEFINED).all()
    known = m.state == State.VALUE
    np.testing.assert_allclose(m.value[known], 1.0, atol=1e-9)


def following(gap, v, *, heading=0.0, y=0.0, lead=None):
    """Pairs of one EGO at v (S,) m/s and one object whose rear is gap (S,) m ahead."""
    gap, v = np.broadcast_arrays(np.asarray(gap, dtype=float), np.asarray(v, dtype=float))
    t = np.arange(41) * 0.1
    plan = np.stack([v[:, None] * t, 0 * v[:, None] * t, 0 * v[:, None] * t, v[:, None] + 0 * t], axis=-1)
    other = np.stack(
        [gap + 4.7, 0 * gap + y, 0 * gap + heading, v if lead is None else lead + 0 * v], axis=-1
    )
    state = np.concatenate([other, np.zeros((len(v), 2))], axis=1)[:, None]
    return Pairs(plan, np.tile(CAR, (len(v), 1)), state, np.tile(CAR, (len(v), 1, 1)), 0.1)


def test_half_the_speedometer_at_120_is_60_metres_in_town_36_kmh_are_10():
    """The examples of Kaefer, 4.5.6.4."""
    spare = c.half_speedometer(following([70.0, 60.0, 45.0], 120 / 3.6))
    np.testing.assert_allclose(spare.value[:, 0], [10.0, 0.0, -15.0], atol=1e-6)
    town = c.half_speedometer(following([10.0], 10.0), urban=True)
    assert town.value[0, 0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("heading", [0.7, 0.9, 0.5 * math.pi, math.pi])
def test_who_is_on_the_path_has_a_gap_whichever_way_he_heads(heading):
    """As a car that is parked across the lane; a distance to be kept is to who goes the same way, or stands."""
    box = affinity.translate(
        affinity.rotate(shapely.box(-2.35, -0.95, 2.35, 0.95), heading, use_radians=True), 34.7
    )
    far = box.intersection(shapely.box(0.0, -0.95, 99.0, 0.95)).bounds[0] - 2.35
    for lead in (0.0, 10.0):
        pairs = following([30.0], 20.0, heading=heading, lead=lead)
        assert c.gap_ahead(pairs).value[0, 0] == pytest.approx(far, abs=0.01)
        spare = c.half_speedometer(pairs)
        if lead and heading > 0.25 * math.pi:
            assert spare.state[0, 0] == State.NOT_DEFINED
        else:
            assert spare.value[0, 0] == pytest.approx(far - 36.0, abs=0.01)


def test_only_who_is_ahead_has_a_gap():
    assert c.gap_ahead(following([30.0], 20.0, y=3.5)).state[0, 0] == State.NO_CONFLICT
    assert c.gap_ahead(following([-30.0], 20.0)).state[0, 0] == State.NO_CONFLICT
    assert c.gap_ahead(following([170.0], 20.0)).state[0, 0] == State.NO_CONFLICT
    # two metres of the box reach into the EGO's way
    assert c.gap_ahead(following([30.0], 20.0, y=1.5)).value[0, 0] == pytest.approx(30.0, abs=1e-6)
    assert c.gap_ahead(following([30.0], -2.0)).state[0, 0] == State.NOT_DEFINED
    assert c.gap_ahead(following([30.0], 0.0)).value[0, 0] == pytest.approx(30.0, abs=1e-6)


@pytest.mark.parametrize(("kmh", "grace"), [(120.0, 3.0), (170.0, 1.0)])
def test_who_was_cut_in_on_has_time_to_restore_the_gap(kmh, grace):
    t = np.arange(0.0, 10.0, 0.5)
    v = np.full(len(t), kmh / 3.6)
    spare = c.half_speedometer(following(np.where(t < 2.0, 200.0, 20.0), v))
    late = c.tailgating(t, v, spare)
    assert (late.state[t < 2.0] == State.NO_CONFLICT).all()
    np.testing.assert_allclose(late.value[t >= 2.0, 0], t[t >= 2.0] - 2.0 - grace)
    assert late.worst_value() == (pytest.approx(7.5 - grace), (19, 0))


def test_who_drives_up_himself_has_none():
    t = np.arange(0.0, 10.0, 0.5)
    v = np.full(len(t), 120 / 3.6)
    gap = 80.1 - 5.0 * t
    gap[t > 8.0] = 90.0
    late = c.tailgating(t, v, c.half_speedometer(following(gap, v)))
    near = (gap < 60.0) & (t <= 8.0)
    np.testing.assert_allclose(late.value[near, 0], t[near] - 4.5)
    assert (late.state[~near] == State.NO_CONFLICT).all()
    with pytest.raises(ResimError, match="times that increase"):
        c.tailgating(t[::-1], v, c.half_speedometer(following(gap, v)))


def test_overtaking_on_the_right():
    def right(x, y, heading, v):
        p = following([x - 4.7], 30.0, y=y, heading=heading, lead=v)
        return c.overtaking_right(p)

    assert right(1.0, 3.5, 0.0, 25.0).value[0, 0] == pytest.approx(5.0)
    assert right(1.0, 3.5, 0.0, 33.0).value[0, 0] == pytest.approx(-3.0)
    for elsewhere in ((1.0, -3.5, 0.0), (8.0, 3.5, 0.0), (1.0, 3.5, math.pi), (1.0, 9.0, 0.0)):
        assert right(*elsewhere, 25.0).state[0, 0] == State.NO_CONFLICT


def test_speed_over_the_limit(network):
    """130 km/h on road 1, then 100."""
    x, y = network.to_xy("1", -2, np.array([100.0, 500.0, 1500.0, 100.0]), np.array([0.0, 0.0, 0.0, -60.0]))
    heading = np.append(network.lane_heading("1", -2, np.array([100.0, 500.0, 1500.0])), 0.0)
    valid = np.array([[True, False, True, True]])
    m = c.speed_over_limit(tracks(x, y, heading, 30.0, valid=valid), network)
    assert m.value[0, 0] == pytest.approx(30 - 130 / 3.6)
    assert m.value[0, 2] == pytest.approx(30 - 100 / 3.6)
    assert m.state.tolist() == [[State.VALUE, State.NOT_COMPUTED, State.VALUE, State.NOT_DEFINED]]
    assert m.worst_value() == (pytest.approx(30 - 100 / 3.6), (0, 2))


def test_a_road_without_limit_has_no_speed_over_it(tmp_path):
    path = tmp_path / "free.xodr"
    path.write_text(
        '<OpenDRIVE><header revMajor="1" revMinor="6"/><road id="7" length="100" junction="-1"><planView>'
        '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry></planView><lanes><laneSection s="0">'
        '<center><lane id="0" type="none"/></center><right><lane id="-1" type="driving">'
        '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road></OpenDRIVE>'
    )
    m = c.speed_over_limit(tracks([10.0, 20.0], -1.75, 0.0, 60.0), load(path))
    assert (m.state == State.NOT_DEFINED).all()


def test_reaching_over_the_lane(network):
    t = np.array([0.0, 0.6, 1.0, -1.4, 0.0])
    x, y = network.to_xy("1", -2, np.full(5, 200.0), t)
    turn = np.array([0.0, 0.0, 0.0, 0.0, 0.3])
    over = c.lane_overhang(tracks(x, y, turn, 20.0), network)
    turned = 0.5 * (4.7 * math.sin(0.3) + 1.9 * math.cos(0.3))
    np.testing.assert_allclose(over.value[0], [-0.8, -0.2, 0.2, 0.6, turned - 1.75], atol=1e-6)
    curve = network.to_xy("1", -2, 1500.0, 0.0)
    along = c.lane_overhang(
        tracks([curve[0]], [curve[1]], network.lane_heading("1", -2, 1500.0), 20.0), network
    )
    assert along.value[0, 0] == pytest.approx(-0.8, abs=1e-6)
    lost = c.lane_overhang(tracks([200.0, 200.0], [80.0, -5.25], 0.0, 20.0, size=(4.7, 0.0)), network)
    assert (lost.state == State.NOT_DEFINED).all()


def test_leaving_the_road(network):
    """Lane -2 is the last that is driven on, its border at y = -7."""
    off = c.off_road(tracks(np.full(4, 200.0), [-5.25, -6.5, -8.2, -30.0], 0.0, 20.0), network)
    assert off.value.tolist() == [[0.0, 2.0, 4.0, 4.0]]
    unknown = c.off_road(tracks([200.0], -30.0, 0.0, 20.0, size=(math.nan, 1.9)), network)
    assert unknown.state[0, 0] == State.NOT_DEFINED


def test_wttr_is_the_least_of_the_predicted_ones():
    pairs = following([30.0, 12.1, 30.0, 30.0], 21.0, lead=10.0)
    pairs.state[2, 0, 1] = 60.0
    pairs.state[3, 0, 4] = np.nan
    inputs = PUBLISHED.inputs(*np.moveaxis(np.nan_to_num(pairs.state[..., 3:]), 2, 0))
    scenes, parameters = Scenes(pairs.plan, pairs.ego_size, pairs.state, pairs.size, inputs), RiskParameters()
    m = c.wttr(scenes, accident_risk(scenes, parameters), parameters)
    assert m.state[:, 0].tolist() == [State.VALUE, State.VALUE, State.NO_CONFLICT, State.NOT_COMPUTED]
    assert m.value[1, 0] <= m.value[0, 0] <= c.ttr(pairs).value[0, 0]


def recorded():
    """EGO at 20 m/s along x; a leader that brakes with 2 m/s² and is gone after 4 s; one that crosses at 30 m."""
    ego = ctra(np.array([[0.0, 0, 0, 20, 0, 0]]), T[None])[0]
    leader = ctra(np.array([[40.0, 0, 0, 20, -2, 0]]), T[None])[0]
    crossing = ctra(np.array([[30.0, -40, 0.5 * math.pi, 12, 0, 0]]), T[None])[0]
    every = np.stack([leader, ego, crossing])
    valid = np.ones(every.shape[:2], dtype=bool)
    valid[0, T > 4.0] = False
    return tracks(*np.moveaxis(every, 2, 0), t=T, valid=valid)


def test_scenes_of_tracks_are_what_was_driven():
    p = c.driven_pairs(recorded(), "1", np.array([1.0, 2.0, 5.0]), horizon=3.0)
    assert p.state.shape == (3, 2, 6)
    np.testing.assert_allclose(p.plan[1, :, 0], 40.0 + 20.0 * np.arange(31) * 0.1, atol=1e-9)
    np.testing.assert_allclose(p.state[1, 0], [76.0, 0, 0, 16.0, -2.0, 0.0], atol=1e-3)
    ttc, ettc = c.ttc(p), c.ettc(p)
    # the gap closes as v_rel t + t²
    gap, v_rel = np.array([34.3, 31.3]), np.array([2.0, 4.0])
    expected = -0.5 * v_rel + np.sqrt(0.25 * v_rel**2 + gap)
    assert ttc.state[:, 0].tolist() == [State.NO_CONFLICT, State.NO_CONFLICT, State.NOT_COMPUTED]
    assert (expected > 3.0).all()
    assert ettc.state[:, 0].tolist() == ttc.state[:, 0].tolist()
    longer = c.ettc(c.driven_pairs(recorded(), "1", np.array([1.0, 2.0]), horizon=6.0))
    np.testing.assert_allclose(longer.value[:, 0], expected, atol=0.002)


def test_pet_of_driven_paths():
    p = c.driven_pairs(recorded(), "1", np.array([0.0]), horizon=5.0, driven=True)
    leaves, enters = (30 + 0.95 + 2.35) / 20, (40 - 0.95 - 2.35) / 12
    assert c.pet(p).value[0, 1] == pytest.approx(enters - leaves, abs=0.005)
    with pytest.raises(ResimError, match="no object '9'"):
        c.driven_pairs(recorded(), "9", np.array([0.0]), horizon=5.0)


def test_a_measure_has_numbers_where_its_state_says_so_and_only_there():
    with pytest.raises(ResimError, match="TTC: expected NaN where there is no value"):
        MeasureValues("TTC", "s", np.array([1.0, 2.0]), np.array([0, 1], dtype=np.uint8), "low")
    with pytest.raises(ResimError, match="state has shape"):
        MeasureValues("TTC", "s", np.array([1.0, 2.0]), np.array([0], dtype=np.uint8), "low")
