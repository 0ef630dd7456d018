"""Are variations of the corner case local, throughout the pipeline? Wagner 2021, Figs. 6.6 to 6.8.

    python tools/validate_locality.py [--kernels FILE] [--count 500] [--wider 100] [--picture docs/images/locality.png]

The lane change of the object that cuts in is varied, `--count` times in a box of 0.5 % of each component's range and
`--wider` times in each larger one, each variation simulated with highway_pilot-1.0 on GT. Local is what ends as the
re-simulated original does in risk: 95 % of a box within an order of magnitude, as Fig. 6.8 has a logarithmic axis. How
many make the same decision, and have the same outcome of every criterion, is told besides: that flips wherever the
original is near a threshold of the function.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.metrics.criteria import read_criteria
from resim.recordings.checked import load_checked
from resim.resimulation import ResimulationOptions
from resim.simulation.function.interface import load_build
from resim.sweeps.engines import ENGINES
from resim.sweeps.one_run import PreparedRuns, prepare_sweep, run_once
from resim.variations.candidate import VariedDrive
from resim.variations.plan import make_plan
from resim.variations.search import look, search
from resim.variations.settings import VariationSettings, WhatVaries

ROOT = Path(__file__).parents[1]
BOXES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2)
WHAT = WhatVaries(objects=("1",), labels=("lane_change_right",))
FACTOR, SHARE = 10.0, 0.95
"""Of the risk of rGT; share of variations that have to be local for the box to be."""
SHOWN = 100
GREEN, BLUE, PURPLE = "#009E73", "#0072B2", "#7B3294"


@dataclass(frozen=True, eq=False)
class Simulated:
    """A variation (None: the original) and what its simulation came to."""

    drive: VariedDrive | None
    tracks: Tracks
    risk: float
    outcome: tuple[object, ...]


@dataclass(frozen=True, eq=False)
class Box:
    """All of one box. looked: points of the sequence."""

    size: float
    runs: list[Simulated]
    looked: int


def simulated(prepared: PreparedRuns, drive: VariedDrive | None) -> Simulated:
    """Simulate a variation."""
    if drive is not None:
        told = {**prepared.recording.described, "GT": drive.scenario}
        prepared = replace(prepared, recording=replace(prepared.recording, described=told))
    build = load_build(ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml")
    done, row = run_once(prepared, build, None, 0, ResimulationOptions(engine=ENGINES["direct"]))
    outcome = row["decision"], *(value for name, value in row.items() if name.startswith("kpi "))
    return Simulated(drive, done.truth, float(row["risk"] or 0.0), outcome)


def boxes(kernels: Path, prepared: PreparedRuns, count: int, wider: int) -> Iterator[Box]:
    """Simulate variations of each box."""
    recording = prepared.recording.recording
    for size in BOXES:
        plan = make_plan(recording, kernels, WHAT, VariationSettings(box=size))
        wanted = count if size == BOXES[0] else wider
        found = list(search(plan, wanted, lambda tasks: map(look, tasks), 40 * wanted))
        kept = [one.drive for one in found if not one.rejected and one.drive is not None]
        yield Box(size, [simulated(prepared, drive) for drive in kept], len(found))


def local(run: Simulated, origin: Simulated, factor: float = FACTOR) -> bool:
    """Whether the risk of a variation is near that of the original."""
    ratio = max(run.risk, 1e-12) / max(origin.risk, 1e-12)
    return 1.0 / factor <= ratio <= factor


def row(box: Box, origin: Simulated, ego: str) -> str:
    """One line of the table."""
    risk = np.array([run.risk for run in box.runs])
    share = np.mean([local(run, origin) for run in box.runs])
    twice = np.mean([local(run, origin, 2.0) for run in box.runs])
    same = np.mean([run.outcome == origin.outcome for run in box.runs])
    end = [own(run.tracks, ego).x[0, -1] - own(origin.tracks, ego).x[0, -1] for run in box.runs]
    distance = np.median([run.drive.distance for run in box.runs if run.drive is not None])
    low, middle, high = np.quantile(risk, [0.025, 0.5, 0.975])
    return (
        f"| {100 * box.size:g} % | {len(box.runs)} | {box.looked - len(box.runs)} | {distance:.3f} | "
        f"{low:.2e} | {middle:.2e} | {high:.2e} | {np.min(end):+.2f} to {np.max(end):+.2f} | {100 * same:.1f} % | "
        f"{100 * twice:.1f} % | {100 * share:.1f} % | {'local' if share >= SHARE else 'lost'} |"
    )


def own(tracks: Tracks, name: str) -> Tracks:
    return tracks.select([name])


def draw(found: list[Box], origin: Simulated, ego: str, file: Path) -> None:
    """Figs. 6.6 and 6.7 of the smallest box side by side, below them 6.8 of every box."""
    figure = plt.figure(figsize=(11.0, 11.0), layout="constrained")
    grid = figure.add_gridspec(4, len(found), height_ratios=[1.0, 1.0, 1.0, 1.1])
    half = len(found) // 2
    first = found[0].runs[:SHOWN]
    for column, (title, who) in enumerate(
        (("variations (Fig. 6.6)", "1"), ("simulated EGO (Fig. 6.7)", ego))
    ):
        span = slice(column * half, (column + 1) * half)
        for k, (what, label) in enumerate((("y", "y [m]"), ("v", "v [m/s]"), ("heading", "heading [rad]"))):
            axes = figure.add_subplot(grid[k, span])
            for run in first:
                one = own(run.tracks, who)
                across = one.x[0] if k == 0 else one.t
                axes.plot(
                    across, getattr(one, what)[0], color=PURPLE if who == "1" else BLUE, lw=0.4, alpha=0.4
                )
            whole = own(origin.tracks, who)
            axes.plot(whole.x[0] if k == 0 else whole.t, getattr(whole, what)[0], color=GREEN, lw=1.2)
            axes.set_ylabel(label)
            axes.set_xlabel("x [m]" if k == 0 else "t [s]")
            if k == 0:
                axes.set_title(f"{title}, {len(first)} of {100 * found[0].size:g} %; green: the original")
    low = np.log10(max(min(run.risk for box in found for run in box.runs), 1e-9))
    high = np.log10(max(run.risk for box in found for run in box.runs))
    bins: Floats = np.logspace(low - 0.1, high + 0.1, 40)
    for k, box in enumerate(found):
        axes = figure.add_subplot(grid[3, k])
        axes.hist(np.maximum([run.risk for run in box.runs], 1e-9), bins=bins, color=PURPLE)
        axes.axvline(origin.risk, color=GREEN, ls="--")
        axes.set_xscale("log")
        axes.set_title(f"{100 * box.size:g} %")
        axes.set_xlabel("risk (Fig. 6.8)")
    figure.savefig(file, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kernels", type=Path, default=ROOT / "scenarios" / "kernels" / "motorway.json")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--wider", type=int, default=100)
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    recording = load_checked(ROOT / "scenarios" / "cut_in_brake")
    prepared = prepare_sweep(recording, read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml"))
    origin = simulated(prepared, None)
    print(f"rGT: risk {origin.risk:.3e}, {origin.outcome}\n")
    print("| box | variations | rejected | median distance [sd] | risk 2.5 % | median | 97.5 % | EGO's end [m] | "
          "same outcome | risk within a factor of 2 | of 10 | |")  # fmt: skip
    print("|" + "---|" * 12, flush=True)
    found = []
    for box in boxes(arguments.kernels, prepared, arguments.count, arguments.wider):
        print(row(box, origin, recording.ego), flush=True)
        found.append(box)
    if arguments.picture is not None:
        draw(found, origin, recording.ego, arguments.picture)


if __name__ == "__main__":
    main()
