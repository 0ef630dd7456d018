from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from resim.core.errors import ResimError
from resim.metrics.drive import _planned, _planned_ways, drive


@pytest.fixture
def tracks(described, network):
    """Give the fitted tracks of a shipped recording, ten times a second."""

    def get(name, basis="GT"):
        scenario = described(name, basis)
        begin = scenario.ego.spawn_time
        return scenario.tracks(network, np.arange(begin, begin + scenario.duration, 0.1)), scenario.ego.id

    return get


def test_the_risk_of_the_corner_case_peaks_where_the_object_brakes_in_front(tracks):
    motion, ego = tracks("cut_in_brake")
    made = drive(motion, ego=ego)
    found = made.risk()
    assert set(made.path) == {"state"}
    peak = made.t[np.argmax(found.r_ind)]
    braking = made.t[np.argmin(motion.a[motion.index("1"), : len(made.t)])]
    assert braking < peak < 7.6  # until the EGO answers, late, at 7.3 s
    assert 0.005 < found.r_ind.max() < 0.6
    assert found.r_ind[0] < 0.005
    assert made.covered[made.present].mean() > 0.9


def test_the_rear_end_collision_ends_at_full_risk(tracks):
    motion, ego = tracks("rear_end")
    found = drive(motion, ego=ego).risk()
    assert found.r_ind[-1] > 0.9
    assert found.r_ind[0] < found.r_ind[-1]


def test_the_driven_path_is_where_it_went(tracks):
    motion, ego = tracks("cut_in_brake")
    made = drive(motion, ego=ego, path="driven")
    row = motion.index(ego)
    np.testing.assert_allclose(made.scenes.plan[10, :5, 0], motion.x[row, 10:15], atol=1e-9)
    assert set(made.path) == {"driven"}
    assert np.isfinite(made.scenes.plan).all()


def test_a_plan_goes_before_the_state_while_it_is_fresh(tracks):
    motion, ego = tracks("cut_in_brake")
    row, start = motion.index(ego), float(motion.t[20])
    ahead = np.arange(0.0, 5.0, 0.1)
    x, v = motion.x[row, 20] + (motion.v[row, 20] - 3.0 * ahead) * ahead, motion.v[row, 20] - 6.0 * ahead
    brakes = np.column_stack([start + ahead, x, motion.y[row, 20] + 0.0 * ahead, v])[v > 0.0]
    made = drive(motion, ego=ego, plans=[(start, brakes)])
    assert made.path[20] == made.path[25] == "plan"
    assert made.path[19] == made.path[26] == "state"
    near = made.scenes.plan[20, :20, 0] - np.interp(0.1 * np.arange(20), brakes[:, 0] - start, brakes[:, 1])
    np.testing.assert_allclose(near, 0.0, atol=0.05)


@pytest.mark.parametrize("frame", ["the EGO's", "backwards", "mirrored", "km", "stands", "ms"])
def test_a_plan_that_no_vehicle_can_follow_is_none(tracks, frame):
    """It says nothing of where the EGO goes: along it, that stands still or goes back, nothing is in the way."""
    motion, ego = tracks("cut_in_brake")
    row, start = motion.index(ego), float(motion.t[20])
    ahead, v = np.arange(0.0, 5.0, 0.1), float(motion.v[row, 20])
    x, y = motion.x[row, 20] + v * ahead, motion.y[row, 20] + 0.0 * ahead
    told = {
        "the EGO's": (ahead, y, -v * ahead), "backwards": (ahead, -x, y), "mirrored": (ahead, y, x),
        "km": (ahead, x / 1000.0, y / 1000.0), "stands": (ahead, 0.0 * x, y), "ms": (1000.0 * ahead, x, y),
    }[frame]  # fmt: skip
    plan = np.column_stack([start + told[0], told[1], told[2], v + 0.0 * ahead])
    assert drive(motion, ego=ego, plans=[(start, plan)]).path[20] == "state"
    plan = np.column_stack([start + ahead, x, y, v + 0.0 * ahead])
    assert drive(motion, ego=ego, plans=[(start, plan)]).path[20] == "plan"


def test_a_plan_begins_at_the_present_state_however_it_was_made(tracks):
    """At present speed, where the EGO is; a plan that begins later is reached, one that is over is none."""
    motion, ego = tracks("cut_in_brake")
    row, start = motion.index(ego), float(motion.t[20])
    x, y, v = (float(c[row, 20]) for c in (motion.x, motion.y, motion.v))
    ahead = np.arange(1.0, 5.0, 0.5)
    late = np.column_stack([start + ahead, x + 0.8 * v * ahead, y + 0.0 * ahead, 0.8 * v + 0.0 * ahead])
    made = drive(motion, ego=ego, plans=[(start, late)])
    assert made.path[20] == "plan"
    pose = made.scenes.plan[20]
    np.testing.assert_allclose(pose[0], [x, y, motion.heading[row, 20], v])
    np.testing.assert_allclose(pose[10:, 0], x + 0.8 * v * np.arange(1.0, 4.05, 0.1), atol=0.01)
    assert (np.diff(pose[:, 0]) > 0.7 * v * 0.1).all()  # it does not wait for the plan to begin
    over = np.column_stack([start - ahead[::-1], x + v * ahead, y + 0.0 * ahead, v + 0.0 * ahead])
    assert drive(motion, ego=ego, plans=[(start, over)]).path[20] == "state"


def test_objects_that_are_not_there_have_no_risk(tracks):
    motion, ego = tracks("overtake")
    gone = motion.valid.copy()
    other = next(n for n in range(len(motion)) if motion.ids[n] != ego)
    gone[other, :30] = False
    blank = {
        c: np.where(gone, getattr(motion, c), np.nan) for c in ("x", "y", "heading", "v", "a", "yaw_rate")
    }
    found = drive(replace(motion, valid=gone, **blank), ego=ego).risk()
    column = [n for n in range(len(motion)) if motion.ids[n] != ego].index(other)
    assert np.isnan(found.r_to[:30, column]).all()
    assert np.isfinite(found.r_to[30:, column]).all()
    assert np.isfinite(found.r_ind).all()


def test_tracks_without_accelerations_or_without_the_ego_are_refused(tracks):
    motion, ego = tracks("rear_end")
    with pytest.raises(ResimError, match="acceleration"):
        drive(replace(motion, a=None), ego=ego)
    with pytest.raises(ResimError, match="no object"):
        drive(motion, ego="nobody")


def test_ways_of_many_plans_are_those_of_each():
    rng = np.random.default_rng(5)
    plans = []
    for n in range(12):
        t = 0.2 * n + np.cumsum(rng.uniform(0.1, 0.4, 13))
        v = rng.uniform(1.0, 30.0) * np.ones(13)
        turn = 0.3 * n + np.cumsum(rng.normal(0.0, 0.1, 13))
        x, y = np.cumsum(v * np.cos(turn) * 0.2), np.cumsum(v * np.sin(turn) * 0.2)
        plans.append(np.column_stack([t, x, y, v]))
    plans[3][:, 1:] = [5.0, 5.0, 0.0]  # stands: no point tells a heading
    plans[4][5:, 1:] = [*plans[4][5, 1:3], 0.0]  # comes to a stand
    plans[5] = plans[5][:7]
    plans[6] = plans[6][:1]
    plans[7][:, 0] += 1.0  # begins later than its scene
    plans[8][:, 3] *= -1.0  # reverses
    ego = np.column_stack([[p[0, 1], p[0, 2], 0.1, 10.0, 0.0, 0.0] for p in plans]).T
    begin = np.array([p[min(1, len(p) - 1), 0] for p in plans])
    begin[7] -= 1.0
    at = begin[:, None] + np.arange(31) * 0.1
    each = np.stack([_planned(p, e, when) for p, e, when in zip(plans, ego, at, strict=True)])
    together = _planned_ways(plans, ego, at)
    turned = np.remainder(together[..., 2] - each[..., 2] + np.pi, 2.0 * np.pi) - np.pi
    np.testing.assert_allclose(turned, 0.0, atol=1e-9)
    np.testing.assert_allclose(together[..., [0, 1, 3]], each[..., [0, 1, 3]], atol=1e-9)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("last", [0.0, -4e-16, 4e-16])
def test_who_comes_to_a_halt_looks_as_just_before(way, last):
    """A speed that rounding leaves on either side of 0 turns nobody round, forwards (way 1) or backwards."""
    t = np.arange(0.0, 3.01, 0.25)
    x, v = way * (2.0 * t - t * t / 3.0), way * (2.0 - 2.0 * t / 3.0)
    plan = np.column_stack([t, x, np.zeros_like(t), v])
    plan[-1, 3] = last
    ego = np.array([0.0, 0.0, 0.0, 2.0 * way])
    for found in (_planned(plan, ego, t), _planned_ways([plan], ego[None], t[None])[0]):
        np.testing.assert_allclose(np.cos(found[:, 2]), 1.0)
