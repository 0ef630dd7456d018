"""What `resim mine` wrote, as the space takes it: scenarios, their slots, and how much was driven."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.sealed import read_sealed
from resim.recordings.tables import read_parquet
from resim.space.traces import REMEDY, Ints, SlotTraces, read_traces

MARK = "mined.json"
TABLES = ("scenarios", "maneuvers", "slots")
COLLISION = "collision"


@dataclass(frozen=True)
class DrivenRecording:
    """How much was driven in a recording.

    Attributes:
        name: Its name in the mined folder.
        hours: h that EGOs drove on lanes in it; NaN where nobody says.
        kilometres: km likewise.
        map: Name and beginning of the hash of its map, "" where nobody says.
        ego: Id of the recording's own EGO.
        build: The build that drove it, "" for a person or where nobody says.
    """

    name: str
    hours: float
    kilometres: float
    map: str
    ego: str
    build: str


@dataclass(frozen=True, eq=False)
class MinedSource:
    """One mined folder.

    Attributes:
        name: Of the folder.
        folder: Where it is.
        hash: Of its tables and its report.
        egos: `every` vehicle, or each recording's `own` EGO.
        recordings: What was driven, in the order of the report.
        rows: A row per scenario that can be compared (`ROWS`).
        traces: Their slots, in the same order.
        left_out: Scenarios without a scene with their EGO.
    """

    name: str
    folder: Path
    hash: str
    egos: str
    recordings: tuple[DrivenRecording, ...]
    rows: pd.DataFrame
    traces: SlotTraces
    left_out: tuple[str, ...]


ROWS = (
    "scenario", "recording", "ego", "start", "end", "map", "road", "along_s", "lanes", "vehicles", "tag", "folder",
    "build", "collided", "occasion", "hours", "kilometres",
)  # fmt: skip
"""Columns of `MinedSource.rows`: build: that drove the EGO, "" for a person; collided: whether the EGO did in it;
occasion: scenarios of one number see the same maneuvers, from one vehicle or another; hours, kilometres: driven in the
source until the scenario begins, NaN where nobody says."""


def read_mined(folder: Path) -> MinedSource:
    """Read a folder of `resim mine`. Raises InputError where it is none, was changed, or has no slots."""
    told = read_sealed(folder / MARK, REMEDY)
    frame, traces = read_parquet(folder / "scenarios.parquet"), read_traces(folder / "slots.parquet")
    maneuvers = read_parquet(folder / "maneuvers.parquet")
    try:
        egos = str(told.get("egos", "every"))
        recordings = tuple(_driven(part, egos) for part in told["parts"])
        trigger = [str(label) for label in told["trigger"]]
    except (KeyError, TypeError, AttributeError) as e:
        raise InputError(folder / MARK, f"is not what `resim mine` writes ({e!r})", REMEDY) from e
    at = traces.rows_of(frame["scenario"].tolist())
    usable = (at >= 0) & (frame["recording"].isin([one.name for one in recordings])).to_numpy()
    left_out = tuple(frame["scenario"][~usable].astype(str))
    rows = _rows(frame[usable].reset_index(drop=True), maneuvers, recordings, trigger)
    state = hashlib.sha256()
    for name in (MARK, *(f"{table}.parquet" for table in TABLES)):
        state.update(file_hash(folder / name).encode())
    return MinedSource(
        folder.resolve().name,
        folder,
        state.hexdigest(),
        egos,
        recordings,
        rows,
        traces.take(at[usable]),
        left_out,
    )


def _driven(part: Mapping[str, Any], egos: str) -> DrivenRecording:
    own = egos == "own"
    hours, way = (
        part.get("ego_hours" if own else "hours"),
        part.get("ego_kilometres" if own else "kilometres"),
    )
    return DrivenRecording(
        str(part["recording"]), math.nan if hours is None else float(hours),
        math.nan if way is None else float(way), part.get("map") or "", part.get("ego") or "",
        part.get("build") or "",
    )  # fmt: skip


def _rows(
    frame: pd.DataFrame, maneuvers: pd.DataFrame, recordings: tuple[DrivenRecording, ...], trigger: list[str]
) -> pd.DataFrame:
    """A row per scenario with ROWS."""
    by_name = {one.name: one for one in recordings}
    of = [by_name[str(name)] for name in frame["recording"]]
    ego = frame["ego"].astype(str)
    hours, way = _driven_until(frame, recordings)
    out = frame[
        ["scenario", "recording", "ego", "start", "end", "road", "along_s", "lanes", "vehicles", "tag", "folder"]
    ].assign(
        map=[one.map for one in of],
        build=[one.build if one.ego == name else "" for one, name in zip(of, ego, strict=True)],
        collided=_collided(frame, maneuvers), occasion=_occasions(frame, maneuvers, trigger),
        hours=hours, kilometres=way,
    )  # fmt: skip
    return out[list(ROWS)]


def _driven_until(
    frame: pd.DataFrame, recordings: tuple[DrivenRecording, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Hours and kilometres driven in the source until each scenario begins, spread evenly over a recording."""
    out = np.full((2, len(frame)), np.nan)
    names = frame["recording"].astype(str).to_numpy()
    start, end = frame["start"].to_numpy(float), frame["end"].to_numpy(float)
    before = np.zeros(2)
    for one in recordings:
        mine, whole = names == one.name, np.array([one.hours, one.kilometres])
        if mine.any():
            low, high = start[mine].min(), max(end[mine].max(), start[mine].min() + 1e-9)
            out[:, mine] = before[:, None] + whole[:, None] * (start[mine] - low) / (high - low)
        before = before + whole
    return out[0], out[1]


def _within(frame: pd.DataFrame, maneuvers: pd.DataFrame) -> Iterable[tuple[int, pd.DataFrame]]:
    """Each scenario by its row, with the maneuvers within its window, of whomever."""
    by_recording = dict(tuple(maneuvers.groupby("recording", sort=False)))
    for row, (recording, start, end) in enumerate(
        zip(frame["recording"], frame["start"], frame["end"], strict=True)
    ):
        own = by_recording.get(recording)
        if own is not None:
            yield row, own[(own["start"] >= start - 1e-6) & (own["end"] <= end + 1e-6)]


def _collided(frame: pd.DataFrame, maneuvers: pd.DataFrame) -> np.ndarray:
    """Whether the EGO of each scenario touches somebody in it."""
    touched = maneuvers[maneuvers["label"] == COLLISION]
    by_ego = dict(tuple(touched.groupby(["recording", "object"], sort=False)))
    out = np.zeros(len(frame), dtype=bool)
    for row, key in enumerate(zip(frame["recording"], frame["ego"], strict=True)):
        if (own := by_ego.get(key)) is not None:
            begin, end = frame["start"].iloc[row], frame["end"].iloc[row]
            out[row] = bool(((own["start"] <= end) & (own["end"] >= begin)).any())
    return out


def _occasions(frame: pd.DataFrame, maneuvers: pd.DataFrame, trigger: list[str]) -> Ints:
    """Number (N,) of the occasion of each scenario: those that share a trigger are one, as it is seen by several EGOs.

    The number is the row of its first scenario.
    """
    wanted = maneuvers[maneuvers["label"].isin(trigger)].reset_index(drop=True)
    pairs = []
    members = [set(str(names).split()) for names in frame["members"]]
    objects = wanted["object"].astype(str).to_numpy()
    for row, own in _within(frame, wanted):
        pairs += [(row, k) for k in own.index.tolist() if objects[k] in members[row]]
    n, m = len(frame), len(wanted)
    if not n:
        return np.zeros(0, dtype=np.intp)
    edges = np.array(pairs or np.zeros((0, 2)), dtype=np.intp).reshape(-1, 2)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], n + edges[:, 1])), shape=(n + m, n + m))
    label = connected_components(graph, directed=False)[1][:n]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.intp)
