"""A sweep of which every part is killed over and over: after resume it is what it is undisturbed, byte for byte."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from processes import below
from sweeps.test_sweeps import ROOT, bytes_of, table

from resim.execution import journal

POINTS = 90
PARTS = ("child", "worker", "scheduler", "command")

FAULTY = '''
import os
import time

from adfunc.highway_pilot import HighwayPilot


class Faulty(HighwayPilot):
    """Waits a while in every run, so that runs are in progress when something is killed; in a few it has a fault."""

    def __init__(self, fault=None):
        super().__init__()
        self.fault = fault

    def reset_batch(self, setups):
        super().reset_batch(setups)
        self.faults = [setup.seed * 0.618 % 1.0 if self.fault is None else self.fault for setup in setups]
        time.sleep((0.05 if self.fault is None else 0.2) * len(setups))

    def step_batch(self, perceived):
        fault = max(self.faults)
        if perceived.t > 0.5 and fault > 0.94:
            if fault > 0.98:
                os.kill(os.getpid(), 11)
            if fault > 0.96:
                time.sleep(100.0)
            raise ValueError("no way out")
        return super().step_batch(perceived)
'''

APART = """
import os
import time

from resim.function import Command


class Faulty:
    def __init__(self, fault):
        self.fault = fault

    def reset(self, setup):
        self.wanted = setup.start.v
        time.sleep(0.2)

    def step(self, perceived):
        if perceived.t > 0.5 and self.fault > 0.94:
            if self.fault > 0.98:
                os.kill(os.getpid(), 11)
            if self.fault > 0.96:
                time.sleep(100.0)
            raise ValueError("no way out")
        return Command(0.4 * (self.wanted - perceived.ego.v), 0.0)

    def close(self):
        pass
"""

SWEEP = """
name = "killed"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["faulty.toml"]
perception = "{root}/adfunc/perception/proving_ground.json"
plan = "halton"
points = {points}
seeds = 1
engine = "{engine}"
repeated_in_sumo = 0.1
time_limit = 20.0

[[recording]]
folder = "short"

[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 1.2

[[parameter]]
name = "{second}"
low = 0.0
high = 1.0
"""


@pytest.fixture(scope="module", params=["sumo", "direct", "direct in batches", "direct apart"])
def sweep(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep over the first second and a half of the corner case, and its undisturbed results beside it."""
    home = tmp_path_factory.mktemp("faults")
    short, whole = home / "short", ROOT / "scenarios" / "cut_in_brake"
    short.mkdir()
    text = (whole / "recording.toml").read_text().replace("../../networks", str(ROOT / "networks"))
    (short / "recording.toml").write_text(text)
    for name in ("gt", "sd"):
        rows = pd.read_csv(whole / f"{name}.csv")
        rows[rows["t"] <= 1.5].to_csv(short / f"{name}.csv", index=False)
    engine, _, how = request.param.partition(" ")
    batches, apart = how == "in batches", how == "apart"
    (home / "faulty.py").write_text(APART if apart else FAULTY)
    (home / "faulty.toml").write_text(
        'name = "faulty"\nversion = "1"\nfactory = "faulty:Faulty"\ntime_limit = 0.5\n'
        + (f'[process]\npython = "{sys.executable}"\n' if apart else "")
        + ("" if batches else "[parameters]\nfault = 0.0\n")
    )
    second = "perception.latency.position" if batches else "function.fault"  # runs of one fault are batches
    (home / "sweep.toml").write_text(SWEEP.format(root=ROOT, points=POINTS, engine=engine, second=second))
    assert start("resim", "sweep", str(home / "sweep.toml"), "--out", str(home / "undisturbed")).wait() == 3
    return home / "sweep.toml"


def start(module: str, *arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True, cwd=ROOT,
    )  # fmt: skip


def children(process: int) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(process)], capture_output=True, text=True, check=False).stdout
    return [int(pid) for pid in found.split()]


class Cluster:
    """A Dask scheduler, and a nanny that keeps two workers alive; whatever was killed is started again."""

    def __init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler = self.nannies = None

    def run(self) -> None:
        if self.scheduler is None or self.scheduler.poll() is not None:
            self.scheduler = start(
                "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(self.port),
                "--dashboard-address", ":0",
            )  # fmt: skip
        if self.nannies is None or self.nannies.poll() is not None:
            self.nannies = start(
                "distributed.cli.dask_worker", self.address, "--nworkers", "2", "--nthreads", "1",
                "--dashboard-address", ":0",
            )  # fmt: skip

    def close(self) -> None:
        for process in (self.nannies, self.scheduler):
            if process is not None:
                kill_all(process)


def kill_all(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def is_function(process: int) -> bool:
    """Whether a process is the function itself, whose death is its own fault, whoever kills it."""
    with contextlib.suppress(OSError):
        return b"resim/function/__init__.py" in Path(f"/proc/{process}/cmdline").read_bytes()
    return True


def kill_one(rng: random.Random, among: list[int]) -> bool:
    if not among:
        return False
    with contextlib.suppress(ProcessLookupError):
        os.kill(rng.choice(among), signal.SIGKILL)
        return True
    return False


@pytest.mark.timeout(1200)
@pytest.mark.slow
@pytest.mark.parametrize("kills", [12, 50])
def test_killed_so_often_it_is_the_same(sweep: Path, kills: int) -> None:
    pytest.importorskip("distributed")
    rng, out, there = random.Random(7), sweep.with_name(f"killed-{kills}"), Cluster()
    killed = dict.fromkeys(PARTS, 0)
    half = min(10, kills // 2)  # so many on one machine, then as many on a cluster, and so on
    deadline = time.monotonic() + 900.0
    try:
        command = None
        while sum(killed.values()) < kills:
            assert time.monotonic() < deadline, killed
            turn = sum(killed.values()) % (2 * half)
            on_cluster = turn >= half
            if on_cluster:
                there.run()
            if command is None or command.poll() is not None:
                assert command is None or command.returncode not in (0, 3), (
                    f"over after {killed}: it needs more runs"
                )
                how = ("--scheduler", there.address) if on_cluster else ("--workers", "2")
                command = start("resim", "sweep", str(sweep), "--out", str(out), "--resume", *how)
                time.sleep(rng.uniform(3.0, 5.0))
            time.sleep(rng.uniform(0.1, 0.8))
            forced = {half // 2: "command", half + half // 2: "scheduler"}.get(turn)
            part = forced or rng.choices(PARTS, (6, 4, 1, 1))[0]
            workers = [] if there.nannies is None else children(there.nannies.pid)
            if part == "child":
                every = [c for p in (command.pid, *workers) for c in below(p)]
                done = kill_one(rng, [c for c in every if not is_function(c)])
            elif part == "worker":
                done = kill_one(rng, workers)
            elif part == "scheduler":
                done = there.scheduler is not None and kill_one(rng, [there.scheduler.pid])
            else:
                kill_all(command)
                done = True
            killed[part] += done
            if sum(killed.values()) % half == 0:
                kill_all(command)  # the other way of running goes on
    finally:
        if command is not None:
            kill_all(command)
        there.close()
    assert all(killed.values()), killed
    assert (
        start("resim", "sweep", str(sweep), "--out", str(out), "--resume").wait() == 3
    )  # some runs fail, as they are to
    entries = sorted(entry.run for entry in journal.read(out / "journal"))
    assert entries == list(range(POINTS))
    assert bytes_of(out) == bytes_of(sweep.with_name("undisturbed"))


@pytest.mark.slow
def test_the_faults_are_told(sweep: Path) -> None:
    found = table(sweep.with_name("undisturbed"))
    fault = found["function.fault"] if "function.fault" in found else found["seed"] * 0.618 % 1.0
    ends = found.set_index(fault).end.sort_index()
    assert (ends[0.94:] == "function_failed").all()
    assert len(ends[0.98:]) > 0
    assert len(ends[0.94:0.96]) > 0
    assert len(ends[0.96:0.98]) > 0
    assert (ends[:0.94] == "duration").all()
