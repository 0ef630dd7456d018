"""Holds the accident risk to a reference forty times finer: python tools/validate_risk.py [../shared/data].

Reference: steps of 2.5 ms, 512 other samples, no missed contact. 60 scenes of one object in each family. Then what it
changes that predictions know the road: traffic both ways on the curves of the proving ground, and US-101 if there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from validate_real import candidates

from resim.metrics.drive import drive
from resim.metrics.risk import PUBLISHED, Risk, RiskParameters, Scenes, accident_risk
from resim.metrics.risk.lane_paths import lane_paths
from resim.recordings import read_commonroad
from resim.resimulation.run import describe_recording
from resim.road.opendrive import RoadNetwork, load

Floats = NDArray[np.float64]
CAR = (4.7, 1.9)
COUNT = 60
FINE = RiskParameters(step=0.0025, samples=512, seed=99)
TRIED = {
    "continuous, 64 Sobol": RiskParameters(),
    "continuous, 32 Sobol": RiskParameters(samples=32),
    "published, 100 random": RiskParameters(mode="published"),
}


def families(rng: np.random.Generator) -> dict[str, tuple[Floats, Floats]]:
    """Give speeds of the EGO (COUNT,) and states of the object (COUNT, 6) by family."""
    n = COUNT
    ego = rng.uniform(10, 30, n)
    v, angle = rng.uniform(5, 25, n), rng.uniform(0.6, 2.5, n) * rng.choice([-1, 1], n)
    meet, zero = rng.uniform(0.8, 3.2, n), np.zeros(n)
    x = ego * meet - v * meet * np.cos(angle) + rng.normal(0, 3, n)
    crossing = [x, -v * meet * np.sin(angle), angle, v, rng.normal(0, 0.7, n), rng.normal(0, 0.05, n)]
    slower = np.maximum(ego - rng.uniform(2, 15, n), 2)
    rear = [rng.uniform(8, 45, n), rng.normal(0, 0.5, n), zero, slower, rng.uniform(-4, 1, n), zero]
    beside = np.maximum(ego + rng.uniform(-8, 3, n), 5)
    cut_in = [rng.uniform(2, 30, n), zero + 3.5, -rng.uniform(0, 0.1, n), beside, rng.uniform(-3, 1, n),
              -rng.uniform(0, 0.1, n)]  # fmt: skip
    oncoming = [rng.uniform(30, 120, n), rng.normal(3, 1, n), zero + np.pi, rng.uniform(10, 25, n), zero,
                rng.normal(0.02, 0.05, n)]  # fmt: skip
    named = {"crossing": crossing, "rear-end": rear, "cut-in": cut_in, "oncoming": oncoming}
    return {name: (ego, np.stack(columns, axis=1)) for name, columns in named.items()}


def risk(ego: Floats, state: Floats, parameters: RiskParameters) -> Risk:
    """Give the risk of scenes of an EGO at constant speed along x."""
    t = np.arange(round(parameters.horizon / parameters.step) + 1) * parameters.step
    plan = np.stack(
        [np.outer(ego, t), 0.0 * np.outer(ego, t), 0.0 * np.outer(ego, t), np.outer(ego, 1.0 + 0.0 * t)],
        axis=2,
    )
    inputs = PUBLISHED.inputs(*state[:, None, 3:6].transpose(2, 0, 1))
    size = np.broadcast_to(CAR, (len(ego), 1, 2)).copy()
    return accident_risk(Scenes(plan, np.tile(CAR, (len(ego), 1)), state[:, None], size, inputs), parameters)


def both_ways(network: RoadNetwork) -> Scenes:
    """Give scenes on road 1 of the proving ground: the EGO, oncoming traffic and a slower car ahead, all neutral."""
    rng, t = np.random.default_rng(7), np.arange(41) * 0.1
    plans, states = [], []
    for s in rng.uniform(950.0, 1850.0, 4 * COUNT):
        v, others = rng.uniform(18.0, 28.0), []
        for lane, ahead, speed in (
            (1, rng.uniform(40, 200), rng.uniform(18, 28)),
            (-1, rng.uniform(25, 60), 0.7 * v),
        ):
            x, y = network.to_xy("1", lane, s + ahead, 0.0)
            rate = speed * float(network.curvature("1", lane, s + ahead))
            others.append([x, y, float(network.lane_heading("1", lane, s + ahead)), speed, 0.0, rate])
        x, y = network.to_xy("1", -1, s + v * t, 0.0)
        plans.append(np.stack([x, y, network.lane_heading("1", -1, s + v * t), np.full(41, v)], axis=1))
        states.append(others)
    state = np.array(states, dtype=np.float64)
    inputs = PUBLISHED.inputs(*np.moveaxis(state[..., 3:6], -1, 0))
    own, size = np.tile(CAR, (len(plans), 1)), np.broadcast_to(CAR, (*state.shape[:2], 2)).copy()
    return Scenes(np.stack(plans), own, state, size, inputs)


def road_awareness(name: str, made: Scenes, network: RoadNetwork) -> Iterator[str]:
    """Give two lines of the table: every object without ways and with."""
    lanes = lane_paths(network, made.state, made.size, horizon=4.0)
    there = made.size[..., 0] > 0.0
    for what, scenes in (("none", made), ("ways", replace(made, ways=lanes))):
        found = accident_risk(scenes)
        r = found.r_to[there]
        share = 100 * (lanes.count[there] > 0).mean()
        shown = [
            f"{100 * value:.3f} %" for value in (r.mean(), r.max(), found.r_ind.mean(), found.r_ind.max())
        ]
        yield f"| {name} | {what} | {there.sum()} | {share:.0f} % | {' | '.join(shown)} |"


def us101(data: Path) -> Iterator[tuple[str, Scenes, RoadNetwork]]:
    """Give drives of US-101, the EGO on the path that it drove."""
    for xml in sorted((data / "ngsim").glob("USA_US101*.xml")):
        road = xml.with_suffix(".xodr")
        network = load(road)
        recording = read_commonroad(xml, map=road, ego=candidates(xml, 1)[0])
        scenario = describe_recording(recording, network)["GT"]
        t = np.round(scenario.ego.spawn_time + np.arange(0.0, scenario.duration, 0.1), 9)
        yield xml.stem, drive(scenario.tracks(network, t), ego=scenario.ego.id, path="driven").scenes, network


def main() -> int:
    print(
        "| family | mean risk | mode | RMS | bias | largest | contact missed |\n|---|---|---|---|---|---|---|"
    )
    for family, (ego, state) in families(np.random.default_rng(5)).items():
        fine = risk(ego, state, FINE)
        for name, parameters in TRIED.items():
            found = risk(ego, state, parameters)
            off = found.r_ind - fine.r_ind
            missed = int(((fine.collision[:, 0] > 1e-3) & (found.collision[:, 0] == 0.0)).sum())
            print(f"| {family} | {100 * fine.r_ind.mean():.1f} % | {name} | {100 * np.sqrt((off**2).mean()):.2f} % | "
                  f"{100 * off.mean():+.2f} % | {100 * np.abs(off).max():.1f} % | {missed} of {COUNT} |")  # fmt: skip
    print(
        "\n| traffic | road | objects | on a way | mean risk of one | largest | mean risk of a scene | largest |"
    )
    print("|---|---|---|---|---|---|---|---|")
    network = load(Path(__file__).parents[1] / "networks" / "proving_ground.xodr")
    for line in road_awareness("proving ground, curves", both_ways(network), network):
        print(line)
    for name, made, roads in us101(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data")):
        for line in road_awareness(name, made, roads):
            print(line)
    return 0


if __name__ == "__main__":
    sys.exit(main())
