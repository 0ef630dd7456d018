"""What a function costs that is a process of its own, or asked over gRPC, beside the same class in this one.

    python tools/bench/function.py [--steps 20000] [--objects 8] [--build unit.toml]

Each is asked in turns with the class here by the same lists, so that both see the same machine, and one after the
other: threads of gRPC would slow down who is asked beside it. Prints JSON at the end.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from resim.core.geometry import Floats
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


def compared(builds: Sequence[Path], steps: int, objects: int) -> Floats:
    """Times [s] (steps, 2) of the answers of two builds, which are asked in turns by the same lists."""
    rng, start = np.random.default_rng(0), EgoState(0.0, 0.0, 0.0, 20.0)
    road = load(ROOT / "networks" / "proving_ground.xodr")
    setup = Setup(road, start, (100.0, 0.0), 4.7, 1.9, 0.04, 0, None, NO_ROUTE)
    functions = []
    for path in builds:
        build = load_build(path)
        with build.factory.afresh():
            functions.append(build.make())
    for function in functions:
        function.reset(setup)
    texts = np.array([str(k) for k in range(objects)]), np.array(["car"] * objects)
    times = np.empty((steps, len(functions)))
    for k in range(steps):
        p = Perceived(0.04 * k, start, *texts, *rng.normal(0.0, 30.0, (6, objects)))
        times[k] = [taken(function, p) for function in functions]
    for function in functions:
        function.close()
    return times[100:]


def main() -> None:
    """Ask each way in turns with the class in this process, one way after the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=20000)
    parser.add_argument("--objects", type=int, default=8)
    parser.add_argument("--build", type=Path, help="a build of another kind, asked as well")
    args = parser.parse_args()
    found: dict[str, float] = {"objects": args.objects}
    head, factory = 'name = "pilot"\nversion = "1"\n', 'factory = "pilot:Pilot"\n'
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        (Path(folder) / "pilot.py").write_text(PILOT, encoding="utf-8")
        here, apart, grpc = (Path(folder) / f"{name}.toml" for name in ("here", "apart", "grpc"))
        here.write_text(head + factory, encoding="utf-8")
        apart.write_text(f'{head}{factory}[process]\npython = "{sys.executable}"\n', encoding="utf-8")
        ways = {"in its own process": ("", apart), "over gRPC, relayed": ("grpc_", grpc)}
        if args.build is not None:
            ways[str(args.build)] = ("build_", args.build)
        for name, (short, path) in ways.items():
            if path is grpc:
                address = stack.enter_context(served(apart))
                grpc.write_text(f'{head}[grpc]\naddress = "{address}"\n', encoding="utf-8")
            us = 1e6 * compared((here, path), args.steps, args.objects)
            more = us[:, 1] - us[:, 0]
            medians = f"median {np.median(us[:, 1]):.1f} us (here {np.median(us[:, 0]):.1f} us)"
            print(f"{name}: {medians}, 99 % {np.quantile(us[:, 1], 0.99):.1f} us")
            found[f"{short}overhead_us"] = round(float(np.median(more)), 1)
            found[f"{short}overhead_p99_us"] = round(float(np.quantile(more, 0.99)), 1)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
