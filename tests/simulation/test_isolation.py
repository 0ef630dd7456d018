"""A run knows nothing of the runs before it in its process, and leaves nothing to those after it."""

from __future__ import annotations

import importlib.util
import os
import random
import shutil
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from resim.core.errors import ChangedError
from resim.road.opendrive import RoadNetwork
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import load_build

Drive = Callable[..., SimulatedDrive]
SOURCE = """import decimal, locale, os, random, sys, types, warnings
import numpy as np
import helper
from resim.simulation.function.interface import Command

N = 0

class Own:
    count = 0
    seen = []

    def reset(self, setup):
        self.a = -0.1 * self.state()

    def state(self):
        {state}

    def step(self, perceived):
        return Command(self.a, 0.0)

    def close(self): pass
"""
STATES = {
    "module": "global N; N += 1; return N",
    "class": "Own.count += 1; return Own.count",
    "list of the class": "self.seen.append(1); return len(self.seen)",
    "module beside": "helper.seen.append(1); return len(helper.seen)",
    "sys.modules": "n = getattr(sys.modules.get('left'), 'n', 0) + 1\n"
    "        sys.modules['left'] = types.ModuleType('left'); sys.modules['left'].n = n; return n",
    "builtins": "n = __builtins__.get('left', 0) + 1; __builtins__['left'] = n; return n",
    "random": "return random.random()",
    "numpy.random": "return np.random.random()",
    "drawn by the module": "return helper.drawn",
    "os.environ": "os.environ['LEFT'] = 'I' + os.environ.get('LEFT', ''); return len(os.environ['LEFT'])",
    "sys.path": "sys.path.append('left'); return sys.path.count('left')",
    "recursion limit": "n = sys.getrecursionlimit(); sys.setrecursionlimit(n + 1000); return n / 1000.0",
    "filters of warnings": "n = len(warnings.filters); warnings.filterwarnings('error', str(n)); return n / 100.0",
    "errors of numpy": "n = np.geterr()['divide'] == 'raise'; np.seterr(divide='raise'); return float(n)",
    "locale": "n = locale.setlocale(locale.LC_ALL); locale.setlocale(locale.LC_ALL, 'C'); return len(n) / 10.0",
    "working directory": "n = len(os.getcwd()); os.chdir('/'); return n / 100.0",
}


@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_a_run_is_the_same_whatever_ran_before(
    state: str, drive: Drive, member: Callable[..., object], write_build: Callable[..., Path]
) -> None:
    path = write_build(SOURCE.format(state=state))
    helper = "import random\nimport numpy as np\nseen = []\ndrawn = random.random() + np.random.random()\n"
    path.with_name("helper.py").write_text(helper)
    build = load_build(path)
    runs = [drive(build, member("e", 300.0), seed=7) for _ in range(3)]
    runs.append(drive(load_build(path), member("e", 300.0), seed=7))
    assert not any(run.failure for run in runs), runs[0].failure
    assert all(np.array_equal(run.commands, runs[0].commands, equal_nan=True) for run in runs)


def test_who_draws_without_a_generator_draws_by_the_runs_seed(
    drive: Drive, member: Callable[..., object], write_build: Callable[..., Path]
) -> None:
    path = write_build(SOURCE.format(state="return random.random() + np.random.random()"))
    path.with_name("helper.py").write_text("")
    build = load_build(path)
    drawn = {drive(build, member("e", 300.0), seed=seed).commands[0, 0] for seed in (0, 1, 2**40)}
    assert len(drawn) == 3


def test_a_run_leaves_the_process_as_it_was(
    drive: Drive, member: Callable[..., object], write_build: Callable[..., Path]
) -> None:
    deeds = (
        "os.environ.clear(); os.environ['LEFT'] = '1'; sys.path.clear(); warnings.simplefilter('error'); "
        "np.seterr(all='raise'); os.chdir('/'); sys.modules.pop('decimal'); return random.random()"
    )
    path = write_build(SOURCE.format(state=deeds))
    path.with_name("helper.py").write_text("")

    def process() -> tuple[object, ...]:
        draws = random.getstate(), np.random.get_state()[1].tobytes()  # type: ignore[index]  # noqa: NPY002
        settings = dict(os.environ), sys.path[:], warnings.filters[:], np.geterr()
        return *draws, *settings, Path.cwd(), sys.modules["decimal"]

    build = load_build(path)
    before = process()
    assert drive(build, member("e", 300.0)).failure == ""
    assert process() == before


def test_a_compiled_module_of_a_package_is_loaded_once_and_found_in_every_run(
    drive: Drive, member: Callable[..., object], write_build: Callable[..., Path]
) -> None:
    spec = importlib.util.find_spec("_bisect")
    if spec is None or not spec.has_location or spec.origin is None:
        pytest.skip("this Python has its modules built in")
    source = SOURCE.replace("import helper", "import parts._bisect").replace("N = 0", "")
    path = write_build(source.format(state="return -parts._bisect.bisect_right([1, 2, 3], 2)"))
    (path.parent / "parts").mkdir()
    (path.parent / "parts" / "__init__.py").write_text("")
    shutil.copy(spec.origin, path.parent / "parts")
    build = load_build(path)
    runs = [drive(build, member("e", 300.0)) for _ in range(2)]
    assert [run.failure for run in runs] == ["", ""]
    assert runs[0].commands[0, 0] == runs[1].commands[0, 0] == 0.1 * 2


def test_a_module_that_fails_when_it_is_executed_again_fails_the_run(
    drive: Drive, member: Callable[..., object], write_build: Callable[..., Path]
) -> None:
    once = (
        "import logging\nif hasattr(logging, 'left'): raise RuntimeError('a second time')\nlogging.left = 1\n"
    )
    path = write_build(once + SOURCE.replace("import helper\n", "").format(state="return 0"))
    run = drive(load_build(path), member("e", 300.0))
    assert run.end == "function_failed"
    assert "raised RuntimeError: a second time" in run.failure


@pytest.fixture(autouse=True)
def _nothing_left_in_logging() -> object:
    import logging

    yield
    vars(logging).pop("left", None)


MAP = """import numpy as np
from resim.simulation.function.interface import Command

class Own:
    def reset(self, setup):
        road = setup.road
        self.seen = len(road.roads)
        {deed}
    def step(self, perceived): return Command(0.0, 0.0)
    def close(self): pass
"""
DEEDS = {
    "takes roads away": ("road.roads.clear()", "changed roads["),
    "has only the road that it needs": ("del road.roads[list(road.roads)[-1]]", "changed roads["),
    "takes lanes away": (
        "road.roads['1'].sections[0].lanes.clear()",
        "changed roads['1'].sections[0].lanes[",
    ),
    "changes a road": ("object.__setattr__(road.roads['1'], 'types', ())", "changed roads['1'].types"),
    "names a road otherwise": ("road.roads['x'] = road.roads.pop(list(road.roads)[-1])", "changed roads["),
    "has another limit": ("vars(road)['speed_limit'] = lambda *a: np.full(9, 99.0)", "changed speed_limit"),
    "has other tables": ("object.__setattr__(road, '_lanes', None)", "changed _lanes"),
    "has another index": ("object.__setattr__(road._index, 'lines', None)", "changed _index.lines"),
}


@pytest.mark.parametrize("what", DEEDS)
def test_who_changes_the_map_is_named_and_neither_the_judge_nor_the_next_run_sees_it(
    what: str, network: RoadNetwork, drive: Drive, member: Callable[..., object], tmp_path: Path
) -> None:
    deed, said = DEEDS[what]
    file = tmp_path / "mapper.toml"
    file.write_text('name = "mapper"\nversion = "1"\nfactory = "mapper:Own"\n')
    (tmp_path / "mapper.py").write_text(MAP.format(deed=deed))
    network.to_road([0.0], [0.0])  # all tables are there before
    roads, lanes = [*network.roads], [*network.roads["1"].sections[0].lanes]
    before, limit = {**vars(network)}, network.speed_limit("1", -2, 10.0)
    build = load_build(file)
    for _ in range(2):  # the second run is given the whole map again
        with pytest.raises(ChangedError) as caught:
            drive(build, member("ego", 10.0))
        assert str(caught.value).startswith(f"{file}: the code {said}")
    assert [*network.roads] == roads
    assert [*network.roads["1"].sections[0].lanes] == lanes
    assert network.roads["1"].types or what != "changes a road"
    assert vars(network) == before
    assert network._index.lines is network._lines
    assert np.array_equal(network.speed_limit("1", -2, 10.0), limit, equal_nan=True)


def test_all_runs_are_given_the_same_map(
    drive: Drive, member: Callable[..., object], network: RoadNetwork, tmp_path: Path
) -> None:
    file = tmp_path / "looker.toml"
    file.write_text('name = "looker"\nversion = "1"\nfactory = "looker:Own"\n')
    deed = "road.to_road([1e4], [1e4])\n        with open(%r, 'a') as f: f.write(f'{id(road)} ')"
    (tmp_path / "looker.py").write_text(MAP.replace("{deed}", deed % str(tmp_path / "seen")))
    build = load_build(file)
    for _ in range(2):
        assert not drive(build, member("ego", 10.0)).failure
    first, second = (tmp_path / "seen").read_text().split()
    assert first == second  # what the function keeps by the map serves its next run
    assert int(first) != id(network)
