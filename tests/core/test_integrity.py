"""What user's code changes of the program is found, what it sets for the process is put back."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import textwrap
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import resim.metrics.assessment  # noqa: F401  as in every child
from resim.core.errors import ResimError
from resim.core.plugins import integrity, process
from resim.simulation.function.interface import Build, load_build

ROOT = Path(__file__).parents[2]
Call = Callable[..., tuple[int, str, str]]

CHANGES = {
    "a function": ("import resim.metrics.assessment as m; m.judge = print", "resim.metrics.assessment.judge"),
    "its code": ("import resim.metrics.criteria as m; m.judge.__code__ = (lambda *a: 1).__code__", "criteria.judge"),
    "its defaults": ("import resim.metrics.assessment as m; m.assess.__defaults__ = (None,) * 5", "assessment.assess"),
    "its defaults, of which Python tells nothing": (
        "import ctypes, resim.metrics.assessment as m; "
        "ctypes.pythonapi.PyFunction_SetDefaults(ctypes.py_object(m.assess), ctypes.py_object((None,) * 5))",
        "assessment.assess",
    ),
    "a method": ("from resim.core.tracks import Tracks; Tracks.at = print", "resim.core.tracks.Tracks.at"),
    "a built-in name": ("import resim.metrics.risk.metric as m; m.max = min", "resim.metrics.risk.metric.max"),
    "a table": (
        "import resim.metrics.assessment_report as m; m.REASONS.clear()",
        "resim.metrics.assessment_report.REASONS",
    ),
    "a measure": (
        "import resim.metrics.measures.registry as m; object.__setattr__(m.MEASURES[0], 'of', print)",
        "MEASURES[0].of",
    ),
    "numpy": ("import numpy; numpy.maximum = numpy.minimum", "numpy.maximum"),
    "Python": ("import builtins; builtins.max = min", "builtins.max"),
}  # fmt: skip

PATCH = """
import sys, threading, types, weakref
import resim.metrics.assessment as m
def patch(_=None):
    m.judge = print
class Late:
    def __del__(self):
        patch()
def wait():
    sys.gap.wait()
    patch()
"""
GAPS = {
    "garbage": "self.late = Late()",
    "a weak reference": "sys.kept = weakref.ref(self, patch)",
    "a thread": "sys.gap = threading.Event(); threading.Thread(target=wait).start()",
}

HARMLESS = """
import builtins, gettext, multiprocessing
gettext.install("x")
builtins.profile = lambda f: f
multiprocessing.set_start_method("fork")
import resim.resimulation.fidelity, resim.metrics.measures, numpy.polynomial, json
from resim.core.geometry import wrap_angle
from resim.metrics.risk import DEFAULTS
class Mine(dict): pass
numpy.seterr(all="ignore")
numpy.typeDict = {}
"""


@pytest.fixture
def own(tmp_path: Path) -> Callable[[str], Path]:
    """Write a build whose function does something when it is made."""

    def write(deed: str, top: str = "", name: str = "own") -> Path:
        methods = "\n".join(f"    def {name}(self, _=None): pass" for name in ("reset", "step", "close"))
        body = textwrap.indent(deed, " " * 8)
        (tmp_path / f"{name}.py").write_text(
            f"{top}\nclass Own:\n    def __init__(self):\n{body}\n{methods}\n"
        )
        path = tmp_path / f"{name}.toml"
        path.write_text(f'name = "own"\nversion = "1"\nfactory = "{name}:Own"\n')
        return path

    return write


def make(build: Build) -> object:
    """Make the function, as a run does."""
    with build.factory.afresh():
        return build.make()


def made(*paths: Path) -> str:
    """Make each function and drop it, in a copy of this process; give what is said."""
    mine, its = os.pipe()
    if not (child := os.fork()):
        try:
            for build in [load_build(path) for path in paths]:
                make(build)
                if (gap := getattr(sys, "gap", None)) is not None:
                    gap.set()
                    for thread in {*threading.enumerate()} - {threading.current_thread()}:
                        thread.join(10.0)
            integrity.check(whole=True)  # as at the end of each task
            os.write(its, b"fine")
        except ResimError as e:
            os.write(its, str(e).encode())
        finally:
            os._exit(0)
    os.close(its)
    os.waitpid(child, 0)
    with os.fdopen(mine) as said:
        return said.read()


@pytest.mark.parametrize("what", CHANGES)
def test_what_a_function_changes_of_the_program_is_named(own: Callable[..., Path], what: str) -> None:
    deed, name = CHANGES[what]
    said = made(own(deed))
    assert "own.toml: the code changed " in said
    assert name in said


@pytest.mark.parametrize("deed", GAPS.values(), ids=GAPS)
def test_what_changes_between_two_runs_is_told_of_the_code_that_ran_before(
    own: Callable[..., Path], deed: str
) -> None:
    said = made(own(deed, PATCH), own("pass", name="honest"))
    assert "own.toml: the code changed resim.metrics.assessment.judge" in said


def test_another_module_in_the_place_of_one_of_resim_is_told(own: Callable[..., Path]) -> None:
    deed = "self.late = Late()"
    put = (
        "def patch(): sys.modules['resim.metrics.assessment'] = types.ModuleType('resim.metrics.assessment')"
    )
    said = made(own(deed, f"{PATCH}\n{put}"), own("pass", name="honest"))
    assert "own.toml: the code changed sys.modules['resim.metrics.assessment']" in said


def test_a_module_that_was_loaded_again_covers_no_change_of_the_first(own: Callable[..., Path]) -> None:
    again = "import sys; sys.modules.pop(m.__name__); import resim.metrics.assessment; sys.modules[m.__name__] = m"
    assert "assessment.judge" in made(own(f"import resim.metrics.assessment as m; {again}; m.judge = print"))


def test_a_measure_gets_no_method_of_its_own(own: Callable[..., Path]) -> None:
    deed = "import resim.metrics.measures.registry as m; m.MEASURES[0].__dict__['__call__'] = print"
    assert "MEASURES[0].__call__" in made(own(deed))


def test_a_module_that_user_code_loads_is_remembered_as_it_was_loaded(own: Callable[..., Path]) -> None:
    lazy = "import sys; sys.modules.pop('resim.resimulation.fidelity', None); import resim.resimulation.fidelity as m"
    assert "fidelity.sensor_error" in made(own(f"{lazy}; m.sensor_error = print"))


def test_what_any_function_may_do_changes_nothing(
    own: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multiprocessing.context._default_context, "_actual_context", None)  # of tests before
    path = own("pass", HARMLESS)
    assert made(path, path) == "fine"


@pytest.mark.parametrize(("when", "basis"), [("m.judge = kept", "gt"), ("self.late = Late()", "both")])
def test_a_function_that_rewrites_the_judge_has_failed(
    call: Call, own: Callable[..., Path], tmp_path: Path, when: str, basis: str
) -> None:
    deed = """
import dataclasses
import resim.metrics.assessment as m
def kept(*a, judge=m.judge, **k):
    return dataclasses.replace(judge(*a, **k), outcome="PASS", reason="kept")
class Late:
    def __del__(self):
        if m.judge.__module__.startswith('resim.'): m.judge = kept
"""
    deed += when
    drive, criteria = ROOT / "scenarios" / "rear_end", ROOT / "scenarios" / "criteria" / "highway.toml"
    arguments = ["--build", own(deed), "--out", tmp_path / "o", "--criteria", criteria, "--basis", basis]
    code, out, err = call("run", drive, *arguments)
    assert code == 3
    assert "PASS" not in out
    assert "changed resim.metrics.assessment.judge" in err
    assert not (tmp_path / "o").exists()


def test_what_a_function_sets_for_the_process_is_put_back(own: Callable[..., Path]) -> None:
    deed = """
import decimal, locale, os, signal, sys, warnings
import numpy as np
np.seterr(all="raise")
os.umask(0o777)
os.environ["OWN"] = "1"
del os.environ["PATH"]
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
sys.setrecursionlimit(5000)
warnings.simplefilter("error")
locale.setlocale(locale.LC_NUMERIC, "C.UTF-8")
decimal.getcontext().prec = 3
"""
    build = load_build(own(deed))
    before = process.state()
    make(build)
    assert process.state() == before
    assert "PATH" in os.environ
    assert signal.getsignal(signal.SIGCHLD) == signal.SIG_DFL


def test_what_a_module_sets_when_it_is_loaded_holds_while_its_code_runs(own: Callable[..., Path]) -> None:
    top = "import os, numpy as np\nos.environ['OWN'] = '1'\nnp.seterr(divide='raise')"
    path = own("self.seen = os.environ.get('OWN'), np.geterr()['divide']", top)
    before = np.geterr()
    build = load_build(path)
    assert "OWN" not in os.environ
    assert np.geterr() == before
    for _ in range(2):
        made = make(build)
        assert vars(made)["seen"] == ("1", "raise")
    assert "OWN" not in os.environ


def test_a_class_of_others_may_get_numbers_and_nothing_else() -> None:
    """Messages of protobuf keep the numbers of their enums once they were asked for."""
    pytest.importorskip("osi3")
    from resim.function.osmp import _CLASS

    (place,) = integrity._inside("_CLASS", _CLASS)
    assert not place.changed()
    place.parts = {**place.parts, "ROLE_NEW": 3}
    assert not place.changed()
    place.parts = {**place.parts, "SerializeToString": print}
    assert place.changed() == ["_CLASS.SerializeToString"]
