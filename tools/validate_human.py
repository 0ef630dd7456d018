"""How near variations of real drives are to these: every vehicle held out once, of recordings that people drove.

    python tools/validate_human.py MINED [--name PART] [--longest SECONDS]

MINED is what `resim mine --scenarios rows` wrote of real recordings; PART names those that are taken. Vehicles are
dealt to four parts; kernels of 20 components are trained without each, and its traces are reconstructed and varied, so
that every trace is held out once. Correlations are of halves, as kernels of four parts have components of their own.
"""

from __future__ import annotations

import argparse
import zlib
from pathlib import Path

import numpy as np

from resim.core.correlation import pearson
from resim.core.geometry import Floats
from resim.jobs.kernels import TrainOptions, maneuver_traces
from resim.jobs.mine import read_mined
from resim.variations.evaluation import evaluate
from resim.variations.kernels import COMPONENTS, ManeuverKernel, fit_kernel
from resim.variations.likeness import (
    Likeness,
    apart_by_series,
    series_of,
    tell_apart,
    varied_traces,
    with_noise,
)
from resim.variations.training import LONGEST

FOLDS, LEAST, DRAWS, FEW = 4, 200, 100, 5
BOXES = (0.005, 0.01, 0.02)
FIVE_FEET = 1.524
"""m/s."""


def traces(folder: Path, name: str, longest: float) -> dict[str, tuple[Floats, np.ndarray]]:
    """Give features (N, F) and a number of the vehicle (N,) by maneuver."""
    found: dict[str, list[tuple[Floats, str]]] = {}
    for one in maneuver_traces(read_mined(folder), TrainOptions(longest=longest)):
        if name in one.recording:
            for label, who, row in zip(one.label, one.object, one.features, strict=True):
                found.setdefault(label, []).append((row, f"{one.recording}/{who}"))
    return {
        label: (np.array([row for row, _ in rows]), np.array([zlib.crc32(who.encode()) for _, who in rows]))
        for label, rows in found.items()
    }


def held_out(label: str, rows: Floats, vehicle: np.ndarray) -> None:
    """Print how every trace is reconstructed and varied by kernels that were trained without its vehicle."""
    errors: list[float] = []
    pairs: dict[float, list[tuple[Floats, Floats]]] = {box: [] for box in BOXES}
    for k in range(FOLDS):
        mine = vehicle % FOLDS == k
        kernel = fit_kernel(label, rows[~mine], rows[mine], components=COMPONENTS)
        errors += [kernel.reconstruction_held_out] * int(mine.sum())
        for box in BOXES:
            pairs[box].append(varied_traces(kernel, rows[mine], box))
    print(f"\n{label}: {len(rows)} traces of {len(set(vehicle.tolist()))} vehicles; "
          f"reconstruction of those held out {100.0 * np.mean(errors):.3f} %")  # fmt: skip
    for box in BOXES:
        measured, varied = (np.concatenate(part) for part in zip(*pairs[box], strict=True))
        print(f"box of {100.0 * box:g} %: {told(tell_apart(measured, varied))}", flush=True)
        if box == BOXES[0]:
            by_values(measured, varied)
    print(f"5 cm of noise: {told(tell_apart(measured, with_noise(measured, np.random.default_rng(0))))}")


def by_values(measured: Floats, varied: Floats) -> None:
    """Print whether variations are told by the values themselves, and by how often they are whole 5 ft/s."""
    for name, one in apart_by_series(measured, varied).items():
        print(f"  by the values of {name}: AUC {one.auc:.3f} ({one.low:.3f} to {one.high:.3f})", flush=True)
    for name, group in (("measured", measured), ("varied", varied)):
        beside = np.abs((series_of(group)["speed along"] / FIVE_FEET + 0.5) % 1.0 - 0.5) * FIVE_FEET
        print(f"  {name} speeds within 0.03 m/s of whole 5 ft/s: {100.0 * (beside < 0.03).mean():.1f} %, "
              f"{100.0 * 0.06 / FIVE_FEET:.1f} % if spread evenly")  # fmt: skip


def told(found: Likeness) -> str:
    """Say how well two groups are told, and by what."""
    by = ", ".join(f"{name} {auc:.2f}" for name, auc in found.by.items())
    return f"AUC {found.auc:.3f} ({found.low:.3f} to {found.high:.3f}), by {by}"


def correlated(label: str, rows: Floats, vehicle: np.ndarray) -> None:
    """Print the correlation of components of one half of the vehicles, by a kernel of the other."""
    mine = vehicle // FOLDS % 2 == 1
    found = evaluate(*_halved(label, rows, mine))
    bias, rng = independent(label, rows, mine, DRAWS), np.random.default_rng(0)
    print(f"half held out, {found.held_out} traces: largest Pearson {_largest(label, rows, mine):.3f}, "
          f"of normal components that are uncorrelated {found.linear_bias:.3f}, of independent ones of these values "
          f"{bias.mean():.3f} (95 % of draws up to {np.quantile(bias, 0.95):.3f}); "
          f"largest nonlinear beyond its bias {found.nonlinear:.3f}")  # fmt: skip
    beyond, each = [], np.unique(vehicle)
    for _ in range(DRAWS):
        mine = np.isin(vehicle, rng.permutation(each)[: len(each) // 2])
        beyond.append(_largest(label, rows, mine) - independent(label, rows, mine, FEW).mean())
    low, middle, high = np.quantile(beyond, [0.025, 0.5, 0.975])
    print(f"{DRAWS} halves by chance: largest Pearson beyond its bias {middle:.3f} ({low:.3f} to {high:.3f})")


def independent(label: str, rows: Floats, mine: np.ndarray, draws: int) -> Floats:
    """The largest Pearson coefficients (draws,) of the same halves, where components are known to be independent.

    The components of all traces, each shuffled, are put together to traces, on which all is done again. That the axes
    are of a sample as well is in it: of normal components each coefficient has the variance 1 / trained + 1 / held out.
    """
    every, rng = fit_kernel(label, rows, rows[:0], components=rows.shape[1]), np.random.default_rng(0)
    scores, out = every.components(rows), []
    for _ in range(draws):
        made = every.features(np.column_stack([rng.permutation(column) for column in scores.T]))
        out.append(_largest(label, made, mine))
    return np.array(out)


def _largest(label: str, rows: Floats, mine: np.ndarray) -> float:
    """The largest Pearson coefficient of two components of those held out."""
    kernel, held = _halved(label, rows, mine)
    return float(np.abs(pearson(kernel.components(held)) - np.eye(kernel.count)).max())


def _halved(label: str, rows: Floats, mine: np.ndarray) -> tuple[ManeuverKernel, Floats]:
    """A kernel of the others, and what is held out."""
    return fit_kernel(label, rows[~mine], rows[mine], components=COMPONENTS), rows[mine]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("mined", type=Path)
    parser.add_argument("--name", default="", help="part of the names of recordings that are taken")
    parser.add_argument("--longest", type=float, default=LONGEST, help="s; longer stretches are cut")
    asked = parser.parse_args()
    for label, (rows, vehicle) in sorted(traces(asked.mined, asked.name, asked.longest).items()):
        if len(rows) < LEAST:
            print(f"{label}: {len(rows)} traces, {LEAST} are needed")
            continue
        held_out(label, rows, vehicle)
        correlated(label, rows, vehicle)


if __name__ == "__main__":
    main()
