from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from calling import called
from xdist.scheduler import LoadFileScheduling

from resim.core.plugins import integrity
from resim.recordings import Recording, read_recording
from resim.road.opendrive import RoadNetwork, load
from resim.road.sumo import SumoNet, sumo_net
from resim.scenario.scenario import Scenario, describe
from resim.simulation.function.interface import Build, load_build

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
signal.signal(
    signal.SIGINT, signal.default_int_handler
)  # a shell that started us in the background had it ignored
SHIPPED = ("cut_in_brake", "rear_end", "overtake")

BUILD = """name = "test"
version = "0.1"
factory = "{module}:{name}"
{top}
[parameters]
{parameters}
"""


Call = Callable[..., tuple[int, str, str]]


class _TogetherScheduling(LoadFileScheduling):
    """Files go to workers as wholes; those of one folder that share what takes long to make go together."""

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        return "tests/results" if file.startswith("tests/results/") else file


LONG = ("docs", "verification", "sweeps", "execution", "cli", "report", "perception", "results", "metrics")
"""Folders of tests that take long, so that no worker is left alone with one at the end."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes long."""
    order = {name: n for n, name in enumerate(LONG)}
    items.sort(key=lambda item: order.get(item.path.relative_to(ROOT / "tests").parts[0], len(LONG)))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadFileScheduling | None:
    """Give the scheduler of `--dist loadfile`."""
    return _TogetherScheduling(config, log) if config.getvalue("dist") == "loadfile" else None


@pytest.fixture
def call(capfd: pytest.CaptureFixture[str]) -> Call:
    """Call `resim` in this process; gives exit code, standard output and standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        capfd.readouterr()
        return called(*arguments), *capfd.readouterr()

    return run


@pytest.fixture
def set_constant(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., None]]:
    """Set a constant of a module of resim while a user's code runs in this process, who would be blamed for it."""
    integrity.begin(Path(__file__))  # what is there now is right, not what a test sets
    allowed = set(integrity._OURS)

    def change(module: ModuleType, name: str, value: object) -> None:
        integrity._OURS.add((module.__name__, name))
        monkeypatch.setattr(module, name, value)

    yield change
    monkeypatch.undo()
    integrity._OURS.intersection_update(allowed)


@pytest.fixture
def ends() -> Iterator[None]:
    """Let a test fail that waits for ever, as for the other end of a pipe."""

    def ring(number: int, frame: object) -> None:
        raise AssertionError("it waits for ever")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(30)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture(scope="session", autouse=True)
def _nets_in_a_cache_of_their_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session", autouse=True)
def _a_catalog_of_their_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    os.environ["RESIM_CATALOG"] = str(tmp_path_factory.mktemp("catalog") / "catalog.sqlite")


@pytest.fixture(scope="session")
def network() -> RoadNetwork:
    """The proving ground: road 1 straight over 2040 m, lanes -1 to -3 along +x."""
    return load(ROOT / "networks" / "proving_ground.xodr")


@pytest.fixture(scope="session")
def net(network: RoadNetwork) -> SumoNet:
    return sumo_net(network)


@pytest.fixture(scope="session")
def shipped() -> Callable[[str], Recording]:
    """Give a recording that ships, by name."""
    read: dict[str, Recording] = {}

    def get(name: str) -> Recording:
        if name not in read:
            read[name] = read_recording(ROOT / "scenarios" / name)
        return read[name]

    return get


@pytest.fixture(scope="session")
def described(shipped: Callable[[str], Recording], network: RoadNetwork) -> Callable[..., Scenario]:
    """Give the scenario fitted to a shipped recording's GT or SD."""
    made: dict[tuple[str, str], Scenario] = {}

    def get(name: str, basis: str = "GT") -> Scenario:
        if (name, basis) not in made:
            recording = shipped(name)
            tracks = recording.gt if basis == "GT" else recording.sd_by_gt()
            assert tracks is not None
            first, last = (float(t[tracks.index(recording.ego)]) for t in tracks.span())
            window = tracks.window(first, last)
            made[name, basis] = describe(window, network, ego=recording.ego, map_name="proving_ground.xodr")
        return made[name, basis]

    return get


@pytest.fixture
def build() -> Callable[[str], Build]:
    """Load a build that ships, by the name of its function."""
    return lambda name: load_build(ROOT / "adfunc" / "builds" / f"{name}-1.0.toml")


@pytest.fixture
def write_build(tmp_path: Path) -> Callable[..., Path]:
    """Write a build file, with the source of its module beside it where one is given."""

    def write(source: str | None = None, *, module: str = "own", name: str = "Own", top: str = "",
              parameters: str = "") -> Path:  # fmt: skip
        if source is not None:
            (tmp_path / f"{module}.py").write_text(source)
        path = tmp_path / "build.toml"
        path.write_text(BUILD.format(module=module, name=name, top=top, parameters=parameters))
        return path

    return write
