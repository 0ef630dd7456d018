"""The engine "direct" gives what SUMO gives, to the byte; a sweep proves it on the way."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA, Call

from resim.core.schema import Row
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings import Recording, read_commonroad, read_recording
from resim.resimulation import ResimulationOptions
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import Build, load_build
from resim.sweeps.engines import ENGINES, is_repeated, what_differs
from resim.sweeps.one_run import PreparedRuns, prepare_sweep, run_once
from resim.sweeps.result import read_swept
from resim.sweeps.tasks import PRELOADED  # noqa: F401  # loaded before functions are

ROOT = Path(__file__).parents[2]
CRITERIA = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
MODEL = read_model(ROOT / "adfunc" / "perception" / "proving_ground.json")
SHIPPED = sorted(p.parent for p in (ROOT / "scenarios").rglob("recording.toml"))
BUILDS = sorted(p for p in (ROOT / "adfunc" / "builds").glob("*.toml") if "[process]" not in p.read_text())
NGSIM = {"USA_US101-12_1_T-1": "296", "USA_US101-22_1_T-1": "659", "USA_Lanker-1_17_T-1": "1545"}

FAILING = """
class Raises:
    def __init__(self, after=1.0): self.after = after
    def reset(self, setup): pass
    def step(self, perceived):
        from resim.simulation.function.interface import Command
        if perceived.t > self.after: raise ValueError("enough")
        return Command(1.5, -0.01)
    def close(self): pass
"""


def differs(prepared: PreparedRuns, build: Build, seed: int = 3, *, model: bool = True) -> tuple[str, str]:
    """What differs between the engines, and how the drive ended."""
    sensed = MODEL if model else None
    one, two = (
        run_once(prepared, build, sensed, seed, ResimulationOptions(engine=engine))
        for engine in ENGINES.values()
    )
    return what_differs(*((drive.fingerprint(), row) for drive, row in (one, two))), one[0].end


@pytest.mark.parametrize("folder", SHIPPED, ids=lambda p: p.name)
def test_shipped_drives_are_the_same_to_the_byte(folder: Path) -> None:
    prepared = prepare_sweep(read_recording(folder), CRITERIA)
    first = SHIPPED.index(folder)
    for n in range(len(BUILDS) if first == 0 else 2):
        path = BUILDS[(first + n) % len(BUILDS)]
        assert differs(prepared, load_build(path), model=bool(n % 2))[0] == ""


def ngsim(name: str) -> Recording:
    """A real drive: the vehicle of the data that is there longest, as EGO."""
    return read_commonroad(
        DATA / "ngsim" / f"{name}.xml", map=DATA / "ngsim" / f"{name}.xodr", ego=NGSIM[name]
    )


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared data")
@pytest.mark.parametrize("name", NGSIM)
@pytest.mark.slow
def test_real_drives_are_the_same_to_the_byte(name: str) -> None:
    prepared = prepare_sweep(ngsim(name), CRITERIA)
    for build in ("highway_pilot-1.0", "idm-1.0"):
        assert differs(prepared, load_build(ROOT / "adfunc" / "builds" / f"{build}.toml"))[0] == ""


@pytest.mark.parametrize(
    ("after", "end"), [(-9.0, "function_failed"), (1.0, "function_failed"), (99.0, "off_road")]
)
def test_failures_and_ends_are_the_same(
    after: float, end: str, write_build: Callable[..., Path], tmp_path: Path
) -> None:
    prepared = prepare_sweep(read_recording(ROOT / "scenarios" / "cut_in_brake"), CRITERIA)
    build = replace(load_build(write_build(FAILING, name="Raises")), parameters={"after": after})
    assert differs(prepared, build) == ("", end)


def test_a_planted_micrometre_is_found() -> None:
    prepared = prepare_sweep(read_recording(ROOT / "scenarios" / "rear_end"), CRITERIA)
    build = load_build(BUILDS[0])
    drive, row = run_once(prepared, build, None, 0, ResimulationOptions(engine=ENGINES["direct"]))
    x = drive.truth.x.copy()
    x[1, 7] += 1e-6
    own = drive.fingerprint(), row

    def against(other: SimulatedDrive, its: Row = row) -> str:
        return what_differs(own, (other.fingerprint(), its))

    assert against(replace(drive, truth=replace(drive.truth, x=x))) == "truth"
    x[1, 7] = np.nextafter(drive.truth.x[1, 7], np.inf)
    assert against(replace(drive, truth=replace(drive.truth, x=x))) == "truth"
    assert against(replace(drive, time=9.0)) == ""
    assert against(replace(drive, failure="it raised at 0x7f")) == "failed"
    assert against(drive, {**row, "risk": 0.5}) == "risk"
    assert against(drive, {**row, "more": 0.5}) == "which columns there are"


def test_words_of_a_failure_may_differ(write_build: Callable[..., Path]) -> None:
    prepared = prepare_sweep(read_recording(ROOT / "scenarios" / "cut_in_brake"), CRITERIA)
    build = load_build(write_build(FAILING.replace('"enough"', "f'{object()}'"), name="Raises"))
    assert differs(prepared, build) == ("", "function_failed")


def test_two_threads_drive_one_after_the_other() -> None:
    prepared = prepare_sweep(read_recording(ROOT / "scenarios" / "rear_end"), CRITERIA)
    build, options = load_build(BUILDS[3]), ResimulationOptions(engine=ENGINES["direct"])
    with ThreadPoolExecutor(4) as pool:
        rows = [*pool.map(lambda _: run_once(prepared, build, None, 0, options)[1], range(8))]
    assert all(row == rows[0] for row in rows)
    assert rows[0]["end"] != "function_failed"


def test_runs_are_drawn_by_their_hash_in_the_share_that_is_asked_for() -> None:
    cases = [hashlib.sha256(f"{n}".encode()).hexdigest() for n in range(20_000)]
    assert 150 < sum(is_repeated(case, 1, 0.01) for case in cases) < 250
    assert is_repeated(cases[0], 0, 1e-9)
    assert not any(is_repeated(case, 0, 0.0) for case in cases)


SWEEP = """
name = "direct"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["{build}"]
engine = "{engine}"
seeds = 2
[[recording]]
folder = "{root}/scenarios/rear_end"
[[parameter]]
name = "function.{parameter}"
low = 1.0
high = 1.5
steps = 2
"""


def swept(call: Call, folder: Path, engine: str, build: Path, parameter: str) -> tuple[int, str]:
    """Run a sweep; exit code and what it said."""
    (folder / f"{engine}.toml").write_text(
        SWEEP.format(root=ROOT, engine=engine, build=build, parameter=parameter), encoding="utf-8"
    )
    code, _, err = call(
        "sweep", folder / f"{engine}.toml", "--out", folder / engine, "--workers", "1", "--quiet"
    )
    return code, err


def test_a_direct_sweep_has_the_rows_of_one_in_sumo_and_says_what_was_repeated(
    call: Call, tmp_path: Path
) -> None:
    for engine in ENGINES:
        assert swept(call, tmp_path, engine, ROOT / "adfunc/builds/idm-1.0.toml", "time_gap") == (0, "")
    one, two = (read_swept(tmp_path / engine).rows for engine in ENGINES)
    assert one.to_json() == two.to_json()
    _, out, _ = call("sweep", "report", tmp_path / "direct")
    assert "direct, without a simulator; 1 of 4 runs repeated in SUMO, the same to the byte" in out
    assert json.loads((tmp_path / "direct" / "report.json").read_text())["repeated_in_sumo"] == 1
    page = (tmp_path / "direct" / "report.html").read_text(encoding="utf-8")
    assert "1 of 4 runs repeated in SUMO" in page


FICKLE = """
import os
class Fickle:
    def __init__(self, by=1.0): self.by = by
    def reset(self, setup): self.more = int.from_bytes(os.urandom(2), "little") * 1e-6 * self.by
    def step(self, perceived):
        from resim.simulation.function.interface import Command
        return Command(self.more, 0.0)
    def close(self): pass
"""


def test_a_run_that_is_not_the_same_in_sumo_ends_the_sweep(
    call: Call, tmp_path: Path, write_build: Callable[..., Path]
) -> None:
    code, err = swept(call, tmp_path, "direct", write_build(FICKLE, name="Fickle"), "by")
    assert code == 2
    assert "run 0 is not the same with the engine direct and in SUMO: truth differs" in err
    assert not (tmp_path / "direct" / "manifest.json").exists()
