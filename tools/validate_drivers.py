"""Holds drivers of reactive traffic against vehicles of SUMO that are let go of.

    python tools/validate_drivers.py [--scenes 60] [--seed 1]

Random scenes on two lanes: an EGO that slows down otherwise than measured, one behind it, and up to six in the left
lane, all at one speed. The one behind is handed over to resim's driver; in SUMO (IDM with the same parameters, and its
lane changes LC2013) it drives the same until then, and is let go of, among the others as resim has them. Prints which
of both changes to the left lane, and when.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import sumo_vehicles  # noqa: E402

from resim.road.opendrive import load  # noqa: E402
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject  # noqa: E402
from resim.simulation.case import Case, SimulatedDrive  # noqa: E402
from resim.simulation.direct import Direct  # noqa: E402
from resim.simulation.function.interface import load_build  # noqa: E402
from resim.simulation.reactive.drivers import driver_of  # noqa: E402
from resim.simulation.reactive.settings import LaneChangeSettings, ReactiveSettings  # noqa: E402

LENGTH, WIDTH, STEP, END = 4.7, 1.9, 0.1, 20.0
SPEED = 20.0
TRAFFIC = ReactiveSettings(calibrated=False, lane_change=LaneChangeSettings(sides="left"))
SLOWS = """from resim.simulation.function.interface import Command

class Slows:
    def __init__(self, *, to, by):
        self.to, self.by = to, by

    def reset(self, setup):
        pass

    def step(self, perceived):
        slower = perceived.t > 0.5 and perceived.ego.v > self.to
        return Command(-self.by if slower else 0.0, 0.0)

    def close(self):
        pass
"""


class Row(NamedTuple):
    """When [s after the hand-over] each changes lanes, None for never, and how far [m] resim's is ahead at the end."""

    ours: float | None
    theirs: float | None
    ahead: float


def main() -> None:
    """Drive the scenes twice, and print what came of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "slows.py").write_text(SLOWS)
        for _ in range(given.scenes):
            found = _scene(rng, Path(folder))
            if found is not None:
                rows.append(found)
    _print(rows, given.scenes)


def _scene(rng: np.random.Generator, folder: Path) -> Row | None:
    """Drive a scene in resim and in SUMO; None where nobody is handed over, or the EGO collides."""
    gap, to, by = rng.uniform(15.0, 60.0), rng.uniform(2.0, 19.5), rng.uniform(1.0, 5.0)
    speed = rng.uniform(12.0, 26.0)
    beside = np.cumsum(rng.uniform(12.0, 60.0, rng.integers(0, 7))) - rng.uniform(60.0, 120.0)
    build = folder / "slows.toml"
    build.write_text(
        f'name = "slows"\nversion = "1"\nfactory = "slows:Slows"\n[parameters]\nto = {to}\nby = {by}\n'
    )
    own = 150.0
    ahead = own + gap + LENGTH
    others = [_member("f", own, SPEED, -2)]
    others += [_member(f"o{k}", own + at, speed, -1) for k, at in enumerate(beside.tolist())]
    scenario = Scenario("proving_ground.xodr", END, _member("ego", ahead, SPEED, -2), tuple(others))
    network = load(ROOT / "networks" / "proving_ground.xodr")
    drive = Case(scenario, network, load_build(build), Direct(), traffic=TRAFFIC, step=STEP).drive()
    handed = next((one for one in drive.handed_over if one.id == "f"), None)
    if handed is None or drive.collisions:
        return None
    return _both(drive, handed.t, [one.t for one in handed.lane_changes], folder)


def _both(
    drive: SimulatedDrive, let_go: float, changes: list[float], folder: Path
) -> Row:  # fmt: skip
    """Drive in SUMO what was driven; changes: when [s] the driver changed lanes here."""
    truth = drive.truth
    n = [*truth.ids].index("f")
    driver = driver_of(TRAFFIC.car, truth.v[n][:1])
    usual = {
        "carFollowModel": "IDM", "accel": driver.acceleration, "decel": driver.deceleration, "tau": driver.time_gap,
        "minGap": driver.standstill, "maxSpeed": driver.desired, "stepping": STEP,
    }  # fmt: skip
    front = 0.5 * LENGTH
    ego = [*truth.ids].index("ego")
    until = int(np.searchsorted(truth.t, let_go)) + 1
    vehicles = [
        {"s": float(truth.x[ego, 0]) + front, "lane": 0, "length": LENGTH, "speeds": truth.v[ego].tolist()},
        {"s": float(truth.x[n, 0]) + front, "lane": 0, "length": LENGTH, "speeds": truth.v[n, :until].tolist(),
         "driver": usual},
    ]  # fmt: skip
    for row, name in enumerate(truth.ids.tolist()):
        if name.startswith("o"):
            speeds = truth.v[row].tolist()
            vehicles.append(
                {"s": float(truth.x[row, 0]) + front, "lane": 1, "length": LENGTH, "speeds": speeds}
            )
    scene = {"folder": str(folder), "lanes": 2, "step": STEP, "steps": len(truth.t), "vehicles": vehicles}
    found = sumo_vehicles.drive(scene)
    lanes = np.array(found[1]["lane"])
    theirs = np.flatnonzero(lanes > 0)
    when = float(truth.t[theirs[0]]) - let_go if len(theirs) else None
    s = np.array(found[1]["s"]) - front
    return Row(changes[0] - let_go if changes else None, when, float(truth.x[n, -1] - s[-1]))


def _member(name: str, s: float, v: float, lane: int) -> ScenarioObject:
    t = np.linspace(0.0, END, 4)
    return ScenarioObject(
        name, "car", LENGTH, WIDTH, RoadPosition("1", lane, s, 0.0), CubicSpline(t, np.full(4, v)),
        CubicSpline(t, np.zeros(4)),
    )  # fmt: skip


def _print(rows: list[Row], scenes: int) -> None:
    late = [row.ours - row.theirs for row in rows if row.ours is not None and row.theirs is not None]
    stay = [row.ahead for row in rows if row.ours is None and row.theirs is None]
    print(f"{scenes} scenes, {len(rows)} of them with the one behind handed over, and no collision\n")
    print("| resim | SUMO | scenes |\n|---|---|---|")
    print(f"| changes | changes | {len(late)} |\n| stays | stays | {len(stay)} |")
    print(f"| changes | stays | {sum(row.theirs is None and row.ours is not None for row in rows)} |")
    print(f"| stays | changes | {sum(row.ours is None and row.theirs is not None for row in rows)} |\n")
    for what, values in (
        ("changes later than SUMO's [s]", late),
        ("is ahead at the end, where both stay [m]", stay),
    ):
        if values:
            low, middle, high = np.quantile(values, [0.25, 0.5, 0.75])
            told = f"median {middle:.1f}, quartiles {low:.1f} and {high:.1f}, {min(values):.1f} to {max(values):.1f}"
            print(f"resim's {what}: {told}")


if __name__ == "__main__":
    main()
