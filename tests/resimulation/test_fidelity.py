from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from resim.core.geometry import wrap_angle
from resim.core.tracks import Tracks
from resim.recordings import Recording
from resim.resimulation import Resimulation, ResimulationOptions, fidelity, resimulate
from resim.resimulation.fidelity import EGO_ROW, SUMS, TO_ROWS
from resim.road.opendrive import RoadNetwork
from resim.scenario import maneuvers
from resim.scenario.scenario import Scenario, describe
from resim.simulation.function.interface import Build

LANE = {1: 1.75, -1: -1.75, -2: -5.25}  # y of the lane centres of road 1, along +x


def tracks(t: object, **objects: tuple[object, object, object, object]) -> Tracks:
    """Objects by id: x, y, heading, v, each a number or one per time; NaN where x is."""
    t_ = np.array(t, dtype=float)
    columns = [
        np.array([np.broadcast_to(np.asarray(o[i], float), t_.shape) for o in objects.values()])
        for i in range(4)
    ]
    valid, n = np.isfinite(columns[0]), len(objects)
    x, y, heading, v = (np.where(valid, c, np.nan) for c in columns)
    a = np.gradient(v, t_, axis=1) if len(t_) > 1 else np.zeros_like(v)
    return Tracks(
        t=t_, ids=np.array(list(objects)), kind=np.array(["car"] * n), x=x, y=y, heading=heading, v=v,
        length=np.full(n, 4.0), width=np.full(n, 2.0), valid=valid, a=a,
    )  # fmt: skip


def test_errors_are_later_minus_earlier() -> None:
    gt = tracks([0.0, 1.0], e=(0.0, 0.0, 0.1, 10.0), a=([5.0, 6.0], 1.0, 0.0, 8.0))
    sd = tracks([0.0, 1.0], a=([8.0, 6.0], [5.0, 0.5], 0.3, 7.0), e=(0.5, 0.0, 0.1, 10.5))
    s = fidelity.sensor_error(gt, sd, ego="e")
    assert s.ids.tolist() == ["e", "a"]
    np.testing.assert_allclose(s.x, [[0.5, 0.5], [3.0, 0.0]])
    np.testing.assert_allclose(s.y, [[0.0, 0.0], [4.0, -0.5]])
    np.testing.assert_allclose(s.d, [[0.5, 0.5], [5.0, 0.5]])
    np.testing.assert_allclose(s.v, [[0.5, 0.5], [-1.0, -1.0]])
    np.testing.assert_allclose(s.heading, [[0.0, 0.0], [0.3, 0.3]])


def test_heading_errors_go_the_short_way_round() -> None:
    one = tracks([0.0], e=(0.0, 0.0, 3.1, 1.0))
    two = tracks([0.0], e=(0.0, 0.0, -3.1, 1.0))
    assert fidelity.difference(two, one, ego="e").heading[0, 0] == pytest.approx(2.0 * math.pi - 6.2)
    assert fidelity.difference(one, two, ego="e").heading[0, 0] == pytest.approx(6.2 - 2.0 * math.pi)


def test_sensor_errors_are_taken_at_the_times_of_the_sensor() -> None:
    gt = tracks([0.0, 0.1, 0.2], e=([0.0, 1.0, 2.0], 0.0, 0.0, 10.0))
    sd = tracks([0.05, 0.15, 0.25], e=([0.6, 1.6, 2.6], 0.0, 0.0, 10.0))
    s = fidelity.sensor_error(gt, sd, ego="e")
    np.testing.assert_array_equal(s.t, sd.t)
    np.testing.assert_allclose(s.x, [[0.1, 0.1, np.nan]])


def test_objects_that_only_one_side_knows_have_no_error() -> None:
    one = tracks([0.0], e=(0.0, 0.0, 0.0, 1.0), lost=(9.0, 0.0, 0.0, 1.0))
    two = tracks([0.0], ghost=(5.0, 0.0, 0.0, 1.0), e=(0.0, 0.0, 0.0, 1.0))
    assert fidelity.difference(two, one, ego="e").ids.tolist() == ["e"]
    with pytest.raises(ValueError, match="equal times"):
        fidelity.difference(two, replace(one, t=one.t + 1.0), ego="e")


def test_statistics_are_numpys_over_all_samples_that_there_are() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(3, 40))
    x[1, 10:20] = np.nan
    errors = fidelity.StepErrors(np.arange(40.0), np.array(["e", "1", "2"]), x, 0.0 * x, x + 1.0, 2.0 * x)
    to = errors.statistics(TO_ROWS)
    v = x[1:][np.isfinite(x[1:])] + 1.0
    assert to["v"] == pytest.approx(
        {"mean": v.mean(), "std": v.std(), "min": v.min(), "max": v.max(), "q50": np.median(v),
         "q25": np.quantile(v, 0.25), "q75": np.quantile(v, 0.75)}
    )  # fmt: skip
    assert to["d"] is not None
    assert to["d"]["mean"] == pytest.approx(np.abs(v - 1.0).mean())
    ego = errors.statistics(EGO_ROW)
    assert ego["heading"] is not None
    assert ego["heading"]["max"] == 2.0 * x[0].max()
    assert fidelity.statistics(np.full(3, np.nan)) is None
    frame = errors.frame("S")
    assert len(frame) == 110
    assert frame.columns.tolist() == ["step", "t", "id", "d", "v", "heading"]


def test_an_ego_alone_has_no_statistics_of_others() -> None:
    one = tracks([0.0, 1.0], e=(0.0, 0.0, 0.0, 1.0))
    assert fidelity.difference(one, one, ego="e").statistics(TO_ROWS) == {
        "d": None,
        "v": None,
        "heading": None,
    }


@pytest.fixture(scope="module")
def resimulated(shipped: Callable[[str], Recording]) -> Callable[[str, str], Resimulation]:
    from pathlib import Path

    from resim.simulation.function.interface import load_build

    done: dict[tuple[str, str], Resimulation] = {}
    builds = Path(__file__).parents[2] / "adfunc" / "builds"

    def get(name: str, function: str) -> Resimulation:
        if (name, function) not in done:
            build: Build = load_build(builds / f"{function}-1.0.toml")
            done[name, function] = resimulate(
                shipped(name), build, ResimulationOptions(stop_at_collision=False)
            )
        return done[name, function]

    return get


@pytest.mark.parametrize("name", ["cut_in_brake", "rear_end", "overtake"])
@pytest.mark.parametrize("function", ["highway_pilot", "replay"])
def test_the_steps_add_up_to_the_pipeline(
    resimulated: Callable[[str, str], Resimulation], name: str, function: str
) -> None:
    """Eq. 5.6, as vectors: what is left is interpolation between the times of the steps."""
    errors = resimulated(name, function).errors
    table = fidelity.sums(errors)
    assert set(table) == set(SUMS) == {"PIPE_GT", "PIPE_SD"}
    for whole, parts in table.items():
        assert set(parts) == {"ego", "to"}
        for who, quantities in parts.items():
            assert abs(quantities["d"]["sum"] - quantities["d"]["measured"]) < 5e-3, (whole, who)
            for quantity, near in (("v", 0.01), ("heading", 1e-3)):
                row = quantities[quantity]
                assert abs(row["sum"] - row["measured"]) < near, (whole, who, quantity)
                assert row["sum"] == pytest.approx(row["sum_of_means"], abs=1e-9)
            assert quantities["d"]["sum_of_means"] >= quantities["d"]["sum"] - 1e-12  # the triangle's


def test_sums_need_all_their_parts(resimulated: Callable[[str, str], Resimulation]) -> None:
    errors = dict(resimulated("cut_in_brake", "replay").errors)
    del errors["S"]
    assert set(fidelity.sums(errors)) == {"PIPE_GT"}


def test_every_error_is_the_difference_of_its_two_sides(
    resimulated: Callable[[str, str], Resimulation], network: RoadNetwork
) -> None:
    r = resimulated("cut_in_brake", "highway_pilot")
    gt, drive = r.recording.gt, r.drives["rGT"]
    refit = r.refits["rGT"]
    pipe = refit.tracks(network, gt.t).select(["ego", "1"])
    measured = gt.select(["ego", "1"])
    np.testing.assert_allclose(r.errors["PIPE_GT"].x, pipe.x - measured.x, atol=1e-9)
    fit = r.described["GT"].tracks(network, gt.t).select(["ego", "1"])
    np.testing.assert_allclose(r.errors["FIT_GT"].v, fit.v - measured.v, atol=1e-9)
    truth = drive.truth.select(["ego", "1"])
    described = r.described["GT"].tracks(network, truth.t).select(["ego", "1"])
    np.testing.assert_allclose(
        r.errors["SIM_GT"].heading, wrap_angle(truth.heading - described.heading), atol=1e-9
    )
    again = refit.tracks(network, truth.t).select(["ego", "1"])
    np.testing.assert_allclose(r.errors["FIT_rGT"].y, again.y - truth.y, atol=1e-9)


def test_the_reaction_is_the_first_braking_that_is_more_than_half_a_metre_per_second_squared() -> None:
    t = np.arange(0.0, 6.0, 0.01)
    a = np.where(t < 2.0, 0.3, np.where(t < 3.0, -0.5, np.where(t < 4.0, -0.6, 1.0)))
    ego = replace(tracks(t, o=(0.0, 0.0, 0.0, 10.0), e=(0.0, 0.0, 0.0, 10.0)), a=np.stack([0.0 * a - 9.0, a]))
    assert maneuvers.reaction_time(ego, ego="e") == pytest.approx(3.0, abs=0.011)
    assert maneuvers.reaction_time(replace(ego, a=np.abs(ego.a)), ego="e") is None  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="acceleration"):
        maneuvers.reaction_time(replace(ego, a=None), ego="e")


def test_the_reaction_of_a_fitted_drive_is_that_of_the_drive(network: RoadNetwork) -> None:
    """Measured with 1 cm of noise: v = 20, from 2 s on braking that comes up by 1 m/s³; under -0.5 at 2.5 s."""
    t = np.arange(0.0, 6.0, 0.04)
    since = np.clip(t - 2.0, 0.0, None)
    rng = np.random.default_rng(2)
    x = 300.0 + 20.0 * t - since**3 / 6.0 + rng.normal(scale=0.01, size=len(t))
    y = -5.25 + rng.normal(scale=0.01, size=len(t))
    measured = tracks(t, e=(x, y, 0.0, 20.0 - since**2 / 2.0))
    scenario = describe(measured, network, ego="e", map_name="m")
    splines = scenario.tracks(network, np.arange(0.0, scenario.duration, 0.01))
    assert maneuvers.reaction_time(splines, ego="e") == pytest.approx(2.5, abs=0.25)


def swerving(lanes: list[int], x0: float = 200.0) -> Tracks:
    """An EGO at 25 m/s that goes from lane to lane, 4 s each, crossing the border half-way."""
    t = np.arange(0.0, 4.0 * len(lanes), 0.04)
    y = np.array([LANE[lane] for lane in lanes])
    u = np.clip((t % 4.0) / 4.0, 0.0, 1.0)
    i = np.minimum((t // 4.0).astype(int), len(lanes) - 1)
    smooth = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    way = y[i] + (y[np.minimum(i + 1, len(lanes) - 1)] - y[i]) * smooth
    return tracks(
        t, o=(0.0, 0.0, 0.0, 0.0), e=(x0 + 25.0 * t, way, np.arctan2(np.gradient(way, t), 25.0), 25.0)
    )


@pytest.mark.parametrize(
    ("lanes", "expected"),
    [
        ([-2], []),
        ([-2, -2, -2], []),
        ([-2, -1], ["lane_change_left"]),
        ([-1, -2], ["lane_change_right"]),
        ([-2, -1, -2], ["lane_change_left", "lane_change_right"]),
        ([-1, -2, -1, -1], ["lane_change_right", "lane_change_left"]),
    ],
)
def test_lane_changes_are_told_by_side_in_their_order(
    network: RoadNetwork, lanes: list[int], expected: list[str]
) -> None:
    drive = swerving(lanes)
    changes = maneuvers.lane_changes(drive, network, ego="e")
    assert [name for _, name in changes] == expected
    assert maneuvers.decision(drive, network, ego="e") == expected
    for k, (t, _) in enumerate(changes):
        assert t == pytest.approx(4.0 * k + 2.0, abs=0.05)  # the centre enters the other lane


def test_within_the_lane_is_no_lane_change(network: RoadNetwork) -> None:
    t = np.arange(0.0, 8.0, 0.04)
    near = tracks(t, e=(200.0 + 20.0 * t, -5.25 + 1.7 * np.sin(t), 0.0, 20.0))
    over = tracks(t, e=(200.0 + 20.0 * t, -5.25 + 1.8 * np.sin(t), 0.0, 20.0))
    assert maneuvers.decision(near, network, ego="e") == []
    assert maneuvers.decision(over, network, ego="e")[:2] == ["lane_change_left", "lane_change_right"]


def test_a_lane_change_on_a_bend_is_told_from_the_bend(network: RoadNetwork) -> None:
    road = network.roads["2"]
    s = np.linspace(20.0, road.length - 20.0, 300)
    for lane, expected in (((-1, -1), []), ((-2, -1), ["lane_change_left"])):
        u = np.clip((np.arange(300) - 100) / 100.0, 0.0, 1.0)
        x, y = (np.where(u < 0.5, a, b) for a, b in zip(
            network.to_xy("2", lane[0], s, 0.0), network.to_xy("2", lane[1], s, 0.0), strict=True))  # fmt: skip
        drive = tracks(0.1 * np.arange(300), e=(x, y, network.lane_heading("2", lane[0], s), 20.0))
        assert maneuvers.decision(drive, network, ego="e") == expected


def test_decisions_stand_in_the_order_of_time(network: RoadNetwork) -> None:
    drive = swerving([-2, -1])
    early, late = (np.where(drive.t > t, -2.0, 0.0) for t in (1.0, 3.0))
    for a, expected in ((early, ["brake", "lane_change_left"]), (late, ["lane_change_left", "brake"])):
        assert maneuvers.decision(replace(drive, a=np.stack([a, a])), network, ego="e") == expected


def test_collisions_are_first_overlaps_of_boxes_with_the_ego() -> None:
    t = np.arange(0.0, 3.0, 0.1)
    drive = tracks(
        t, ahead=(30.0, 0.0, 0.0, 0.0), e=(20.0 * t, 0.0, 0.0, 20.0), beside=(20.0 * t, 2.1, 0.0, 20.0),
        touched=(np.where(t < 1.05, np.nan, 20.0 * t), -1.9, 0.0, 20.0), late=(52.0, 0.5, math.pi / 2, 0.0),
        twin=(30.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    hits = fidelity.collisions(drive, ego="e")
    assert [name for _, name in hits] == ["touched", "ahead", "twin", "late"]
    np.testing.assert_allclose([t for t, _ in hits], [1.1, 1.3, 1.3, 2.5])
    assert fidelity.collisions(drive.select(["e", "beside"]), ego="e") == []


def test_a_spline_knows_its_reaction(network: RoadNetwork, described: Callable[..., Scenario]) -> None:
    """v = 20 - 2 sin² t over a natural spline: its slope is first under -0.5 where it is."""
    scenario = described("cut_in_brake")
    knots = np.linspace(0.0, 3.0, 40)
    v = CubicSpline(knots, 20.0 - 2.0 * np.sin(knots) ** 2, bc_type="natural")
    ego = replace(scenario.ego, v=v, heading=CubicSpline(knots[[0, -1]], [0.0, 0.0], bc_type="natural"))
    t = np.arange(0.0, 3.0, 0.01)
    own = replace(scenario, ego=ego, objects=()).tracks(network, t)
    expected = 0.5 * math.asin(0.25)  # a = -2 sin 2t
    assert maneuvers.reaction_time(own, ego="ego") == pytest.approx(expected, abs=0.02)


def test_overtaking_through_the_oncoming_lane_is_a_lane_change(network: RoadNetwork) -> None:
    t = np.arange(0.0, 8.0, 0.04)
    y = LANE[-1] + 3.5 * np.clip((t - 2.0) / 3.0, 0.0, 1.0)
    [(when, side)] = maneuvers.lane_changes(tracks(t, e=(300.0 + 20.0 * t, y, 0.0, 20.0)), network, ego="e")
    assert side == "lane_change_left"
    assert when == pytest.approx(3.5, abs=0.1)


def test_a_slow_ground_truth_still_has_a_sensor_error() -> None:
    slow, fast = np.arange(0.0, 4.01, 0.5), np.arange(0.0, 4.0, 0.1)
    gt, sd = (tracks(t, e=(10.0 * t + off, 0.0, 0.0, 10.0)) for t, off in ((slow, 0.0), (fast, 1.0)))
    np.testing.assert_allclose(fidelity.sensor_error(gt, sd, ego="e").x, 1.0)


def test_turning_off_is_no_lane_change(network: RoadNetwork) -> None:
    t = np.arange(0.0, 2.5, 0.04)
    turn = 0.6 * t
    x, y = 300.0 + 10.0 * np.sin(turn), LANE[-1] + 10.0 * (1.0 - np.cos(turn))
    assert maneuvers.lane_changes(tracks(t, e=(x, y, turn, 6.0)), network, ego="e") == []
