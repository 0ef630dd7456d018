"""How often first braking, read of noisy drives, is within its own spread; prints a table of docs/validation.md.

    python tools/validate_reaction.py [--drives 25] [--seed 0]

Each drive brakes at a known time with a jerk and a deceleration that are drawn, and is read with noise of its
positions and without: the two differ by no more than `reaction_spread` in two of three cases, or it is told too narrow.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.resimulation.reaction import ego_tracks, reaction_spread
from resim.road.opendrive import load
from resim.scenario import maneuvers
from resim.scenario.scenario import describe

ROAD = load(Path(__file__).parents[1] / "networks" / "proving_ground.xodr")
BEGINS, LASTS, WHOLE = 5.0, 3.0, 12.0  # s
JERKS = (3.0, 5.0, 8.0, 15.0, 30.0)  # m/s³


def driven(step: float, jerk: float, most: float, off: Floats) -> Tracks:
    """An EGO at 24 m/s that brakes; step [s], most [m/s²], off (2, T) [m]: the noise of its positions."""
    fine, t = np.arange(0.0, WHOLE, 1e-3), np.arange(0.0, WHOLE, step)
    a = np.where(fine < BEGINS + LASTS, np.clip(-jerk * (fine - BEGINS), most, 0.0), 0.0)
    v = 24.0 + 1e-3 * (np.cumsum(a) - a)
    x = 200.0 + 1e-3 * (np.cumsum(v) - v)
    x, v = np.interp(t, fine, x) + off[0], np.interp(t, fine, v)
    return Tracks(
        t=t, ids=np.array(["ego"]), kind=np.array(["car"]), x=x[None], y=-5.25 + off[1][None], v=v[None],
        heading=np.zeros((1, len(t))), length=np.array([4.7]), width=np.array([1.9]),
        valid=np.ones((1, len(t)), dtype=bool),
    )  # fmt: skip


def one(step: float, noise: float, rng: np.random.Generator) -> tuple[float, float]:
    """How far the reading of a noisy drive is off that of the same drive without noise, and the spread told [s]."""
    jerk, most, t = float(rng.choice(JERKS)), -rng.uniform(1.5, 6.0), np.arange(0.0, WHOLE, step)
    off = noise * rng.standard_normal((2, len(t)))
    clean, noisy = driven(step, jerk, most, 0.0 * off), driven(step, jerk, most, off)
    told = [describe(tracks, ROAD, ego="ego", map_name="m") for tracks in (clean, noisy)]
    true, read = (maneuvers.reaction_time(ego_tracks(one, ROAD), ego="ego") for one in told)
    spread = reaction_spread(noisy, told[1], ROAD)
    if true is None or read is None or spread is None:
        return np.nan, np.nan
    return abs(read - true), spread


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--drives", type=int, default=25)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    print(
        "| rate | noise | off in two of three | spread told, median | within it | not read |\n|---|---|---|---|---|---|"
    )
    for step in (0.04, 0.1):
        for noise in (0.01, 0.02, 0.05, 0.1):
            found = np.array([one(step, noise, rng) for _ in range(args.drives)])
            off, spread = found[np.isfinite(found[:, 0])].T
            within = f"{int((off <= spread).sum())} of {len(off)}"
            print(f"| {1.0 / step:.0f} Hz | {100.0 * noise:.0f} cm | {np.quantile(off, 0.68):.3f} s "
                  f"| {np.median(spread):.3f} s | {within} | {args.drives - len(off)} |")  # fmt: skip


if __name__ == "__main__":
    main()
