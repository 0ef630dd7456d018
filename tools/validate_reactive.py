"""Traffic that reacts, on NGSIM: collisions that vanish, and how well calibrated drivers follow; tables in Markdown.

python tools/validate_reactive.py ../shared/data [--egos 8]
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from validate_real import BUILDS, NGSIM, candidates

from resim.core.errors import ResimError
from resim.recordings import Recording, read_commonroad
from resim.resimulation import ResimulationOptions, resimulate
from resim.resimulation.run import prepare
from resim.simulation.case import SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.function.interface import Build, load_build
from resim.simulation.reactive.drivers import Following, driver_of, fitted, followed
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.traffic import followings, way_of
from resim.simulation.traffic import staged

LEARNED = 0.6
"""Share of an object's following time that its driver is fitted to; the rest is driven."""
LONG = 3.0
"""s of the shortest stretch that is driven."""


def recordings(data: Path, egos: int) -> Iterator[Recording]:
    """The NGSIM drives of so many vehicles each."""
    for name in NGSIM:
        xml = data / "ngsim" / f"{name}.xml"
        for ego in candidates(xml, egos):
            yield read_commonroad(xml, map=xml.with_suffix(".xodr"), ego=ego)


def simulated(recording: Recording, build: Build, traffic: ReactiveSettings | None) -> SimulatedDrive | None:
    """The drive on ground truth; None for one that is refused."""
    options = ResimulationOptions(bases=("GT",), traffic=traffic, engine=Direct())
    try:
        return resimulate(recording, build, options).drives["rGT"]
    except ResimError:
        return None


def hit_by(drive: SimulatedDrive) -> str:
    """How the drive's collision came: from behind, where the other's centre is behind the EGO's rear third."""
    if not drive.collisions:
        return "none"
    t, who = drive.collisions[0].t, drive.collisions[0].id
    k, n = int(np.searchsorted(drive.truth.t, t - 1e-6)), drive.truth.ids.tolist().index(who)
    dx, dy = drive.truth.x[n, k] - drive.truth.x[0, k], drive.truth.y[n, k] - drive.truth.y[0, k]
    along = dx * np.cos(drive.truth.heading[0, k]) + dy * np.sin(drive.truth.heading[0, k])
    return "from behind" if along < -drive.truth.length[0] / 6.0 else "other"


def collisions(data: Path, egos: int) -> None:
    """Print how many drives collide, and how, on traces and with reactive traffic."""
    head = (
        "build", "drives", "hit from behind, on traces", "with reactive traffic", "other collisions, on traces",
        "reactive", "drives with handed-over objects", "hand-overs", "farthest behind its trace [m]",
        "ms a drive, traces", "reactive",
    )  # fmt: skip
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * 11)
    every = [*recordings(data, egos)]
    for name in ("idm-1.0", "highway_pilot-1.0", "highway_pilot-1.2", "constant_velocity-1.0", "replay-1.0"):
        build = load_build(BUILDS / f"{name}.toml")
        pairs = [(simulated(r, build, None), simulated(r, build, ReactiveSettings())) for r in every]
        both = [(one, two) for one, two in pairs if one is not None and two is not None]
        before, after = (Counter(hit_by(pair[k]) for pair in both) for k in (0, 1))
        handed = [two.handed_over for _, two in both if two.handed_over]
        farthest = max((one.farthest for drive in handed for one in drive), default=0.0)
        times = [1e3 * float(np.mean([pair[k].time for pair in both])) for k in (0, 1)]
        cells = [
            len(both), before["from behind"], after["from behind"], before["other"], after["other"], len(handed),
            sum(map(len, handed)), f"{farthest:.1f}", *(f"{one:.0f}" for one in times),
        ]  # fmt: skip
        print(f"| {name} | " + " | ".join(map(str, cells)) + " |")


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
