"""A closed-loop run against the bare libsumo loop, on the same net in one process.

Bare: place (moveToXY, setSpeed) six vehicles and step, nothing else, over as many steps as the run takes
with its lead-in. Closed loop: `simulate` whole, from the scenario to its `Run`: guided traffic objects,
perception, `idm`, vehicle model, read-back, collisions, road surface.

    python tools/bench/run.py [--repeat 30]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork, load
from resim.road.path import lane_path
from resim.road.sumo import sumo_net
from resim.scenario.scenario import Scenario, describe
from resim.sim.adfunction import load_build
from resim.sim.guide import guide
from resim.sim.loop import simulate
from resim.sim.session import Session, open_session, to_sumo

ROOT = Path(__file__).parents[2]
STEP = 0.04


def platoon(network: RoadNetwork) -> Scenario:
    """EGO and five traffic objects around it, 10 s at about 25 m/s on the proving ground."""
    path = lane_path(network, "1", -2, 300.0, 600.0, behind=200.0)
    t = np.arange(0.0, 10.0 + 1e-9, STEP)
    starts = np.array(
        [
            [0.0, 0.0, 25.0],
            [45.0, 0.0, 24.0],
            [-40.0, 0.0, 25.0],
            [20.0, 3.5, 27.0],
            [-25.0, 3.5, 28.0],
            [80.0, 3.5, 26.0],
        ]
    )
    x, y = path.xy(starts[:, :1] + starts[:, 2:] * t, np.broadcast_to(starts[:, 1:2], (6, len(t))))
    heading = np.full(x.shape, path.at(0.0).heading)
    tracks = Tracks(
        t=t, ids=np.array(["ego", *"12345"]), kind=np.array(["car"] * 6), x=x, y=y, heading=heading,
        v=np.broadcast_to(starts[:, 2:], x.shape), length=np.full(6, 4.7), width=np.full(6, 1.9),
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeat", type=int, default=30)
    repeat = parser.parse_args().repeat
    network, net = (
        load(ROOT / "networks" / "proving_ground.xodr"),
        sumo_net(ROOT / "networks" / "proving_ground.xodr"),
    )
    scenario, build = platoon(network), load_build(ROOT / "adfunc" / "builds" / "idm-1.0.toml")
    plan = guide(scenario, network, step=STEP, relaxation=3.0)
    front = to_sumo(plan.x, plan.y, plan.heading, np.full((6, 1), 4.7))
    placements = np.stack([*front, plan.v], axis=-1).transpose(1, 0, 2).tolist()
    times: dict[str, list[float]] = {"bare": [], "closed": []}
    for _ in range(repeat + 1):
        session = open_session(net.path, STEP)
        begin = time.perf_counter()
        bare(session, [[tuple(row) for row in rows] for rows in placements])
        middle = time.perf_counter()
        run = simulate(scenario, network, net.path, build, step=STEP)
        times["bare"].append(middle - begin)
        times["closed"].append(time.perf_counter() - middle)
        assert run.end == "duration"
    low = {name: float(np.median(values[1:])) for name, values in times.items()}
    print(f"{len(placements)} steps (3 s lead-in and 10 s at 25 Hz), 5 TO and EGO, median of {repeat} runs")
    print(
        f"bare libsumo loop       {1e3 * low['bare']:7.1f} ms   {1e6 * low['bare'] / len(placements):6.0f} µs a step"
    )
    print(
        f"closed loop with idm    {1e3 * low['closed']:7.1f} ms   {1e6 * low['closed'] / len(placements):6.0f} µs a step"
    )
    print(
        json.dumps(
            {
                "cost_ratio": round(low["closed"] / low["bare"], 3),
                "bare_ms": round(1e3 * low["bare"], 2),
                "closed_ms": round(1e3 * low["closed"], 2),
            }
        )
    )


if __name__ == "__main__":
    main()
