"""Recordings as people keep them: a folder of `recording.toml`, the tables `gt` and `sd`, and a map."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import tomllib
from collections.abc import Mapping
from datetime import date, datetime, time
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.core.tracks import Strings, Tracks
from resim.ingest.recording import Recording, existing_map, sample_rate
from resim.ingest.tables import EXISTENCE, GT_ID, read_table, read_track_table, row_problem

SETTINGS = "recording.toml"
PLAN_COLUMNS = ("t", "t_plan", "x", "y", "v")


def _text(value: object) -> object:
    """TOML's own numbers and times as text."""
    if isinstance(value, datetime | date | time):
        return value.isoformat()
    return str(value) if isinstance(value, int | float) and not isinstance(value, bool) else value


_Text = Annotated[str, BeforeValidator(_text)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Environment(_Part):
    fog_density: _Text | None = Field(default=None, alias="fogDensity")
    precipitation_density: _Text | None = Field(default=None, alias="precipitationDensity")
    date_time: _Text | None = Field(default=None, alias="dateTime")


class _Settings(_Part):
    name: str = Field(min_length=1)
    map: str = Field(min_length=1)
    ego: _Text = Field(min_length=1)
    build: str | None = None
    build_hash: str | None = None
    gt_rate: float | None = Field(default=None, gt=0.0)
    sd_rate: float | None = Field(default=None, gt=0.0)
    environment: _Environment = _Environment()
    provenance: dict[str, _Text] = Field(default_factory=dict)


def read_recording(folder: Path) -> Recording:
    """Give the recording in the folder.

    The folder holds `recording.toml`, `gt.csv` or `gt.parquet`, and where measured `sd` and `plan` likewise.
    An SD table without the column `gt_id` names its objects as the GT does. Raises InputError.
    """
    folder = Path(folder)
    settings = _read_settings(folder / SETTINGS)
    road = existing_map(folder / SETTINGS, folder / settings.map)
    gt_file, sd_file, plan_file = (_table(folder, name) for name in ("gt", "sd", "plan"))
    if gt_file is None:
        raise InputError(folder, "holds neither gt.csv nor gt.parquet", "Put the ground truth there.")
    gt = _read_ground_truth(folder, gt_file, settings.ego)
    sd, identity, existence = (None, None, None) if sd_file is None else _read_sensor_data(sd_file, gt)
    if sd is None and settings.sd_rate is not None:
        problem = f"sd_rate is {settings.sd_rate:g}, but there is neither sd.csv nor sd.parquet beside it"
        raise InputError(folder / SETTINGS, problem, "Add the sensor data or take sd_rate out.")
    return Recording(
        name=settings.name,
        map=road,
        ego=settings.ego,
        gt=gt,
        gt_rate=settings.gt_rate or sample_rate(gt_file, gt),
        sd=sd,
        sd_rate=None if sd is None or sd_file is None else settings.sd_rate or sample_rate(sd_file, sd),
        sd_gt_id=identity,
        existence_probability=existence,
        build=settings.build,
        build_hash=settings.build_hash,
        plan=None if plan_file is None else _read_plan(plan_file),
        environment=settings.environment.model_dump(by_alias=True, exclude_none=True),
        provenance=settings.provenance,
        folder=folder,
    )


def write_recording(recording: Recording, folder: Path, *, map_reference: str | None = None) -> None:
    """Write the recording as a new folder, all or nothing; the same recording gives the same bytes.

    The map is copied into it; with map_reference, a path relative to the folder, the folder refers to that
    file instead. Raises InputError where the folder exists and is not empty, or there is no such map.
    """
    folder = Path(folder)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(folder, "exists already", "Remove it or name another folder.")
    road = recording.map if map_reference is None else Path(os.path.normpath(folder / map_reference))
    existing_map(folder, road)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        _write(recording, folder, map_reference)
    except OSError as e:
        raise InputError(folder, f"cannot be written ({e.strerror})", "Name a folder you may write.") from e


def _write(recording: Recording, folder: Path, map_reference: str | None) -> None:
    """Write a folder beside, then put it in place."""
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        if map_reference is None:
            shutil.copyfile(recording.map, beside / recording.map.name)
        text = _settings_text(recording, map_reference or recording.map.name)
        (beside / SETTINGS).write_text(text, encoding="utf-8", newline="\n")
        for name, table in _tables(recording).items():
            table.to_csv(beside / f"{name}.csv", index=False, lineterminator="\n", encoding="utf-8")
        beside.chmod(0o755)
        beside.replace(folder)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _read_settings(path: Path) -> _Settings:
    try:
        with path.open("rb") as file:
            return _Settings.model_validate(tomllib.load(file))
    except OSError as e:
        remedy = f"A recording is a folder with {SETTINGS}, gt.csv and a map."
        raise InputError(path, f"cannot be read ({e.strerror})", remedy) from e
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise InputError(path, f"is not TOML ({e})", 'TOML puts text in quotes: name = "drive 1".') from e
    except ValidationError as e:
        problems = "; ".join(map(_problem, e.errors()))
        raise InputError(path, problems, "Correct these fields.") from e


def _problem(error: ErrorDetails) -> str:
    found = "" if error["type"] == "missing" else f", found {error['input']!r}"
    return f"{'.'.join(map(str, error['loc']))}: {error['msg']}{found}"


def _table(folder: Path, name: str) -> Path | None:
    """The folder's CSV or Parquet file of that name, None where it has neither."""
    found = [path for end in ("csv", "parquet") if (path := folder / f"{name}.{end}").is_file()]
    if len(found) > 1:
        raise InputError(folder, f"holds both {name}.csv and {name}.parquet", "Keep the one that is meant.")
    return found[0] if found else None


def _read_ground_truth(folder: Path, path: Path, ego: str) -> Tracks:
    gt = Tracks.from_frame(read_track_table(path))
    if ego not in gt.ids:
        problem = f"ego {ego!r} is no object of {path.name}, which holds {', '.join(gt.ids[:20])}"
        raise InputError(folder / SETTINGS, problem, "Name one of its objects.")
    return gt


def _read_sensor_data(path: Path, gt: Tracks) -> tuple[Tracks, Strings, Floats | None]:
    """Tracks, their GT ids (N,) and existence probabilities (N, T)."""
    frame = read_track_table(path)
    sd = Tracks.from_frame(frame)
    rows = frame["id"].map({name: n for n, name in enumerate(sd.ids.tolist())}).to_numpy(int)
    existence = None
    if EXISTENCE in frame:
        existence = np.full(sd.valid.shape, np.nan)
        existence[rows, np.searchsorted(sd.t, frame["t"])] = frame[EXISTENCE]
    if GT_ID not in frame:
        return sd, np.where(np.isin(sd.ids, gt.ids), sd.ids, ""), existence
    first = frame.groupby(rows, sort=True)[GT_ID].first()
    changed = frame[frame[GT_ID].to_numpy() != first.to_numpy()[rows]]
    if len(changed):
        row = changed.index[0]
        known = first.iloc[rows[frame.index.get_loc(row)]]
        what = f"{GT_ID} is {changed[GT_ID].iloc[0]!r}, the object's first row has {known!r}"
        remedy = "Give the track a new id where its identity changes."
        raise InputError(path, row_problem(frame, row, what), remedy)
    unknown = frame[(frame[GT_ID] != "") & ~frame[GT_ID].isin(gt.ids)]
    if len(unknown):
        what = f"{GT_ID} {unknown[GT_ID].iloc[0]!r} is no object of the ground truth"
        remedy = "Name a ground truth object or leave the field empty."
        raise InputError(path, row_problem(frame, unknown.index[0], what), remedy)
    return sd, np.array(first, dtype=str), existence


def _read_plan(path: Path) -> pd.DataFrame:
    return read_table(path, required=PLAN_COLUMNS).reset_index(drop=True)


def _settings_text(recording: Recording, road: str) -> str:
    """The recording.toml, its fields in the order of the model."""
    values: dict[str, str | float | None] = {
        "name": recording.name, "map": road, "ego": recording.ego,
        "build": recording.build, "build_hash": recording.build_hash,
        "gt_rate": recording.gt_rate, "sd_rate": recording.sd_rate,
    }  # fmt: skip
    lines = [f"{key} = {_toml(value)}" for key, value in values.items() if value is not None]
    for section, entries in (("environment", recording.environment), ("provenance", recording.provenance)):
        if entries:
            lines += ["", f"[{section}]", *(f"{_key(k)} = {_toml(v)}" for k, v in entries.items())]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if re.fullmatch("[A-Za-z0-9_-]+", name) else _toml(name)


def _toml(value: str | float) -> str:
    """A TOML number or basic string (JSON's escapes, and DEL)."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value))


def _tables(recording: Recording) -> Mapping[str, pd.DataFrame]:
    tables = {"gt": _by_first_time(recording.gt).to_frame()}
    if recording.sd is not None:
        tables["sd"] = _sensor_table(recording, recording.sd)
    if recording.plan is not None:
        tables["plan"] = recording.plan[list(PLAN_COLUMNS)]
    return tables


def _sensor_table(recording: Recording, sd: Tracks) -> pd.DataFrame:
    frame = _by_first_time(sd).to_frame()
    rows = frame["id"].map({name: n for n, name in enumerate(sd.ids.tolist())}).to_numpy(int)
    frame[GT_ID] = recording.sd_gt_id[rows] if recording.sd_gt_id is not None else ""
    if recording.existence_probability is not None:
        frame[EXISTENCE] = recording.existence_probability[rows, np.searchsorted(sd.t, frame["t"])]
    return frame


def _by_first_time(tracks: Tracks) -> Tracks:
    """The objects in the order in which a reader will meet them."""
    return tracks.select(tracks.ids[np.argsort(tracks.valid.argmax(axis=1), kind="stable")])
