"""Whatever the function under test does: the run ends as failed with a reason, and the program goes on."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from resim.core.errors import FunctionError, InputError, StopError
from resim.core.plugins import loading
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import SumoNet
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.function import driver
from resim.simulation.function.interface import Build, load_build
from resim.simulation.sumo.engine import Sumo

Drive = Callable[..., SimulatedDrive]
Make = Callable[..., Build]
Member = Callable[..., ScenarioObject]
ROOT = Path(__file__).parents[2]

LATER = "if perceived.t < 1.0: return Command(0.0, 0.0)\n"
NEVER = "while True: pass"
SLEEPS = "time.sleep(100.0)"
ORACLE = "needs_truth = True"
METHODS = "".join(f"    def {name}(self, _=None): pass\n" for name in ("reset", "step", "close"))
SILENT = """
class KeyboardOff(BaseException): pass
class Silent(BaseException):
    def __str__(self): raise KeyboardOff
    __repr__ = __str__
class Slow(Exception):
    def __str__(self): time.sleep(100.0)
"""
STUBBORN = """while True:
    try:
        while True: time.sleep(0.01)
    except Exception:
        pass"""


@pytest.mark.parametrize(
    ("step", "why"),
    [
        ("raise ValueError('no lane')", "raised ValueError: no lane"),
        ("return 1 / 0", "raised ZeroDivisionError"),
        ("return Command(math.nan, 0.0)", "answered acceleration nan, expected a finite number"),
        ("return Command(0.0, math.inf)", "answered curvature inf, expected a finite number"),
        ("return None", "answered None, expected a Command"),
        ("return (1.0, 0.0)", r"answered (1.0, 0.0), expected a Command"),
        ("return Command(0.0, 0.0, 'straight on')", "answered the plan 'straight on'"),
        (
            "import numpy\nreturn Command(0.0, 0.0, numpy.zeros((0, 4)))",
            "expected one or more rows of finite numbers",
        ),
        (
            "import numpy as np\nreturn Command(0.0, 0.0, np.full((3, 4), math.nan))",
            "expected one or more rows of finite numbers (K, 4)",
        ),
        (
            "import numpy as np\nreturn Command(0.0, 0.0, np.full((3, 4), 1e200))",
            "expected one or more rows of finite numbers (K, 4) below 1e+12",
        ),
        (
            "import numpy as np\nreturn Command(0.0, 0.0, np.array([[1.0, 0, 0, 0], [2.0, 1, 0, 0], [1.5, 2, 0, 0]]))",
            "answered a plan whose times do not increase: 2 s and then 1.5 s",
        ),
        (
            "import numpy as np\nreturn Command(0.0, 0.0, np.zeros((2, 4)))",
            "answered a plan whose times do not increase: 0 s and then 0 s",
        ),
        (
            "import resource\nresource.setrlimit(resource.RLIMIT_NOFILE, (20, 20))",
            "lowers RLIMIT_NOFILE of its process to 20; set limits in a process of its own",
        ),
        (
            "import os, resource\nresource.prlimit(os.getpid(), resource.RLIMIT_FSIZE, (0, -1))",
            "lowers RLIMIT_FSIZE of its process to 0",
        ),
        ("return self.nothing.at_all", "raised AttributeError"),
        (NEVER, "did not answer within 0.5 s"),
        (SLEEPS, "did not answer within 0.5 s"),
        (STUBBORN, "did not answer within 0.5 s"),
        ("end = time.thread_time() + 0.7\nwhile time.thread_time() < end: pass", "0.5 s"),
        ("def deep(): return deep()\nreturn deep()", "raised RecursionError"),
        ("raise GeneratorExit('enough')", "raised GeneratorExit: enough"),
        ("class Own(BaseException): pass\nraise Own('of my own')", "raised Own: of my own"),
        (f"{SILENT}raise Silent", "raised Silent: (its text raised, too)"),
        (f"{SILENT}raise SystemExit(Silent())", "SystemExit((its text raised, too))"),
        (f"{SILENT}raise Slow", "did not answer within 0.5 s"),
        (f"{SILENT}return Silent()", "raised KeyboardOff"),
        (f"{SILENT}return Command(Silent(), 0.0)", "raised KeyboardOff"),
        ("from resim.core.errors import FunctionError\nraise FunctionError('mine')", "mine"),
    ],
)
def test_a_fault_in_a_step_ends_the_run_with_its_reason(
    drive: Drive, function: Make, member: Member, step: str, why: str
) -> None:
    run = drive(function(LATER + step, top="time_limit = 0.5"), member("e", 300.0, 20.0), member("1", 340.0))
    assert run.end == "function_failed"
    assert why in run.failure
    assert run.failure.startswith("test-0.1 at t = 1.00 s ")
    assert run.truth.t[-1] == pytest.approx(1.0)
    assert np.isfinite(run.truth.x).all()
    assert len(run.perceived) == 25  # what it answered to


def test_where_it_raised_is_told_from_its_own_file_on(drive: Drive, function: Make, member: Member) -> None:
    run = drive(function(LATER + "import json\nreturn json.loads('{')"), member("e", 300.0, 20.0))
    first, *_, last = run.traceback
    assert re.fullmatch(r"own\.py, line \d+, in step: return json\.loads\('\{'\)", first)
    assert re.match(r"json/decoder\.py, line \d+, in raw_decode: ", last)
    assert not any("resim" in line or "/tmp" in line for line in run.traceback)


def test_of_many_calls_the_first_and_the_last_are_told(drive: Drive, function: Make, member: Member) -> None:
    run = drive(function(LATER + "def deep(): return deep()\nreturn deep()"), member("e", 300.0, 20.0))
    assert len(run.traceback) == 20
    assert "in step" in run.traceback[0]


def test_a_failure_that_nothing_raised_has_no_such_lines(
    drive: Drive, function: Make, member: Member
) -> None:
    assert drive(function("return None"), member("e", 300.0, 20.0)).traceback == ()
    assert drive(function(f"{SILENT}raise Silent"), member("e", 300.0, 20.0)).traceback != ()


@pytest.mark.parametrize(("reset", "why"), [("raise OSError('none')", "raised OSError: none"),
                                            (NEVER, "did not answer"), (STUBBORN, "did not answer")])  # fmt: skip
def test_a_fault_in_reset_ends_the_run(
    drive: Drive, function: Make, member: Member, set_constant: Callable[..., None], reset: str, why: str
) -> None:
    set_constant(driver, "RESET_LIMIT", 0.2)  # a minute
    run = drive(function(reset=reset), member("e", 300.0, 20.0), member("1", 340.0))
    assert run.end == "function_failed"
    assert why in run.failure
    assert not run.truth.valid.any()
    assert (len(run.perceived), run.collisions) == (0, ())


def test_a_fault_in_the_lead_in_ends_the_run_before_its_start(
    drive: Drive, function: Make, member: Member
) -> None:
    run = drive(function("raise ValueError('early')"), member("e", 300.0, 20.0))
    assert (run.end, run.truth.valid.any()) == ("function_failed", False)
    assert "at t = -3.00 s raised ValueError: early" in run.failure


def test_a_constructor_that_raises_ends_the_run(drive: Drive, function: Make, member: Member) -> None:
    own = function(parameters="gain = -1.0", members="__slots__ = ()")  # has no __dict__ to fill
    run = drive(own, member("e", 300.0, 20.0))
    assert run.end == "function_failed"
    assert "raised AttributeError" in run.failure


def test_a_fault_in_close_is_a_failure(drive: Drive, function: Make, member: Member) -> None:
    run = drive(function(close="raise RuntimeError('still open')"), member("e", 300.0, 20.0))
    assert run.end == "function_failed"
    assert "raised RuntimeError: still open" in run.failure
    assert run.truth.t[-1] == pytest.approx(4.0)


def test_a_collision_before_the_fault_is_what_ended_the_run(
    drive: Drive, function: Make, member: Member
) -> None:
    run = drive(function(LATER + "raise ValueError"), member("e", 300.0, 20.0), member("1", 310.0, 5.0))
    assert run.end == "collision"
    assert run.truth.t[-1] < 0.5
    assert run.failure == ""


def test_the_next_run_is_as_if_nothing_had_happened(drive: Drive, function: Make, member: Member) -> None:
    members = member("e", 300.0, 20.0), member("1", 340.0, 15.0)
    good = function()
    before = drive(good, *members)
    for bad in ("raise ValueError", NEVER):
        drive(function(LATER + bad, top="time_limit = 0.5"), *members)
    after = drive(good, *members)
    assert after.end == "duration"
    assert before.truth.x.tobytes() == after.truth.x.tobytes()


def test_a_slow_run_of_quick_answers_is_no_overrun(drive: Drive, function: Make, member: Member) -> None:
    run = drive(
        function("time.sleep(0.004)\nreturn Command(0.0, 0.0)", top="time_limit = 0.5"), member("e", 300.0)
    )
    assert run.end == "duration"


def test_limits_that_hurt_nobody_may_be_set(drive: Drive, function: Make, member: Member) -> None:
    limits = "resource.setrlimit(resource.RLIMIT_CORE, (0, 0))"
    inner = "lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (20, 20))"
    reset = f"import resource, subprocess\n{limits}\nsubprocess.run(['true'], check=True, preexec_fn={inner})"
    assert drive(function(reset=reset), member("e", 300.0, 20.0)).failure == ""


def test_an_alarm_of_the_caller_is_left_as_it_was(drive: Drive, function: Make, member: Member) -> None:
    def own(number: int, frame: object) -> None:
        raise AssertionError("not mine")

    before = signal.signal(signal.SIGALRM, own)
    try:
        drive(function(), member("e", 300.0))
        assert signal.getsignal(signal.SIGALRM) is own
        assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    finally:
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("answer", ["Command(None, 0.0)", "Command('1', 0.0)", "Command([1.0, 2.0], 0.0)",
                                    "Command(10**400, 0.0)", "Placement(None)"])  # fmt: skip
def test_an_answer_of_no_numbers_ends_the_run(
    drive: Drive, function: Make, member: Member, answer: str
) -> None:
    run = drive(function(f"return {answer}"), member("e", 300.0, 20.0))
    assert run.end == "function_failed"


def test_numbers_of_numpy_are_numbers(drive: Drive, function: Make, member: Member) -> None:
    own = function("import numpy as np\nreturn Command(np.float32(-1.0), np.float64(0.0))")
    assert drive(own, member("e", 300.0, 20.0)).end == "duration"


def test_a_placement_at_nan_is_a_failure(drive: Drive, function: Make, member: Member) -> None:
    run = drive(
        function(LATER + "return Placement(EgoState(math.nan, 0.0, 0.0, 1.0))"), member("e", 300.0, 20.0)
    )
    assert run.end == "function_failed"


def test_a_function_that_exits_fails_alone(drive: Drive, function: Make, member: Member) -> None:
    assert drive(function("raise SystemExit(3)"), member("e", 300.0, 20.0)).end == "function_failed"


def test_a_fault_in_close_leaves_the_end_that_was(drive: Drive, function: Make, member: Member) -> None:
    own = function(close="raise RuntimeError('still open')")
    assert drive(own, member("e", 300.0, 20.0), member("1", 310.0, 5.0)).end == "collision"


def test_a_function_cannot_change_what_others_see(
    function: Make, member: Member, network: RoadNetwork, net: SumoNet
) -> None:
    scenario = Scenario("m", 4.0, member("e", 300.0, 20.0), (member("1", 340.0, 15.0),))
    with_care = function(
        "try: perceived.length[:] = 500.0\nexcept ValueError: pass\nreturn Command(0.0, 0.0)"
    )
    Case(scenario, network, with_care, Sumo(), stop_at_collision=False).drive()
    run = Case(scenario, network, function(), Sumo(), stop_at_collision=False).drive()
    assert run.perceived[0].length.tolist() == [4.7]


def test_a_function_cannot_write_into_the_map_that_all_runs_share(
    drive: Drive, function: Make, member: Member
) -> None:
    """It looks through all that hangs on the map, uses it, and writes into the first array that lets it."""
    walk = """
import numpy
from resim.road.path import lane_path
road = setup.road
path = lane_path(road, "1", -1, 5.0, 80.0)
path.project([0.0], [0.0]), road.to_road([0.0, 9e3], [0.0, 9e3]), road.z("1", 2.0)
todo, seen, arrays = [road, path], set(), 0
while todo:
    one = todo.pop()
    if id(one) in seen: continue
    seen.add(id(one))
    if isinstance(one, numpy.ndarray):
        arrays += 1
        try: one[...] = one
        except ValueError: continue
        raise RuntimeError("could write")
    if isinstance(one, dict): todo += one.values()
    elif isinstance(one, (list, tuple)): todo += one
    elif type(one).__module__.startswith("resim.road"): todo += getattr(one, "__dict__", {}).values()
assert arrays > 40, arrays
path.x[0] += 1.0
"""
    run = drive(function(reset=walk), member("e", 300.0, 20.0))
    assert "is read-only" in run.failure, run.failure


def test_a_signal_to_the_program_is_no_failure_of_the_function(
    drive: Drive, function: Make, member: Member
) -> None:
    def stop(number: int, frame: object) -> None:
        raise StopError(128 + number)

    before = {
        signal.SIGTERM: signal.signal(signal.SIGTERM, stop),
        signal.SIGINT: signal.signal(signal.SIGINT, signal.default_int_handler),
    }
    try:
        with pytest.raises(StopError):
            drive(
                function("import os, signal\nos.kill(os.getpid(), signal.SIGTERM)"), member("e", 300.0, 20.0)
            )
        with pytest.raises(KeyboardInterrupt):
            drive(
                function("import os, signal\nos.kill(os.getpid(), signal.SIGINT)"), member("e", 300.0, 20.0)
            )
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_an_interrupt_of_its_own_is_a_failure_of_the_function(
    drive: Drive, function: Make, member: Member
) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # as in a child process
    try:
        run = drive(function("raise KeyboardInterrupt"), member("e", 300.0, 20.0))
    finally:
        signal.signal(signal.SIGINT, before)
    assert "raised KeyboardInterrupt" in run.failure


def test_an_end_of_the_program_of_its_own_is_a_failure_of_the_function(
    drive: Drive, function: Make, member: Member
) -> None:
    own = function("from resim.core.errors import StopError\nraise StopError(15)")
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)  # as in a child process
    try:
        run = drive(own, member("e", 300.0, 20.0))
    finally:
        signal.signal(signal.SIGTERM, before)
    assert "tried to exit the program: SystemExit(15)" in run.failure


def test_an_exception_whose_class_has_no_name_is_told(drive: Drive, function: Make, member: Member) -> None:
    nameless = """
class Meta(type):
    @property
    def __name__(self): raise RuntimeError("no name")
class Nameless(BaseException, metaclass=Meta):
    @property
    def __class__(self): raise RuntimeError("no class")
    def __repr__(self): raise self
raise Nameless("odd")
"""
    assert "raised Nameless: odd" in drive(function(nameless), member("e", 300.0, 20.0)).failure


def test_numbers_of_numpy_place_the_ego_too(drive: Drive, function: Make, member: Member) -> None:
    own = function(
        "import numpy as np\nreturn Placement(EgoState(np.float32(300.0), -5.0, 0.0, 1.0))", members=ORACLE
    )
    assert drive(own, member("e", 300.0, 20.0)).end == "duration"


def run_gt(scenario: str, build: Path) -> subprocess.CompletedProcess[str]:
    """Run a shipped drive's GT by the command, with its results beside the build."""
    order = [
        "run",
        ROOT / "scenarios" / scenario,
        "--basis",
        "gt",
        "--build",
        build,
        "--out",
        build.with_name("out"),
    ]
    words = [sys.executable, "-m", "resim", *order]
    return subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.slow
def test_a_function_that_swallows_every_interruption_is_ended_from_outside(tmp_path: Path) -> None:
    (tmp_path / "stubborn.py").write_text(
        "import time\nclass Stubborn:\n    def reset(self, setup): pass\n    def close(self): pass\n"
        "    def step(self, perceived):\n        while True:\n            try:\n                time.sleep(10)\n"
        "            except:\n                pass\n"
    )
    build = tmp_path / "stubborn.toml"
    build.write_text('name = "stubborn"\nversion = "1"\nfactory = "stubborn:Stubborn"\ntime_limit = 0.1\n')
    done = run_gt("overtake", build)
    assert done.returncode == 3
    assert (
        "stubborn-1 at t = -3.00 s did not answer within 0.1 s, and could not be interrupted" in done.stderr
    )
    assert (tmp_path / "out" / "run.json").exists()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_function_is_let_go_of_within_its_time_limit(
    drive: Drive, function: Make, member: Member, set_constant: Callable[..., None]
) -> None:
    """Its `__del__` is its code, too: outside of a limit the command would wait for it for good."""
    set_constant(driver, "RESET_LIMIT", 0.3)  # a minute
    own = function(members="def __del__(self): time.sleep(3.0)")
    assert "on closing took longer than 0.3 s" in drive(own, member("e", 300.0, 20.0)).failure


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_what_a_module_holds_is_let_go_of_within_its_time_limit(
    write_build: Callable[..., Path], set_constant: Callable[..., None]
) -> None:
    """The collector would run it at any time, in code of resim's."""
    set_constant(loading, "LET_GO_LIMIT", 0.3)  # a minute
    held = "import time\nclass Held:\n    def __del__(self): time.sleep(3.0)\nHELD = Held()\n"
    path = write_build(f"{held}class Own:\n{METHODS}")
    with pytest.raises(FunctionError, match=r"took longer than 0\.3 s"):  # noqa: PT012  whichever collects it
        build = load_build(path)
        with build.factory.afresh():
            pass


def test_a_function_that_takes_resims_modules_away_is_to_blame(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(
        "import sys\nfrom resim.simulation.function.interface import Command\nclass Own:\n"
        "    def reset(self, setup): pass\n    def close(self): pass\n"
        "    def step(self, perceived):\n        sys.modules.clear(); sys.path.clear()\n"
        "        return Command(0.0, 0.0)\n"
    )
    build = tmp_path / "own.toml"
    build.write_text('name = "own"\nversion = "1"\nfactory = "own:Own"\n')
    done = run_gt("rear_end", build)
    assert (done.returncode, "took modules of resim away" in done.stderr) == (3, True), done.stderr


def test_a_module_beside_its_build_takes_no_other_modules_place(write_build: Callable[..., Path]) -> None:
    path = write_build(f"class Own:\n{METHODS}")
    installed = sys.modules.get("own")
    assert load_build(path).factory.load().__name__ == "Own"
    assert sys.modules.get("own") is installed


def test_only_oracles_place_the_ego(drive: Drive, function: Make, member: Member) -> None:
    run = drive(function("return Placement(EgoState(300.0, -5.0, 0.0, 1.0))"), member("e", 300.0, 20.0))
    assert "answered a Placement; only oracles may" in run.failure


def test_a_class_that_is_no_function_is_refused(write_build: Callable[..., Path]) -> None:
    with pytest.raises(InputError, match="has no step, close"):
        load_build(write_build("class Own:\n    def reset(self, setup): pass\n"))


def test_a_module_may_use_another_beside_it(write_build: Callable[..., Path]) -> None:
    path = write_build(f"import own_gain\nclass Own:\n{METHODS}")
    (path.parent / "own_gain.py").write_text("GAIN = 1\n")
    one = load_build(path).hash
    (path.parent / "own_gain.py").write_text("GAIN = 2\n")
    assert load_build(path).hash != one
