"""A closed-loop run against the bare libsumo loop, on the same net in one process.

Three cases: the straight of the proving ground, where SUMO is at its cheapest and the ratio at its worst
(`cost_ratio`); its curve; and the straight with `idm` answering at every step instead of every 0.2 s.

Bare: place (moveToXY, setSpeed) six vehicles and step, nothing else, over the steps that the run tells SUMO
of, which are those after the lead-in. Closed loop: `simulate` whole, from the scenario to its `Run`: guided
traffic objects, perception, `idm`, vehicle model, read-back, collisions, road surface.

    python tools/bench/run.py [--repeat 30]
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork, load
from resim.road.path import lane_path
from resim.road.sumo import sumo_net
from resim.scenario.scenario import Scenario, describe
from resim.simulation.case import Case
from resim.simulation.function.interface import Build, load_build
from resim.simulation.guide import guide
from resim.simulation.sumo.engine import Sumo
from resim.simulation.sumo.session import Session, open_session, to_sumo

ROOT = Path(__file__).parents[2]
STEP = 0.04


def platoon(network: RoadNetwork, start: float) -> Scenario:
    """EGO and five traffic objects around it, 10 s at about 25 m/s on the proving ground from s = start on."""
    path = lane_path(network, "1", -2, start, 600.0, behind=200.0)
    t = np.arange(0.0, 10.0 + 1e-9, STEP)
    s, d, v = np.array(
        [
            (0.0, 0.0, 25.0),
            (45.0, 0.0, 24.0),
            (-40.0, 0.0, 25.0),
            (20.0, 3.5, 27.0),
            (-25.0, 3.5, 28.0),
            (80.0, 3.5, 26.0),
        ]
    ).T[..., None]
    x, y = path.xy(s + v * t, np.broadcast_to(d, (6, len(t))))
    heading = np.arctan2(np.gradient(y, axis=1), np.gradient(x, axis=1))
    tracks = Tracks(
        t=t, ids=np.array(["ego", *"12345"]), kind=np.array(["car"] * 6), x=x, y=y, heading=heading,
        v=np.broadcast_to(v, x.shape), length=np.full(6, 4.7), width=np.full(6, 1.9),
        valid=np.ones(x.shape, dtype=bool),
    )  # fmt: skip
    return describe(tracks, network, ego="ego", map_name="proving_ground.xodr")


def bare(session: Session, placements: list[list[tuple[float, float, float, float]]]) -> None:
    """The least that moves six vehicles through SUMO."""
    session.reset()
    names = [str(n) for n in range(6)]
    for name in names:
        session.add(name, 4.7, 1.9, 25.0)
    vehicle, step = session._sumo.vehicle, session._sumo.simulationStep
    move, speed = vehicle.moveToXY, vehicle.setSpeed
    for rows in placements:
        for name, (x, y, angle, v) in zip(names, rows, strict=True):
            move(name, "", -1, x, y, angle, 2, 5.0)
            speed(name, v)
        step()


def compare(
    network: RoadNetwork, net: Path, scenario: Scenario, build: Build, repeat: int
) -> tuple[float, float, int]:
    """Median times [s] of the bare loop and the closed loop, run in turns, and how many steps the bare one takes."""
    plan = guide(scenario, network, step=STEP, lead_in=3.0)
    front = to_sumo(plan.x, plan.y, plan.heading, np.full((6, 1), 4.7))
    placements = [
        [tuple(row) for row in rows]
        for rows in np.stack([*front, plan.v], axis=-1).transpose(1, 0, 2)[plan.begin :].tolist()
    ]
    times = []
    for _ in range(repeat + 1):
        session = open_session(net, STEP)
        begin = time.perf_counter()
        bare(session, placements)
        middle = time.perf_counter()
        run = Case(scenario, network, build, Sumo(), step=STEP).drive()
        times.append((middle - begin, time.perf_counter() - middle))
        assert run.end == "duration", run.end
    low = np.median(times[1:], axis=0)
    return float(low[0]), float(low[1]), len(placements)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=30)
    repeat = parser.parse_args().repeat
    road = ROOT / "networks" / "proving_ground.xodr"
    network = load(road)
    net = sumo_net(network).path
    build = load_build(ROOT / "adfunc" / "builds" / "idm-1.0.toml")
    cases = {
        "cost_ratio": ("straight", platoon(network, 300.0), build),
        "cost_ratio_curve": ("curve", platoon(network, 1300.0), build),
        "cost_ratio_every_step": (
            "straight, idm at every step",
            platoon(network, 300.0),
            replace(build, cycle_time=None),
        ),
    }
    figures = {}
    print(f"5 TO and EGO (idm), 3 s lead-in and 10 s at 25 Hz, median of {repeat} runs of each in turns")
    print(f"{'case':30} {'bare libsumo loop':>24} {'closed loop':>24}  ratio")
    for figure, (name, scenario, pinned) in cases.items():
        one, two, steps = compare(network, net, scenario, pinned, repeat)
        figures[figure] = round(two / one, 3)
        columns = (f"{1e3 * took:.1f} ms, {1e6 * took / steps:.0f} µs a step" for took in (one, two))
        print(f"{name:30} {next(columns):>24} {next(columns):>24}  {two / one:.2f}")
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
