"""Recordings as people keep them: a folder of `recording.toml`, the tables `gt` and `sd`, and a map."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError
from resim.core.schema import GT_ID, PLAN_COLUMNS
from resim.recordings.present import existing_map, ground_truth, table_file
from resim.recordings.recording import Recording
from resim.recordings.settings import SETTINGS, Settings, read_settings, settings_text
from resim.recordings.source import RecordingTables, recording_of
from resim.recordings.tables import check_readable, read_table, read_track_table, row_problem, write_parquet


def read_tables(folder: Path) -> RecordingTables:
    """Give what the folder holds, as it stands.

    The folder holds `recording.toml`, `gt.csv` or `gt.parquet`, and where measured `sd` and `plan` likewise.
    Raises InputError for what cannot be read at all; what `resim.recordings.checks` examines is let through.
    """
    folder = Path(folder)
    settings = read_settings(folder / SETTINGS)
    road = existing_map(folder / SETTINGS, folder / settings.map)
    gt_file, sd_file, plan_file = ground_truth(folder), table_file(folder, "sd"), table_file(folder, "plan")
    gt = read_track_table(gt_file)
    _check_ego(folder, gt_file, gt, settings.ego)
    sd = None if sd_file is None else _read_sensor_data(sd_file, gt)
    if sd is None and settings.sd_rate is not None:
        problem = f"sd_rate is {settings.sd_rate:g}, but there is neither sd.csv nor sd.parquet beside it"
        raise InputError(folder / SETTINGS, problem, "Add the sensor data or take sd_rate out.")
    return RecordingTables(
        settings=settings, map=road, gt=gt, sd=sd, plan=None if plan_file is None else _read_plan(plan_file),
        folder=folder, gt_file=gt_file, sd_file=sd_file or folder / "sd.csv",
    )  # fmt: skip


def read_recording(folder: Path) -> Recording:
    """Give the recording in the folder (see `read_tables`).

    An SD table without the column `gt_id` names its objects as the GT does. Raises InputError.
    """
    return recording_of(read_tables(folder))


def write_recording(
    recording: Recording, folder: Path, *, map_reference: str | None = None, parquet: bool = False
) -> None:
    """Write the recording as a new folder (see `write_tables`)."""
    write_tables(RecordingTables.of(recording), folder, map_reference=map_reference, parquet=parquet)


def write_tables(
    tables: RecordingTables, folder: Path, *, map_reference: str | None = None, parquet: bool = False
) -> None:
    """Write the tables as a new recording folder, all or nothing; the same tables give the same bytes.

    parquet: as Parquet, which takes a third of the space, and not as CSV.

    The map is copied into it; with map_reference, a path relative to the folder, the folder refers to that
    file instead. Raises InputError where the folder exists and is not empty, there is no such map, or a table holds
    what could not be read again.
    """
    folder = Path(folder)
    for file, table in ((tables.gt_file, tables.gt), (tables.sd_file, tables.sd)):
        if table is not None:
            check_readable(file, table)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(folder, "exists already", "Name a new folder: a recording is never replaced.")
    road = tables.map if map_reference is None else Path(os.path.normpath(folder / map_reference))
    existing_map(folder, road)
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        _write(tables, folder, map_reference, parquet)
    except OSError as e:
        raise InputError(folder, f"cannot be written ({e.strerror})", "Name a folder you may write.") from e


def _write(tables: RecordingTables, folder: Path, map_reference: str | None, parquet: bool) -> None:
    """Write a folder beside, then put it in place."""
    beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        if map_reference is None:
            shutil.copyfile(tables.map, beside / tables.map.name)
        text = _settings(tables.settings, map_reference or tables.map.name)
        (beside / SETTINGS).write_text(text, encoding="utf-8", newline="\n")
        plan = None if tables.plan is None else tables.plan[list(PLAN_COLUMNS)]
        for name, table in (("gt", tables.gt), ("sd", tables.sd), ("plan", plan)):
            if table is not None and parquet:
                write_parquet(beside / f"{name}.parquet", table)
            elif table is not None:
                table.to_csv(beside / f"{name}.csv", index=False, lineterminator="\n", encoding="utf-8")
        beside.chmod(0o755)
        beside.replace(folder)
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _check_ego(folder: Path, path: Path, gt: pd.DataFrame, ego: str) -> None:
    known = gt["id"].unique().tolist()
    if ego not in known:
        problem = f"ego {ego!r} was not found in {path.name}, which holds {', '.join(known[:20])}"
        raise InputError(folder / SETTINGS, problem, "Name one of its objects.")


def _read_sensor_data(path: Path, gt: pd.DataFrame) -> pd.DataFrame:
    """The SD table; where it has `gt_id`, each object has one, which the ground truth knows."""
    frame = read_track_table(path)
    if GT_ID not in frame:
        return frame
    first = frame.groupby("id", sort=False)[GT_ID].transform("first")
    changed = frame[frame[GT_ID] != first]
    if len(changed):
        row = changed.index[0]
        what = f"{GT_ID} is {changed[GT_ID].iloc[0]!r}, the object's first row has {first.loc[row]!r}"
        remedy = "Give the track a new id where its identity changes."
        raise InputError(path, row_problem(frame, row, what), remedy)
    unknown = frame[(frame[GT_ID] != "") & ~frame[GT_ID].isin(gt["id"])]
    if len(unknown):
        what = f"{GT_ID} {unknown[GT_ID].iloc[0]!r} was not found in the ground truth"
        remedy = "Name a ground truth object or leave the field empty."
        raise InputError(path, row_problem(frame, unknown.index[0], what), remedy)
    return frame


def _read_plan(path: Path) -> pd.DataFrame:
    return read_table(path, required=PLAN_COLUMNS).reset_index(drop=True)


def _settings(settings: Settings, road: str) -> str:
    """The recording.toml, its fields in the order of the model."""
    fields = {
        "name": settings.name, "map": road, "ego": settings.ego,
        "build": settings.build, "build_hash": settings.build_hash,
        "gt_rate": settings.gt_rate, "sd_rate": settings.sd_rate,
    }  # fmt: skip
    environment = settings.environment.model_dump(by_alias=True, exclude_none=True)
    return settings_text(fields, {"environment": environment, "provenance": settings.provenance})
