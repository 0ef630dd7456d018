"""What a case's hash is of: everything that a drive follows from, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from resim.perception.model import read_model
from resim.perception.runtime.sensor import Sensor
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.simulation.case import Case
from resim.simulation.direct import Direct
from resim.simulation.function.interface import Build
from resim.simulation.sumo.engine import Sumo
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.model import Vehicle
from resim.simulation.vehicles.single_track import SingleTrack

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"


@pytest.fixture
def case(network: RoadNetwork, member: Callable[..., ScenarioObject], build: Callable[[str], Build]) -> Case:
    scenario = Scenario("m", 2.0, member("e", 300.0, 20.0, end=2.0), (member("1", 340.0, end=2.0),))
    return Case(scenario, network, build("highway_pilot"), Sumo())


def seen(*settings: str) -> Sensor:
    return Sensor(read_model(MODEL, settings))


def moved(case: Case) -> Scenario:
    one = case.scenario.objects[0]
    return replace(case.scenario, objects=(replace(one, start=replace(one.start, s=one.start.s + 1e-9)),))


CHANGES: dict[str, Callable[[Case], Case]] = {
    "an object's place": lambda c: replace(c, scenario=moved(c)),
    "a parameter of the function": lambda c: replace(c, build=replace(c.build, parameters={"a": 1})),
    "its cycle time": lambda c: replace(c, build=replace(c.build, cycle_time=0.08)),
    "the perception": lambda c: replace(c, perception=seen()),
    "a parameter of the perception": lambda c: replace(c, perception=seen("latency.speed=0.4")),
    "the vehicle model": lambda c: replace(c, vehicle=SingleTrack()),
    "a parameter of the vehicle": lambda c: replace(c, vehicle=Kinematic(Vehicle(max_braking=3.0))),
    "the step": lambda c: replace(c, step=0.02),
    "the lead-in": lambda c: replace(c, lead_in=2.0),
    "the seed": lambda c: replace(c, seed=1),
    "when it ends": lambda c: replace(c, stop_at_collision=False),
    "who moves the EGO": lambda c: replace(c, open_loop=True),
}


def test_everything_that_a_drive_follows_from_changes_the_hash(case: Case) -> None:
    every = [case.hash, *(change(case).hash for change in CHANGES.values())]
    assert len(set(every)) == len(CHANGES) + 1


def test_another_map_and_another_build_change_the_hash(
    case: Case, build: Callable[[str], Build], tmp_path: Path
) -> None:
    text = case.network.path.read_text(encoding="utf-8")
    (tmp_path / "other.xodr").write_text(text + "<!-- another file -->", encoding="utf-8")
    assert replace(case, network=load(tmp_path / "other.xodr")).hash != case.hash
    assert replace(case, build=build("idm")).hash != case.hash


def test_the_same_case_made_anew_has_the_same_hash(case: Case) -> None:
    again = replace(case, scenario=replace(case.scenario), perception=seen(), vehicle=Kinematic())
    assert replace(case, perception=seen()).hash == again.hash
    drive = case.drive()
    assert drive.case is case
    assert replace(case, engine=Direct()).hash == case.hash, (
        "on traces, an engine only repeats what it is told"
    )
    assert drive.case.hash == case.hash
