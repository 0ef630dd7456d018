"""Drives of vehicles that do not respond as our model: `verify` lays to the vehicle what is the vehicle's alone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import ROOT

from resim.metrics.criteria import read_criteria
from resim.recordings import Recording
from resim.resimulation.result import ResimulationOptions
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import SumoNet
from resim.simulation.case import Case
from resim.simulation.function.interface import load_build
from resim.simulation.perception import IdealPerception
from resim.simulation.sumo.engine import Sumo
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.model import Vehicle, VehicleModel, VehicleState
from resim.verification.entries import RecordingSource
from resim.verification.result import VerificationResult
from resim.verification.tolerance import Tolerances
from resim.verification.verify import Demands, verify_recording

CRITERIA = ROOT / "scenarios" / "criteria" / "highway.toml"
TOOLS = ROOT / "tools"


class Weak(Kinematic):
    """Accelerates and brakes with 70 % of what it is asked for."""

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        return super().step(state, 0.7 * acceleration, curvature, dt)


class LateSteering(Kinematic):
    """Steers 0.4 s after it is asked to."""

    def __init__(self) -> None:
        super().__init__()
        self.waiting = deque([0.0] * 10)

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        self.waiting.append(curvature)
        return super().step(state, acceleration, self.waiting.popleft(), dt)


VEHICLES: dict[str, Callable[[], VehicleModel]] = {
    "as modelled": Kinematic,
    "brakes with at most 3 m/s²": lambda: Kinematic(Vehicle(max_braking=3.0)),
    "lags by 0.5 s": lambda: Kinematic(Vehicle(acceleration_lag=0.5)),
    "weak": Weak,
    "steers late": LateSteering,
}
Drive = Callable[..., Recording]


@pytest.fixture(scope="module")
def driven(network: RoadNetwork, net: SumoNet) -> Drive:
    """Drive a neighbour of the corner case with a vehicle; `sees`: by the virtual sensors, else the truth."""
    made: dict[tuple[str, str, bool], Recording] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(TOOLS)
        import make_scenarios as tool
        from neighbours import NEIGHBOURS

    def drive(name: str, vehicle: str, *, sees: bool = False) -> Recording:
        if (name, vehicle, sees) not in made:
            wanted, build = (
                NEIGHBOURS[name],
                load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"),
            )
            run = Case(
                tool.stage(wanted, network), network, build, Sumo(),
                tool.Sensor(wanted.sensor) if sees else IdealPerception(), VEHICLES[vehicle](), step=tool.STEP,
                seed=wanted.seed, stop_at_collision=False,
            ).drive()  # fmt: skip
            made[name, vehicle, sees] = Recording(
                name=name, map=tool.MAP, ego="ego", gt=tool.referenced(run.truth, wanted.seed), gt_rate=25.0,
                sd=tool.sensed(run), sd_rate=25.0, sd_gt_id=run.truth.ids, build=build.label, build_hash=build.hash,
                plan=tool.planned(run),
            )  # fmt: skip
        return made[name, vehicle, sees]

    return drive


def verified(recording: Recording, build: str = "highway_pilot-1.0") -> VerificationResult:
    demands = Demands(read_criteria(CRITERIA), Tolerances())
    path: Path = ROOT / "adfunc" / "builds" / f"{build}.toml"
    return verify_recording(recording, load_build(path), demands, ResimulationOptions(bases=("GT",)))


def step_of(found: VerificationResult) -> str | None:
    cause = found.causes["rGT"]
    return None if cause is None else cause.step


@pytest.mark.parametrize(
    ("name", "vehicle", "sees"),
    [
        ("lead_brakes_hard", "brakes with at most 3 m/s²", True),
        ("lead_brakes_hard", "brakes with at most 3 m/s²", False),
        ("lead_brakes_hard", "lags by 0.5 s", True),
        ("jam_end", "weak", True),
        ("lead_slows", "steers late", False),
    ],
)
def test_a_vehicle_that_responds_otherwise_is_the_cause(
    driven: Drive, name: str, vehicle: str, sees: bool
) -> None:
    found = verified(driven(name, vehicle, sees=sees))
    assert (found.verdict, step_of(found)) == ("not verified", "vehicle")
    assert found.driven is not None
    assert found.driven.function == "plans as recorded"
    told = found.entry(RecordingSource(name, name, None))
    assert told.driven is not None
    assert told.driven.blamed == "vehicle"
    assert any("the vehicle moved differently from its model" in note for note in told.notes)


def test_without_plans_the_build_that_drove_is_known_by_its_hash_alone(driven: Drive) -> None:
    recording = replace(driven("lead_brakes_hard", "brakes with at most 3 m/s²", sees=True), plan=None)
    assert step_of(verified(recording)) == "vehicle"
    assert step_of(verified(replace(recording, build_hash=None))) == "function or vehicle"


@pytest.mark.parametrize("some", ["the first", "of the first second", "short ones"])
def test_plans_that_do_not_cover_the_drive_say_nothing_of_it(driven: Drive, some: str) -> None:
    recording = driven("lead_brakes_hard", "brakes with at most 3 m/s²", sees=True)
    plan = recording.plan
    assert plan is not None
    kept = {
        "the first": plan.t == plan.t.min(), "of the first second": plan.t < plan.t.min() + 1.0,
        "short ones": plan.t_plan <= plan.t + 0.3,
    }[some]  # fmt: skip
    found = verified(replace(recording, plan=plan[kept], build_hash=None))
    assert step_of(found) == "function or vehicle"


def test_without_sensor_data_nobody_is_known_by_what_it_answers_to_the_truth(driven: Drive) -> None:
    recording = driven("lead_brakes_hard", "brakes with at most 3 m/s²", sees=True)
    unseen = replace(recording, sd=None, sd_gt_id=None, sd_rate=None)
    assert step_of(verified(unseen)) == "function or vehicle"


@pytest.mark.slow
def test_another_function_in_the_right_vehicle_is_the_function(driven: Drive) -> None:
    recording = driven("lead_slows", "as modelled")
    assert step_of(verified(recording)) is None
    found = verified(recording, "highway_pilot-1.1")
    assert step_of(found) == "function"
    assert found.driven is not None
    assert (found.driven.function, found.driven.planned) == ("plans otherwise", pytest.approx(3.6, abs=0.5))
    assert step_of(verified(replace(recording, plan=None), "highway_pilot-1.1")) == "function or vehicle"


def test_late_sensors_in_the_right_vehicle_are_the_sensor(driven: Drive) -> None:
    found = verified(driven("lead_brakes_hard", "as modelled", sees=True))
    assert (found.verdict, step_of(found)) == ("not verified", "sensor")
    assert found.driven is not None
    assert found.driven.blamed is None
    assert found.driven.error["v"] < 0.25
    assert not any("the vehicle moved differently" in note for note in found.notes)
