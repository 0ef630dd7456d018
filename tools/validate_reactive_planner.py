"""Drive with the CommonRoad reactive planner, and print what docs/validation.md holds of it.

    make reactive_planner
    python tools/validate_reactive_planner.py [../shared/data] [--horizon 60]

The corner case, its neighbours, and of each US-101 scenario the first two vehicles that tools/make_us101.py takes, on
ground truth. ms: of an answer, asked in this process. braked: cycles without a trajectory, in which it brakes hard.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
from make_us101 import SCENARIOS, make

import resim
from resim.core.errors import ResimError
from resim.simulation.function.interface import Command, Perceived
from resim.simulation.function.messages import MessageFunction

ROOT = Path(__file__).parents[1]
BUILD = ROOT / "adfunc" / "builds" / "reactive_planner-2025.1.toml"
COLUMNS = (
    "recording",
    "decision GT",
    "decision rGT",
    "end",
    "FAIL",
    "INVALID",
    "braked",
    "cycles",
    "ms",
    "99 %",
    "s",
)
answers: list[tuple[float, float, float]] = []
"""t [s], acceleration [m/s²] and time [s] of each answer of the run."""


_asked = MessageFunction.step


def timed(function: MessageFunction, perceived: Perceived) -> Command:
    """Ask for an answer, and note it and how soon it came."""
    begin = time.perf_counter()
    command = _asked(function, perceived)
    answers.append((perceived.t, command.acceleration, time.perf_counter() - begin))
    return command


def row(folder: Path, build: Path, criteria: str) -> str:
    """One line of the table."""
    answers.clear()
    limits, begin = ROOT / "scenarios" / "criteria" / f"{criteria}.toml", time.perf_counter()
    try:
        result = resim.resimulate(folder, build, resim.ResimulationOptions(bases=("GT",)), criteria=limits)
    except ResimError as e:
        return f"| {folder.name} | refused: {e} |"
    took = time.perf_counter() - begin
    t, a, ms = np.array(answers).T
    driven = t >= 0.0
    decisions = ["/".join(result.report.decision[basis] or []) or "none" for basis in ("GT", "rGT")]
    judged = result.verdicts["rGT"]
    broken = [
        ", ".join(str(name) for name, verdict in judged.items() if verdict == bad) or "–"
        for bad in ("FAIL", "INVALID")
    ]
    cells = [
        folder.name, *decisions, result.report.end["rGT"], *broken, f"{(a[driven] == -8.0).sum()}",
        f"{driven.sum()}", f"{1e3 * np.median(ms):.0f}", f"{1e3 * np.quantile(ms, 0.99):.0f}", f"{took:.1f}",
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--horizon", type=int, default=30, help="planner's time_steps_computation, of 0.1 s")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    asked = parser.parse_args()
    MessageFunction.step = timed  # type: ignore[method-assign]
    print(f"| {' | '.join(COLUMNS)} |\n|" + "---|" * len(COLUMNS))
    with tempfile.TemporaryDirectory() as made:
        ours = [ROOT / "scenarios" / "cut_in_brake", *sorted((ROOT / "scenarios" / "neighbours").iterdir())]
        folders = [(folder, "highway") for folder in ours]
        for name in SCENARIOS if asked.data else ():
            folders += [(Path(made) / found, "traffic") for found in make(asked.data, name, Path(made), 2)]
        build = BUILD.with_name(f"reactive_planner_{asked.horizon}.toml") if asked.horizon != 30 else BUILD
        text = BUILD.read_text(encoding="utf-8").replace("computation = 30", f"computation = {asked.horizon}")
        try:
            build.write_text(text, encoding="utf-8")
            for folder, criteria in folders:
                if asked.only in folder.name:
                    print(row(folder, build, criteria), flush=True)
        finally:
            if build != BUILD:
                build.unlink()


if __name__ == "__main__":
    main()
