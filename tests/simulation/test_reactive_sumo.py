"""The drivers of traffic that reacts, held against real vehicles of SUMO that its own models drive."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT

from resim.core.errors import ResimError
from resim.resimulation.notes import handed_over
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.scenario import Scenario
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.engine import Engine
from resim.simulation.reactive.drivers import Following, TrafficDriver, followed
from resim.simulation.reactive.settings import DriverSettings, LaneChangeSettings, ReactiveSettings
from resim.simulation.sumo.engine import Sumo

LENGTH = 4.7
DRIVERS = [
    TrafficDriver(30.0, 1.2, 2.0, 1.4, 2.0, reaction=0.0), TrafficDriver(22.0, 1.8, 3.0, 0.9, 1.5, reaction=0.0),
    TrafficDriver(35.0, 0.6, 1.5, 2.2, 3.0, reaction=0.0),
]  # fmt: skip


def in_sumo(
    folder: Path, vehicles: list[dict[str, Any]], *, lanes: int, step: float, steps: int
) -> list[Any]:
    scene = {"folder": str(folder), "lanes": lanes, "step": step, "steps": steps, "vehicles": vehicles}
    done = subprocess.run(
        [sys.executable, ROOT / "tools" / "sumo_vehicles.py"], input=json.dumps(scene), capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [{k: np.array(v) for k, v in one.items()} for one in json.loads(done.stdout.splitlines()[-1])]


def of_type(driver: TrafficDriver) -> dict[str, Any]:
    return {
        "carFollowModel": "IDM", "accel": driver.acceleration, "decel": driver.deceleration, "tau": driver.time_gap,
        "minGap": driver.standstill, "maxSpeed": driver.desired,
    }  # fmt: skip


@pytest.mark.parametrize("driver", DRIVERS, ids=["usual", "calm", "hasty"])
def test_a_driver_follows_as_a_vehicle_of_sumo_with_the_same_model(
    tmp_path: Path, driver: TrafficDriver
) -> None:
    """Over a minute behind a leader that brakes, stops and starts again, both by ballistic steps of 0.1 s, without a
    reaction time, which SUMO's model has none of."""
    t = np.arange(0.0, 60.0, 0.1)
    lead = np.interp(t, [0, 5, 12, 15, 20, 24, 30, 35, 45, 60], [20, 20, 9, 9, 24, 24, 0, 0, 15, 15])
    ahead, own = in_sumo(
        tmp_path,
        [
            {"s": 200.0, "lane": 0, "length": LENGTH, "speeds": lead.tolist()},
            {"s": 150.0, "lane": 0, "length": 5.0, "speeds": [20.0], "driver": {**of_type(driver), "stepping": 0.1}},
        ],
        lanes=1, step=0.1, steps=len(t),
    )  # fmt: skip
    gap = ahead["s"] - LENGTH - own["s"]
    assert np.ptp(gap) > 20.0
    given = Following(own["s"], own["v"], gap, ahead["v"], 0.1)
    np.testing.assert_allclose(followed(driver, given), gap, rtol=0, atol=1e-9)
    other = replace(driver, time_gap=1.1 * driver.time_gap)
    assert np.abs(followed(other, given) - gap).max() > 0.5


@pytest.mark.slow
def test_it_changes_lanes_where_a_vehicle_of_sumo_does(tmp_path: Path) -> None:
    """In the first of the scenes of `tools/validate_drivers.py`, of which docs/validation.md has more."""
    order = [sys.executable, ROOT / "tools" / "validate_drivers.py", "--scenes", "8"]
    done = subprocess.run(order, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = {
        (ours, theirs): int(count)
        for ours, theirs, count in re.findall(
            r"^\| (changes|stays) \| (changes|stays) \| (\d+) \|", done.stdout, re.M
        )
    }
    assert len(found) == 4
    assert sum(found.values()) == 8
    assert found["changes", "changes"] + found["stays", "stays"] >= 7, done.stdout


@pytest.fixture
def behind_a_crawler(function: Any, network: RoadNetwork, member: Any) -> Callable[..., SimulatedDrive]:
    """Drive an EGO that crawls, two behind it, and one that comes faster on the left."""

    def driven(engine: Engine | None = None, **settings: Any) -> SimulatedDrive:
        crawls = function("return Command(-4.0 if perceived.t > 0.5 and perceived.ego.v > 2.5 else 0.0, 0.0)")
        places = ("f", 230.0, 20.0, -2), ("h", 200.0, 20.0, -2), ("g", 150.0, 26.0, -1)
        others = tuple(member(name, s, v, lane=lane, end=25.0) for name, s, v, lane in places)
        scenario = Scenario(network.path.name, 25.0, member("ego", 300.0, 20.0, lane=-2, end=25.0), others)
        traffic = ReactiveSettings(calibrated=False, **settings)
        return Case(scenario, network, crawls, engine or Sumo(), traffic=traffic).drive()

    return driven


def test_sumos_models_drive(behind_a_crawler: Callable[..., SimulatedDrive]) -> None:
    """Its IDM as resim's, to rounding; its LC2013 when it wants to; the same bytes twice."""
    keeps = LaneChangeSettings(possible=False)
    ours, theirs = (behind_a_crawler(drivers=who, lane_change=keeps) for who in ("resim", "sumo"))
    assert len(ours.handed_over) == len(theirs.handed_over) == 2
    np.testing.assert_allclose(theirs.truth.x, ours.truth.x, rtol=0, atol=1e-6)
    changing, again = behind_a_crawler(drivers="sumo"), behind_a_crawler(drivers="sumo")
    changes = {one.id: [change.side for change in one.lane_changes] for one in changing.handed_over}
    assert changes["f"][0] == changes["h"][0] == "left"
    assert changing.collisions == ()
    assert "handed over to drivers of SUMO's own models, not" in handed_over(
        changing.handed_over, by_sumo=True
    )
    assert changing.fingerprint() == again.fingerprint()
    other = behind_a_crawler(drivers="resim")
    assert [one.lane_changes for one in other.handed_over] != [
        one.lane_changes for one in changing.handed_over
    ]


def test_sumos_models_drive_by_the_parameters_of_a_file(
    behind_a_crawler: Callable[..., SimulatedDrive],
) -> None:
    """Digits that SUMO does not print by itself count."""
    keeps = LaneChangeSettings(possible=False)
    driver = DriverSettings(time_gap=1.2345678, acceleration=1.2345678, deceleration=2.3456789)
    ours, theirs = (behind_a_crawler(drivers=d, lane_change=keeps, car=driver) for d in ("resim", "sumo"))
    np.testing.assert_allclose(theirs.truth.x, ours.truth.x, rtol=0, atol=1e-6)


def test_sumos_drivers_need_sumo(behind_a_crawler: Callable[..., SimulatedDrive]) -> None:
    with pytest.raises(ResimError, match='drivers = "sumo" needs SUMO'):
        behind_a_crawler(Direct(), drivers="sumo")


def test_sumos_drivers_off_the_road_follow_all_the_same(
    function: Any, network: RoadNetwork, member: Any
) -> None:
    """Beside the map, where SUMO has no lane for them, its library would end the process; resim's IDM is the same."""
    slows = function("return Command(-2.0 if perceived.ego.v > 10.0 else 0.0, 0.0)")
    ego, other = (member(name, s, 20.0, lane=-3, t=-4.0) for name, s in (("ego", 300.0), ("f", 270.0)))
    scenario = Scenario(network.path.name, 4.0, ego, (other,))
    ours, theirs = (
        Case(scenario, network, slows, Sumo(), traffic=ReactiveSettings(drivers=who)).drive()
        for who in ("resim", "sumo")
    )
    assert [one.id for one in theirs.handed_over] == ["f"]
    np.testing.assert_allclose(theirs.truth.x, ours.truth.x, rtol=0, atol=1e-6)


def test_sumos_drivers_change_no_lanes_where_traffic_keeps_left(
    function: Any, network: RoadNetwork, member: Any, tmp_path: Path
) -> None:
    """SUMO's net does not say that it does, and LC2013 keeps right."""
    path = tmp_path / "left.xodr"
    path.write_text(network.path.read_text().replace('rule="RHT"', 'rule="LHT"'))
    left = load(path)
    scenario = Scenario(path.name, 1.0, member("ego", 300.0, end=1.0), ())
    traffic = ReactiveSettings(drivers="sumo")
    with pytest.raises(ResimError, match="keeps left there"):
        Case(scenario, left, function(), Sumo(), traffic=traffic).drive()
    keeps = traffic.model_copy(update={"lane_change": LaneChangeSettings(possible=False)})
    assert Case(scenario, left, function(), Sumo(), traffic=keeps).drive().collisions == ()
