"""The files of a study's scenarios: recordings, the maps that they refer to, and JSCEN files, fitted on any process.

A JSCEN file follows from the scenario's recording as it is written, so that it is the same whoever fits it, and when.
It is written whole or not at all: what a call that was killed left behind is kept.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.errors import ResimError
from resim.core.objects import GAP
from resim.core.tracks import Tracks
from resim.mining.cutting import CutSource, cut, write_cut, write_described
from resim.mining.extraction import ExtractedScenario
from resim.mining.slots import map_folder
from resim.recordings import read_recording
from resim.road.opendrive import load

FILES = ("folder", "jscen", "note")
"""Columns of scenarios.parquet that say where a scenario is, and what is to be known of it."""
ENDING = ".jscen.json"
JOINT = "+"
"""Between recording, EGO and number in a scenario's name; in neither of them."""


@dataclass(frozen=True)
class FitTask:
    """A scenario to be fitted.

    Attributes:
        folder: Its recording.
        file: The JSCEN file to be written.
    """

    folder: Path
    file: Path


def fit_scenario(task: FitTask) -> str:
    """Fit a scenario and write it as JSCEN; gives "", or why it cannot be fitted."""
    try:
        scenario = read_recording(task.folder)
        write_described(scenario, load(scenario.map), task.file)
    except ResimError as e:
        return str(e)
    return ""


def write_scenarios(
    source: CutSource, scenarios: list[ExtractedScenario], frame: pd.DataFrame, out: Path, *, fit: bool
) -> pd.DataFrame:
    """Write scenarios as recordings; gives their table (frame, with their names) with FILES.

    fit: whether the table says where JSCEN files are to be, which are still to be written.
    """
    road = map_beside(source.recording.map, out)
    rows = []
    for one, name in zip(scenarios, frame["scenario"].tolist(), strict=True):
        labels = ", ".join(dict.fromkeys(m.label for m in one.triggers))
        try:
            write_cut(cut(source, one, name, labels), out / "recordings" / name, road)
        except ResimError as e:
            rows.append(("", "", str(e)))
        else:
            file = f"maps/{road.parent.name}/{name}{ENDING}" if fit else ""
            rows.append((f"recordings/{name}", file, _note(source.recording.gt, one)))
    columns = dict(zip(FILES, zip(*rows, strict=True) if rows else ((), (), ()), strict=True))
    return frame.assign(**{name: list(values) for name, values in columns.items()}).astype(
        dict.fromkeys(FILES, "string")
    )


def _note(gt: Tracks, one: ExtractedScenario) -> str:
    """What is to be said of a window in which the EGO is not all the time."""
    notes = []
    if (one.start, one.end) != (one.ego_start, one.ego_end):
        notes.append("the window is longer than the EGO's life: the recording is the part with the EGO")
    own = slice(one.ego_start, one.ego_end + 1)
    if (widest := float(np.diff(gt.t[own][gt.valid[one.ego, own]]).max())) > GAP + TICK:
        notes.append(f"the EGO has no sample for {widest:.2f} s: it runs only with --accept GAP")
    return "; ".join(notes)


def fit_tasks(frame: pd.DataFrame, out: Path) -> list[FitTask]:
    """Give what is still to be fitted of a table of scenarios."""
    pairs = zip(*(frame[name].fillna("").tolist() for name in ("folder", "jscen")), strict=True)
    return [
        FitTask(out / folder, out / file) for folder, file in pairs if file and not (out / file).is_file()
    ]


def with_fits(frame: pd.DataFrame, out: Path, told: dict[str, str]) -> pd.DataFrame:
    """Give a table of scenarios with the JSCEN files that there are. told: why there is none, by the file's name."""
    names, notes = (frame[name].fillna("").tolist() for name in ("jscen", "note"))
    files = [file if file and (out / file).is_file() else "" for file in names]
    why = [
        "; ".join(text for text in (told.get(Path(file).name), note) if text)
        for file, note in zip(names, notes, strict=True)
    ]
    return frame.assign(jscen=files, note=why).astype(dict.fromkeys(FILES, "string"))


def map_beside(road: Path, out: Path) -> Path:
    """Give the study's copy of a map, made at need: maps of one name and other content are told apart."""
    folder = out / "maps" / map_folder(road)
    copy = folder / road.name
    if not copy.is_file():
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(road, folder / f".{road.name}")
        (folder / f".{road.name}").replace(copy)
    return copy


def forget_scenarios(out: Path, recording: str) -> None:
    """Delete the scenarios that were cut out of a recording of this name, first their JSCEN files."""
    for old in (out / "recordings").glob(f"{recording}{JOINT}*{JOINT}*"):
        if old.is_dir() and _is_of(old, recording):
            for file in (out / "maps").glob(f"*/{old.name}{ENDING}"):
                file.unlink()
            shutil.rmtree(old)


def _is_of(folder: Path, recording: str) -> bool:
    """Whether a scenario's folder was cut out of a recording of this name."""
    settings = folder / "recording.toml"
    return settings.is_file() and f'mined_from = "{recording}"' in settings.read_text("utf-8")
