"""What a function costs that is a process of its own, or asked over gRPC, beside the same class in this one.

    python tools/bench/function.py [--steps 20000] [--objects 8] [--build unit.toml]

All are asked in turns by the same lists, so that all see the same machine. Prints JSON at the end.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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


@contextmanager
def served(build: Path) -> Iterator[str]:
    """The address of a server of a process build."""
    order = [sys.executable, "-m", "resim", "function", "serve", build, "--address", "127.0.0.1:0"]
    with subprocess.Popen(order, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield server.stdout.readline().split()[-1]
        server.terminate()


def main() -> None:
    """Ask all in turns."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20000)
    parser.add_argument("--objects", type=int, default=8)
    parser.add_argument("--build", type=Path, help="a build of another kind, asked as well")
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
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        (Path(folder) / "pilot.py").write_text(PILOT, encoding="utf-8")
        functions = []
        head, factory = 'name = "pilot"\nversion = "1"\n', 'factory = "pilot:Pilot"\n'
        ways = {"here": factory, "apart": f'{factory}[process]\npython = "{sys.executable}"\n', "grpc": ""}
        for name, text in ways.items():
            path = Path(folder) / f"{name}.toml"
            if name == "grpc":
                text = f'[grpc]\naddress = "{stack.enter_context(served(path.with_name("apart.toml")))}"\n'
            path.write_text(head + text, encoding="utf-8")
            build = load_build(path)
            with build.factory.afresh():
                functions.append(build.make())
        if args.build is not None:
            build = load_build(args.build)
            with build.factory.afresh():
                functions.append(build.make())
        for function in functions:
            function.reset(setup)
        texts = np.array([str(k) for k in range(n)]), np.array(["car"] * n)
        times = np.empty((args.steps, len(functions)))
        for k in range(args.steps):
            p = Perceived(0.04 * k, start, *texts, *rng.normal(0.0, 30.0, (6, n)))
            times[k] = [taken(function, p) for function in functions]
        for function in functions:
            function.close()
    us = 1e6 * times[100:]
    found: dict[str, float] = {"objects": n}
    names = ("in this process", "in its own", "over gRPC, relayed", str(args.build))
    for name, column in zip(names, us.T, strict=False):
        print(f"{name}: median {np.median(column):.1f} us, 99 % {np.quantile(column, 0.99):.1f} us")
    for name, column in zip(("", "grpc_", "build_"), us.T[1:], strict=False):
        more = column - us[:, 0]
        found[f"{name}overhead_us"] = round(float(np.median(more)), 1)
        found[f"{name}overhead_p99_us"] = round(float(np.quantile(more, 0.99)), 1)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
