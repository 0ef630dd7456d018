"""Makes training drives for a perception model: python tools/make_training.py [--count 30] [--out scenarios/training].

Varied traffic on the proving ground, driven by highway_pilot with the sensor of scenarios/cut_in_brake. Cut-ins,
braking leaders, overtaking, lane changes and following, at varied speeds, gaps and decelerations; none of them is
the corner case, which the model is to be tested on. The same seeds give the same bytes.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from drives import LANE, Drive, Motion, profile, swerve
from make_scenarios import ROOT, record
from virtual_sensor import SensorErrors

from resim.core.geometry import Floats
from resim.road.path import Path as LanePath

FIRST_SEED = 1000


def cut_in(rng: np.random.Generator, v: float) -> Callable[[Floats], Motion]:
    """Somebody faster comes from behind on the left, cuts in, and brakes or does not."""
    start, dv = rng.uniform(-30.0, 5.0), rng.uniform(3.0, 10.0)
    begin, takes = rng.uniform(1.0, 4.0), rng.uniform(2.5, 5.0)
    brake, a, until = rng.uniform(3.0, 6.0), -rng.uniform(0.5, 4.0), rng.uniform(1.0, 4.0)
    return lambda t: (
        start + profile(t, v + dv, (brake, brake + until, a)), LANE - swerve(t, begin, takes, LANE)
    )  # fmt: skip


def leader(rng: np.random.Generator, v: float) -> Callable[[Floats], Motion]:
    """Somebody ahead brakes and speeds up again."""
    gap, dv = rng.uniform(25.0, 60.0), rng.uniform(-3.0, 2.0)
    brake, a = rng.uniform(1.0, 5.0), -rng.uniform(1.0, 4.0)
    again, more = brake + rng.uniform(1.0, 2.5), rng.uniform(0.5, 2.0)
    return lambda t: (
        gap + profile(t, v + dv, (brake, again, a), (again, again + 2.0, more)),
        np.zeros_like(t),
    )


def passing(rng: np.random.Generator, v: float) -> Callable[[Floats], Motion]:
    """Somebody overtakes on the left, at changing speed."""
    start, dv, at = rng.uniform(-40.0, -10.0), rng.uniform(2.0, 8.0), rng.uniform(1.0, 6.0)
    a = rng.uniform(-1.5, 1.5)
    return lambda t: (start + profile(t, v + dv, (at, at + 2.0, a)), LANE * np.ones_like(t))


def leaving(rng: np.random.Generator, v: float) -> Callable[[Floats], Motion]:
    """Somebody ahead changes to the left lane."""
    gap, dv, begin = rng.uniform(30.0, 70.0), rng.uniform(-2.0, 3.0), rng.uniform(1.0, 5.0)
    takes = rng.uniform(3.0, 5.0)
    return lambda t: (gap + profile(t, v + dv), swerve(t, begin, takes, LANE))


def behind(rng: np.random.Generator, v: float) -> Callable[[Floats], Motion]:
    """Somebody follows far behind."""
    gap, dv = rng.uniform(-90.0, -60.0), rng.uniform(-3.0, 0.0)
    return lambda t: (gap + profile(t, v + dv), np.zeros_like(t))


KINDS = (
    (cut_in,), (leader,), (cut_in, leader), (passing, leader), (leaving, passing), (cut_in, behind), (leaving, behind),
)  # fmt: skip
"""Who is around, drive after drive."""


def training_drive(number: int) -> Drive:
    """Give the drive of this number."""
    rng = np.random.default_rng([FIRST_SEED, number])
    v = rng.uniform(20.0, 30.0)
    kinds = KINDS[number % len(KINDS)]
    motions = [kind(rng, v) for kind in kinds]

    def traffic(path: LanePath, t: Floats) -> dict[str, Motion]:
        return {str(n): motion(t) for n, motion in enumerate(motions, start=1)}

    names = " and ".join(kind.__name__.replace("_", " ") for kind in kinds)
    return Drive(
        f"Training drive {number}: {names}",
        "highway_pilot-1.0",
        10.0,
        -2,
        v,
        traffic,
        SensorErrors(),
        FIRST_SEED + number,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=30)
    parser.add_argument("--out", type=Path, default=ROOT / "scenarios" / "training")
    asked = parser.parse_args()
    for number in range(asked.count):
        name = f"drive_{number:02d}"
        run = record(name, training_drive(number), asked.out / name)
        told = f"{len(run.truth) - 1} objects, {run.truth.t[-1]:.1f} s, {len(run.collisions)} collisions"
        print(f"{asked.out / name}: {told}")


if __name__ == "__main__":
    main()
