from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from resim.core.errors import ResimError
from resim.core.spec import to_json
from resim.core.tracks import Tracks
from resim.recordings import Recording, read_commonroad
from resim.resimulation import (
    STAGES,
    AssessmentOptions,
    Resimulation,
    ResimulationOptions,
    assess_resimulation,
    perceived_frame,
    resimulate,
)
from resim.resimulation.fidelity import STEPS
from resim.resimulation.report import BuildReport
from resim.resimulation.run import measured_tracks
from resim.resimulation.tables import tracks_frame
from resim.scenario.jscen import read_jscen
from resim.simulation.function.interface import Build, EgoState, Perceived, load_build

DATA = Path(__file__).parents[3] / "shared" / "data"
Shipped = Callable[[str], Recording]
Builds = Callable[[str], Build]


@pytest.fixture(scope="module")
def corner_case(shipped: Shipped) -> Resimulation:
    build = load_build(Path(__file__).parents[2] / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    return resimulate(shipped("cut_in_brake"), build)


def test_the_corner_case_is_one(corner_case: Resimulation) -> None:
    """Section 5.2: on GT, without the sensor's errors, the function reacts earlier and changes lanes."""
    report = corner_case.report
    assert report.decision["GT"] == ("brake",)
    assert "lane_change_left" in report.decision["rGT"]
    assert report.reaction_difference["rGT"] < -0.5
    assert report.reaction_difference["rGT"] == pytest.approx(report.reaction["rGT"] - report.reaction["GT"])
    assert report.collision == {"GT": False, "SD": False, "rGT": False, "rSD": False}
    assert report.build == BuildReport("highway_pilot", "1.0", True)
    assert report.warnings == ()


def test_todays_clock_and_places_of_utm_change_nothing(
    corner_case: Resimulation, shipped: Shipped, tmp_path: Path
) -> None:
    """The corner case 1,000 km away, at seconds since 1970: the same errors, decisions and reactions."""
    far, clock = 1e6, 1.7e9
    recording = shipped("cut_in_brake")
    road = etree.parse(recording.map)
    for geometry in road.getroot().iter("geometry"):
        for axis in "xy":
            geometry.set(axis, repr(float(geometry.get(axis)) + far))
    road.write(tmp_path / "far.xodr")
    gt, sd = (
        replace(one, t=one.t + clock, x=one.x + far, y=one.y + far) for one in (recording.gt, recording.sd)
    )
    plan = recording.plan.assign(
        **{name: recording.plan[name] + clock for name in ("t", "t_plan")},
        **{axis: recording.plan[axis] + far for axis in "xy"},
    )
    moved = replace(recording, map=tmp_path / "far.xodr", gt=gt, sd=sd, plan=plan)
    found, was = resimulate(moved, corner_case.build).report, corner_case.report
    assert (found.decision, found.collision, found.end, found.failure) == (
        was.decision, was.collision, was.end, was.failure,
    )  # fmt: skip
    for source, t in was.reaction.items():
        assert found.reaction[source] == pytest.approx(t + clock, abs=1e-4)
    for step, sides in was.errors.items():
        for side, quantities in sides.items():
            for quantity, value in to_json(quantities).items():
                assert to_json(found.errors[step][side])[quantity] == pytest.approx(value, abs=1e-3), (
                    step,
                    side,
                )


def test_an_object_faster_than_anything_is_refused_by_name(shipped: Shipped) -> None:
    """Positions 10,000 km off for a second: the fit bends through them."""
    recording = shipped("rear_end")
    row = next(n for n, name in enumerate(recording.gt.ids) if name != recording.ego)
    x = recording.gt.x.copy()
    x[row, (recording.gt.t > 3.0) & (recording.gt.t < 4.0)] = 1e7
    far = replace(recording, gt=replace(recording.gt, x=x), sd=None)
    build = load_build(Path(__file__).parents[2] / "adfunc" / "builds" / "replay-1.0.toml")
    with pytest.raises(
        ResimError, match=rf"GT: object '{recording.gt.ids[row]}' would drive at .* m/s at t = "
    ):
        resimulate(far, build)


@pytest.mark.parametrize(
    ("factor", "remedy"), [(1000.0, "t is in ms. Give t in seconds"), (200.0, "Cut the recording")]
)
def test_a_recording_too_long_is_told_its_unit_of_time(shipped: Shipped, factor: float, remedy: str) -> None:
    recording = shipped("rear_end")
    slow = replace(recording, gt=replace(recording.gt, t=recording.gt.t * factor), sd=None)
    with pytest.raises(ResimError, match=remedy):
        measured_tracks(slow)


def test_what_was_measured_is_judged_as_long_as_it_was_simulated(shipped: Shipped) -> None:
    """A drive of 3.1 s at 10 Hz: the last whole step of 0.04 s is at 3.08 s, the last scene of both at 3.0 s."""
    whole = shipped("cut_in_brake")
    recording = replace(whole, gt=whole.gt.at(np.round(np.arange(0.0, 3.11, 0.1), 9)), sd=None, plan=None)
    replay = load_build(Path(__file__).parents[2] / "adfunc" / "builds" / "replay-1.0.toml")
    result = resimulate(recording, replay)
    assert result.described["GT"].duration == pytest.approx(3.1)
    blocks = assess_resimulation(result, AssessmentOptions(path="state", only=("TTC", "THW"))).blocks
    assert {name: block.drive.t[-1] for name, block in blocks.items()} == {"GT": 3.0, "rGT": 3.0}
    for name in ("TTC", "THW"):
        np.testing.assert_array_equal(blocks["GT"].measures[name].value, blocks["rGT"].measures[name].value)


def test_the_corner_case_has_the_sensor_errors_of_the_source(corner_case: Resimulation) -> None:
    s = corner_case.report.errors["S"]
    assert s["to"]["d"]["mean"] == pytest.approx(1.56, abs=0.05)
    assert s["to"]["d"]["std"] == pytest.approx(0.20, abs=0.05)
    assert s["ego"]["d"]["mean"] == pytest.approx(0.23, abs=0.02)
    assert s["ego"]["d"]["std"] == pytest.approx(0.05, abs=0.02)


def test_the_report_has_its_structure(corner_case: Resimulation) -> None:
    report = corner_case.report
    assert tuple(report.errors) == STEPS == (
        "S", "FIT_GT", "FIT_SD", "SIM_GT", "SIM_SD", "FIT_rGT", "FIT_rSD", "PIPE_GT", "PIPE_SD",
    )  # fmt: skip
    for step in report.errors.values():
        assert set(step) == {"ego", "to"}
        for quantities in step.values():
            assert set(quantities) == {"d", "v", "heading"}
            for statistics in quantities.values():
                assert set(statistics) == {"mean", "std", "min", "q25", "q50", "q75", "max"}
                low = [statistics[q] for q in ("min", "q25", "q50", "q75", "max")]
                assert low == sorted(low)
    for part in ("reaction", "decision"):
        assert set(getattr(report, part)) == {"GT", "rGT", "rSD"}
    json.dumps(to_json(report), allow_nan=False)


@pytest.mark.parametrize("name", ["cut_in_brake", "rear_end", "overtake"])
def test_with_replay_the_simulation_adds_nothing(shipped: Shipped, build: Builds, name: str) -> None:
    report = resimulate(shipped(name), build("replay"), ResimulationOptions(stop_at_collision=False)).report
    for step in ("SIM_GT", "SIM_SD"):
        for who in ("ego", "to"):
            for quantity in ("d", "v", "heading"):
                values = report.errors[step][who][quantity]
                assert max(abs(values["min"]), abs(values["max"])) < 1e-6, (step, who, quantity)


def test_the_rear_end_drive_ends_in_its_collision_with_the_function_that_drove_it(
    shipped: Shipped, build: Builds
) -> None:
    report = resimulate(shipped("rear_end"), build("constant_velocity")).report
    assert (report.collision["GT"], report.collision["rGT"]) == (True, True)
    assert report.end["rGT"] == "collision"
    gt, again = report.collisions["GT"][0], report.collisions["rGT"][0]
    assert gt.id == again.id == "1"
    assert again.t == pytest.approx(gt.t, abs=0.1)
    assert any("rGT ended at t = " in w and "collision" in w for w in report.warnings)


def test_without_sensor_data_there_is_ground_truth_only(shipped: Shipped, build: Builds) -> None:
    recording = replace(shipped("overtake"), sd=None, sd_gt_id=None)
    stages: list[str] = []
    result = resimulate(recording, build("idm"), progress=stages.append)
    report = result.report
    assert set(result.scenarios()) == {"GT", "rGT"}
    assert report.errors["S"] == {who: {"d": None, "v": None, "heading": None} for who in ("ego", "to")}
    assert report.errors["PIPE_GT"]["ego"]["d"] is not None
    assert (report.reaction["rSD"], report.decision["rSD"]) == (None, None)
    assert "highway_pilot-1.0 drove the recording, not idm-1.0" in report.warnings[0]
    assert stages == [s for s in STAGES if not s.endswith(("SD", "+M"))]


def test_sensor_data_alone_leave_the_ground_truth_branch_out(shipped: Shipped, build: Builds) -> None:
    report = resimulate(shipped("overtake"), build("idm"), ResimulationOptions(bases=("SD",))).report
    assert report.errors["SIM_GT"]["ego"]["d"] is None
    assert report.errors["S"]["to"]["d"] is not None
    assert report.errors["PIPE_SD"]["ego"]["d"] is not None


def changed(tracks: Tracks, t: np.ndarray, ids: list[str]) -> Tracks:
    return tracks.at(t).select(ids)


def test_rates_order_and_times_of_sensor_data_may_be_others(shipped: Shipped, build: Builds) -> None:
    """SD at 10 Hz from another start, its EGO last; the recording's times begin at 50 s, not 0."""
    one = shipped("cut_in_brake")
    assert one.sd is not None
    sd = changed(one.sd, np.arange(0.21, 9.0, 0.1), ["1", "ego"])
    identity = np.array(["1", "ego"])
    two = replace(one, sd=sd.shifted(50.0), sd_rate=10.0, sd_gt_id=identity, gt=one.gt.shifted(50.0))
    result = resimulate(two, build("replay"), ResimulationOptions(step=0.05))
    report = result.report
    for step in ("SIM_GT", "SIM_SD"):
        assert report.errors[step]["ego"]["d"]["max"] < 1e-6
    assert result.drives["rSD"].truth.t[0] == pytest.approx(50.21)
    assert result.drives["rSD"].truth.ids.tolist() == ["ego", "1"]
    assert report.errors["S"]["to"]["d"]["mean"] == pytest.approx(1.56, abs=0.1)
    for row in report.sums.values():
        for quantities in row.values():
            assert quantities["d"]["sum"] == pytest.approx(quantities["d"]["measured"], abs=0.02)


def test_times_do_not_matter_to_the_result(shipped: Shipped, build: Builds) -> None:
    one = shipped("cut_in_brake")
    assert one.sd is not None
    two = replace(one, gt=one.gt.shifted(32.0), sd=one.sd.shifted(32.0))
    a, b = (resimulate(r, build("highway_pilot")).report for r in (one, two))
    assert a.decision == b.decision
    assert b.reaction["rGT"] - a.reaction["rGT"] == pytest.approx(32.0, abs=0.05)


def test_times_before_zero_can_be_written(shipped: Shipped, build: Builds, tmp_path: Path) -> None:
    from resim.results import write_resimulation

    one = shipped("overtake")
    early = replace(one, gt=one.gt.shifted(-60.0), sd=None, sd_gt_id=None)
    write_resimulation(resimulate(early, build("idm")), tmp_path)
    assert read_jscen(tmp_path / "rGT.jscen.json").ego.spawn_time == -60.0


def test_objects_seen_once_and_without_ground_truth_are_told(shipped: Shipped, build: Builds) -> None:
    one = shipped("overtake")
    assert one.sd is not None
    valid = one.gt.valid.copy()
    valid[one.gt.index("3"), 1:] = False
    hidden = {c: np.where(valid, getattr(one.gt, c), np.nan) for c in ("x", "y", "heading", "v")}
    gt = replace(one.gt, valid=valid, **hidden)
    identity = np.where(one.sd.ids == "2", "", one.sd.ids)
    result = resimulate(replace(one, gt=gt, sd_gt_id=identity), build("idm"))
    assert "GT: seen only once and left out: 3" in result.warnings
    assert any("SD holds 1 object(s) without ground truth" in w for w in result.warnings)
    assert "sd:2" in result.drives["rSD"].truth.ids
    assert "sd:2" not in result.errors["PIPE_SD"].ids


def test_a_failing_function_leaves_results_with_the_reason(
    shipped: Shipped, write_build: Callable[..., Path]
) -> None:
    source = """
class Own:
    def reset(self, setup): pass
    def step(self, perceived): raise ValueError("lost")
    def close(self): pass
"""
    result = resimulate(shipped("overtake"), load_build(write_build(source)))
    report = result.report
    assert result.failure.count("raised ValueError: lost") == 2
    assert report.end == {"rGT": "function_failed", "rSD": "function_failed"}
    assert "raised ValueError: lost" in report.failure["rGT"]
    assert report.errors["FIT_GT"]["ego"]["d"] is not None
    assert report.errors["PIPE_GT"]["ego"]["d"] is None
    assert (report.reaction["rGT"], report.collision["rGT"]) == (None, False)
    assert tracks_frame(result)["source"].isin(["GT", "SD"]).all()
    json.dumps(to_json(report), allow_nan=False)


def test_what_was_perceived_stands_in_map_coordinates(corner_case: Resimulation) -> None:
    table = tracks_frame(corner_case)
    seen = table[table["source"] == "perceived_rGT"].set_index("t")
    true = table[(table["source"] == "rGT") & (table["id"] == "1")].set_index("t")
    for column in ("x", "y", "heading", "v", "length", "width"):
        np.testing.assert_allclose(
            seen[column].to_numpy(), true[column].to_numpy(), atol=1e-6, err_msg=column
        )


def test_perceived_headings_in_the_table_are_wrapped_as_all_others() -> None:
    one, zero = np.array([1.0]), np.array([0.0])
    names = np.array(["1"]), np.array(["car"])
    seen = Perceived(0.0, EgoState(0.0, 0.0, 3.0, 1.0), *names, one, zero, one, one, one, one)
    assert perceived_frame((seen,))["heading"].tolist() == pytest.approx([4.0 - 2.0 * np.pi])


@pytest.mark.parametrize("name", ["USA_US101-22_1_T-1", "USA_Lanker-1_17_T-1"])
def test_real_vehicles_replay_without_error(build: Builds, name: str) -> None:
    path = DATA / "ngsim" / f"{name}.xml"
    if not path.is_file():
        pytest.skip("the shared data are not on this machine")
    ids = [str(e.get("id")) for e in etree.parse(path).iter("dynamicObstacle", "obstacle")]
    recording = read_commonroad(path, map=path.with_suffix(".xodr"), ego=ids[0])
    assert len(recording.gt) > 5
    report = resimulate(recording, build("replay"), ResimulationOptions(stop_at_collision=False)).report
    assert report.end["rGT"] in ("duration", "off_road")
    assert report.errors["SIM_GT"]["ego"]["d"]["max"] < 1e-6
    assert report.errors["SIM_GT"]["to"]["d"]["max"] < 1e-6


def test_a_sensor_that_does_not_see_the_ego_is_not_perfect(shipped: Shipped, build: Builds) -> None:
    one = shipped("overtake")
    assert one.sd is not None
    blind = replace(one, sd=one.sd.without("ego"), sd_gt_id=one.sd.without("ego").ids)
    result = resimulate(blind, build("idm"))
    report = result.report
    assert report.errors["S"]["ego"]["d"] is None
    assert report.errors["S"]["to"]["d"]["mean"] > 1.0
    assert any("SD has no EGO" in w for w in result.warnings)


def test_ground_truth_is_told_of_whatever_is_run(shipped: Shipped, build: Builds) -> None:
    report = resimulate(
        shipped("cut_in_brake"), build("highway_pilot"), ResimulationOptions(bases=("SD",))
    ).report
    assert report.decision["GT"] == ("brake",)
    assert report.decision["rGT"] is None
    assert report.reaction_difference["rSD"] < -0.5
    assert report.collision["GT"] is False


def test_clocks_that_do_not_meet_are_refused(shipped: Shipped, build: Builds) -> None:
    one = shipped("overtake")
    assert one.sd is not None
    with pytest.raises(ResimError, match="they do not overlap in time"):
        resimulate(replace(one, sd=one.sd.shifted(1000.0)), build("idm"))


def test_wrong_maps_and_units_and_bridged_gaps_are_noted(shipped: Shipped, build: Builds) -> None:
    one = replace(shipped("overtake"), sd=None, sd_gt_id=None)
    moved = replace(one, gt=replace(one.gt, y=one.gt.y + 100.0))
    assert any("on no driving lane in 100 %" in w for w in resimulate(moved, build("replay")).warnings)
    turned = replace(one, gt=replace(one.gt, heading=one.gt.heading + 0.5))
    assert any("rad off its motion" in w for w in resimulate(turned, build("replay")).warnings)
    hidden = one.gt.valid & ((one.gt.t < 2.0) | (one.gt.t > 4.0) | (one.gt.ids == "ego")[:, None])
    columns = {c: np.where(hidden, getattr(one.gt, c), np.nan) for c in ("x", "y", "heading", "v")}
    gaps = replace(one, gt=replace(one.gt, valid=hidden, **columns))
    result = resimulate(gaps, build("replay"))
    assert any("counted as another object from then on: 1~2, 2~2, 3~2" in w for w in result.warnings)
    truth = result.drives["rGT"].truth
    assert not truth.at([3.0]).select(["1"]).valid.any()  # nobody drives where nobody was seen
    assert result.errors["PIPE_GT"].ids.tolist() == ["ego", "1", "2", "3"]
    assert np.nanmax(result.errors["PIPE_GT"].d) < 0.1
    assert np.nanmax(result.errors["SIM_GT"].d) < 1e-6


def test_another_state_of_the_build_that_drove_is_another_build(shipped: Shipped, build: Builds) -> None:
    result = resimulate(replace(shipped("overtake"), build_hash="0" * 64), build("highway_pilot"))
    assert result.report.build.drove is False
    assert any("in another state" in w for w in result.warnings)
