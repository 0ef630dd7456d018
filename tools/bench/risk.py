"""Times the accident risk against the published algorithm in plain Python: python tools/bench/risk.py.

8 critical objects a scene. speedup: plain over compiled at equal samples, published mode, whose values are
compared. Prints a table, and as the last line a JSON object with its figures.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np

from resim.assess.assessment import MEASURES
from resim.assess.criticality import Pairs
from resim.assess.risk import PUBLISHED, Parameters, Scenes, accident_risk

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from assess import plain

CAR = (4.7, 1.9)
OBJECTS, MANY, REPEAT = 8, 400, 5


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


def seconds(made: Scenes, parameters: Parameters) -> float:
    """Give the shortest time [s] for all scenes; the first call, which compiles, is not counted."""
    accident_risk(made, parameters)
    times = []
    for _ in range(REPEAT):
        begin = time.perf_counter()
        accident_risk(made, parameters)
        times.append(time.perf_counter() - begin)
    return min(times)


def main() -> int:
    made, published = scenes(MANY), Parameters(mode="published", samples=32)
    rates = {
        "scenes_per_s": MANY / seconds(made, published),
        "scenes_per_s_continuous": MANY / seconds(made, Parameters()),
        "scenes_per_s_benign": MANY / seconds(benign(MANY), Parameters()),
    }
    one = scenes(1)
    sample = np.random.default_rng(0).uniform(-1.0, 1.0, (32, 2))
    begin = time.perf_counter()
    objects = [(tuple(s), CAR) for s in one.state[0]]
    r_to, r_ind, _, _ = plain.risk([tuple(p) for p in one.plan[0]], CAR, objects, one.inputs[0], sample, 0.1)
    slow = time.perf_counter() - begin
    found = accident_risk(one, published)
    rates["speedup"] = slow * rates["scenes_per_s"]
    rates["largest_difference"] = float(max(np.abs(found.r_to[0] - r_to).max(), abs(found.r_ind[0] - r_ind)))
    rates["critical_objects"] = float((accident_risk(made).r_to > 0.0).sum(axis=1).mean())
    rates["faster_than_real_time_at_10_hz"] = rates["scenes_per_s_continuous"] / 10.0
    pairs = Pairs.of(made, 0.1)
    for name, measure in MEASURES.items():
        begin = time.perf_counter()
        measure(pairs)
        rates[f"{name}_scenes_per_s"] = MANY / (time.perf_counter() - begin)
    print(f"plain Python: {slow:.1f} s a scene of {OBJECTS} objects, 32 samples each")
    for name, value in rates.items():
        print(f"{name:32} {value:12.4g}")
    print(json.dumps(rates))
    return 0


if __name__ == "__main__":
    sys.exit(main())
