"""Holds the accident risk to a reference forty times finer: python tools/validate_risk.py.

Reference: steps of 2.5 ms, 512 other samples, no missed contact. 60 scenes of one object in each family.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from resim.assess.risk import PUBLISHED, Parameters, Risk, Scenes, accident_risk

Floats = NDArray[np.float64]
CAR = (4.7, 1.9)
COUNT = 60
FINE = Parameters(step=0.0025, samples=512, seed=99)
TRIED = {
    "continuous, 64 Sobol": Parameters(),
    "continuous, 32 Sobol": Parameters(samples=32),
    "published, 100 random": Parameters(mode="published"),
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


def risk(ego: Floats, state: Floats, parameters: Parameters) -> Risk:
    """Give the risk of scenes of an EGO at constant speed along x."""
    t = np.arange(round(parameters.horizon / parameters.step) + 1) * parameters.step
    plan = np.stack(
        [np.outer(ego, t), 0.0 * np.outer(ego, t), 0.0 * np.outer(ego, t), np.outer(ego, 1.0 + 0.0 * t)],
        axis=2,
    )
    inputs = PUBLISHED.inputs(*state[:, None, 3:6].transpose(2, 0, 1))
    size = np.broadcast_to(CAR, (len(ego), 1, 2)).copy()
    return accident_risk(Scenes(plan, np.tile(CAR, (len(ego), 1)), state[:, None], size, inputs), parameters)


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
    return 0


if __name__ == "__main__":
    sys.exit(main())
