"""Scenarios as the slots around their EGO over time, as `resim mine` writes them (slots.parquet)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.recordings.tables import read_parquet

Ints = NDArray[np.intp]
SLOTS = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")
"""Left rear, beside and front; own lane rear and front; right rear, beside and front (Wagner 2021, Fig. 6.11)."""
FARTHEST = 100.0
"""m ahead that a slot reaches; 50 m behind."""
RATE = 5.0
"""Samples a second [Hz]."""
COLUMNS = ("scenario", "t", *SLOTS, *(f"v_{slot}" for slot in SLOTS), "lane", "bend")
REMEDY = "Mine the recordings again with `resim mine`."


@dataclass(frozen=True, eq=False)
class SlotTraces:
    """N scenarios with K scenes in all, RATE a second.

    Attributes:
        names: (N,) of the scenarios.
        first: (N + 1,) where the scenes of each begin.
        offset: (K, 8) m ahead of the EGO along its lane, NaN where nobody holds the slot.
        speed: (K, 8) m/s above the EGO's, NaN likewise.
        lane: (K,) lanes to the EGO's right, -1 without a lane.
        bend: (K,) 1/m, curvature of the EGO's lane, NaN without a lane.
    """

    names: NDArray[np.str_]
    first: Ints
    offset: Floats
    speed: Floats
    lane: Ints
    bend: Floats

    def __len__(self) -> int:
        return len(self.names)

    @property
    def scenes(self) -> Ints:
        """How many scenes (N,) each has."""
        return np.diff(self.first)

    @property
    def off_lane(self) -> NDArray[np.bool_]:
        """Say of each (N,) whether its EGO is on no lane in a scene: who was around it there is not known."""
        of = np.repeat(np.arange(len(self)), self.scenes)
        return np.asarray(np.bincount(of[self.lane < 0], minlength=len(self)) > 0)

    def take(self, rows: Ints | Sequence[int]) -> SlotTraces:
        """Give some of them (by row), in this order."""
        rows = np.asarray(rows, dtype=np.intp)
        count = self.scenes[rows]
        first = np.concatenate([[0], np.cumsum(count)]).astype(np.intp)
        k = np.repeat(self.first[rows] - first[:-1], count) + np.arange(first[-1])
        return SlotTraces(self.names[rows], first, self.offset[k], self.speed[k], self.lane[k], self.bend[k])

    def rows_of(self, names: Sequence[str]) -> Ints:
        """Give the rows of scenarios, -1 for those that are not there."""
        order = np.argsort(self.names)
        wanted = np.asarray(names, dtype=str)
        if not len(order):
            return np.full(len(wanted), -1, dtype=np.intp)
        at = order[np.minimum(np.searchsorted(self.names[order], wanted), len(order) - 1)]
        return np.where(self.names[at] == wanted, at, -1).astype(np.intp)


def from_frame(frame: pd.DataFrame) -> SlotTraces:
    """Give the traces of a table with COLUMNS, scenario by scenario, each in order of time."""
    names = frame["scenario"].to_numpy(dtype=str)
    new = np.flatnonzero(np.r_[True, names[1:] != names[:-1]]) if len(names) else np.zeros(0, np.intp)
    first = np.append(new, len(names)).astype(np.intp)
    offset = frame[list(SLOTS)].to_numpy(float)
    speed = frame[[f"v_{slot}" for slot in SLOTS]].to_numpy(float)
    return SlotTraces(
        names[new], first, offset, speed, frame["lane"].to_numpy(np.intp), frame["bend"].to_numpy(float)
    )


def to_frame(traces: SlotTraces) -> pd.DataFrame:
    """Give a row per scenario and scene, with COLUMNS."""
    t = (np.arange(traces.first[-1]) - np.repeat(traces.first[:-1], traces.scenes)) / RATE
    columns = {"scenario": np.repeat(traces.names.astype(object), traces.scenes), "t": t}
    columns |= {slot: traces.offset[:, k] for k, slot in enumerate(SLOTS)}
    columns |= {f"v_{slot}": traces.speed[:, k] for k, slot in enumerate(SLOTS)}
    frame = pd.DataFrame({**columns, "lane": traces.lane, "bend": traces.bend})
    return frame.astype({"scenario": "string", "lane": "int64"})


def read_traces(path: Path) -> SlotTraces:
    """Read slots.parquet.

    Raises InputError where it is none, where a scenario stands in two places or its scenes are not RATE a second, and
    where a slot has an offset and no speed.
    """
    if not path.is_file():
        raise InputError(path, "there is no such file: the slots of the scenarios are not known", REMEDY)
    frame = read_parquet(path)
    if lost := [name for name in COLUMNS if name not in frame]:
        raise InputError(path, f"has no column {lost[0]!r}", REMEDY)
    found = from_frame(frame)
    if len(set(found.names.tolist())) < len(found):
        raise InputError(path, "a scenario stands in two places", REMEDY)
    expected = (np.arange(len(frame)) - np.repeat(found.first[:-1], found.scenes)) / RATE
    if len(frame) and not np.allclose(frame["t"].to_numpy(float), expected, atol=1e-6):
        raise InputError(path, f"t: expected 0, {1.0 / RATE:g}, ... s in each scenario", REMEDY)
    if (np.abs(found.offset) > FARTHEST + 1e-3).any():
        problem = f"somebody is over {FARTHEST:g} m away: these are not the slots of the published distance"
        raise InputError(path, problem, "Mine with the thresholds `beside`, `ahead` and `behind` that ship.")
    if (np.isnan(found.offset) != np.isnan(found.speed)).any() or np.isinf(found.offset).any():
        raise InputError(path, "a slot has an offset without a speed, or an infinite one", REMEDY)
    return found


def joined(parts: Sequence[SlotTraces]) -> SlotTraces:
    """Give several as one, in their order."""
    first = np.concatenate([[0], np.cumsum(np.concatenate([one.scenes for one in parts]))]).astype(np.intp)
    names, offset, speed, lane, bend = (
        np.concatenate([getattr(one, field) for one in parts])
        for field in ("names", "offset", "speed", "lane", "bend")
    )
    return SlotTraces(names, first, offset, speed, lane, bend)
