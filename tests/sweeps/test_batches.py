"""Runs that are driven at once are those that are driven alone, to the bit, whatever else is in the batch."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA, Call
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from resim.core.schema import Row
from resim.metrics.criteria import read_criteria
from resim.perception.model import PerceptionModel, read_model
from resim.recordings import read_commonroad, read_recording
from resim.resimulation import ResimulationOptions
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import Build, load_build
from resim.sweeps import execution, tasks
from resim.sweeps.engines import ENGINES, what_differs
from resim.sweeps.estimate import sampled
from resim.sweeps.file import read_sweep, runs
from resim.sweeps.one_run import PreparedRuns, prepare_sweep, run_together
from resim.sweeps.result import SweepResult, read_swept
from resim.sweeps.tasks import MOST, RunTask, in_batches

ROOT = Path(__file__).parents[2]
CRITERIA = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
PROVING_GROUND = ROOT / "adfunc" / "perception" / "proving_ground.json"
DIRECT = ResimulationOptions(engine=ENGINES["direct"])
SENSED: list[tuple[str, ...] | None] = [
    (), None, ("latency.speed=0.3", "update.period=0.0"), ("latency.heading=0.0", "update.period=0.0"),
    ("id_switch=0.7",), ("update.period=0.2", "update.jitter=0.03"), ("false_objects.rate=2.0",),
    ("field_of_view.range=40.0", "field_of_view.bearing=0.6", "update.period=0.12"),
]  # fmt: skip
"""What of the trained model is otherwise; None for ideal perception."""

BATCHED = """
import numpy as np
from resim.simulation.function.batch import CommandBatch
from resim.simulation.function.interface import Command


class Own:
    def __init__(self, turns=0.0, wrong="", gain=1.0):
        self.turns, self.wrong, self.gain = turns, wrong, gain

    def reset(self, setup):
        self.seeds = np.array([setup.seed])

    def reset_batch(self, setups):
        self.seeds = np.array([setup.seed for setup in setups])

    def answers(self, t, v, near):
        a = np.where(near < 40.0, -0.2 * self.gain * self.seeds, 0.3)
        if t > 1.0 and (self.seeds % 7 == 5).any() and self.wrong:
            return eval(self.wrong)
        return a, np.where(self.seeds % 3 == 1, self.turns, 0.0)

    def step(self, perceived):
        near = np.array([np.min(perceived.x_ego, initial=99.0)])
        a, curvature = self.answers(perceived.t, np.array([perceived.ego.v]), near)
        return Command(float(a[0]), float(curvature[0]))

    def step_batch(self, perceived):
        near = np.where(perceived.listed, perceived.x_ego, 99.0).min(axis=1, initial=99.0)
        return CommandBatch(*self.answers(perceived.t, perceived.ego[:, 3], near))

    def close(self):
        pass
"""
"""Drives by the seed: every third run leaves the road; in run 5 it answers what is `wrong`."""

Done = tuple[SimulatedDrive, Row]


def model(changes: tuple[str, ...] | None) -> PerceptionModel | None:
    return None if changes is None else read_model(PROVING_GROUND, changes)


def differing(one: Sequence[Done], other: Sequence[Done]) -> list[str]:
    """What differs between the runs of a batch and those of others."""
    pairs = zip(one, other, strict=True)
    return [what_differs((a.fingerprint(), row), (b.fingerprint(), its)) for (a, row), (b, its) in pairs]


def alone(
    prepared: PreparedRuns, build: Build, runs: Sequence[tuple[PerceptionModel | None, int]]
) -> list[Done]:
    return [done for run in runs for done in run_together(prepared, build, [run], DIRECT)]


def shipped(name: str) -> PreparedRuns:
    return prepare_sweep(read_recording(ROOT / "scenarios" / name), CRITERIA)


@pytest.mark.parametrize(
    "build", ["highway_pilot-1.0", "highway_pilot-1.2", "idm-1.0", "constant_velocity-1.0"]
)
def test_each_run_of_a_batch_is_the_run_alone(build: str) -> None:
    prepared, of = shipped("cut_in_brake"), load_build(ROOT / "adfunc" / "builds" / f"{build}.toml")
    assert of.in_batches
    runs = [(model(changes), seed) for seed, changes in enumerate(SENSED[:1] + SENSED[2:])]
    together = run_together(prepared, of, runs, DIRECT)
    assert set(differing(together, alone(prepared, of, runs))) == {""}
    assert set(differing(together[2:5], run_together(prepared, of, runs[2:5], DIRECT))) == {""}


@pytest.mark.slow
@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    st.sampled_from(["rear_end", "overtake", "neighbours/jam_end"]),
    st.lists(
        st.tuples(st.sampled_from(SENSED[:1] + SENSED[2:]), st.integers(0, 10**9)), min_size=2, max_size=6
    ),
)
def test_whatever_else_is_in_the_batch(name: str, drawn: list[tuple[tuple[str, ...], int]]) -> None:
    prepared, build = shipped(name), load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    runs = [(model(changes), seed) for changes, seed in drawn]
    assert set(differing(run_together(prepared, build, runs, DIRECT), alone(prepared, build, runs))) == {""}


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="no shared data")
def test_objects_of_a_real_drive_come_and_go_in_all_runs() -> None:
    file = DATA / "ngsim" / "USA_US101-12_1_T-1"
    recording = read_commonroad(file.with_suffix(".xml"), map=file.with_suffix(".xodr"), ego="296")
    prepared = prepare_sweep(recording, CRITERIA)
    for build in ("highway_pilot-1.0", "idm-1.0"):
        of = load_build(ROOT / "adfunc" / "builds" / f"{build}.toml")
        runs = [(model(changes), 3) for changes in (SENSED[0], SENSED[3], SENSED[4], SENSED[7])]
        assert set(differing(run_together(prepared, of, runs, DIRECT), alone(prepared, of, runs))) == {""}


def test_runs_of_a_batch_end_each_in_its_own_way(write_build: Callable[..., Path]) -> None:
    prepared, of = shipped("rear_end"), load_build(write_build(BATCHED))
    of = replace(of, parameters={"turns": 0.004})
    runs = [(None, seed) for seed in range(8)]
    together = run_together(prepared, of, runs, DIRECT)
    assert {drive.end for drive, _ in together} >= {"off_road", "collision"}
    assert len({drive.truth.t[-1] for drive, _ in together}) > 2
    assert set(differing(together, alone(prepared, of, runs))) == {""}


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ("1 / 0", "division by zero"),
        ("(a * np.nan, a)", "expected"),
        ("(a[:0], a)", ""),
        ("exit('enough')", "tried to exit"),
        ("(a, 'left')", "could not convert"),
    ],
)
def test_a_function_that_fails_ends_its_own_run(
    wrong: str, reason: str, write_build: Callable[..., Path]
) -> None:
    prepared, of = shipped("rear_end"), load_build(write_build(BATCHED))
    good = run_together(prepared, of, [(None, seed) for seed in range(7)], DIRECT)
    done = run_together(
        prepared, replace(of, parameters={"wrong": wrong}), [(None, seed) for seed in range(7)], DIRECT
    )
    ends = [drive.end for drive, _ in done]
    assert ends[5] == "function_failed"
    assert reason in done[5][0].failure
    for k in (0, 1, 2, 3, 4, 6):
        assert done[k][0].truth.x.tobytes() == good[k][0].truth.x.tobytes()
        assert done[k][0].failure == ""


def test_a_function_that_answers_otherwise_in_batches_is_found(write_build: Callable[..., Path]) -> None:
    """By one bit of one command: the repetition of a run is alone, as that in SUMO is."""
    answered = "CommandBatch(*self.answers(perceived.t, perceived.ego[:, 3], near))"
    assert answered in BATCHED
    source = BATCHED.replace(
        answered, answered.replace("*self", "*np.nextafter(self").replace("near))", "near), 1.0))")
    )
    prepared, of = shipped("rear_end"), load_build(write_build(source))
    runs = [(None, 0), (None, 2)]
    assert "" not in differing(run_together(prepared, of, runs, DIRECT), alone(prepared, of, runs))


VANDAL = """
    def step_batch(self, perceived):
        names = "ego count key ids kind x_ego y_ego heading_ego v length width z_ego"
        for column in [getattr(perceived, name) for name in names.split()]:
            for write in (lambda: column.setflags(write=True), lambda: column.fill(0)):
                try:
                    write()
                except ValueError:
                    pass
        return super().step_batch(perceived)
"""


@pytest.mark.parametrize("changes", [None, (), ("id_switch=0.7", "false_objects.rate=2.0")])
def test_a_function_cannot_change_what_is_kept_of_what_it_saw(
    changes: tuple[str, ...] | None, write_build: Callable[..., Path]
) -> None:
    prepared = shipped("cut_in_brake")
    builds = [
        load_build(write_build(f"{BATCHED}\n\nclass Heir(Own):\n{body}", name="Heir", module=module))
        for body, module in ((VANDAL, "vandal"), ("    pass\n", "good"))
    ]
    done = [run_together(prepared, of, [(model(changes), k) for k in range(3)], DIRECT) for of in builds]
    for (one, _), (other, _) in zip(*done, strict=True):
        mine, others = one.fingerprint(), other.fingerprint()
        assert {name for name in mine if mine[name] != others[name]} == {"case"}


def test_one_bit_is_found() -> None:
    prepared = shipped("rear_end")
    build = load_build(ROOT / "adfunc" / "builds" / "idm-1.0.toml")
    ((drive, row),) = run_together(prepared, build, [(None, 0)], DIRECT)
    commands = drive.commands.copy()
    commands[3, 0] = np.nextafter(commands[3, 0], 9.0)
    assert differing([(drive, row)], [(replace(drive, commands=commands), row)]) == ["commands"]


def test_a_function_with_step_alone_is_driven_run_by_run(write_build: Callable[..., Path]) -> None:
    source = BATCHED.replace("def step_batch", "def other")
    prepared, of = shipped("rear_end"), load_build(write_build(source))
    assert not of.in_batches
    runs = [(None, seed) for seed in range(3)]
    assert set(differing(run_together(prepared, of, runs, DIRECT), alone(prepared, of, runs))) == {""}


def test_who_overrides_step_alone_is_not_driven_by_the_step_batch_of_another(
    write_build: Callable[..., Path],
) -> None:
    heir = "\n\nclass Heir(Own):\n    def {}(self, *a):\n        return super().{}(*a)\n"
    for name, at_once in (("step", False), ("reset", False), ("step_batch", True), ("answers", True)):
        build = load_build(write_build(BATCHED + heir.format(name, name), name="Heir", module=f"heir_{name}"))
        assert build.in_batches is at_once


def test_batches_are_of_runs_that_are_alike(write_build: Callable[..., Path]) -> None:
    of = load_build(write_build(BATCHED)).frozen

    def task(
        run: int, values: tuple[tuple[str, float], ...] = (), folder: str = "a", engine: str = "direct"
    ) -> RunTask:
        return RunTask(run, Path(folder), "", of, None, of, (), values, run, "kinematic", engine)  # type: ignore[arg-type]

    seen = [
        task(k, (("perception.latency.speed", 0.1 * k), ("function.turns", float(k % 2)))) for k in range(400)
    ]
    batches = in_batches(seen, 2)
    assert {task.values[1] for batch in batches[:1] for task in batch} == {("function.turns", 0.0)}
    assert max(map(len, batches)) == MOST
    assert sorted(task.run for batch in batches for task in batch) == list(range(400))
    assert len(in_batches([task(k) for k in range(8)], 2)) == 8  # each worker has some
    assert set(map(len, in_batches([task(k, engine="sumo") for k in range(100)], 1))) == {1}
    assert len(in_batches([task(k, folder="ab"[k % 2]) for k in range(64)], 1)) == 4


SWEEP = """
name = "batches"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["{build}"]
engine = "direct"
repeated_in_sumo = 0.05
seeds = {seeds}
[[recording]]
folder = "{root}/scenarios/rear_end"
[[recording]]
folder = "{root}/scenarios/overtake"
[[parameter]]
name = "function.{parameter}"
values = [0.0, 1.0]
"""


def swept(
    call: Call, folder: Path, build: Path, parameter: str, workers: int, seeds: int = 12
) -> SweepResult:
    folder.mkdir()
    (folder / "own.toml").write_text(
        SWEEP.format(root=ROOT, build=build, parameter=parameter, seeds=seeds), encoding="utf-8"
    )
    code, _, err = call(
        "sweep", folder / "own.toml", "--out", folder / "out", "--workers", workers, "--quiet"
    )
    assert code in (0, 1, 3), err
    return read_swept(folder / "out")


@pytest.mark.slow
def test_a_sweep_has_the_same_bytes_whatever_its_batches(
    call: Call, tmp_path: Path, set_constant: Callable[..., None]
) -> None:
    build = ROOT / "adfunc" / "builds" / "idm-1.0.toml"
    one = swept(call, tmp_path / "one", build, "time_gap", 1)
    set_constant(tasks, "MOST", 1)
    two = swept(call, tmp_path / "two", build, "time_gap", 2)
    table = "runs/part-00000.parquet"
    assert (one.folder / table).read_bytes() == (two.folder / table).read_bytes()


@pytest.mark.slow
def test_a_run_that_ends_its_process_costs_itself_alone(
    call: Call, tmp_path: Path, write_build: Callable[..., Path]
) -> None:
    good = swept(call, tmp_path / "good", write_build(BATCHED), "gain", 1, 4).rows
    ends = BATCHED.replace("eval(self.wrong)", "__import__('os')._exit(3)").replace(
        'wrong=""', 'wrong="it ends"'
    )
    rows = swept(call, tmp_path / "ends", write_build(ends), "gain", 1, 4).rows
    five = rows["seed"] % 7 == 5
    assert 0 < five.sum() < 8
    assert rows["failure"][five].str.contains("ended its process, which ended with code 3").all()
    columns = [name for name in rows.columns if name not in ("case", "build")]
    assert rows[~five][columns].to_json() == good[~five][columns].to_json()


@pytest.mark.parametrize(("engine", "workers", "count", "size"), [("direct", 2, 4, 32), ("sumo", 2, 8, 1)])
def test_what_a_dry_run_tries_is_what_the_sweep_does(
    engine: str, workers: int, count: int, size: int
) -> None:
    sweep = read_sweep(ROOT / "scenarios" / "sweeps" / "perception_latency.toml")
    sweep = sweep.model_copy(update={"file": sweep.file.model_copy(update={"engine": engine})})
    batches = in_batches(list(execution.tasks(sweep, runs(sweep))), workers)
    tried = sampled(batches, workers)
    assert len(tried) == count
    assert set(map(len, tried)) == {size}
    assert all(one in batches for one in tried)


@pytest.mark.slow
def test_a_dry_run_of_a_function_that_fails_says_so(
    call: Call, tmp_path: Path, write_build: Callable[..., Path]
) -> None:
    build = write_build(BATCHED.replace("eval(self.wrong)", "1 / 0").replace('wrong=""', 'wrong="x"'))
    text = SWEEP.format(root=ROOT, build=build, parameter="gain", seeds=24)
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    words = "sweep", tmp_path / "own.toml", "--out", tmp_path / "out", "--workers", 1, "--dry-run", "--json"
    code, out, _ = call(*words)
    told = json.loads(out)
    assert code == 0
    assert 0 < len(told["failures"]) < told["tried"]  # every seventh seed
    assert all("ZeroDivisionError" in one for one in told["failures"])
