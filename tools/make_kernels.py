"""Make the kernels that ship, of made traffic, cut at the truth of its lane changes.

    resim traffic networks/motorway.xodr --hours 0.6 --out out/traffic
    python tools/make_kernels.py out/traffic [--out scenarios/kernels/motorway.json] [--report PAGE] [--workers 2]

Between its lane changes a vehicle follows its lane. The traffic is synthetic: its drivers are SUMO's, its lane changes
of least jerk; so nothing is claimed of humans. Same traffic, same bytes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.jobs.kernels import TrainOptions, fitted_kernels, kernel_likeness
from resim.recordings import read_tables
from resim.results import whole_file
from resim.variations.kernels import write_kernels
from resim.variations.page.kernels import write_kernel_page
from resim.variations.training import LONGEST, CuttingTask, chosen_maneuvers, pooled, traces_of

ROOT = Path(__file__).parents[1]
ERROR = 1e-3
"""Relative error to which the traces are reconstructed: the published one. Made traffic is so smooth that 20 components
would be mostly rounding, which variations then show."""
MOST = 2400
"""Traces of a maneuver."""
APART, EDGE = 0.2, 0.1
"""s between a lane change and the following of a lane, and s left out at either end of a vehicle's life."""
CHANGES = ("lane_change_left", "lane_change_right")


def maneuvers(folder: Path) -> Iterator[tuple[str, str, float, float]]:
    """Give label, object, start and end [s] of every maneuver of a recording."""
    gt = read_tables(folder).gt
    life = gt.groupby("id")["t"].agg(["min", "max"])
    truth = pd.read_csv(folder / "truth.csv", dtype={"object": str})
    changes = truth[truth["label"].isin(CHANGES)].sort_values("start")
    for name, span in life.iterrows():
        first, last = float(span["min"]) + EDGE, float(span["max"]) - EDGE
        for one in changes[changes["object"] == str(name)].itertuples():
            if one.start >= first and one.end <= last:
                yield str(one.label), str(name), float(one.start), float(one.end)
            if one.start - APART - first > 2.0:
                yield "follow_lane", str(name), first, float(one.start) - APART
            first = max(first, float(one.end) + APART)
        if last - first > 2.0:
            yield "follow_lane", str(name), first, last


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("traffic", type=Path)
    parser.add_argument("--out", type=Path, default=ROOT / "scenarios" / "kernels" / "motorway.json")
    parser.add_argument("--report", type=Path)
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    folders = {path.parent.name: path.parent for path in sorted(arguments.traffic.glob("*/truth.csv"))}
    taken = chosen_maneuvers(
        {name: tuple(maneuvers(folder)) for name, folder in folders.items()}, LONGEST, MOST
    )
    tasks = [CuttingTask(folder, name, taken[name]) for name, folder in folders.items()]
    done = dict(run_all(traces_of, tasks, workers=arguments.workers, time_limit=7200.0))
    found = []
    for k in range(len(tasks)):
        one = done[k]
        assert not isinstance(one, Failure), one.reason
        found.append(one)
    kernels, held = fitted_kernels(found, TrainOptions(error=ERROR)), pooled(found)
    with whole_file(arguments.out, None) as beside:
        write_kernels(kernels, beside)
    likeness = kernel_likeness(kernels, held)
    if arguments.report is not None:
        with whole_file(arguments.report) as beside:
            write_kernel_page(kernels, held, likeness, beside)
    for name, kernel in kernels.kernels.items():
        print(f"{name}: {kernel.traces} and {kernel.held_out} held out, {kernel.count} components")
    for name, (alike, noisy) in likeness.items():
        print(f"{name}: AUC {alike}, noise {noisy}")


if __name__ == "__main__":
    main()
