from __future__ import annotations

import timeit

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.errors import InputError
from resim.road.path import lane_path


@pytest.fixture(scope="module")
def path(proving_ground):
    return lane_path(proving_ground, "1", -2, 800.0, 1500.0)


def test_points_lie_on_the_lane_in_driving_direction(proving_ground, path):
    assert (np.diff(path.s) > 0.0).all()
    assert path.s[0] <= -50.0 + 1e-6
    assert path.s[-1] >= 1500.0
    assert not path.ends
    found = proving_ground.to_road(path.x, path.y)
    assert set(found.lane.tolist()) == {-2}
    assert set(found.road.tolist()) == {"1", "2"}
    np.testing.assert_allclose(found.t, 0.0, atol=1e-6)
    at = np.interp(0.0, path.s, path.x), np.interp(0.0, path.s, path.y)
    np.testing.assert_allclose(at, proving_ground.to_xy("1", -2, 800.0, 0.0), atol=1e-9)


def test_heading_and_curvature_go_with_the_points(path):
    chord = np.unwrap(np.arctan2(np.diff(path.y), np.diff(path.x)))
    np.testing.assert_allclose(0.5 * (path.heading[1:] + path.heading[:-1]), chord, atol=1e-4)
    steep = np.gradient(path.heading, path.s)
    np.testing.assert_allclose(path.curvature, steep, atol=2e-3)


def test_neighbours_widths_and_limits(path):
    np.testing.assert_allclose(path.left_width[path.s < 1400], 3.5)
    assert path.at(50.0).right_width == 0.0  # the shoulder is no driving lane
    assert path.at(160.0).right_width == pytest.approx(1.75, abs=0.01)
    assert path.at(300.0).right_width == pytest.approx(3.5)
    np.testing.assert_allclose(path.half_width, 1.75)
    assert path.at(0.0).speed_limit * 3.6 == pytest.approx(130.0)
    assert path.at(450.0).speed_limit * 3.6 == pytest.approx(100.0)


def test_the_oncoming_lane_runs_the_other_way_and_has_no_neighbour(proving_ground):
    path = lane_path(proving_ground, "2", 1, 400.0, 1000.0)
    assert not path.ends
    assert np.cos(path.at(900.0).heading) < 0.0
    assert path.left_width.max() == 0.0
    assert path.right_width.max() == 0.0


def test_where_the_road_ends_the_path_goes_straight_on(proving_ground):
    path = lane_path(proving_ground, "2", -1, 700.0, 300.0, behind=20.0)
    assert path.ends
    assert path.end == pytest.approx(103.3, abs=0.5)
    beyond = path.s > path.end
    assert np.ptp(path.heading[beyond]) == 0.0
    assert (path.curvature[beyond] == 0.0).all()
    assert path.s[-1] == pytest.approx(300.0)


def test_before_the_start_of_the_road_it_is_straight_too(proving_ground):
    path = lane_path(proving_ground, "1", -1, 10.0, 50.0)
    np.testing.assert_allclose(path.x[0], -40.0, atol=1e-6)
    np.testing.assert_allclose(path.y, -1.75, atol=1e-9)


def test_a_lane_that_does_not_exist_is_an_error(proving_ground):
    with pytest.raises(InputError, match="no lane -4"):
        lane_path(proving_ground, "1", -4, 100.0, 50.0)


@settings(max_examples=200, deadline=None)
@given(st.floats(-60.0, 1550.0), st.floats(-15.0, 15.0))
def test_project_inverts_xy(path, s, d):
    found_s, found_d = path.project(*path.xy(s, d))
    assert found_s[0] == pytest.approx(s, abs=1e-7)
    assert found_d[0] == pytest.approx(d, abs=1e-7)


def test_project_agrees_with_brute_force_and_is_the_same_for_few_and_many(path):
    rng = np.random.default_rng(2)
    s, d = rng.uniform(-40, 1490, 300), rng.uniform(-12, 12, 300)
    x, y = path.xy(s, d)
    fine_s = np.linspace(-50, 1500, 155_001)
    fine_x, fine_y = path.xy(fine_s, 0.0)
    found_s, found_d = path.project(x, y)
    for i in range(0, 300, 15):
        gap = np.hypot(fine_x - x[i], fine_y - y[i])
        assert abs(found_d[i]) == pytest.approx(gap.min(), abs=1e-4)
        assert found_s[i] == pytest.approx(fine_s[gap.argmin()], abs=0.03)
    few = [path.project(x[i : i + 6], y[i : i + 6]) for i in range(0, 300, 6)]
    np.testing.assert_allclose(np.concatenate([a for a, _ in few]), found_s, atol=1e-9)
    np.testing.assert_allclose(np.concatenate([b for _, b in few]), found_d, atol=1e-9)


def test_d_is_continuous_across_points(path):
    s = np.linspace(500.0, 510.0, 20_001)
    x, y = path.xy(s, 4.0)
    _, d = path.project(x, y)
    assert np.abs(np.diff(d)).max() < 1e-9


def test_project_takes_empty_and_scalar(path):
    s, d = path.project([], [])
    assert len(s) == len(d) == 0
    x, y = path.xy(5.0, 1.0)
    assert path.project(x, y)[0].shape == (1,)


def test_project_refuses_places_without_an_x_or_a_y(path):
    with pytest.raises(ValueError, match="not equally many"):
        path.project(np.zeros(20), np.zeros(19))


def test_project_is_fast_enough_for_every_step(path):
    x, y = path.xy(np.linspace(0, 300, 6), np.linspace(-5, 5, 6))
    path.project(x, y)
    assert min(timeit.repeat(lambda: path.project(x, y), number=200, repeat=5)) / 200 < 100e-6


def test_forks_go_straight_on(shared_map):
    net = shared_map("xodr/esmini/fabriksgatan.xodr")
    for road in net.roads.values():
        for lane in road.sections[0].lanes.values():
            if road.junction or not lane.drivable or not lane.id:
                continue
            path = lane_path(net, road.id, lane.id, 0.5 * road.length, 300.0)
            inside = path.s < path.end
            assert np.abs(np.diff(path.heading[inside])).max() < 0.3
            again = lane_path(net, road.id, lane.id, 0.5 * road.length, 300.0)
            np.testing.assert_array_equal(path.x, again.x)


@pytest.mark.parametrize(
    "name", ["xodr/carla/Town04.xodr", "ngsim/USA_US101-22_1_T-1.xodr", "mcity/mcity.xodr"]
)
def test_paths_on_real_maps_run_forwards(shared_map, name):
    net = shared_map(name)
    for road in list(net.roads.values())[::6]:
        for lane in road.sections[0].lanes.values():
            if lane.drivable and lane.id:
                s = 0.4 * min(road.sections[0].end, road.length)
                path = lane_path(net, road.id, lane.id, s, 400.0)
                assert (np.diff(path.s) > 1e-6).all()
                ahead = np.diff(path.x) * np.cos(path.heading[:-1]) + np.diff(path.y) * np.sin(
                    path.heading[:-1]
                )
                assert (ahead > 0.0).all()
                assert path.s[0] <= -50.0 + 1e-6
                assert path.s[-1] >= 400.0 - 1e-6
