"""What a function costs that is a process of its own, beside the same class in this one; prints JSON at the end.

    python tools/bench/function.py [--steps 20000] [--objects 8]

Both are asked in turns by the same lists, so that both see the same machine.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from resim.road.driven_route import NO_ROUTE
from resim.road.opendrive import load
from resim.simulation.function.interface import AdFunction, EgoState, Perceived, Setup, load_build

ROOT = Path(__file__).parents[2]
PILOT = """
from resim.function import Command
class Pilot:
    def reset(self, setup): self.v = setup.start.v
    def step(self, p):
        ahead = p.x_ego[(p.x_ego > 0.0) & (abs(p.y_ego) < 1.5)]
        return Command(0.3 * (self.v - p.ego.v) - (len(ahead) > 0) * 0.1, 0.0)
    def close(self): pass
"""


def taken(function: AdFunction, perceived: Perceived) -> float:
    """Time [s] of one answer."""
    begin = time.perf_counter()
    function.step(perceived)
    return time.perf_counter() - begin


def main() -> None:
    """Ask both in turns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20000)
    parser.add_argument("--objects", type=int, default=8)
    args = parser.parse_args()
    n, rng = args.objects, np.random.default_rng(0)
    start = EgoState(0.0, 0.0, 0.0, 20.0)
    setup = Setup(
        load(ROOT / "networks" / "proving_ground.xodr"),
        start,
        (100.0, 0.0),
        4.7,
        1.9,
        0.04,
        0,
        None,
        NO_ROUTE,
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pilot.py").write_text(PILOT, encoding="utf-8")
        both = []
        for name, more in (("here", ""), ("apart", f'[process]\npython = "{sys.executable}"\n')):
            path = Path(folder) / f"{name}.toml"
            path.write_text(
                f'name = "pilot"\nversion = "1"\nfactory = "pilot:Pilot"\n{more}', encoding="utf-8"
            )
            build = load_build(path)
            with build.factory.afresh():
                both.append(build.make())
        for function in both:
            function.reset(setup)
        texts = np.array([str(k) for k in range(n)]), np.array(["car"] * n)
        times = np.empty((args.steps, 2))
        for k in range(args.steps):
            p = Perceived(0.04 * k, start, *texts, *rng.normal(0.0, 30.0, (6, n)))
            times[k] = [taken(function, p) for function in both]
        for function in both:
            function.close()
    us = 1e6 * times[100:]
    for name, column in zip(("in this process", "in its own"), us.T, strict=True):
        print(f"{name}: median {np.median(column):.1f} us, 99 % {np.quantile(column, 0.99):.1f} us")
    more = us[:, 1] - us[:, 0]
    print(
        json.dumps(
            {
                "overhead_us": round(float(np.median(more)), 1),
                "overhead_p99_us": round(float(np.quantile(more, 0.99)), 1),
                "objects": n,
            }
        )
    )


if __name__ == "__main__":
    main()
