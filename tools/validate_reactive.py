"""Traffic that reacts, on NGSIM: collisions that vanish, and how well calibrated drivers follow; tables in Markdown.

python tools/validate_reactive.py ../shared/data [--egos 8]
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from validate_real import BUILDS, NGSIM, candidates

from resim.core.errors import ResimError
from resim.core.geometry import Boxes, boxes_overlap
from resim.recordings import read_commonroad
from resim.resimulation import ResimulationOptions
from resim.resimulation.result import PreparedRecording
from resim.resimulation.run import prepare
from resim.simulation.case import SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.function.interface import Build, load_build
from resim.simulation.reactive.drivers import Following, driver_of, fitted, followed
from resim.simulation.reactive.people import followings, way_of
from resim.simulation.reactive.settings import LaneChangeSettings, ReactiveSettings
from resim.simulation.sumo.engine import Sumo
from resim.simulation.traffic import staged

LEARNED = 0.6
"""Share of an object's following time that its driver is fitted to; the rest is driven."""
LONG = 3.0
"""s of the shortest stretch that is driven."""


def recordings(data: Path, egos: int) -> Iterator[PreparedRecording]:
    """The NGSIM drives of so many vehicles each, but for those that are refused."""
    for name in NGSIM:
        xml = data / "ngsim" / f"{name}.xml"
        for ego in candidates(xml, egos):
            with suppress(ResimError):
                yield prepare(read_commonroad(xml, map=xml.with_suffix(".xodr"), ego=ego), ("GT",))


def simulated(recording: PreparedRecording, build: Build, traffic: ReactiveSettings | None) -> SimulatedDrive:
    """The drive on ground truth."""
    engine = Sumo() if traffic is not None and traffic.drivers == "sumo" else Direct()
    options = ResimulationOptions(bases=("GT",), traffic=traffic, engine=engine)
    return options.case(recording.described["GT"], recording.network, build).drive()


def hit_by(drive: SimulatedDrive) -> str:
    """How the drive's collision came: from behind, where the other's centre is behind the EGO's rear third."""
    if not drive.collisions:
        return "none"
    t, who = drive.collisions[0].t, drive.collisions[0].id
    k, n = int(np.searchsorted(drive.truth.t, t - 1e-6)), drive.truth.ids.tolist().index(who)
    dx, dy = drive.truth.x[n, k] - drive.truth.x[0, k], drive.truth.y[n, k] - drive.truth.y[0, k]
    along = dx * np.cos(drive.truth.heading[0, k]) + dy * np.sin(drive.truth.heading[0, k])
    return "from behind" if along < -drive.truth.length[0] / 6.0 else "other"


def run_into(drive: SimulatedDrive) -> int:
    """How many pairs of traffic objects overlap at some time."""
    t = drive.truth
    boxes = Boxes(t.x[1:], t.y[1:], t.heading[1:], t.length[1:, None], t.width[1:, None])
    return sum(
        int(
            boxes_overlap(Boxes(*(c[n] for c in boxes)), Boxes(*(c[n + 1 :] for c in boxes)))
            .any(axis=-1)
            .sum()
        )
        for n in range(len(t.x) - 1)
    )


def collisions(data: Path, egos: int) -> None:
    """Print how many drives collide, and how: on traces, with drivers who keep their lanes, who change them, SUMO's."""
    head = (
        "build", "traffic", "drives", "hit from behind", "other collisions", "drives with handed-over objects",
        "hand-overs", "lane changes", "farthest behind its trace [m]", "over 20 m behind", "braking by over 6 m/s²",
        "pairs of traffic objects that overlap", "ms a drive",
    )  # fmt: skip
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    every = [*recordings(data, egos)]
    keeps = ReactiveSettings(lane_change=LaneChangeSettings(possible=False))
    how = {
        "traces": None, "keeps its lane": keeps, "changes lanes": ReactiveSettings(),
        "changes lanes, by SUMO's models": ReactiveSettings(drivers="sumo"),
    }  # fmt: skip
    for name in ("idm-1.0", "highway_pilot-1.0", "highway_pilot-1.2", "constant_velocity-1.0", "replay-1.0"):
        build = load_build(BUILDS / f"{name}.toml")
        driven = [[simulated(r, build, traffic) for traffic in how.values()] for r in every]
        for k, traffic in enumerate(how):
            print(f"| {name} | {traffic} | {cells([drives[k] for drives in driven])} |", flush=True)


def cells(drives: Sequence[SimulatedDrive]) -> str:
    """What is told of drives, after who drove."""
    how = Counter(map(hit_by, drives))
    handed = [one for drive in drives for one in drive.handed_over]
    told = [
        len(drives), how["from behind"], how["other"], sum(bool(d.handed_over) for d in drives), len(handed),
        sum(len(one.lane_changes) for one in handed), f"{max((one.farthest for one in handed), default=0.0):.1f}",
        sum(one.farthest > 20.0 for one in handed), sum(one.hardest > 6.0 for one in handed),
        sum(map(run_into, drives)), f"{1e3 * float(np.mean([d.time for d in drives])):.0f}",
    ]  # fmt: skip
    return " | ".join(map(str, told))


def split(stretches: list[Following]) -> tuple[list[Following], list[Following]]:
    """What is learned and what is driven: the first part of the time, and the rest."""
    left = LEARNED * sum(len(one.s) for one in stretches)
    learned, driven = [], []
    for one in stretches:
        cut = min(max(int(left), 0), len(one.s))
        left -= cut
        learned.append(one.part(slice(0, cut)))
        driven.append(one.part(slice(cut, None)))
    return learned, [one for one in driven if one.time >= LONG]


def following(data: Path) -> None:
    """Print how far off drivers are in gaps that they were not fitted to."""
    head = (
        "recording", "objects", "s driven", "gap error, root mean square [m]: calibrated", "usual driver",
        "constant speed", "median of objects [m]: calibrated", "usual driver",
    )  # fmt: skip
    print("\n| " + " | ".join(head) + " |")
    print("|" + "---|" * 8)
    for name in NGSIM:
        xml = data / "ngsim" / f"{name}.xml"
        recording = read_commonroad(xml, map=xml.with_suffix(".xodr"), ego=candidates(xml, 1)[0])
        prepared = prepare(recording, ("GT",))
        stage = staged(prepared.described["GT"], prepared.network, 0.04, 0.0)
        off: list[tuple[float, float, float]] = []
        squares, count, time = np.zeros(3), 0, 0.0
        for row, member in enumerate(stage.members):
            kind = ReactiveSettings().of(member.kind)
            if row == 0 or kind is None or not way_of(stage, row).forwards:
                continue
            learned, driven = split([*followings(stage, row)])
            usual = driver_of(kind, way_of(stage, row).v)
            own = fitted(usual, learned)
            if not driven or not own.fitted:
                continue
            errors = np.zeros(3)
            for one in driven:
                steady = one.s + one.gap - (one.s[0] + one.v[0] * one.step * np.arange(len(one.s)))
                parts = (followed(own, one), followed(usual, one), steady)
                errors += [float(((gap - one.gap) ** 2).sum()) for gap in parts]
            samples = sum(len(one.s) for one in driven)
            squares, count, time = squares + errors, count + samples, time + sum(one.time for one in driven)
            off.append(tuple(np.sqrt(errors / samples).tolist()))
        if not count:
            print(f"| {name} | 0 |" + " – |" * 6)
            continue
        whole, median = np.sqrt(squares / count), np.median(off, axis=0)
        numbers = " | ".join(f"{one:.2f}" for one in (*whole, *median[:2]))
        print(f"| {name} | {len(off)} | {time:.0f} | {numbers} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--egos", type=int, default=8)
    told = parser.parse_args()
    collisions(told.data, told.egos)
    following(told.data)


if __name__ == "__main__":
    main()
