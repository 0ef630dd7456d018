"""The runs of a sweep by point and seed: what was varied, and what came of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from resim.core.geometry import Bools, Floats
from resim.perception.parameters import unit
from resim.sweeps.outcomes.registry import OUTCOMES
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import Layout
from resim.sweeps.result import SweepResult


@dataclass(frozen=True, eq=False)
class SweepOutcome:
    """An outcome of the runs: y (K, S) by point and seed; of a share 1 where a run is good, of a value NaN for none."""

    name: str
    label: str
    unit: str
    share: bool
    y: Floats


@dataclass(frozen=True, eq=False)
class SweepPoints:
    """The points of a plan: x (K, P), and as shares of the parameters' distributions u (K, P). layout: how they lie."""

    parameters: tuple[SweepParameter, ...]
    layout: Layout
    x: Floats
    u: Floats

    def along(self, i: int) -> Bools:
        """Give which points (K,) tell of the i-th parameter: all, or one at a time those with the others at base."""
        if self.layout != "axes":
            return np.ones(len(self.x), dtype=bool)
        base = np.array([p.middle() for p in self.parameters])
        return np.asarray(np.delete(self.x == base, i, axis=1).all(axis=1))


def points_of(swept: SweepResult, rows: pd.DataFrame) -> tuple[SweepPoints, list[SweepOutcome]]:
    """The points of a recording and build, and the outcomes at them."""
    names = [p.name for p in swept.parameters]
    _, first, of = np.unique(rows["point"].to_numpy(), return_index=True, return_inverse=True)
    x = rows[names].to_numpy(dtype=float)[first]
    u = np.stack([p.share(x[:, i]) for i, p in enumerate(swept.parameters)], axis=1)
    seed = rows.groupby("point").cumcount().to_numpy()  # each point has seeds of its own

    def by_point(values: Floats) -> Floats:
        y = np.full((len(first), int(seed.max()) + 1), np.nan)
        y[of, seed] = values
        return y

    outcomes = [
        SweepOutcome(name, words, unit, share, by_point(v))
        for name, words, unit, share, v in _columns(swept, rows)
    ]
    return SweepPoints(swept.parameters, swept.file.planned.layout, x, u), outcomes


def _columns(swept: SweepResult, rows: pd.DataFrame) -> Iterator[tuple[str, str, str, bool, Floats]]:
    """Name, label, unit, whether it is a share, and values of each outcome; what failed is not good and has none."""
    good = ~failed(rows).to_numpy()
    for o in OUTCOMES:
        if o.good is not None:
            yield o.column, o.label, o.unit, True, (good & equal(rows[o.column], o.good)).astype(float)
    criteria = [str(c).removeprefix("kpi ") for c in rows.columns if str(c).startswith("kpi ")]
    for name in criteria:
        yield f"kpi {name}", name, "", True, (good & equal(rows[f"kpi {name}"], "PASS")).astype(float)
    risk = rows["risk"].to_numpy(dtype=float)
    for o in OUTCOMES:
        if o.good is None:
            value = rows[o.column].to_numpy(dtype=float)
            yield o.column, o.label, o.unit, False, np.where(good, value, np.nan)
    for name in criteria:
        value = rows[f"value {name}"].to_numpy(dtype=float)
        if not np.array_equal(value, risk, equal_nan=True):
            words = f"worst value of {name}"
            yield f"value {name}", words, swept.unit(name), False, np.where(good, value, np.nan)


def equal(column: pd.Series[Any], value: str | bool) -> Bools:
    """Give where a column (N,) has this value; nowhere that it has none."""
    return np.asarray((column == value).fillna(False).to_numpy(dtype=bool))


def failed(rows: pd.DataFrame) -> pd.Series[bool]:
    """Runs without a result, and those in which the function failed."""
    return (rows["end"] == "failed") | rows["failure"].notna()


def label(name: str) -> str:
    """Give a parameter's name in words."""
    kind, *parts = name.split(".")
    if kind == "variation":
        return (
            "number of the variation" if parts == ["number"] else f"component {parts[0][1:]} of the variation"
        )
    words = [part.replace("_", " ") for part in parts]
    if kind != "perception":
        return " ".join([*words, "of the function" if kind == "function" else "of the build"])
    if words[0] == "latency":
        return f"latency of {' '.join(words[1:])}"
    if words[0] == "errors" and len(words) > 2:
        by = "" if words[-1] == "constant" else f" by {' '.join(words[3:])}"
        return f"{words[1]} {words[2]}{by}"
    return " ".join(words)


def unit_of(name: str) -> str:
    """Give a parameter's unit, "" where the project does not know it."""
    if name.startswith("perception."):
        return unit(name.removeprefix("perception."))
    if name.startswith("variation.c"):
        return "sd"
    return "s" if name == "build.cycle_time" else ""
