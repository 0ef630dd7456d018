"""Are the parameters of known perception models recovered? python tools/validate_recovery.py [--picture FILE]

Trains on 20 drives of 10 s that tests/perception/generator.py makes by each known model, three times, and draws each
estimate less the true value, in half widths of its 95 % interval: within -1 and 1 the interval holds the truth.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib.pyplot as plt

from resim.perception.model import PerceptionModel
from resim.perception.training import train

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from perception.generator import KNOWN, drives, parameter

SEEDS = (1, 2, 3)
LEFT_OUT = ("detection", "coupling", "maneuvers", "update", "field_of_view")
"""What has bins, or is no single number with an interval around it."""


def off(known: PerceptionModel, trained: PerceptionModel) -> dict[str, float]:
    """Give each estimate less the truth in half widths of its interval, of parameters that do something."""
    assert trained.training is not None
    out = {}
    for name, found in trained.training.estimates.items():
        if name.split(".")[0] in LEFT_OUT or any(part in LEFT_OUT for part in name.split(".")):
            continue
        of_nothing = (
            name.startswith("ego.") and name.endswith("correlation_time") and not _drifts(known, name)
        )
        true, half = 0.0 if of_nothing else parameter(known, name), 0.5 * (found.high - found.low)
        if true != 0.0 and half > 0.0:
            out[name] = (found.value - true) / half
    return out


def _drifts(known: PerceptionModel, name: str) -> bool:
    """Whether there is a drift to have this correlation time."""
    return parameter(known, name.replace("correlation_time", "drift")) > 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--picture", type=Path)
    asked = parser.parse_args()
    by_model = {
        name: [off(known, train(drives(known, seed), name=name)) for seed in SEEDS]
        for name, known in KNOWN.items()
        if name != "detection"
    }
    print("| known model | parameters | intervals of 95 % that hold the truth |\n|---|---|---|")
    for name, found in by_model.items():
        every = [abs(value) for one in found for value in one.values()]
        print(f"| {name} | {len(found[0])} | {sum(v <= 1.0 for v in every)} of {len(every)} |")
    if asked.picture:
        draw(by_model, asked.picture)


def draw(by_model: dict[str, list[dict[str, float]]], file: Path) -> None:
    counts = [max(len(one) for one in found) for found in by_model.values()]
    figure, axes = plt.subplots(
        len(by_model), 1, figsize=(9.0, 0.2 * sum(counts) + 0.9 * len(counts)), height_ratios=counts,
        sharex=True, layout="constrained",
    )  # fmt: skip
    for axis, (name, found) in zip(axes, by_model.items(), strict=True):
        names = list(dict.fromkeys(key for one in found for key in one))
        axis.axvspan(-1.0, 1.0, color="#e6e9ed")
        for one in found:
            rows = [names.index(key) for key in one]
            axis.plot(list(one.values()), rows, "o", color="#0072B2", markersize=4, alpha=0.7)
        axis.set_yticks(range(len(names)), names, fontsize=7)
        axis.set_ylim(len(names) - 0.4, -0.6)
        axis.set_title(f"known model: {name}", fontsize=9, loc="left")
    axes[-1].set_xlabel("estimate less truth, in half widths of its 95 % interval (grey: it holds the truth)")
    figure.savefig(file, dpi=100)


if __name__ == "__main__":
    main()
