"""What is doubtful of a drive is doubtful of its parts, and whom a moment is about is in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mining.planted import Drive, path_of, smooth, steady, tracks_of, write_motorway

from resim.core.errors import InputError
from resim.core.tracks import Tracks
from resim.jobs.augment import augment
from resim.jobs.check import check
from resim.jobs.mine import MineOptions, mine
from resim.mining.around import AroundOptions
from resim.recordings import Recording, read_recording, read_tables, write_recording
from resim.recordings.source import recording_of
from resim.road.opendrive import load


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """Behind a lane change an EGO; a car that stands beside the lanes' centres, and a pedestrian on a lane."""
    road = write_motorway(tmp_path / "motorway.xodr")
    path = path_of(load(road), "7", -2, 520.0, 360.0)
    change = Drive("b", lambda t: 40.0 + 15.0 * t, lambda t: smooth(t, 3.0, 5.0, 3.5), end=12.0)
    others = [
        Drive("stands", lambda t: 100.0 + 0.0 * t, end=12.0),
        Drive("walks", lambda t: 90.0 + 0.1 * t, end=12.0),
    ]
    gt = tracks_of(path, [Drive("a", steady(15.0), end=12.0), change, *others])
    kind = np.where(gt.ids == "walks", "pedestrian", gt.kind)
    sizes = {name: np.where(gt.ids == "walks", 0.6, getattr(gt, name)) for name in ("length", "width")}
    recording = Recording("drive", road, "a", replace(gt, kind=kind, **sizes), 25.0)
    write_recording(recording, tmp_path / "drive")
    return tmp_path / "drive"


def blanked(drive: Path, whom: str) -> None:
    table = pd.read_csv(drive / "gt.csv", dtype={"id": str})
    table.loc[table["id"] == whom, "v"] = np.nan
    table.to_csv(drive / "gt.csv", index=False)


def cut_out(drive: Path, out: Path, around: str | None = None) -> Recording:
    options = MineOptions(around=around and AroundOptions(around), fit=False, accept=("OVERLAP",))
    found = mine([drive], out, options)
    assert len(found.scenarios) >= 1
    return recording_of(read_tables(out / found.scenarios["folder"].iloc[0]), lenient=True)


@pytest.mark.parametrize("around", [None, "TTC"])
def test_rows_without_a_value_are_in_the_scenario_too(
    drive: Path, tmp_path: Path, around: str | None
) -> None:
    blanked(drive, "stands")
    found = cut_out(drive, tmp_path / "out", around)
    assert set(found.incomplete["gt"]["id"]) == {"stands"}
    assert len(found.incomplete["gt"]) == len(found.gt.t)


@pytest.mark.parametrize("around", [None, "TTC", "collision"])
def test_a_pedestrian_near_the_ego_is_in_the_scenario(
    drive: Path, tmp_path: Path, around: str | None
) -> None:
    assert "walks" in cut_out(drive, tmp_path / "out", around).gt.ids


def test_a_size_that_one_row_gives_is_told_of_the_part_too(drive: Path, tmp_path: Path) -> None:
    table = pd.read_csv(drive / "gt.csv", dtype={"id": str})
    table.loc[table.index[table["id"] == "b"][150], "length"] = 9.0
    table.to_csv(drive / "gt.csv", index=False)
    out = tmp_path / "out"
    found = mine([drive], out, MineOptions(fit=False, accept=("OVERLAP", "SIZE_CHANGES")))
    rows = pd.read_csv(out / found.scenarios["folder"].iloc[0] / "gt.csv", dtype={"id": str})
    assert rows.loc[rows["id"] == "b", "length"].max() == 9.0


def test_a_gap_of_the_ego_is_told_beside_the_scenario(drive: Path, tmp_path: Path) -> None:
    table = pd.read_csv(drive / "gt.csv", dtype={"id": str})
    table[(table["id"] != "a") | (table["t"] < 3.99) | (table["t"] > 5.51)].to_csv(
        drive / "gt.csv", index=False
    )
    out = tmp_path / "out"
    rows = mine([drive], out, MineOptions(fit=False, accept=("OVERLAP", "GAP"))).scenarios
    assert any("no sample for 1.56 s: it runs only with --accept GAP" in note for note in rows["note"])
    for folder, note in zip(rows["folder"], rows["note"], strict=True):
        codes = {f.code for f in check(out / folder).findings if f.severity == "error"}
        assert ("--accept GAP" in note) is ("GAP" in codes)


def test_nobody_varies_who_cannot_be_placed(drive: Path, tmp_path: Path) -> None:
    blanked(drive, "stands")
    with pytest.raises(InputError, match="rows lack a value"):
        augment(drive, tmp_path / "out", count=1)


def test_scenarios_of_ids_that_are_written_alike_are_apart(drive: Path, tmp_path: Path) -> None:
    whole = read_recording(drive)
    names = {"a": "x/1", "b": "x_1"}
    gt: Tracks = replace(whole.gt, ids=np.array([names.get(name, name) for name in whole.gt.ids.tolist()]))
    other = replace(whole, ego="x/1", gt=gt)
    write_recording(other, tmp_path / "r")
    write_recording(
        replace(other, ego="1", gt=replace(gt, ids=np.array(["1", "2", "3", "4"]))), tmp_path / "r_x"
    )
    found = mine([tmp_path / "r", tmp_path / "r_x"], tmp_path / "out", MineOptions(fit=False))
    rows = found.scenarios
    assert rows["scenario"].is_unique
    for folder, ego in zip(rows["folder"], rows["ego"], strict=True):
        assert read_recording(tmp_path / "out" / folder).ego == ego
