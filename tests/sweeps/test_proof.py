"""No table is made of batches in which a function drives otherwise, or longer, than it may alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pandas as pd
import pytest
from conftest import Call

from resim.execution import journal
from resim.sweeps.result import read_swept
from resim.sweeps.tasks import SPREAD, RunTask, in_batches, to_prove_first

ROOT = Path(__file__).parents[2]

PILOTS = """
import time
import numpy as np
from resim.simulation.function.batch import CommandBatch
from resim.simulation.function.interface import Command


class Honest:
    def __init__(self, k=0.0):
        self.k = k

    def reset(self, setup):
        self.reset_batch([setup])

    def reset_batch(self, setups):
        self.seeds, self.calls = np.array([setup.seed for setup in setups]), 0

    def answers(self, t):
        self.calls += 1
        self.wait()
        return np.full(len(self.seeds), -2.0 if t > 1.0 else 0.0)

    def step(self, perceived):
        return Command(float(self.answers(perceived.t)[0]), 0.0)

    def step_batch(self, perceived):
        return CommandBatch(self.answers(perceived.t), np.zeros(len(perceived)))

    def wait(self):
        pass

    def close(self):
        pass


class Lies(Honest):
    def step(self, perceived):
        return Command(0.5, 0.0)  # alone, which is what counts, it never brakes

    def step_batch(self, perceived):
        return Honest.step_batch(self, perceived)

    def reset_batch(self, setups):
        Honest.reset_batch(self, setups)


class Forgets(Honest):
    def step(self, perceived):  # brakes by k, as a batch does not
        return Command(float(self.answers(perceived.t)[0]) * (1.0 + self.k), 0.0)

    def reset_batch(self, setups):
        Honest.reset_batch(self, setups)

    def step_batch(self, perceived):
        return Honest.step_batch(self, perceived)


class Middle(Honest):
    def step_batch(self, perceived):
        answers = self.answers(perceived.t)
        answers[1:-1] = 0.5
        return CommandBatch(answers, np.zeros(len(perceived)))


class Asks(Honest):
    def __init__(self, k=0.0):
        super().__init__()
        import os
        self.gain = float(os.environ.get("PILOT_GAIN", "0"))


class Leaves(Honest):
    def __init__(self, k=0.0):
        import os
        os._exit(0)


class Slow(Honest):
    def wait(self):
        if self.calls == 10 and (self.seeds % 4 == 1).any():
            time.sleep(0.8)
"""

SWEEP = """
name = "proof"
criteria = "{root}/scenarios/criteria/highway.toml"
build = [{builds}]
engine = "direct"
seeds = {seeds}
perception = "{root}/adfunc/perception/proving_ground.json"
[[recording]]
folder = "{root}/scenarios/rear_end"
[[parameter]]
name = "{swept}"
values = {values}
"""


@pytest.fixture
def sweep(call: Call, tmp_path: Path) -> Callable[..., tuple[int, str, Path]]:
    """Sweep with these pilots; gives exit code, standard error and the folder."""
    (tmp_path / "pilots.py").write_text(PILOTS)

    def run(
        *names: str, seeds: int = 24, workers: int = 1, more: tuple[str, ...] = (), ks: tuple[float, ...] = ()
    ) -> tuple[int, str, Path]:
        for name in names:
            limit = "time_limit = 0.4\n" if name == "Slow" else ""
            text = f'name = "{name.lower()}"\nversion = "1"\nfactory = "pilots:{name}"\n{limit}'
            (tmp_path / f"{name}.toml").write_text(text)
        file, builds = tmp_path / "sweep.toml", ", ".join(f'"{name}.toml"' for name in names)
        swept = "function.k" if ks else "perception.latency.speed"
        text = SWEEP.format(root=ROOT, builds=builds, seeds=seeds, swept=swept, values=list(ks) or [0.0])
        file.write_text(text)
        out = tmp_path / f"out_{workers}"
        code, _, error = call("sweep", file, "--out", out, "--workers", workers, "--quiet", *more)
        return code, error, out

    return run


def test_a_refused_sweep_stays_refused(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    code, error, out = sweep("Lies")
    assert code == 2
    assert "run 0 is not the same with the engine direct and in SUMO" in error
    assert "1-of-1.jsonl.refused" in error
    assert [*journal.read(out / "journal")] == []
    assert sweep("Lies", more=("--resume",))[0] == 2
    assert not (out / "manifest.json").exists()


def test_each_build_is_proved(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    code, error, out = sweep("Honest", "Lies", seeds=8)
    assert code == 2
    assert "is not the same" in error
    assert not (out / "manifest.json").exists()


def test_each_shard_proves_its_own(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    assert sweep("Lies", more=("--shard", "2/3"))[0] == 2


@pytest.mark.slow
def test_who_is_too_slow_fails_whatever_the_batches(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    tables = list[pd.DataFrame]()
    for workers in (1, 4):
        code, error, out = sweep("Slow", seeds=16, workers=workers)
        assert code == 3, error
        tables.append(read_swept(out).rows)
    for rows in tables:
        slow = rows["seed"] % 4 == 1
        assert (rows["end"][slow] == "function_failed").all()
        assert rows["failure"][~slow].isna().all()
    assert tables[0].drop(columns="failure").equals(tables[1].drop(columns="failure"))


def test_the_first_batch_of_each_recording_and_build_is_proved_first() -> None:
    def task(run: int, folder: str, build: str, repeated: float = 0.01) -> RunTask:
        return RunTask(
            run, Path(folder), "", build, None, build, (), (), run, "kinematic", "direct", repeated
        )  # type: ignore[arg-type]

    every = [task(k, "ab"[k % 2], "cd"[k // 2 % 2]) for k in range(256)]
    first = to_prove_first(in_batches(every, 1))
    for batch in first:
        proved = [k for k, one in enumerate(batch) if one.repeated == 1.0]
        if batch[0].run < 4:
            assert proved == [0, len(batch) // 2, len(batch) - 1]
        else:
            assert len(proved) == 1
    assert {0, 1, 2, 3} < {batch[0].run for batch in first}
    assert to_prove_first(in_batches([task(k, "a", "c", 0.0) for k in range(64)], 1)) == []
    alone = to_prove_first(in_batches([task(k, "a", "c") for k in range(3)], 4))
    assert [[one.repeated for one in batch] for batch in alone] == [[1.0]]  # by step, which may be random
    swept = [replace(task(k, "a", "c"), values=(("function.k", float(k % 20)),)) for k in range(80)]
    groups = [batch[0].values[0][1] for batch in to_prove_first(in_batches(swept, 1))]
    assert groups == [float(k) for k in range(20)]


def test_one_run_of_batches_from_all_over_a_sweep_is_proved_first() -> None:
    """As a fault of `step_batch` may show with some perceptions only."""
    every = [
        RunTask(
            k,
            Path("a"),
            "",
            "c",
            None,
            "c",
            (),
            (("perception.x", k // 400),),
            k,
            "kinematic",
            "direct",
            0.01,
        )  # type: ignore[arg-type]
        for k in range(8000)
    ]
    batches = in_batches(every, 2)
    first = to_prove_first(batches)
    places = [batches.index(next(b for b in batches if b[0].run == one[0].run)) for one in first]
    assert len(places) == SPREAD
    assert max(b - a for a, b in pairwise(places)) <= len(batches) // SPREAD + 1
    assert {sum(task.repeated == 1.0 for task in batch) for batch in first} == {1, 3}
    drawn = {next(k for k, task in enumerate(batch) if task.repeated == 1.0) for batch in first[1:]}
    assert len(drawn) > 16  # not always the same row


def test_a_parameter_that_batches_forget_is_found(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    """Its first value, with which all is well, tells nothing of the others."""
    code, error, _ = sweep("Forgets", seeds=8, ks=(0.0, 0.5))
    assert code == 2
    assert "is not the same" in error


def test_what_is_wrong_in_the_middle_of_a_batch_is_found(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    assert sweep("Middle")[0] == 2


@pytest.mark.slow
def test_a_second_refusal_keeps_the_first(sweep: Callable[..., tuple[int, str, Path]]) -> None:
    _, _, out = sweep("Lies")
    (out / "journal" / "1-of-1.jsonl.refused").write_text("keep me")
    sweep("Lies", more=("--resume",))
    assert (out / "journal" / "1-of-1.jsonl.refused").read_text() == "keep me"
    assert (out / "journal" / "1-of-1.jsonl.refused1").exists()


def test_what_a_build_asks_besides_its_hash_is_told_and_nothing_is_added_later(
    sweep: Callable[..., tuple[int, str, Path]], call: Call
) -> None:
    """Under another environment the runs that are left would be of other code."""
    code, _, out = sweep("Asks", seeds=4, more=("--shard", "1/2"))
    told = "the code read PILOT_GAIN from the environment"
    journal = out / "journal" / "1-of-2.jsonl"
    assert told in journal.read_text()
    journal.write_text(journal.read_text().splitlines(keepends=True)[0])
    code, error, _ = sweep("Asks", seeds=4, more=("--shard", "1/2", "--resume"))
    assert code == 2
    assert "cannot be resumed: asks-1: " + told in error
    code, _, out = sweep("Asks", seeds=4, workers=2)
    assert code in (0, 1)
    assert told in call("sweep", "report", out)[1]
    assert told in (out / "report.html").read_text()


def test_a_function_that_ends_its_process_when_it_is_made_is_named(
    sweep: Callable[..., tuple[int, str, Path]],
) -> None:
    code, error, _ = sweep("Leaves", seeds=2)
    assert (code, "leaves-1 on being made ended its process" in error) == (3, True), error


@pytest.mark.slow
def test_a_sweep_of_which_every_run_took_too_long_has_a_report(
    sweep: Callable[..., tuple[int, str, Path]], call: Call, tmp_path: Path
) -> None:
    sweep("Honest", seeds=2)
    file = tmp_path / "sweep.toml"
    file.write_text(file.read_text().replace("seeds = 2", "seeds = 2\ntime_limit = 0.001"))
    assert call("sweep", file, "--out", tmp_path / "late", "--workers", 1, "--quiet")[0] == 3
    code, out, error = call("sweep", "report", tmp_path / "late")
    assert (code, error) == (0, "")
    assert "2 runs" in out
