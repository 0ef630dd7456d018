"""What `resim mine` wrote, as the space takes it: scenarios, their slots, and how much was driven."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pandas.arrays import BooleanArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from resim.core.errors import InputError
from resim.core.files import check_hashes, file_hash
from resim.core.sealed import read_sealed
from resim.recordings.tables import read_parquet
from resim.space.shared_traffic import moments, no_moments
from resim.space.traces import REMEDY, Ints, SlotTraces, read_traces

MARK = "mined.json"
UNKNOWN_BUILD = "a build without a hash"
"""In place of the hash of a build that a recording names and does not pin: it may be any."""
TABLES = ("scenarios", "maneuvers", "slots")
COLLISION = "collision"


@dataclass(frozen=True)
class DrivenRecording:
    """How much was driven in a recording.

    Attributes:
        name: Its name in the mined folder.
        hours: h that EGOs drove on lanes in it, without those in which they stand; NaN where nobody says.
        kilometres: km likewise.
        map: Name and beginning of the hash of its map, "" where nobody says.
        ego: Id of the recording's own EGO.
        build: Hash of the build that drove it, UNKNOWN_BUILD for one without a hash, "" for a person or where nobody
            says.
        tracks: Hash of its GT, EGO and map, which copies under other names share.
        traffic: Hash of who was where, and of the EGO where it alone counts, which copies of other bytes share.
        accidents: Collisions of its own EGO, and ends of a function's drive before its time, that are in no scenario; 1
            where nobody says that it did not collide.
        content: Hash of all that it is, by which the lake knows it.
    """

    name: str
    hours: float
    kilometres: float
    map: str
    ego: str
    build: str
    tracks: str = ""
    traffic: str = ""
    accidents: int = 0
    content: str = ""


@dataclass(frozen=True, eq=False)
class MinedSource:
    """One mined folder.

    Attributes:
        name: Of the folder.
        folder: Where it is.
        hash: Of its tables and its report.
        egos: `every` vehicle, or each recording's `own` EGO.
        trigger: What its scenarios were cut out for.
        rules: Hash of the thresholds that it was mined with, "" for those that ship.
        recordings: What was driven, in the order of the report.
        rows: A row per scenario that can be compared (`ROWS`).
        traces: Their slots, in the same order.
        left_out: Scenarios without a scene with their EGO.
        failed: Recordings that could not be mined.
        mined: Hash of its report, by which the lake knows it.
        moments: When vehicles of its recordings were where (`resim.space.shared_traffic`).
    """

    name: str
    folder: Path
    hash: str
    egos: str
    recordings: tuple[DrivenRecording, ...]
    rows: pd.DataFrame
    traces: SlotTraces
    left_out: tuple[str, ...]
    failed: tuple[str, ...] = ()
    trigger: tuple[str, ...] = ()
    rules: str = ""
    mined: str = ""
    moments: pd.DataFrame = field(default_factory=no_moments)


ROWS = (
    "scenario", "recording", "ego", "start", "end", "map", "road", "along_s", "lanes", "vehicles", "tag", "folder",
    "build", "collided", "occasion", "hours", "kilometres",
)  # fmt: skip
"""Columns of `MinedSource.rows`: build: hash of what drove the EGO, UNKNOWN_BUILD where it
has none, "" for a person; collided: whether the EGO did in it, or its drive broke off, NULL where nobody says;
occasion: scenarios of one number see the same maneuvers, from one vehicle or another; hours, kilometres: driven in the
source until the scenario ends, NaN where nobody says."""


def read_mined(folder: Path) -> MinedSource:
    """Read a folder of `resim mine`. Raises InputError where it is none, was changed, or has no slots."""
    told = read_sealed(folder / MARK, REMEDY)
    check_hashes(folder, _hashes(told), REMEDY)
    frame, traces = read_parquet(folder / "scenarios.parquet"), read_traces(folder / "slots.parquet")
    maneuvers = read_parquet(folder / "maneuvers.parquet")
    try:
        egos = str(told.get("egos", "every"))
        recordings = tuple(_driven(part, egos) for part in told["parts"])
        ended = {
            str(part["recording"]): float(part["ended"])
            for part in told["parts"]
            if part.get("ended") is not None
        }
        unclear = {
            str(part["recording"]) for part in told["parts"] if part.get("collided", False) is not False
        }
        failed = tuple(str(one["recording"]) for one in told["failures"])
        trigger = [str(label) for label in told["trigger"]]
        rules = str(told["rules"])
    except (KeyError, TypeError, AttributeError) as e:
        raise InputError(folder / MARK, f"is not what `resim mine` writes ({e!r})", REMEDY) from e
    at = traces.rows_of(frame["scenario"].tolist())
    usable = (at >= 0) & (frame["recording"].isin([one.name for one in recordings])).to_numpy()
    left_out = tuple(frame["scenario"][~usable].astype(str))
    seen = _Accidents(maneuvers, recordings, ended, unclear)
    rows = _rows(frame[usable].reset_index(drop=True), maneuvers, recordings, trigger, seen)
    recordings = tuple(
        replace(one, accidents=max(seen.outside(one, rows), seen.unclear(one))) for one in recordings
    )
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
        failed,
        tuple(trigger),
        rules,
        file_hash(folder / MARK),
        moments(maneuvers, pd.Series({one.name: one.map for one in recordings}, dtype=str)),
    )


def _driven(part: Mapping[str, Any], egos: str) -> DrivenRecording:
    own = egos == "own"
    of = "ego_" if own else ""
    hours, stands, way = (part.get(f"{of}{name}") for name in ("hours", "standing_hours", "kilometres"))
    return DrivenRecording(
        str(part["recording"]), math.nan if hours is None or stands is None else max(float(hours) - float(stands), 0.0),
        math.nan if way is None else float(way), part.get("map") or "", part.get("ego") or "",
        part.get("build_hash") or (UNKNOWN_BUILD if part.get("build") else ""), str(part["tracks"]),
        f"{part['traffic']} {part.get('ego') if own else ''}", content=str(part["content"]),
    )  # fmt: skip


def _rows(
    frame: pd.DataFrame, maneuvers: pd.DataFrame, recordings: tuple[DrivenRecording, ...], trigger: list[str],
    seen: _Accidents,
) -> pd.DataFrame:  # fmt: skip
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
        collided=seen.within(frame), occasion=_occasions(frame, maneuvers, trigger),
        hours=hours, kilometres=way,
    )  # fmt: skip
    return out[list(ROWS)]


def _driven_until(
    frame: pd.DataFrame, recordings: tuple[DrivenRecording, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Hours and kilometres driven in the source until each scenario ends, spread evenly over a recording.

    How long a recording went on after its last scenario is not told: that one ends with it, so that nothing is said
    to have been found earlier than it was.
    """
    out = np.full((2, len(frame)), np.nan)
    names = frame["recording"].astype(str).to_numpy()
    start, end = frame["start"].to_numpy(float), frame["end"].to_numpy(float)
    before = np.zeros(2)
    for one in recordings:
        mine, whole = names == one.name, np.array([one.hours, one.kilometres])
        if mine.any():
            low, high = start[mine].min(), max(end[mine].max(), start[mine].min() + 1e-9)
            out[:, mine] = before[:, None] + whole[:, None] * (end[mine] - low) / (high - low)
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


class _Accidents:
    """When EGOs touch somebody, and when a function's drive broke off, by recording and object: (begin, end) [s]."""

    def __init__(
        self, maneuvers: pd.DataFrame, recordings: tuple[DrivenRecording, ...], ended: Mapping[str, float],
        unclear: set[str],
    ) -> None:  # fmt: skip
        self.spans: dict[tuple[str, str], list[tuple[float, float]]] = {}
        touched = maneuvers[maneuvers["label"] == COLLISION]
        columns = (touched[name].tolist() for name in ("recording", "object", "start", "end"))
        for recording, name, start, end in zip(*columns, strict=True):
            self.spans.setdefault((str(recording), str(name)), []).append((float(start), float(end)))
        self._unclear = {(one.name, one.ego) for one in recordings if one.name in unclear} - set(self.spans)
        for one in recordings:
            if one.name in ended:
                at = ended[one.name]
                self.spans.setdefault((one.name, one.ego), []).append((at, at))

    def within(self, frame: pd.DataFrame) -> BooleanArray:
        """Say of each scenario (N,) whether there is one in it, NULL where nobody says."""
        columns = (frame[name].tolist() for name in ("recording", "ego", "start", "end"))
        return pd.array(
            [
                any(_meet(span, start, end) for span in self.spans.get((str(recording), str(ego)), ()))
                or (pd.NA if (str(recording), str(ego)) in self._unclear else False)
                for recording, ego, start, end in zip(*columns, strict=True)
            ],
            dtype="boolean",
        )  # fmt: skip

    def unclear(self, one: DrivenRecording) -> bool:
        """Say whether its own EGO collides, or may, and nobody says when."""
        return (one.name, one.ego) in self._unclear

    def outside(self, one: DrivenRecording, rows: pd.DataFrame) -> int:
        """Count those of a recording's own EGO that are in no scenario of it."""
        own = rows[(rows["recording"] == one.name) & (rows["ego"] == one.ego)]
        windows = list(zip(own["start"].tolist(), own["end"].tolist(), strict=True))
        spans = self.spans.get((one.name, one.ego), ())
        return sum(not any(_meet(span, *window) for window in windows) for span in spans)


def _meet(span: tuple[float, float], start: float, end: float) -> bool:
    return span[0] <= end + 1e-6 and span[1] >= start - 1e-6


def _hashes(told: Mapping[str, Any]) -> dict[str, str]:
    """The hashes of the tables, as the folder's report says them; a table without one is told as changed."""
    files = told.get("files")
    known = files if isinstance(files, dict) else {}
    return {f"{name}.parquet": str(known.get(f"{name}.parquet", "")) for name in TABLES}


def _occasions(frame: pd.DataFrame, maneuvers: pd.DataFrame, trigger: list[str]) -> Ints:
    """Number (N,) of the occasion of each scenario: those that share a trigger are one, as it is seen by several EGOs.

    The number is the row of its first scenario.
    """
    wanted = maneuvers[maneuvers["label"].isin(trigger)].reset_index(drop=True)
    pairs = []
    # names may have spaces; one that is part of another joins too many, never too few
    members = [f" {names} " for names in frame["members"]]
    objects = wanted["object"].astype(str).to_numpy()
    for row, own in _within(frame, wanted):
        pairs += [(row, k) for k in own.index.tolist() if f" {objects[k]} " in members[row]]
    n, m = len(frame), len(wanted)
    if not n:
        return np.zeros(0, dtype=np.intp)
    edges = np.array(pairs or np.zeros((0, 2)), dtype=np.intp).reshape(-1, 2)
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], n + edges[:, 1])), shape=(n + m, n + m))
    label = connected_components(graph, directed=False)[1][:n]
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.intp)
