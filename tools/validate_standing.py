"""Fit who stands, creeps, stops or reverses, with worthless headings, and print a table of docs/validation.md.

    python tools/validate_standing.py [--seed 0]

Each motion for 4, 20 and 60 s, with noise of positions and speeds, and headings as sensors give them where they have
none.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from itertools import product

import numpy as np

from resim.core.geometry import Floats
from resim.scenario.course import MISFIT, NEAR
from resim.scenario.fit import fit_trace

FINE = 0.005  # s
MOTIONS = {
    "standing": lambda t: 0.0 * t,
    "creeping": lambda t: np.abs(0.2 * np.sin(0.5 * t)),
    "stop and go": lambda t: np.clip(3.0 * np.sin(0.7 * t), 0.0, None),
    "reversing": lambda t: -1.5 * np.clip(np.sin(0.5 * t), 0.0, None),
    "there and back": lambda t: 2.0 * np.sin(0.7 * t),
    "moving off": lambda t: 1.5 * np.clip(t - 0.5 * t[-1], 0.0, None),
    "stopping": lambda t: np.clip(8.0 - 2.0 * t, 0.0, None),
}
HEADINGS = ("true", "noisy", "course of noise", "anything", "0", "turned at times", "turned")


def drawn(
    motion: str, heading: str, span: float, noise: float, v_noise: float, rng: np.random.Generator
) -> Floats:
    """One error: the largest distance [m] of the trace from the measured positions."""
    fine = np.arange(0.0, span + 1e-9, FINE)
    v, h = MOTIONS[motion](fine), rng.uniform(-np.pi, np.pi)
    h = h + 0.02 * np.cumsum(v) * FINE
    step = v * np.exp(1j * h)
    way = np.concatenate([[0.0], np.cumsum(0.5 * FINE * (step[1:] + step[:-1]))])
    own = slice(None, None, int(rng.choice([8, 20])))
    t, truth = fine[own], h[own]
    p = way[own] + noise * (rng.normal(size=len(t)) + 1j * rng.normal(size=len(t)))
    told = {
        "true": truth,
        "noisy": truth + 0.3 * rng.normal(size=len(t)),
        "course of noise": np.angle(np.gradient(p)),
        "anything": rng.uniform(-np.pi, np.pi, len(t)),
        "0": 0.0 * t,
        "turned at times": truth + np.pi * (rng.random(len(t)) < 0.3),
        "turned": truth + np.pi,
    }
    speed = v[own] + v_noise * rng.normal(size=len(t))
    return fit_trace(
        t, p.real, p.imag, told[heading], np.abs(speed) if rng.random() < 0.5 else speed
    ).distance.max()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    rng = np.random.default_rng(parser.parse_args().seed)
    rows: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for motion, heading, span, noise, v_noise in product(
        MOTIONS, HEADINGS, (4.0, 20.0, 60.0), (0.0, 0.05, 0.3), (0.0, 0.5)
    ):
        rows[motion].append((float(drawn(motion, heading, span, noise, v_noise, rng)), noise))
    print(
        "| motion | traces | beyond noise | largest distance without noise [m] | with 0.05 m | with 0.3 m |"
    )
    print("|" + "---|" * 6)
    for motion, found in rows.items():
        beyond = sum(d > max(MISFIT * noise, NEAR) for d, noise in found)
        worst = " | ".join(f"{max(d for d, n in found if n == noise):.2f}" for noise in (0.0, 0.05, 0.3))
        print(f"| {motion} | {len(found)} | {beyond} | {worst} |")


if __name__ == "__main__":
    main()
