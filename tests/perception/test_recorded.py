"""What was recorded as perceived, shown again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from resim.core.geometry import from_frame
from resim.core.tracks import Tracks
from resim.perception.runtime.recorded import RecordedPerception
from resim.recordings import read_recording
from resim.resimulation import ResimulationOptions, resimulate
from resim.resimulation.run import measured_tracks, run_on_gt
from resim.scenario import maneuvers
from resim.simulation.function.interface import EgoState, load_build
from resim.simulation.perception import World

ROOT = Path(__file__).parents[2]


def tracks(t: np.ndarray, x: list[np.ndarray], y: list[float], v: float, heading: float = 0.0) -> Tracks:
    n = len(x)
    column = np.full((n, len(t)), 1.0)
    ids, kind = np.array(["ego", "1", "2"][:n]), np.array(["car"] * n)
    return Tracks(
        t=t, ids=ids, kind=kind, x=np.array(x), y=column * np.array(y)[:, None],
        heading=column * heading, v=column * v, length=np.full(n, 4.7), width=np.full(n, 1.9),
        valid=np.isfinite(np.array(x)),
    )  # fmt: skip


T = np.arange(0.0, 2.01, 0.1)
GT = tracks(T, [20.0 * T, 20.0 * T + 30.0, 20.0 * T - 15.0], [0.0, 3.5, 0.0], 20.0)
SEEN = np.where(T < 1.0, 20.0 * T + 31.5, np.nan)
SD = tracks(T, [20.0 * T, SEEN, 20.0 * T - 15.0], [0.0, 3.7, 0.0], 18.0)


def world(t: float, ego: EgoState) -> World:
    position = np.array([20.0 * t + 30.0 + 3.5j, 20.0 * t - 15.0])
    each = np.ones(2)
    return World(
        t,
        ego,
        np.array(["1", "2"]),
        np.array(["car", "car"]),
        position,
        0.0 * each,
        20.0 * each,
        4.7 * each,
        1.9 * each,
    )


def test_sensor_data_of_the_ego_alone_show_nobody() -> None:
    shown = RecordedPerception(GT, SD.select(["ego"]), ego="ego", senses_ego=True)
    assert shown.perceive(world(0.5, EgoState(10.0, 0.0, 0.0, 20.0))).ids.tolist() == []


def test_errors_follow_an_ego_that_drives_otherwise() -> None:
    """1.5 m too far ahead and 0.2 m too far left stay that, seen from an EGO that is elsewhere and turned."""
    shown = RecordedPerception(GT, SD, ego="ego", senses_ego=False)
    ego = EgoState(8.0, -1.0, 0.1, 17.0)
    seen = shown.perceive(world(0.52, ego))
    row = seen.ids.tolist().index("1")
    x, y = from_frame(seen.x_ego[row] - 1.5, seen.y_ego[row] - 0.2, ego.x, ego.y, ego.heading)
    assert (x, y) == (pytest.approx(20.0 * 0.52 + 30.0), pytest.approx(3.5))
    assert seen.v.tolist() == pytest.approx([18.0, 18.0])
    assert seen.ego == ego


def test_who_was_not_on_the_list_is_not_shown() -> None:
    shown = RecordedPerception(GT, SD, ego="ego", senses_ego=False)
    assert shown.perceive(world(0.95, EgoState(19.0, 0.0, 0.0, 20.0))).ids.tolist() == ["1", "2"]
    assert shown.perceive(world(1.05, EgoState(21.0, 0.0, 0.0, 20.0))).ids.tolist() == ["2"]


def test_before_the_first_list_its_errors_hold() -> None:
    shown = RecordedPerception(GT, SD, ego="ego", senses_ego=True)
    seen = shown.perceive(world(-1.0, EgoState(-20.0, 0.0, 0.0, 20.0)))
    assert seen.x_ego.tolist() == pytest.approx([31.5, -15.0])
    assert seen.ego.v == pytest.approx(18.0)


def test_the_corner_case_shown_what_was_recorded_is_the_measured_drive() -> None:
    """Wagner 2021, 5.3.3: the sensor's error is the leading cause; with it, simulation drives as the vehicle did."""
    recording = read_recording(ROOT / "scenarios" / "cut_in_brake")
    build = load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    result = resimulate(recording, build, ResimulationOptions(bases=("GT",)))
    whole = measured_tracks(recording)
    shown = RecordedPerception(whole["GT"], whole["SD"], ego=recording.ego, senses_ego=recording.senses_ego)
    again = run_on_gt(result, perception=shown)
    run, pipe = again.drives["rGT+M0"], again.errors["PIPE_GT+M0"]
    assert maneuvers.decision(run.truth, result.network, ego="ego") == ["brake"]
    assert maneuvers.reaction_time(run.truth, ego="ego") == pytest.approx(7.3, abs=0.05)
    assert pipe.d[0][np.isfinite(pipe.d[0])][-1] < 0.1
