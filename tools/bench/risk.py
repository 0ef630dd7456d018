"""Times the accident risk: python tools/bench/risk.py [../shared/data].

Made scenes of 8 critical objects each, against the published algorithm in plain Python at equal samples, whose values
are compared; then real traffic, a drive at 10 Hz with the 8 nearest objects: how many times faster than real time.
Prints a table, and as the last line a JSON object with its figures.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from resim.metrics.drive import drive
from resim.metrics.risk import PUBLISHED, RiskParameters, Scenes, accident_risk
from resim.metrics.risk.lane_paths import lane_paths
from resim.recordings import Recording, read_commonroad, read_recording
from resim.resimulation.run import describe_recording
from resim.road.opendrive import RoadNetwork, load

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from metrics import plain
from validate_real import candidates

SCENARIOS = Path(__file__).resolve().parents[2] / "scenarios"
CAR = (4.7, 1.9)
OBJECTS, MANY, REPEAT = 8, 400, 7
COMPARED = RiskParameters(mode="published", samples=32)


def scenes(count: int, seed: int = 1) -> Scenes:
    """Scenes of an EGO at 20 m/s and slower objects close ahead that brake and turn into its way."""
    rng = np.random.default_rng(seed)
    t = np.arange(41) * 0.1
    plan = np.repeat(np.stack([20.0 * t, 0.0 * t, 0.0 * t, 20.0 + 0.0 * t], axis=1)[None], count, axis=0)
    state = np.zeros((count, OBJECTS, 6))
    shape = state.shape[:2]
    state[..., 0], state[..., 1] = rng.uniform(5.0, 40.0, shape), rng.choice([-3.5, 0.0, 3.5], shape)
    state[..., 3], state[..., 4] = rng.uniform(5.0, 14.0, shape), rng.uniform(-3.0, 0.0, shape)
    state[..., 5] = -np.sign(state[..., 1]) * rng.uniform(0.05, 0.25, shape)
    size = np.broadcast_to(CAR, (*shape, 2)).copy()
    inputs = PUBLISHED.inputs(*np.moveaxis(state[..., 3:6], -1, 0))
    return Scenes(plan, np.tile(CAR, (count, 1)), state, size, inputs)


def benign(count: int) -> Scenes:
    """The same with everybody driving far ahead at the EGO's speed."""
    made = scenes(count)
    made.state[..., 0] += 150.0
    made.state[..., 3:] = [20.0, 0.0, 0.0]
    made.inputs[...] = PUBLISHED.inputs(*np.moveaxis(made.state[..., 3:6], -1, 0))
    return made


def seconds(made: Scenes, parameters: RiskParameters) -> float:
    """Give the shortest time [s] for all scenes; the first call, which compiles, is not counted."""
    accident_risk(made, parameters)
    times = []
    for _ in range(REPEAT):
        begin = time.perf_counter()
        accident_risk(made, parameters)
        times.append(time.perf_counter() - begin)
    return min(times)


def nearest(made: Scenes, count: int = OBJECTS) -> Scenes:
    """Give the scenes with the objects that are nearest to the EGO alone."""
    apart = np.hypot(*np.moveaxis(made.state[..., :2] - made.plan[:, :1, :2], -1, 0))
    order = np.argsort(np.where(made.size[..., 0] > 0.0, apart, np.inf), axis=1)[:, :count]
    picked = {
        name: np.take_along_axis(getattr(made, name), order[..., None], axis=1)
        for name in ("state", "size", "inputs")
    }
    motion = None if made.motion is None else np.take_along_axis(made.motion, order, axis=1)
    return replace(made, **picked, motion=motion)


def traffic(recording: Recording, network: RoadNetwork) -> Scenes:
    """Give the scenes of a recording at 10 Hz with the nearest objects."""
    scenario = describe_recording(recording, network)["GT"]
    t = scenario.ego.spawn_time + np.arange(0.0, scenario.duration, 0.1)
    return nearest(drive(scenario.tracks(network, np.round(t, 9)), ego=scenario.ego.id).scenes)


def real(data: Path) -> Iterator[tuple[str, Scenes, RoadNetwork]]:
    """Drives of the repository and, where the data are there, of US-101."""
    for folder in ("overtake", "cut_in_brake"):
        recording = read_recording(SCENARIOS / folder)
        network = load(recording.map)
        yield folder, traffic(recording, network), network
    xml = data / "ngsim" / "USA_US101-5_1_T-1.xml"
    if xml.is_file():
        road = xml.with_suffix(".xodr")
        network = load(road)
        recording = read_commonroad(xml, map=road, ego=candidates(xml, 1)[0])
        yield "us101_5", traffic(recording, network), network


def against_plain(rate: float) -> dict[str, float]:
    """How many times faster than plain Python `rate` [scenes/s] is, and how far values are apart."""
    one = scenes(1)
    sample = np.random.default_rng(0).uniform(-1.0, 1.0, (32, 2))
    objects = [(tuple(s), CAR) for s in one.state[0]]
    begin = time.perf_counter()
    r_to, r_ind, _, _ = plain.risk([tuple(p) for p in one.plan[0]], CAR, objects, one.inputs[0], sample, 0.1)
    slow = time.perf_counter() - begin
    found = accident_risk(one, COMPARED)
    return {
        "plain_s_per_scene": slow,
        "speedup": slow * rate,
        "largest_difference": float(max(np.abs(found.r_to[0] - r_to).max(), abs(found.r_ind[0] - r_ind))),
    }


def main() -> int:
    made = scenes(MANY)
    rates = {
        "scenes_per_s": MANY / seconds(made, COMPARED),
        "scenes_per_s_continuous": MANY / seconds(made, RiskParameters()),
        "scenes_per_s_benign": MANY / seconds(benign(MANY), RiskParameters()),
        "critical_objects": float((accident_risk(made).r_to > 0.0).sum(axis=1).mean()),
    }
    rates |= against_plain(rates["scenes_per_s"])
    rates["faster_than_real_time_at_10_hz"] = rates["scenes_per_s_continuous"] / 10.0
    for name, some, network in real(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data")):
        span = 0.1 * len(some.state)
        begin = time.perf_counter()
        lanes = lane_paths(network, some.state, some.size, horizon=4.0)
        rates[f"{name}_ways_s"] = time.perf_counter() - begin
        rates[f"{name}_published"] = span / seconds(some, RiskParameters(mode="published"))
        rates[f"{name}_continuous"] = span / seconds(some, RiskParameters())
        rates[f"{name}_with_ways"] = span / seconds(replace(some, ways=lanes), RiskParameters())
    print(
        "of real drives: times faster than real time, 10 Hz with the 8 nearest objects; s to find their ways"
    )
    for name, value in rates.items():
        print(f"{name:32} {value:12.4g}")
    print(json.dumps(rates))
    return 0


if __name__ == "__main__":
    sys.exit(main())
