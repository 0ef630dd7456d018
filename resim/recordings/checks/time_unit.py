"""The unit of times: milliseconds and the like, by speeds and distances. What is found is put right for the rest."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.finding import Source
from resim.core.geometry import Bools
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.units import MOVING, SPEED_UNITS, STEADY

UNITS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
"""What there is of each in a second."""
NEAR = 0.15
"""Relative distance from a unit's factor that still is it: units are a thousand apart."""
LEAST = 5
"""Steps of an object that tell."""
SELDOM = 5.0
"""Step [s] that no measurement of a drive has."""


def time_unit(source: Source, frame: pd.DataFrame) -> tuple[pd.DataFrame, list[RankedFinding]]:
    """Give the finding that all moving objects need a unit's factor less time than stamped; and the rows in seconds."""
    ratios = _ratios(frame)
    if not ratios:
        return frame, _by_step(source, frame)
    every = np.array(ratios)
    for unit, factor in UNITS.items():
        for speed, times in {"m/s": 1.0, **SPEED_UNITS}.items():
            if (np.abs(every / (factor * times) - 1.0) < NEAR).all():
                what = f"t is in {unit}" + ("" if times == 1.0 else f", and v in {speed}")
                text = f"{what}: speed times time is {np.median(every):.4g} times the way, of {len(every)} objects"
                span = float(frame["t"].min()) / factor, float(frame["t"].max()) / factor
                one = found(
                    "TIME_UNIT", source, "", span, factor, "", text, limit=1.0, details={"factor": factor}
                )
                return frame.assign(t=np.round(frame["t"].to_numpy(float) / factor, 9)), [one]
    return frame, []


def _by_step(source: Source, frame: pd.DataFrame) -> list[RankedFinding]:
    """The finding that samples are too far apart for seconds, where no speed tells their unit: without a repair."""
    step = frame.groupby("id", sort=False)["t"].diff()
    step = step[step > 0.0]
    middle = float(step.median()) if len(step) >= LEAST else 0.0
    if middle < SELDOM:
        return []
    text = f"samples are {middle:g} s apart and nothing moves at its speed: is t in ms?"
    span = float(frame["t"].min()), float(frame["t"].max())
    return [found("TIME_UNIT", source, "", span, middle, "s", text, limit=SELDOM, repair="")]


def _ratios(frame: pd.DataFrame) -> list[float]:
    """Speed times time by the way, of each object that moves: 1 where all is well."""
    out = []
    for _, rows in frame.groupby("id", sort=False):
        t, x, y, v = (rows[c].to_numpy(float) for c in ("t", "x", "y", "v"))
        way, told, dt = np.hypot(np.diff(x), np.diff(y)), 0.5 * np.abs(v[1:] + v[:-1]), np.diff(t)
        moves: Bools = (way > 1e-3) & (told > MOVING) & (dt > 0.0)
        if moves.sum() < LEAST:
            continue
        ratio = told[moves] * dt[moves] / way[moves]
        middle = float(np.median(ratio))
        if float(np.quantile(np.abs(ratio / middle - 1.0), 0.75)) < 2.0 * STEADY:
            out.append(middle)
    return out
