"""Scenarios with the motion of one object changed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from resim.core.errors import ResimError
from resim.recordings import read_recording
from resim.resimulation.run import describe_recording
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.scenario import Scenario
from resim.scenario.variation import PARAMETERS, vary
from resim.scenario.varied import VARIED

ROOT = Path(__file__).parents[2]
T = np.arange(0.0, 9.11, 0.1)


@pytest.fixture(scope="module")
def scene() -> tuple[Scenario, RoadNetwork]:
    recording = read_recording(ROOT / "scenarios" / "cut_in_brake")
    network = load(recording.map)
    return describe_recording(recording, network)["GT"], network


def changed(scene: tuple[Scenario, RoadNetwork], parameter: str, amount: float):
    scenario, network = scene
    before = scenario.tracks(network, T).select(["1"])
    after = vary(scenario, network, "1", parameter, amount).tracks(network, T).select(["1"])
    return before, after


@pytest.mark.parametrize("parameter", list(PARAMETERS))
def test_a_small_amount_changes_little_and_none_nothing(
    scene: tuple[Scenario, RoadNetwork], parameter: str
) -> None:
    assert vary(*scene, "1", parameter, 0.0) is scene[0]
    before, after = changed(scene, parameter, 1e-6)
    assert np.abs(after.x - before.x).max() < 0.01
    assert np.abs(after.y - before.y).max() < 0.01
    assert np.abs(after.v - before.v).max() < 0.05


def test_faster_by_an_amount(scene: tuple[Scenario, RoadNetwork]) -> None:
    before, after = changed(scene, "speed", 2.0)
    assert (after.v - before.v)[0, 5:-5] == pytest.approx(2.0, abs=0.05)
    assert (after.x - before.x)[0] == pytest.approx(2.0 * T, abs=0.05)
    assert (after.y - before.y)[0] == pytest.approx(0.0, abs=0.01)


def test_further_ahead(scene: tuple[Scenario, RoadNetwork]) -> None:
    before, after = changed(scene, "gap", -5.0)
    assert (after.x - before.x)[0] == pytest.approx(-5.0, abs=0.02)


def test_brakes_harder_by_an_amount(scene: tuple[Scenario, RoadNetwork]) -> None:
    before, after = changed(scene, "braking", 2.0)
    assert after.a is not None
    assert before.a is not None
    assert after.a.min() - before.a.min() == pytest.approx(-2.0, abs=0.3)
    assert after.x[0, :35] == pytest.approx(before.x[0, :35], abs=0.05)
    assert after.v.min() >= 0.0


def test_changes_lane_later(scene: tuple[Scenario, RoadNetwork]) -> None:
    before, after = changed(scene, "lane_change", 0.5)
    assert after.y[0, 25:60] == pytest.approx(np.interp(T[25:60] - 0.5, T, before.y[0]), abs=0.02)
    assert after.x == pytest.approx(before.x, abs=0.02)


def test_what_cannot_be_varied_is_told(scene: tuple[Scenario, RoadNetwork]) -> None:
    with pytest.raises(ResimError, match="no object '9'"):
        vary(*scene, "9", "speed", 1.0)
    recording = read_recording(ROOT / "scenarios" / "overtake")
    network = load(recording.map)
    overtake = describe_recording(recording, network)["GT"]
    with pytest.raises(ResimError, match=r"object '1' brakes at 0\.\d+ m/s² at most"):
        vary(overtake, network, "1", "braking", 1.0)
    with pytest.raises(ResimError, match="no lane change to move"):
        vary(overtake, network, "1", "lane_change", 1.0)


def test_suites_know_the_names_of_all_that_can_be_varied() -> None:
    assert tuple(PARAMETERS) == VARIED
