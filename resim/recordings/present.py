"""Files of a recording, looked for before anything of them is read."""

from __future__ import annotations

import os
from pathlib import Path

from resim.core.errors import InputError
from resim.recordings.settings import SETTINGS, Settings, read_settings


def look_over(folder: Path) -> Settings:
    """Give the settings of a recording whose ground truth and map are there. Raises InputError."""
    settings = read_settings(folder / SETTINGS)
    existing_map(folder / SETTINGS, folder / settings.map)
    ground_truth(folder)
    return settings


def existing_map(source: Path, road: Path) -> Path:
    """Give the map file resolved; InputError against `source`, which names it, where there is none."""
    try:
        if road.is_file():
            return road.resolve()
    except OSError:  # a name no file system takes
        pass
    raise InputError(source, f"map: there is no file {road}", "Name an OpenDRIVE file that exists.")


def ground_truth(folder: Path) -> Path:
    """Give the file of the ground truth. Raises InputError where there is none, or there are two."""
    if (found := table_file(folder, "gt")) is None:
        raise InputError(folder, "holds neither gt.csv nor gt.parquet", "Put the ground truth there.")
    return found


def table_file(folder: Path, name: str) -> Path | None:
    """Give the CSV or Parquet file of that name, None where there is neither. Raises InputError for what is no file."""
    found = [path for end in ("csv", "parquet") if os.path.lexists(path := folder / f"{name}.{end}")]
    if len(found) > 1:
        raise InputError(folder, f"holds both {name}.csv and {name}.parquet", "Keep the right one.")
    if found and not found[0].is_file():
        problem = "is not a regular file but a folder, device, pipe or dangling link"
        raise InputError(found[0], problem, "Put the table itself there, or remove it.")
    return found[0] if found else None
