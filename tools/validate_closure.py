"""Does a perception model close the gap between measured drive and re-simulation? The corner case, over seeds.

    python tools/validate_closure.py [MODEL] [--seeds 20] [--drives 1]

Re-simulates scenarios/cut_in_brake on GT with the model, and with the virtual sensor itself that the drive was made
with (tools/virtual_sensor.py), other seeds: what no model can do better than. With --drives N the same is done
for N - 1 more drives of the same case, made with other seeds of the sensor in a temporary folder.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from drives import DRIVES
from make_scenarios import ROOT, record
from virtual_sensor import Sensor

from resim.perception.model import read_model
from resim.recordings import Recording, read_recording
from resim.resimulation import (
    PerceptionSetup,
    Resimulation,
    ResimulationOptions,
    end_error,
    fidelity,
    resimulate,
)
from resim.resimulation.reaction import ego_tracks
from resim.scenario import maneuvers
from resim.scenario.scenario import describe
from resim.simulation.case import Case
from resim.simulation.function.interface import load_build
from resim.simulation.sumo.engine import Sumo

SHIPPED = ROOT / "adfunc" / "perception" / "proving_ground.json"
BUILD = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
CASE = "cut_in_brake"

Seed = tuple[bool, float | None, float | None]
"""Of one run: whether it decides as measured, how much later it brakes [s], and how far off it ends [m]."""


@dataclass(frozen=True)
class Closure:
    """How a measured drive is re-simulated: first braking [s] as measured, without a model, and with it by seed."""

    measured: float
    without: Seed
    seeds: Sequence[Seed]

    def share(self) -> float:
        """Give the share of seeds that decide as measured."""
        return float(np.mean([same for same, _, _ in self.seeds]))

    def late(self) -> list[float]:
        """Give by how much [s] those seeds that brake do so later than measured."""
        return [late for _, late, _ in self.seeds if late is not None]

    def off(self) -> list[float]:
        """Give the errors [m] at the end."""
        return [off for _, _, off in self.seeds if off is not None]

    def met(self) -> tuple[bool, bool, bool]:
        """Say which of TARGETS the drive meets; what cannot be said is not met."""
        late, off, without = self.late(), self.off(), self.without[2]
        near = bool(late) and abs(float(np.median(late))) < 0.1
        return self.share() >= 0.9, near, bool(off) and without is not None and np.median(off) < without / 3.0


TARGETS = (
    "the measured decision in at least 90 % of the seeds",
    "median difference in reaction time under 0.1 s",
    "error at the end under a third of that without",
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", type=Path, nargs="?", default=SHIPPED)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--drives", type=int, default=1, help="the shipped recording, and N - 1 more")
    asked = parser.parse_args()
    perceiving = PerceptionSetup(read_model(asked.model), tuple(range(asked.seeds)))
    with tempfile.TemporaryDirectory() as folder:
        drives = recordings(asked.drives, Path(folder))
        shipped, result = resimulated(next(drives), perceiving)
        sensor = by_the_sensor(result, asked.seeds)
        print_shipped(shipped, perceiving.model.name, sensor)
        found, yardstick = [shipped], [replace(shipped, seeds=sensor)]
        for drive in drives:
            one, result = resimulated(drive, perceiving)
            found.append(one)
            yardstick.append(replace(one, seeds=by_the_sensor(result, asked.seeds)))
        if asked.drives > 1:
            print_drives({perceiving.model.name: found, "the sensor itself": yardstick})


def recordings(count: int, folder: Path) -> Iterator[Recording]:
    """Give the shipped recording, and others of the same case made with the sensor's next seeds."""
    drive = DRIVES[CASE]
    yield read_recording(ROOT / "scenarios" / CASE)
    for seed in range(drive.seed + 1, drive.seed + count):
        record(CASE, replace(drive, seed=seed), folder / str(seed))
        yield read_recording(folder / str(seed))


def resimulated(recording: Recording, perceiving: PerceptionSetup) -> tuple[Closure, Resimulation]:
    """Re-simulate a drive without the model and with it."""
    result = resimulate(
        recording, load_build(BUILD), ResimulationOptions(bases=("GT",)), perceiving=perceiving
    )
    report = result.report
    measured = report.decision["GT"]
    seeds = [
        (
            s.decision == measured and s.failure is None,
            s.reaction_difference,
            s.end_position_error,
        )
        for s in (() if report.perception is None else report.perception.seeds)
    ]
    same = report.decision["rGT"] == measured
    without = same, report.reaction_difference["rGT"], report.end_position_error["rGT"]
    return Closure(report.reaction["GT"], without, seeds), result


def by_the_sensor(result: Resimulation, seeds: int) -> list[Seed]:
    """Re-simulate with the virtual sensor itself in place of a model."""
    report, gt, out = result.report, result.measured["GT"], []
    for seed in range(seeds):
        shown = Sensor(DRIVES[CASE].sensor)
        run = Case(result.described["GT"], result.network, result.build, Sumo(), shown, seed=seed).drive()
        own = run.truth.select([result.ego])
        refit = describe(own, result.network, ego=result.ego, map_name="proving_ground.xodr")
        off = end_error(run, fidelity.pipeline_error(refit, gt, result.network))
        driven = ego_tracks(refit, result.network)
        same = tuple(maneuvers.decision(driven, result.network, ego=result.ego)) == report.decision["GT"]
        reaction = maneuvers.reaction_time(driven, ego=result.ego)
        out.append((same, None if reaction is None else round(reaction - report.reaction["GT"], 9), off))
    return out


def print_shipped(found: Closure, model: str, sensor: list[Seed]) -> None:
    """Print the table of the shipped recording."""
    print(f"measured: first braking at {found.measured:.2f} s\n")
    print("| re-simulated with | same decision | first braking against GT: median, 5 to 95 % | end error |")
    print("|---|---|---|---|")
    decided, late, apart = found.without
    print(f"| ideal perception | {int(decided)} of 1 | {late:+.2f} s | {apart:.2f} m |")
    for name, of in ((model, found), ("the sensor itself", replace(found, seeds=sensor))):
        low, middle, high = np.quantile(of.late(), [0.05, 0.5, 0.95])
        same, off = sum(s for s, _, _ in of.seeds), of.off()
        braking = f"{middle:+.3f} s, {low:+.2f} to {high:+.2f}"
        error = f"{np.median(off):.2f} m, {min(off):.2f} to {max(off):.2f}"
        print(f"| {name} | {same} of {len(of.seeds)} | {braking} | {error} |")


def print_drives(every: Mapping[str, Sequence[Closure]]) -> None:
    """Print how many of the drives meet each target, and medians over the drives, by what they were seen with."""
    met = [np.array([f.met() for f in found]).sum(axis=0) for found in every.values()]
    some = next(iter(every.values()))
    print(
        f"\n| drives that meet the target, of {len(some)} | {' | '.join(every)} |\n|---|{'---|' * len(every)}"
    )
    for k, target in enumerate(TARGETS):
        print(f"| {target} | {' | '.join(str(counts[k]) for counts in met)} |")
    late = [[float(np.median(f.late())) for f in found] for found in every.values()]
    off = [[float(np.median(f.off())) for f in found] for found in every.values()]
    for name, columns, unit in (
        ("median difference in reaction time", late, "s"),
        ("its size", np.abs(late), "s"),
        ("median error at the end", off, "m"),
    ):
        print(f"| {name}: median of the drives, range | {' | '.join(_middle(c, unit) for c in columns)} |")
    print(f"\nmeasured: first braking at {_middle([f.measured for f in some], 's')}")
    print(f"without the model: {_middle([f.without[1] for f in some], 's')} later, ", end="")
    print(f"{_middle([f.without[2] for f in some], 'm')} off at the end")


def _middle(values: Sequence[float | None], unit: str) -> str:
    low, middle, high = np.quantile(np.array(values, dtype=float), [0.0, 0.5, 1.0])
    return f"{middle:.2f} {unit}, {low:.2f} to {high:.2f}"


if __name__ == "__main__":
    main()
