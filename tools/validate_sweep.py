"""Does the adaptive sweep find the boundary that a fine grid has, and the shipped grid the same one?

    python tools/validate_sweep.py [--workers 2] [--out out/validate_sweep]

Runs scenarios/sweeps/perception_boundary.toml (adaptive), a grid of all points that it can choose from, and
scenarios/sweeps/perception_latency.toml, all by `resim sweep --resume`, so that it goes on where it was interrupted.
Prints the latency from which on the function decides as measured, by bias of distance, in all three.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd

from resim.sweeps.file import read_sweep
from resim.sweeps.plans.adaptive import Lattice, boundary

ROOT = Path(__file__).parents[1]
SWEEPS = ROOT / "scenarios" / "sweeps"
LATENCY, BIAS = "perception.latency.speed", "perception.errors.longitudinal.bias.constant"


def swept(path: Path, out: Path, workers: int) -> pd.DataFrame:
    """Do a sweep and give, by point, the share of the seeds that decide as measured."""
    done = subprocess.run(
        [sys.executable, "-m", "resim", "sweep", path, "--out", out, "--resume", "--workers", str(workers)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    print(done.stdout.strip().replace(str(out), out.name), flush=True)
    rows = duckdb.sql(f"select * from '{out}/runs/*.parquet'").df()
    return rows.groupby([LATENCY, BIAS], as_index=False)["same_decision"].mean()


def fine_grid(lattice: Lattice, text: str) -> str:
    """The grid of all points of a lattice, as a sweep."""
    head = text[: text.index("[[parameter]]")].replace('"adaptive"', '"grid"').replace("[adaptive]", "")
    lines = [line for line in head.splitlines() if not line.startswith(("points", "outcome", "share", "#"))]
    lines = [line.replace('"../', f'"{ROOT}/scenarios/').replace("scenarios/../", "") for line in lines]
    for name, low, high, cells in zip(
        (LATENCY, BIAS), lattice.low, lattice.high, lattice.counts, strict=True
    ):
        lines += [
            "",
            "[[parameter]]",
            f'name = "{name}"',
            f"low = {low}",
            f"high = {high}",
            f"steps = {cells + 1}",
        ]
    return "\n".join(lines) + "\n"


def thresholds(found: pd.DataFrame, bias: float) -> str:
    """Between which latencies [s] the share passes a half at this bias."""
    mine = found[np.isclose(found[BIAS], bias)].sort_values(LATENCY)
    good, latency = mine["same_decision"].to_numpy() >= 0.5, mine[LATENCY].to_numpy()
    changes = np.flatnonzero(good[1:] != good[:-1])
    if not len(changes):
        return "always" if good.all() else "never" if not good.any() else "?"
    return ", ".join(f"{latency[k]:.3f} to {latency[k + 1]:.3f}" for k in changes)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "validate_sweep")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = SWEEPS / "perception_boundary.toml"
    lattice = Lattice.over(read_sweep(path).file.parameter)
    fine = given.out / "fine.toml"
    fine.write_text(fine_grid(lattice, path.read_text(encoding="utf-8")), encoding="utf-8")
    found = {
        name: swept(file, given.out.absolute() / name, given.workers)
        for name, file in (
            ("adaptive", path),
            ("fine", fine),
            ("shipped", SWEEPS / "perception_latency.toml"),
        )
    }
    cells = {}
    for name in ("adaptive", "fine"):
        values = found[name][[LATENCY, BIAS]].to_numpy()
        low, high = np.array(lattice.low), np.array(lattice.high)
        places = np.round((values - low) / (high - low) * lattice.counts).astype(int)
        cells[name] = {
            tuple(c)
            for c in boundary(lattice, places, found[name]["same_decision"].to_numpy() >= 0.5)[0].tolist()
        }
        print(f"{name}: {len(places)} points, the decision changes in {len(cells[name])} cells")
    print(f"cells of the fine grid that the adaptive plan has: {len(cells['fine'] & cells['adaptive'])}; "
          f"that it has not: {len(cells['fine'] - cells['adaptive'])}; "
          f"of its own: {len(cells['adaptive'] - cells['fine'])}\n")  # fmt: skip
    print("| bias [m] | shipped grid [s] | fine grid [s] |\n|---|---|---|")
    for bias in sorted(found["shipped"][BIAS].unique()):
        print(f"| {bias:g} | {thresholds(found['shipped'], bias)} | {thresholds(found['fine'], bias)} |")


if __name__ == "__main__":
    main()
