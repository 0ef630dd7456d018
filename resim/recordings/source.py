"""A recording as its tables stand, faults and all; and the strict recording that is made of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.errors import InputError
from resim.core.geometry import Bools, Floats
from resim.core.schema import EXISTENCE, GT_ID, REPAIRED, TOLD
from resim.core.tracks import Strings, Tracks
from resim.recordings.identity import UNMATCHED, DetectionSpread
from resim.recordings.own_detection import misnamed_egos, without_names
from resim.recordings.recording import Recording, sample_rate
from resim.recordings.settings import Environment, Settings
from resim.recordings.tables import FILLED, VALUES, check_complete, check_times

LONGEST = 14_400.0
"""Largest time [s] from a table's first sample to its last."""

MOST_PLACES = 20_000_000
"""Most objects times times of a table: tracks have a place for each pair."""


@dataclass(frozen=True, eq=False)
class RecordingTables:
    """A recording before anyone has said that it is sound.

    map: resolved OpenDRIVE file. gt, sd: track tables with `core.tracks.COLUMNS` and optional ones, indexed by
    row number in the file, in the file's order. Rows may repeat, run back in time, contradict each other in
    size, and hold NaN in x, y, heading and v. plan as in `Recording`. folder: where they came from, None for
    one made in memory; gt_file, sd_file: what errors name.
    """

    settings: Settings
    map: Path
    gt: pd.DataFrame
    sd: pd.DataFrame | None
    plan: pd.DataFrame | None
    folder: Path | None
    gt_file: Path
    sd_file: Path

    @classmethod
    def of(cls, recording: Recording) -> RecordingTables:
        """Give the tables of a recording in memory, with `gt_id` in the SD; inverse of `recording_of`."""
        settings = Settings(
            name=recording.name, map=str(recording.map), ego=recording.ego, build=recording.build,
            build_hash=recording.build_hash, gt_rate=recording.gt_rate, sd_rate=recording.sd_rate,
            environment=Environment.model_validate(dict(recording.environment)),
            provenance=dict(recording.provenance),
        )  # fmt: skip
        tables = track_tables(recording)
        for table in tables.values():
            table.index = pd.RangeIndex(2, len(table) + 2)
        return cls(
            settings=settings, map=recording.map, gt=tables["gt"], sd=tables.get("sd"), plan=recording.plan,
            folder=recording.folder, gt_file=(recording.folder or Path(recording.name)) / "gt.csv",
            sd_file=(recording.folder or Path(recording.name)) / "sd.csv",
        )  # fmt: skip


def recording_of(tables: RecordingTables, *, lenient: bool = False) -> Recording:
    """Make the recording of its tables.

    Raises InputError where a row repeats, a time runs back or a value is missing. With lenient=True rows with
    missing values are dropped, the first of repeated rows stays, and the rest is put in order of time. An
    object's size and kind are those of its first row either way. An SD object that is named as the EGO and cannot be
    it by its kind or size (`own_detection`) is nobody of GT.
    """
    settings = tables.settings
    if tables.sd is not None:
        strangers = misnamed_egos(tables.sd, tables.gt, settings.ego)
        tables = replace(tables, sd=without_names(tables.sd, strangers, set(tables.gt["id"])))
    gt_table = _sound(tables.gt, tables.gt_file, lenient=lenient)
    sd_table = None if tables.sd is None else _sound(tables.sd, tables.sd_file, lenient=lenient)
    gt = Tracks.from_frame(gt_table)
    if settings.ego not in gt.ids:
        raise InputError(tables.gt_file, f"ego {settings.ego!r} has no row without missing values")
    sd = None if sd_table is None else Tracks.from_frame(sd_table)
    marks = {"gt": _marks(gt, gt_table), "sd": _marks(sd, sd_table)}
    named = {"gt": tables.gt}
    if tables.sd is not None:
        named["sd"] = tables.sd.assign(id=_names(tables.sd, gt))
    return Recording(
        name=settings.name, map=tables.map, ego=settings.ego, gt=gt,
        gt_rate=settings.gt_rate or sample_rate(tables.gt_file, gt),
        sd=sd, sd_rate=None if sd is None else settings.sd_rate or sample_rate(tables.sd_file, sd),
        sd_gt_id=None if sd is None or sd_table is None else _identity(sd, sd_table, gt),
        existence_probability=None if sd is None or sd_table is None else _existence(sd, sd_table),
        build=settings.build, build_hash=settings.build_hash, plan=tables.plan,
        environment=settings.environment.model_dump(by_alias=True, exclude_none=True),
        provenance=settings.provenance, folder=tables.folder,
        repair_marks={name: found for name, found in marks.items() if found is not None},
        incomplete={name: table[~_complete(table)] for name, table in named.items()},
        sizes={name: _largest(table) for name, table in named.items()},
        repeated={name: _repeated(table) for name, table in named.items()},
        repairs={name: _repairs(table) for name, table in named.items() if REPAIRED in table},
    )  # fmt: skip


def track_tables(recording: Recording) -> dict[str, pd.DataFrame]:
    """Give the recording's tables as they are written: `gt`, and `sd` where measured."""
    tables = {"gt": _by_first_time(recording.gt).to_frame()}
    if recording.sd is not None:
        tables["sd"] = _sensor_table(recording, recording.sd)
    for name, marks in recording.repair_marks.items():
        tracks = recording.gt if name == "gt" else recording.sd
        if tracks is not None:
            tables[name][REPAIRED] = marks[_cells(tracks, tables[name])]
    return tables


def _sensor_table(recording: Recording, sd: Tracks) -> pd.DataFrame:
    frame = _by_first_time(sd).to_frame()
    rows, samples = _cells(sd, frame)
    frame[GT_ID] = recording.sd_gt_id[rows] if recording.sd_gt_id is not None else ""
    if recording.existence_probability is not None:
        frame[EXISTENCE] = recording.existence_probability[rows, samples]
    return frame


def _by_first_time(tracks: Tracks) -> Tracks:
    """The objects in the order in which a reader will meet them."""
    return tracks.select(tracks.ids[np.argsort(tracks.valid.argmax(axis=1), kind="stable")])


def _sound(frame: pd.DataFrame, path: Path, *, lenient: bool) -> pd.DataFrame:
    """The rows of a recording; refused, or with lenient=True left out, where they are none."""
    check_extent(path, frame)
    if not lenient:
        check_complete(path, frame)
        check_times(path, frame)
        return frame
    ordered: pd.DataFrame = (
        frame[_complete(frame)].drop_duplicates(["t", "id"]).sort_values("t", kind="stable")
    )
    return ordered


def _complete(frame: pd.DataFrame) -> Bools:
    """Which rows lack no value."""
    return np.asarray(np.isfinite(frame[list(VALUES)].to_numpy(float)).all(axis=1))


def _names(frame: pd.DataFrame, gt: Tracks) -> list[str]:
    """What the SD rows' objects are called beside the ground truth (`Recording.sd_by_gt`)."""
    own = frame[GT_ID] if GT_ID in frame else frame["id"]
    known = set(gt.ids.tolist())
    return [g if g in known else f"{UNMATCHED}{i}" for g, i in zip(own, frame["id"], strict=True)]


def _largest(frame: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """The largest length and width [m] that rows give each object, or gave it before a repair."""
    sides = {c: frame[c] if told not in frame else frame[[c, told]].max(axis=1) for c, told in TOLD.items()}
    largest = pd.DataFrame(sides).groupby(frame["id"], sort=False)[list(TOLD)].max()
    return {str(name): (float(a), float(b)) for name, a, b in largest.itertuples()}


def _repeated(frame: pd.DataFrame) -> dict[str, DetectionSpread]:
    """By what rows of one object at one time differ, of which the first is taken; also those that lack a value."""
    twice = frame[frame.duplicated(["t", "id"], keep=False)]
    out: dict[str, DetectionSpread] = {}
    for name, rows in twice.groupby("id", sort=False):
        place, turn = rows["x"] + 1j * rows["y"], np.exp(2j * rows["heading"])
        velocity = rows["v"] * np.exp(1j * rows["heading"])
        whole = rows["t"].to_numpy(float)
        apart, turned, faster = (_spread(whole, z.to_numpy(complex)) for z in (place, turn, velocity))
        out[str(name)] = DetectionSpread(apart, float(np.arcsin(min(0.5 * turned, 1.0))), faster)
    return out


def _spread(t: Floats, values: NDArray[np.complex128]) -> float:
    """The largest distance between values (R,) at one of the times t (R,), of those that are there."""
    by_time = pd.DataFrame({"t": t, "x": values.real, "y": values.imag}).groupby("t")
    wide = (by_time.max() - by_time.min()).to_numpy(float)
    return float(np.nan_to_num(np.hypot(wide[:, 0], wide[:, 1])).max(initial=0.0))


def _repairs(frame: pd.DataFrame) -> pd.DataFrame:
    """The repaired rows that lack no value, but for those filled where another row of the object was seen."""
    rows = frame[_complete(frame)]
    codes = rows[REPAIRED].str.split()
    filled = codes.map(lambda own: not set(FILLED).isdisjoint(own)).to_numpy(bool)
    keys = pd.MultiIndex.from_frame(rows[["t", "id"]])
    seen = keys.isin(keys[~filled])
    keep = (rows[REPAIRED] != "").to_numpy() & ~(filled & seen)
    out: pd.DataFrame = rows[keep].assign(filled=filled[keep])
    return out


def check_extent(path: Path, frame: pd.DataFrame) -> None:
    """Refuse what would take more memory, or time to fit, than there is. Raises InputError."""
    first, last = float(frame["t"].min()), float(frame["t"].max())
    if last - first > LONGEST:
        text = f"lasts {last - first:g} s, from t {first:g} to {last:g}; up to {LONGEST:g} s are read"
        raise InputError(path, text, "Give t in seconds, and cut the recording to the drive.")
    objects, times = frame["id"].nunique(), frame["t"].nunique()
    if objects * times > MOST_PLACES:
        text = (
            f"{objects} objects at {times} different times: too many, up to {MOST_PLACES:.0e} pairs are read"
        )
        raise InputError(path, text, "Cut the recording to the drive, and give all objects the same times.")


def _identity(sd: Tracks, frame: pd.DataFrame, gt: Tracks) -> Strings:
    """GT id (N,) of each SD object, "" for none."""
    if GT_ID not in frame:
        return np.where(np.isin(sd.ids, gt.ids), sd.ids, "")
    given = np.array(frame.drop_duplicates("id").set_index("id")[GT_ID].loc[sd.ids.tolist()], dtype=str)
    return np.where(np.isin(given, gt.ids), given, "")


def _existence(sd: Tracks, frame: pd.DataFrame) -> Floats | None:
    if EXISTENCE not in frame:
        return None
    out = np.full(sd.valid.shape, np.nan)
    out[_cells(sd, frame)] = frame[EXISTENCE]
    return out


def _marks(tracks: Tracks | None, frame: pd.DataFrame | None) -> Strings | None:
    """What was repaired (N, T), None where nothing was."""
    if tracks is None or frame is None or REPAIRED not in frame or not (frame[REPAIRED] != "").any():
        return None
    values = frame[REPAIRED].to_numpy(str)
    out = np.full(tracks.valid.shape, "", dtype=values.dtype)
    out[_cells(tracks, frame)] = values
    return out


def _cells(tracks: Tracks, frame: pd.DataFrame) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Row and sample of each table row in the tracks."""
    number = {name: n for n, name in enumerate(tracks.ids.tolist())}
    return frame["id"].map(number).to_numpy(int), np.searchsorted(tracks.t, frame["t"])
