"""Do intervals between two spaces hold the truth, and how far on the safe side: 500 draws of known populations.

    python tools/validate_comparison.py [DRAWS]

Of two populations of kinds N and M scenarios are drawn, alone, or four kinds in a row at one occasion. Told are the
share of draws whose interval of 95 % holds the total variation, the means of its value and ends, and in how many draws
the difference of a kind's shares is held: the mean over all kinds that are expected at least once in both, and the
least of them.
"""

from __future__ import annotations

import sys

import numpy as np

from resim.core.geometry import Floats
from resim.space.comparison import difference, variation
from resim.space.statistics.rates import share
from resim.space.traces import Ints

DRAWS = 500
LEVEL = 0.93
"""95 % less 2 points."""


def normed(weights: Floats) -> Floats:
    return np.asarray(weights / weights.sum())


ZIPF = normed(1.0 / np.arange(1, 301))
PAIRS = {
    "zipf, alike": (ZIPF, ZIPF),
    "zipf, moved by 7 kinds": (ZIPF, np.roll(ZIPF, 7)),
    "zipf, one kind in five is missing": (ZIPF, normed(np.where(np.arange(300) % 5 == 4, 0.0, ZIPF))),
    "12 even kinds, alike": (np.full(12, 1 / 12), np.full(12, 1 / 12)),
    "12 kinds, 6 in both": (normed(np.r_[np.ones(9), np.zeros(3)]), normed(np.r_[np.zeros(3), np.ones(9)])),
    "12 kinds, nothing in common": (normed(np.r_[np.ones(6), np.zeros(6)]), normed(np.r_[np.zeros(6), np.ones(6)])),
    "common and rare, rare ones twice as often": (
        np.r_[np.full(5, 0.18), np.full(200, 0.0005)], np.r_[np.full(5, 0.16), np.full(200, 0.001)]
    ),
}  # fmt: skip
SIZES = ((30, 20), (400, 300), (4000, 1000))


def held(one: Floats, other: Floats, sizes: tuple[int, int], together: int, draws: int) -> list[str]:
    """A row: how often the truth is held by total variation, its ends, and differences of shares."""
    rng = np.random.default_rng(0)
    both = [np.mean([np.roll(p, k) for k in range(together)], axis=0) for p in (one, other)]
    truth, expected = (
        0.5 * float(np.abs(both[0] - both[1]).sum()),
        np.minimum(sizes[0] * both[0], sizes[1] * both[1]),
    )
    spread, ends, inside, parts = (float(together),) * 2, [], 0, np.zeros(len(one))
    for _ in range(draws):
        occasions = [rng.multinomial(n // together, p) for n, p in zip(sizes, (one, other), strict=True)]
        counts = np.stack([np.sum([np.roll(c, k) for k in range(together)], axis=0) for c in occasions])
        found = variation(counts, spread)
        inside += found.low <= truth <= found.high
        ends.append((found.value, found.low, found.high))
        parts += _parts(counts, spread, both[0] - both[1])
    value, low, high = np.mean(ends, axis=0)
    kinds = parts[expected >= 1.0] / draws
    told = f"{kinds.mean():.1%}, {kinds.min():.1%} of {len(kinds)}" if len(kinds) else "no kind"
    mark = "" if inside >= LEVEL * draws and (not len(kinds) or kinds.mean() >= LEVEL) else " **below**"
    return [f"{truth:.3f}", f"{inside / draws:.1%}", f"{value:.3f} ({low:.3f} to {high:.3f})", told + mark]


def _parts(counts: Ints, spread: tuple[float, float], truth: Floats) -> Floats:
    """Whether the difference of shares of each kind (C,) holds the truth (C,)."""
    total = counts.sum(axis=1)
    out = np.zeros(len(truth))
    for kind in range(len(truth)):
        told = [share(float(counts[k, kind]) / spread[k], float(total[k]) / spread[k]) for k in (0, 1)]
        found = difference(told[0], told[1])
        out[kind] = found.low <= truth[kind] <= found.high
    return out


def main() -> None:
    draws = int(sys.argv[1]) if len(sys.argv) > 1 else DRAWS
    print(
        "| populations | N, M | at a time | total variation | held | told in the mean | differences held: mean, least |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, (one, other) in PAIRS.items():
        for sizes in SIZES:
            for together in (1, 4) if sizes == SIZES[1] else (1,):
                row = held(one, other, sizes, together, draws)
                print(f"| {name} | {sizes[0]}, {sizes[1]} | {together} | {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
