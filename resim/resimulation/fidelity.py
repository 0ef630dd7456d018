"""What each step between the measured drive and its re-simulation did to it (Wagner 2021, Section 5.3.2).

Errors are always later minus earlier, at equal times. Takes tracks and scenarios, gives tables; runs nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.geometry import Bools, Boxes, Floats, boxes_overlap, wrap_angle
from resim.core.levels import apart_from
from resim.core.tracks import Strings, Tracks, whole_id
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario

STEPS = ("S", "FIT_GT", "FIT_SD", "SIM_GT", "SIM_SD", "FIT_rGT", "FIT_rSD", "PIPE_GT", "PIPE_SD")
"""The steps, in the order of the chain."""

SUMS: Mapping[str, tuple[str, ...]] = {
    "PIPE_GT": ("FIT_GT", "SIM_GT", "FIT_rGT"),
    "PIPE_SD": ("S", "FIT_SD", "SIM_SD", "FIT_rSD"),
}
"""Eq. 5.6: the steps whose errors add up to the pipeline's."""

QUANTITIES: Mapping[str, str] = {"d": "m", "v": "m/s", "heading": "rad"}
"""What an error is measured in: distance, speed and heading difference, with their units."""

STATISTICS = ("mean", "std", "min", "q25", "q50", "q75", "max")

Statistics: TypeAlias = dict[str, float]


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Errors of one step: later minus earlier of N objects at T times; NaN where either is missing.

    t: (T,) s. ids: (N,), the EGO first. x, y: (N, T) m in the map frame. v: (N, T) m/s. heading: (N, T) rad,
    wrapped.
    """

    t: Floats
    ids: Strings
    x: Floats
    y: Floats
    v: Floats
    heading: Floats

    @property
    def d(self) -> Floats:
        """Distance (N, T) [m]."""
        return np.hypot(self.x, self.y)

    def quantity(self, name: str) -> Floats:
        """Give d, v or heading (N, T)."""
        return np.asarray(getattr(self, name))

    def statistics(self, rows: slice) -> dict[str, Statistics | None]:
        """Give the statistics of d, v and heading over all samples of these rows, None where there is none."""
        return {name: statistics(self.quantity(name)[rows]) for name in QUANTITIES}

    def rms(self, rows: slice) -> dict[str, float | None]:
        """Give the root mean square of d [m], v [m/s] and heading [rad] over all samples of these rows."""
        out: dict[str, float | None] = {}
        for name in QUANTITIES:
            values = self.quantity(name)[rows]
            known = values[np.isfinite(values)]
            out[name] = float(np.sqrt(np.mean(known * known))) if known.size else None
        return out

    def frame(self, step: str) -> pd.DataFrame:
        """Give the time series as a table: step, t, id, d, v, heading."""
        row, sample = np.nonzero(np.isfinite(self.x))
        columns = {name: self.quantity(name)[row, sample] for name in QUANTITIES}
        return pd.DataFrame({"step": step, "t": self.t[sample], "id": self.ids[row], **columns})


EGO_ROW, TO_ROWS = slice(0, 1), slice(1, None)


def statistics(values: Floats) -> Statistics | None:
    """Give mean, standard deviation, range and quartiles of the finite values, None where there is none."""
    values = values[np.isfinite(values)]
    if not values.size:
        return None
    low, q25, q50, q75, high = np.quantile(values, [0.0, 0.25, 0.5, 0.75, 1.0]).tolist()
    return {
        "mean": float(values.mean()), "std": float(values.std()), "min": low,
        "q25": q25, "q50": q50, "q75": q75, "max": high,
    }  # fmt: skip


def difference(later: Tracks, earlier: Tracks, *, ego: str) -> StepErrors:
    """Give later minus earlier for the objects that are in both, EGO first.

    Both must have the same times; `Tracks.at` and `Scenario.tracks` bring them there.
    """
    if not np.array_equal(later.t, earlier.t):
        raise ValueError("errors are differences at equal times")
    common = [ego, *(i for i in earlier.ids.tolist() if i != ego and i in set(later.ids.tolist()))]
    one, two = earlier.select(common), later.select(common)
    return StepErrors(
        t=later.t,
        ids=one.ids,
        x=two.x - one.x,
        y=two.y - one.y,
        v=two.v - one.v,
        heading=wrap_angle(two.heading - one.heading),
    )


def sensor_error(gt: Tracks, sd: Tracks, *, ego: str) -> StepErrors:
    """S = SD - GT, at the times of SD; GT is interpolated between neighbouring samples."""
    return difference(sd, gt.at(sd.t, max_gap=max(0.3, 2.0 * float(np.median(np.diff(gt.t))))), ego=ego)


def fit_error(scenario: Scenario, tracks: Tracks, network: RoadNetwork) -> StepErrors:
    """FIT_X = JSCEN of X - X, at the times of X, measured or re-simulated."""
    return difference(scenario.tracks(network, tracks.t), tracks, ego=scenario.ego.id)


def simulation_error(truth: Tracks, scenario: Scenario, network: RoadNetwork) -> StepErrors:
    """SIM_X = rX - JSCEN of X, at the times of the simulation."""
    return difference(truth, scenario.tracks(network, truth.t), ego=scenario.ego.id)


def pipeline_error(scenario: Scenario, gt: Tracks, network: RoadNetwork) -> StepErrors:
    """PIPE_X = JSCEN of rX - GT, at the times of GT; an object's parts (`Tracks.split`) are compared as one."""
    return difference(scenario.tracks(network, gt.t).joined(), gt, ego=scenario.ego.id)


def sums(errors: Mapping[str, StepErrors]) -> dict[str, dict[str, dict[str, dict[str, float]]]]:
    """Set the sum of the steps' errors against the measured pipeline error (Eq. 5.6).

    Position errors add up as vectors: `sum` is the mean length of the summed vectors, `sum_of_means` the
    plain sum of the steps' means, as the source has it. For v and heading both are the same.
    """
    out: dict[str, dict[str, dict[str, dict[str, float]]]] = {}
    for whole, parts in SUMS.items():
        if whole not in errors or any(part not in errors for part in parts):
            continue
        pipe = errors[whole]
        moved = [_at(errors[part], pipe) for part in parts]
        total = StepErrors(
            pipe.t, pipe.ids, *(sum(getattr(m, c) for m in moved) for c in ("x", "y", "v", "heading"))
        )
        out[whole] = {
            who: rows
            for who, at in (("ego", EGO_ROW), ("to", TO_ROWS))
            if (rows := _sums_of(pipe, total, moved, at))
        }
    return out


def _at(part: StepErrors, whole: StepErrors) -> StepErrors:
    """One step's errors at the times and objects of another's, by linear interpolation."""
    order = {name: row for row, name in enumerate(whole.ids.tolist())}

    def column(name: str) -> Floats:
        values = np.full((len(whole.ids), len(whole.t)), np.nan)
        for n, object_id in enumerate(part.ids.tolist()):
            own = getattr(part, name)[n]
            known = np.isfinite(own)
            row = order.get(object_id, order.get(whole_id(object_id, order)))
            if row is None or not known.any():
                continue
            there = (whole.t >= part.t[known][0]) & (whole.t <= part.t[known][-1])
            values[row, there] = np.interp(whole.t[there], part.t[known], own[known])
        return values

    return StepErrors(whole.t, whole.ids, *(column(c) for c in ("x", "y", "v", "heading")))


def _sums_of(
    pipe: StepErrors, total: StepErrors, parts: Sequence[StepErrors], rows: slice
) -> dict[str, dict[str, float]]:
    both: Bools = np.isfinite(pipe.x[rows]) & np.isfinite(total.x[rows])
    if not both.any():
        return {}
    return {
        name: {
            "sum": float(total.quantity(name)[rows][both].mean()),
            "sum_of_means": float(sum(p.quantity(name)[rows][both].mean() for p in parts)),
            "measured": float(pipe.quantity(name)[rows][both].mean()),
        }
        for name in QUANTITIES
    }


def collisions(tracks: Tracks, *, ego: str) -> list[tuple[float, str]]:
    """Give, per object that the EGO's box overlaps, the first time [s] and the object's id."""
    row = tracks.index(ego)
    hit: NDArray[np.bool_] = boxes_overlap(
        Boxes(tracks.x[row], tracks.y[row], tracks.heading[row], tracks.length[row], tracks.width[row]),
        Boxes(tracks.x, tracks.y, tracks.heading, tracks.length[:, None], tracks.width[:, None]),
    )
    hit[row] = False
    if hit.any() and (levels := apart_from(tracks, row)) is not None:
        hit &= ~levels
    struck: Iterable[int] = np.flatnonzero(hit.any(axis=1)).tolist()
    return sorted((float(tracks.t[np.argmax(hit[n])]), str(tracks.ids[n])) for n in struck)
