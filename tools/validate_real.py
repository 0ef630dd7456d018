"""Re-simulate real vehicles, and print what docs/validation.md holds of them.

    python tools/validate_real.py fits ../shared/data
    python tools/validate_real.py runs ../shared/data [--vehicles 2] [--only NAME]

Every vehicle of NGSIM (four US-101 scenarios, Lankershim) that is there for at least 5 s can be EGO; the
first and the last in file order of those that are there longest are taken. Mcity trials are imported with
resim.recordings.formats.mcity.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from lxml import etree

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.recordings import Recording, read_commonroad, recording_of
from resim.recordings.formats.mcity import import_trial
from resim.recordings.formats.mcity_frames import trials
from resim.resimulation import ResimulationOptions, resimulate
from resim.road.opendrive import load
from resim.scenario.fit import fit_trace
from resim.simulation.function.interface import load_build

BUILDS = Path(__file__).parents[1] / "adfunc" / "builds"
NGSIM = (
    "USA_US101-5_1_T-1",
    "USA_US101-10_1_T-1",
    "USA_US101-12_1_T-1",
    "USA_US101-22_1_T-1",
    "USA_Lanker-1_17_T-1",
)


COLUMNS = (
    "recording", "EGO", "build", "TO", "FIT_GT EGO", "FIT_GT TO", "SIM_GT EGO max", "SIM_GT TO max", "FIT_rGT EGO",
    "PIPE_GT EGO", "S EGO", "SIM_SD EGO max", "end", "decision GT", "decision rGT", "s",
)  # fmt: skip


def candidates(xml: Path, count: int) -> list[str]:
    """Ids of `count` moving vehicles that are there longest, spread over the file."""
    root = etree.parse(xml, etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
    found = []
    for obstacle in [*root.iterfind("obstacle"), *root.iterfind("dynamicObstacle")]:
        states = obstacle.findall(".//state")
        speeds = [float(e.text) for e in obstacle.findall(".//state/velocity/exact")]
        if speeds and max(speeds) > 2.0:
            found.append((len(states), obstacle.get("id")))
    longest = [name for n, name in found if n >= 0.8 * max(n for n, _ in found)]
    return [longest[i] for i in np.unique(np.linspace(0, len(longest) - 1, count).round().astype(int))]


def recordings(data: Path, count: int) -> list[Recording]:
    """The NGSIM vehicles and the Mcity trials."""
    out = []
    for name in NGSIM:
        xml, road = data / "ngsim" / f"{name}.xml", data / "ngsim" / f"{name}.xodr"
        out += [read_commonroad(xml, map=road, ego=ego) for ego in candidates(xml, count)]
    mcity = data / "mcity"
    network = load(mcity / "mcity.xodr")
    out += [recording_of(import_trial(trial, mcity, network)) for trial in trials(mcity)]
    return out


def row(recording: Recording, build_name: str) -> str:
    """One line of the table."""
    begin = time.perf_counter()
    try:
        result = resimulate(recording, load_build(BUILDS / f"{build_name}-1.0.toml"), ResimulationOptions())
    except ResimError as e:
        return f"| {recording.name} | {recording.ego} | {build_name} | refused: {e} |"
    report, took = result.report, time.perf_counter() - begin

    def of(step: str, who: str, q: str = "d", stat: str = "mean") -> str:
        s = report.errors[step][who][q]
        return "–" if s is None else f"{s[stat]:.3g}"

    cells = [
        recording.name, recording.ego, build_name, f"{len(result.described['GT'].objects)}",
        of("FIT_GT", "ego"), of("FIT_GT", "to"), of("SIM_GT", "ego", stat="max"), of("SIM_GT", "to", stat="max"),
        of("FIT_rGT", "ego"), of("PIPE_GT", "ego"), of("S", "ego"), of("SIM_SD", "ego", stat="max"),
        report.end["rGT"], *("/".join(report.decision[b] or []) or "none" for b in ("GT", "rGT")),
        f"{took:.1f}",
    ]  # fmt: skip
    return "| " + " | ".join(cells) + " |"


def fits(data: Path) -> None:
    """Print the distribution of the GT fit's mean errors over all vehicles, and of what they cost."""
    print("| scenario | vehicles | min | q25 | median | q75 | q90 | max | mean segments | ms a vehicle |")
    print("|" + "---|" * 10)
    everything: list[tuple[float, int, float]] = []
    for name in NGSIM:
        road = data / "ngsim" / f"{name}.xodr"
        ego = candidates(data / "ngsim" / f"{name}.xml", 1)[0]
        gt = read_commonroad(data / "ngsim" / f"{name}.xml", map=road, ego=ego).gt
        rows = [fitted(gt, n) for n in np.flatnonzero(gt.valid.sum(axis=1) >= 2)]
        print(quantiles(name, rows))
        everything += rows if "US101" in name else []
    print(quantiles("four US-101", everything))


def fitted(gt: Tracks, n: int) -> tuple[float, int, float]:
    """Mean error [m], segments and time [s] of one vehicle's fit."""
    own = gt.valid[n]
    begin = time.perf_counter()
    fit = fit_trace(gt.t[own], gt.x[n, own], gt.y[n, own], gt.heading[n, own], gt.v[n, own])
    return float(fit.distance.mean()), len(fit.trace.v.x) - 1, time.perf_counter() - begin


def quantiles(name: str, rows: list[tuple[float, int, float]]) -> str:
    """One line of the table of fits."""
    errors, segments, times = np.array(rows).T
    cells = [f"{q:.4f}" for q in np.quantile(errors, [0.0, 0.25, 0.5, 0.75, 0.9, 1.0])]
    return (
        f"| {name} | {len(rows)} | {' | '.join(cells)} | {segments.mean():.1f} | {1e3 * times.mean():.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=["fits", "runs"])
    parser.add_argument("data", type=Path)
    parser.add_argument("--vehicles", type=int, default=2, help="EGOs of each NGSIM scenario")
    parser.add_argument("--only", default="", help="recordings whose name contains this")
    arguments = parser.parse_args()
    if arguments.what == "fits":
        fits(arguments.data)
        return
    print(f"| {' | '.join(COLUMNS)} |\n|" + "---|" * len(COLUMNS))
    for recording in recordings(arguments.data, arguments.vehicles):
        if arguments.only in recording.name:
            for build in ("replay", "follow_trace", "idm", "highway_pilot"):
                print(row(recording, build), flush=True)


if __name__ == "__main__":
    main()
