"""Runs of a sweep a second and core, what a second worker brings, what the engine costs, and whether memory grows.

    python tools/bench/sweep.py [DATA] [--runs 240] [--rounds 6] [--long 0] [--seconds 10]

A run is a re-simulation by highway_pilot-1.0 with the trained perception model, with its errors and criticality, risk
at 5 Hz. First one process does runs of the corner case and, with DATA (../shared/data), of two NGSIM US-101 recordings,
35 objects over 8 s and 54 over 16.6 s, with both engines, one by one and as many at once as a sweep does, in turns: CPU
time a run, least and median. `harness_ms`: that of a run of the corner case by a function that has `step` alone, less
what the function took inside it. Targets a second and core with the engine direct: 100
runs of the corner case (300 the goal), 20 (60) and 8 (25) of the recordings; 10 ms (5) for the harness.

Then the runner, with runs of 10 s at 25 Hz with five traffic objects (a drive of tools/bench/verify.py), engine direct.
Targets: two workers 1.9 times one (1.95); less than 5 % for the runner.

In turns, in each round: the same runs by one worker, in a plain loop in this process, and by two workers, journal and
all. The other cores are kept busy, as an idle one makes the others of a virtual machine slower, by up to a half.
Counted from the first batch of each worker on: what a worker loads first is told as `start_s`. The best of the rounds
counts, as what else the machine does only slows; so rounds are short and many. `overhead`: the share of one worker's
time that it did not spend in runs. Half of a run is the interpreter's own time, so `loop_ns` tells how fast that is:
one turn of a plain loop. (Built with its makers' optimisations, as distributions do and pyenv by itself does not, it
is about twice as fast.)

`--long N`: N runs more with two workers, of drives of `--seconds`, and every tenth of the way the memory of the
children and of this process.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median

from resim.execution import journal
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings import read_commonroad, read_recording
from resim.resimulation import ResimulationOptions
from resim.simulation.function.interface import Build, load_build
from resim.sweeps.engines import ENGINES
from resim.sweeps.execution import begin, execute, inputs, tasks
from resim.sweeps.file import Sweep, read_sweep, runs
from resim.sweeps.one_run import prepare_sweep, run_together
from resim.sweeps.tasks import MOST, in_batches, run

sys.path.insert(0, str(Path(__file__).parent))
from verify import drive, record

ROOT = Path(__file__).parents[2]
SWEEP = """
name = "bench"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["{root}/adfunc/builds/highway_pilot-1.0.toml"]
perception = "{root}/adfunc/perception/proving_ground.json"
seeds = {seeds}
engine = "direct"
repeated_in_sumo = 0.0

[[recording]]
folder = "drive"

[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 1.0
steps = 10
"""


NGSIM = {
    "US-101-12, 35 objects": ("USA_US101-12_1_T-1", "296"),
    "US-101-22, 54 objects": ("USA_US101-22_1_T-1", "659"),
}
CORNER = "corner case"


METERED = """
import time
from adfunc.highway_pilot import HighwayPilot


class Metered:
    def __init__(self, *, told):
        self.pilot, self.told, self.inside = HighwayPilot(), told, 0.0

    def reset(self, setup):
        self.pilot.reset(setup)

    def step(self, perceived):
        begun = time.process_time()
        answer = self.pilot.step(perceived)
        self.inside += time.process_time() - begun
        return answer

    def close(self):
        with open(self.told, "w") as file:
            file.write(repr(self.inside))
"""
"""highway_pilot with `step` alone, which tells how much CPU time [s] it took."""


def metered(home: Path) -> tuple[Build, Path]:
    """Give the build of it, and the file in which it tells."""
    told = home / "told" / "inside.txt"
    told.parent.mkdir()
    (home / "metered.py").write_text(METERED, encoding="utf-8")
    text = f'name = "metered"\nversion = "1.0"\nfactory = "metered:Metered"\n[parameters]\ntold = "{told}"\n'
    (home / "metered.toml").write_text(text, encoding="utf-8")
    return load_build(home / "metered.toml"), told


def engines(data: Path | None, rounds: int, home: Path) -> dict[str, float]:
    """Print CPU times of runs with both engines, and of a function with `step` alone; give runs a second and core with
    direct, and harness_ms.
    """
    criteria = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
    build, (step_alone, told) = (
        load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"),
        metered(home),
    )
    model = read_model(ROOT / "adfunc" / "perception" / "proving_ground.json")
    recordings = {CORNER: read_recording(ROOT / "scenarios" / "cut_in_brake")}
    for name, (file, ego) in NGSIM.items() if data is not None else ():
        at = data / "ngsim" / file
        recordings[name] = read_commonroad(at.with_suffix(".xml"), map=at.with_suffix(".xodr"), ego=ego)
    sumo, direct = (ResimulationOptions(engine=ENGINES[name]) for name in ("sumo", "direct"))
    ways = {
        "sumo": (build, 1, sumo), "direct": (build, 1, direct), "direct, at once": (build, MOST, direct),
        "direct, step alone": (step_alone, MOST, direct),
    }  # fmt: skip
    out = dict[str, float]()
    print("| run | engine | runs at once | CPU a run, least [ms] | median [ms] |\n|---|---|---|---|---|")
    for name, recording in recordings.items():
        prepared, taken, inside = (
            prepare_sweep(recording, criteria),
            {way: list[float]() for way in ways},
            0.0,
        )
        for turn in range(rounds + 1):
            for way, (of, count, options) in ways.items():
                seeds = [(model, turn * MOST + k) for k in range(count)]
                begun = time.process_time()
                run_together(prepared, of, seeds, options)
                taken[way].append((time.process_time() - begun) / count)
            least = min(taken["direct, step alone"][1:], default=0.0)
            if taken["direct, step alone"][-1] == least:
                inside = float(told.read_text(encoding="utf-8"))
        for way, (_, count, _) in ways.items():
            row = (1e3 * of(taken[way][1:]) for of in (min, median))
            print(f"| {name} | {way} | {count} | " + " | ".join(f"{ms:.1f}" for ms in row) + " |", flush=True)
        key = {CORNER: "runs_per_s_core"}.get(name, f"runs_per_s_core, {name}")
        out[key] = round(1.0 / min(taken["direct, at once"][1:]), 1)
        if name == CORNER:
            out["harness_ms"] = round(1e3 * (least - inside), 1)
    return out


def sweep_of(home: Path, count: int) -> Sweep:
    """A sweep of so many runs of the drive in a folder."""
    path = home / f"sweep_{count}.toml"
    path.write_text(SWEEP.format(root=ROOT, seeds=count // 10), encoding="utf-8")
    return read_sweep(path)


def turn() -> float:
    """Nanoseconds of one turn of a plain loop in this interpreter."""

    def turns(count: int) -> int:
        total = 0
        for k in range(count):
            total += 2 * k
        return total

    return min(timeit.repeat(lambda: turns(10**5), number=10, repeat=20)) * 1e3


def plain(sweep: Sweep) -> float:
    """Seconds a run in a loop in this process."""
    every = list(tasks(sweep, runs(sweep)))
    run((every[0],))
    begun = time.perf_counter()
    for batch in in_batches(every, 1):
        run(batch)
    return (time.perf_counter() - begun) / len(every)


def swept(sweep: Sweep, home: Path, workers: int) -> tuple[float, float, float]:
    """Seconds a run by so many loaded workers; the share of it that they were not in runs; seconds until loaded."""
    out = home / "out"
    shutil.rmtree(out, ignore_errors=True)
    begin(out, inputs(sweep, out), resume=False)
    came: list[float] = []
    begun = time.perf_counter()
    execute(sweep, out, workers=workers, tell=lambda failed: came.append(time.perf_counter()))
    first = workers * len(
        in_batches([*tasks(sweep, runs(sweep))], workers)[0]
    )  # of each worker its first batch
    inside = [entry.time for entry in journal.read(out / "journal")][first:]
    each = (came[-1] - came[first - 1]) / len(inside)
    return each, each * workers * len(inside) / sum(inside) - 1.0, came[first - 1] - begun


@contextmanager
def others_busy(used: int) -> Iterator[None]:
    """Keep the cores busy that are not used: on a virtual machine an idle core makes the others slower."""
    spinning = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range((os.cpu_count() or 1) - used)
    ]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def memory() -> tuple[int, int]:
    """MiB of the largest child, and of this process."""
    told = subprocess.run(
        ["ps", "-o", "rss=,comm=", "--ppid", str(os.getpid())], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    children = [int(line.split()[0]) for line in told if "python" in line]
    own = Path("/proc/self/statm").read_text(encoding="utf-8").split()[1]
    return max(children, default=0) // 1024, int(own) * os.sysconf("SC_PAGE_SIZE") // 2**20


def long(sweep: Sweep, home: Path, count: int) -> None:
    """Do many runs, and print memory on the way."""
    out = home / "long"
    begin(out, inputs(sweep, out), resume=False)
    done, begun = 0, time.perf_counter()
    print("| runs | s | largest worker [MiB] | command [MiB] |\n|---|---|---|---|")

    def tell(failed: bool) -> None:
        nonlocal done
        done += 1
        if done == 100 or done % (count // 10) == 0:
            print(
                f"| {done} | {time.perf_counter() - begun:.0f} | {memory()[0]} | {memory()[1]} |", flush=True
            )

    execute(sweep, out, workers=2, tell=tell)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="?", type=Path, metavar="DATA", help="folder with ngsim/")
    parser.add_argument("--runs", type=int, default=240)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--long", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=10.0)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        home = Path(temporary)
        record("drive", replace(drive(0), duration=given.seconds), home / "drive")
        if given.long:
            long(sweep_of(home, given.long), home, given.long)
            return
        print(f"load before {os.getloadavg()[0]:.2f}")
        single = engines(given.data, 2 * given.rounds, home)
        print("seconds a run of 10 s with five objects")
        print("| round | plain loop | 1 worker | 2 workers |\n|---|---|---|---|")
        found = []
        for number in range(given.rounds):
            sweep, double = sweep_of(home, given.runs), sweep_of(home, 2 * given.runs)
            with others_busy(1):
                one, engine, start = swept(sweep, home, 1)
                alone = plain(sweep)
            row = (alone, one, swept(double, home, 2)[0])
            found.append((*row, engine, start))
            print(f"| {number + 1} | " + " | ".join(f"{s:.4f}" for s in row) + " |", flush=True)
    loop, one, two, engine, start = (min(column) for column in zip(*found, strict=True))
    print(json.dumps({
        **single, "five_objects_per_s_core": round(1.0 / one, 1),
        "scaling": round(one / two, 2), "overhead": round(engine, 3), "plain_per_s": round(1.0 / loop, 1),
        "start_s": round(start, 1), "python": platform.python_version(), "loop_ns": round(turn()),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
