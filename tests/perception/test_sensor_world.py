from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.geometry import box_corners
from resim.perception.model import FEATURES
from resim.perception.runtime.kernel import PAST_ROWS, V, remember
from resim.perception.runtime.world import features, occlusion
from resim.scenario.maneuvers import MANEUVERS, SEEN_ACROSS, SEEN_BRAKING, momentary
from resim.simulation.function.interface import EgoState

BOX = st.tuples(
    st.floats(-60, 60), st.floats(-20, 20), st.floats(-3.1, 3.1), st.floats(1, 18), st.floats(1, 2.6)
)


def test_features_are_what_the_names_say() -> None:
    ego = EgoState(0.0, 0.0, 1.2, 20.0)
    seen = dict(zip(FEATURES, features(ego, [3.0], [4.0], [np.pi], [5.0], [-2.0])[0].tolist(), strict=True))
    assert seen == pytest.approx(
        {"range": 5.0, "bearing": np.arctan2(4, 3), "relative_speed": -25.0, "acceleration": -2.0}
    )


def test_features_take_objects_and_times_at_once() -> None:
    table = np.ones((3, 7))
    assert features(EgoState(0, 0, 0, 1.0), table, table, table, table, table).shape == (3, 7, 4)


def test_maneuvers() -> None:
    does = momentary([0.0, 0.02, -0.02, 0.02, 0.005, 0.0], [20.0] * 6, [0.0, 0.0, 0.0, -1.1, 0.0, -0.9])
    assert [MANEUVERS[k] for k in does] == [
        "follow_lane", "lane_change_left", "lane_change_right", "braking", "follow_lane", "follow_lane",
    ]  # fmt: skip


@settings(deadline=None)  # the first example may compile
@given(st.floats(-np.pi, np.pi), st.floats(0.0, 50.0), st.sampled_from([-1.1, -1.0, -0.9, 0.0, 2.0]))
def test_the_kernel_means_the_same_by_a_maneuver(heading: float, v: float, a: float) -> None:
    dt = 0.04
    known, maneuver = np.zeros((PAST_ROWS, 2, 1)), np.zeros((1, 2, 1), dtype=np.int8)
    known[V, 0] = v - a * dt
    gained = (v - known[V, 0, 0]) / dt
    remember(
        known,
        maneuver,
        1,
        np.zeros(1, dtype=complex),
        np.array([heading]),
        np.array([v]),
        np.zeros(1),
        SEEN_BRAKING * dt,
        SEEN_ACROSS,
    )
    if abs(gained - SEEN_BRAKING) > 1e-9:  # at the limit itself rounding decides
        assert maneuver[0, 1, 0] == momentary(heading, v, gained)


def test_who_runs_no_model_loads_no_compiler() -> None:
    code = (
        "import sys, resim.cli.run, resim.report, resim.perception.training; sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_box_behind_an_equal_one_is_hidden_and_half_of_one_beside_it() -> None:
    x, y = np.array([10.0, 30.0, 30.0]), np.array([0.0, 0.0, 40.0])
    assert occlusion(x, y, np.zeros(3), np.full(3, 4.0), np.full(3, 2.0)).tolist() == [0.0, 1.0, 0.0]
    edge = 1.0 / 8.0  # slope of the front box's left edge, seen from the EGO
    far = occlusion([10.0, 100.0], [0.0, 100.0 * edge], [0.0, np.pi / 2], [4.0, 10.0], [2.0, 1e-9])
    left, right = np.arctan(np.array([100 * edge + 5, 100 * edge - 5]) / 100)
    assert far[1] == pytest.approx((np.arctan(edge) - right) / (left - right))


def test_who_stands_on_the_ego_hides_everything() -> None:
    assert occlusion([0.5, -30.0], [0.0, 0.0], [0.0, 0.0], [4.7, 4.7], [1.9, 1.9]).tolist() == [0.0, 1.0]


@given(st.lists(BOX, min_size=2, max_size=6))
def test_occlusion_agrees_with_rays(boxes: list[tuple[float, ...]]) -> None:
    x, y, heading, length, width = np.array(boxes).T
    if np.any(np.hypot(x, y) < 12.0):  # the EGO outside of every box
        return
    corners = box_corners(x, y, heading, length, width)
    angle = np.arctan2(corners[..., 1], corners[..., 0]) - np.arctan2(y, x)[:, None]
    angle -= 2 * np.pi * np.round(angle / (2 * np.pi))
    low, high = angle.min(axis=1), angle.max(axis=1)
    rays = 4000
    share = occlusion(x, y, heading, length, width)
    for i in range(len(x)):
        ray = np.arctan2(y[i], x[i]) + low[i] + (high[i] - low[i]) * (np.arange(rays) + 0.5) / rays
        hidden = np.zeros(rays, dtype=bool)
        for j in np.flatnonzero(np.hypot(x, y) < np.hypot(x[i], y[i])):
            off = ray - np.arctan2(y[j], x[j])
            off -= 2 * np.pi * np.round(off / (2 * np.pi))
            hidden |= (off > low[j]) & (off < high[j])
        assert share[i] == pytest.approx(hidden.mean(), abs=1e-3)
