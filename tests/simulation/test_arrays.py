"""What goes to a function and comes from it: nothing that it does to arrays changes records, or what comes later."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from resim.perception.model import read_model
from resim.perception.runtime.sensor import Sensor
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import SumoNet
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.function.interface import Build
from resim.simulation.perception import IdealPerception, Perception
from resim.simulation.sumo.engine import Sumo

Make = Callable[..., Build]
Member = Callable[..., ScenarioObject]
MODEL = Path(__file__).parents[2] / "adfunc" / "perception" / "proving_ground.json"
COLUMNS = ("ids", "kind", "x_ego", "y_ego", "heading_ego", "v", "length", "width")

SPOILS = """self.calls.append(perceived)
for seen in self.calls[-3:]:
    for name in ("x_ego", "y_ego", "heading_ego", "v", "length", "width", "ids", "kind"):
        array = getattr(seen, name)
        while array is not None:
            for what in ("array.flags.writeable = True", "array[...] = array[...] * 2.0 + 1.0", "array[...] = 'x'"):
                try: exec(what)
                except (ValueError, TypeError, AttributeError, IndexError): pass
            array = getattr(array, "base", None)
return Command(0.0, 0.0)"""


@pytest.fixture
def run(
    member: Member, network: RoadNetwork, net: SumoNet
) -> Callable[[Build, Perception | None], SimulatedDrive]:
    """Simulate the EGO behind a slower car, the same scenario each time."""
    scenario = Scenario("m", 2.0, member("e", 300.0, 20.0), (member("1", 340.0, 15.0), member("2", 280.0)))
    return lambda build, perception: Case(
        scenario, network, build, Sumo(), perception or IdealPerception()
    ).drive()


@pytest.mark.parametrize("period", [None, 0.0, 0.2])
def test_a_function_changes_neither_records_nor_what_it_sees_next(
    run: Callable[..., SimulatedDrive], function: Make, period: float | None
) -> None:
    sensor = None if period is None else Sensor(read_model(MODEL, (f"update.period={period}",)))
    before, spoilt = run(function(), sensor), run(function(SPOILS), sensor)
    after = run(function(), sensor)
    assert spoilt.end == "duration"
    for other in (spoilt, after):
        assert len(other.perceived) == len(before.perceived) > 40
        for was, now in zip(before.perceived, other.perceived, strict=True):
            for name in COLUMNS:
                assert getattr(was, name).tolist() == getattr(now, name).tolist(), name


def test_each_plan_is_kept_though_the_function_uses_one_array(
    run: Callable[..., SimulatedDrive], function: Make
) -> None:
    step = """import numpy as np
if not hasattr(self, "plan"): self.plan = np.zeros((3, 4))
self.plan[:] = perceived.t
self.plan[:, 0] += [0.0, 1.0, 2.0]
return Command(0.0, 0.0, self.plan)"""
    plans = run(function(step), None).plans
    assert [when for when, _ in plans] == [plan[0, 0] for _, plan in plans]
    assert len(plans) == 51


def test_a_command_is_what_it_was_when_it_was_given(
    run: Callable[..., SimulatedDrive], function: Make
) -> None:
    step = """class Later(Command):
    said = 0
    @property
    def acceleration(self):
        Later.said += 1
        return 0.5 if Later.said == 1 else -5.0
    @acceleration.setter
    def acceleration(self, value): pass
return Later(0.0, 0.0)"""
    found = run(function(step), None)
    assert found.commands[:-1, 0].tolist() == [0.5] * 50
    assert found.truth.v[0, -1] > 20.5


@pytest.mark.parametrize("plan", ["np.ma.masked_array(np.ones((3, 4)), mask=True)", "np.ones((3, 4), dtype=complex)",
                                  "np.ones((2, 3, 4))", "np.array([[1e308, np.inf, 0, 0]])"])  # fmt: skip
def test_a_plan_of_what_are_no_numbers_fails(
    run: Callable[..., SimulatedDrive], function: Make, plan: str
) -> None:
    found = run(function(f"import numpy as np\nreturn Command(0.0, 0.0, {plan})"), None)
    assert "answered the plan" in found.failure


def test_a_plan_of_large_numbers_is_one(run: Callable[..., SimulatedDrive], function: Make) -> None:
    found = run(
        function("import numpy as np\nreturn Command(0.0, 0.0, np.array([[9e8] * 4, [9.1e8] * 4]))"), None
    )
    assert found.plans[0][1].tolist() == [[9e8] * 4, [9.1e8] * 4]


def test_a_parameter_that_is_changed_is_whole_again_in_the_next_run(
    run: Callable[..., SimulatedDrive], function: Make
) -> None:
    step = "self.gains.append(-1.0)\nself.deep['a'][0] -= 1.0\nreturn Command(self.gains[0] + len(self.gains), 0.0)"
    build = function(step, parameters="gains = [0.0]\ndeep = {a = [1.0]}")
    one, two = run(build, None), run(build, None)
    assert one.commands.tobytes() == two.commands.tobytes()
    assert build.parameters == {"gains": [0.0], "deep": {"a": [1.0]}}


def test_a_failure_names_the_file_that_the_build_does_not_list(
    run: Callable[..., SimulatedDrive], function: Make
) -> None:
    build = function("from pathlib import Path\nreturn (Path(__file__).parent / 'w.json').read_text()")
    (build.path.parent / "w.json").write_text("1")
    assert 'List in build.toml: files = ["w.json"]' in run(build, None).failure
