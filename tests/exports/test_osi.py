"""Drives as OSI and MCAP: what goes out comes in again, and other readers find in the files what the drive holds."""

from __future__ import annotations

import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from resim.core.errors import InputError
from resim.core.tracks import Tracks
from resim.jobs.export import export_drive, recorded_drive
from resim.recordings import Recording, read_recording
from resim.recordings.formats.osi import read_osi
from resim.recordings.source import recording_of
from resim.road.opendrive import load

pytest.importorskip("osi3")
pytest.importorskip("foxglove")
from exports.drives import MAP, assert_same, recordings
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from resim.exports import mcap, osi


def test_sensor_data_without_the_ego_in_some_lists_come_in_where_they_were(tmp_path: Path) -> None:
    """The EGO takes itself to be 1.5 m behind: lists that do not say so are seen from where it is."""
    t = np.arange(0.0, 5.9, 0.1)
    row = np.stack([90.0 + 20.0 * t, 50.0 + 20.0 * t])
    same = {"kind": np.array(["car", "car"]), "heading": 0.0 * row, "v": 0.0 * row + 20.0}
    sizes = {"length": np.array([4.5, 4.5]), "width": np.array([1.8, 1.8])}
    gt = Tracks(
        t=t,
        ids=np.array(["1", "ego"]),
        x=row,
        y=0.0 * row - 5.25,
        valid=np.ones(row.shape, bool),
        **same,
        **sizes,
    )
    there = np.ones(row.shape, dtype=bool)
    there[1, 3::5], there[1, 40:46] = False, False
    columns = {name: np.where(there, getattr(gt, name), np.nan) for name in ("x", "y", "heading", "v")}
    sd = replace(gt, **{**columns, "x": columns["x"] - 1.5}, valid=there)
    recording = Recording("r", MAP, "ego", gt, 10.0, sd=sd, sd_rate=10.0, sd_gt_id=np.array(["1", "ego"]))
    osi.write(recorded_drive(recording, load(MAP)), tmp_path)
    found = recording_of(
        read_osi(tmp_path / "GT.osi", map=MAP, ego="ego", sd=tmp_path / "SD.osi"), lenient=True
    ).sd
    assert found is not None
    np.testing.assert_allclose(found.t, t, atol=1e-9)
    np.testing.assert_allclose(found.x[found.index("1")], sd.x[0], atol=1e-6)
    assert found.valid[1 - found.index("1")].tolist() == there[1].tolist()


@pytest.mark.slow
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(recording=recordings(), form=st.sampled_from(["mcap", "osi"]))
def test_what_goes_out_comes_in_again(
    recording: Recording, form: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """States to 1e-6 m, times to 1e-9 s or what a clock of 1.7e9 s holds; what was not measured is not made up."""
    folder = tmp_path_factory.mktemp("out")
    drive = recorded_drive(recording, load(MAP))
    if form == "mcap":
        mcap.write(drive, folder)
        found = recording_of(read_osi(folder / "drive.mcap", ego=recording.ego))
        assert found.map.read_bytes() == MAP.read_bytes()
    else:
        osi.write(drive, folder)
        sd = folder / "SD.osi" if recording.sd is not None else None
        found = recording_of(read_osi(folder / "GT.osi", map=MAP, ego=recording.ego, sd=sd))
        found = Recording(**{**vars(found), "gt": without_derived(found.gt, recording.gt)})
    origin = float(recording.gt.t[0])
    assert_same(found.gt, recording.gt, origin)
    if recording.sd is None:
        assert found.sd is None
        return
    assert found.sd is not None
    true = recording.sd_by_gt() if recording.senses_ego else recording.sd_by_gt().without(recording.ego)
    ghosts = [name for name in true.ids.tolist() if name not in recording.gt.ids.tolist()]
    named = dict(zip(found.sd.ids.tolist(), found.sd_gt_id.tolist(), strict=True))
    assert sorted(n for n in named.values() if n) == sorted(set(true.ids.tolist()) - set(ghosts))
    assert sum(not n for n in named.values()) == len(ghosts)
    ids = np.array([named[name] or ghosts[0] for name in found.sd.ids.tolist()])
    assert_same(Tracks(**{**vars(found.sd), "ids": ids}), true, origin, recording.ego)


def without_derived(found: Tracks, true: Tracks) -> Tracks:
    """A trace has no place to say what is derived in it: a, yaw_rate and z are there in any case."""
    known = {name: getattr(true, name) for name in ("a", "yaw_rate", "z")}
    lost = {name: None for name, v in known.items() if v is None or np.isnan(v[true.valid]).any()}
    return Tracks(**{**vars(found), **lost})


@pytest.fixture(scope="module")
def exported(result: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("mcap") / "out"
    export_drive(result, folder, "mcap")
    return folder


def read(folder: Path) -> dict[str, list]:
    """All messages by topic, as mcap's own decoder reads them by the schemas in the file."""
    found: dict[str, list] = {}
    with (folder / "drive.mcap").open("rb") as file:
        for _, channel, message, told in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, told))
    return found


def test_one_file_holds_all_of_a_drive(result: Path, exported: Path) -> None:
    found = read(exported)
    sources = ("GT", "SD", "rGT", "rSD")
    worlds = {"ground_truth", "ground_truth_map", "sensor_data", "rGT", "rSD", "rGT+M0"}
    perceived = {f"perceived_{name}" for name in ("rGT", "rSD", "rGT+M0")}
    assert worlds | perceived | {"/map", "/tf", "/log"} <= set(found)
    assert {f"/{kind}/{name}" for kind in ("scene", "ego", "risk", "verdicts") for name in sources} <= set(
        found
    )
    judged = json.loads((result / "assessment.json").read_text(encoding="utf-8"))
    for name in sources:
        ((_, told),) = found[f"/verdicts/{name}"]
        assert told.verdict == judged[name]["verdict"]
        assert {c.criterion: c.verdict for c in told.criteria} == {
            k: c["verdict"] for k, c in judged[name]["criteria"].items()
        }
        risks = [math.nan if r is None else r for r in judged[name]["risk"]["r_ind"]]
        np.testing.assert_array_equal([one.risk for _, one in found[f"/risk/{name}"]], risks)
    ((_, told),) = found["/verdicts/drive"]
    assert told.decides == ", ".join(judged["decides"])
    worst = {judged[name]["verdict"] for name in judged["decides"]}
    assert told.verdict == next(v for v in ("FAIL", "INVALID", "PASS") if v in worst)
    assert {one.source: one.verdict for one in told.sources}["rGT+M"] == judged["rGT+M"]["verdict"]
    times = [t for rows in found.values() for t, _ in rows]
    assert min(times) == 0


def test_runs_with_a_model_are_among_their_traffic(exported: Path) -> None:
    found = read(exported)
    assert {one.id.value for one in found["rGT+M0"][0][1].update} == {
        one.id.value for one in found["rGT"][0][1].update
    }


def test_boxes_are_where_the_drive_has_them(exported: Path) -> None:
    """In the map's frame, once the drive's frame is where /tf puts it."""
    found, true = read(exported), read_recording(ROOT / "scenarios" / "cut_in_brake").gt
    fixed = next(t for _, told in found["/tf"] for t in told.transforms if t.child_frame_id == "drive")
    assert fixed.parent_frame_id == "map"
    for k, (_, told) in enumerate(found["/scene/GT"]):
        for entity in told.entities:
            if entity.id == "plan":
                continue
            n = true.index(entity.id)
            (box,) = entity.cubes
            at = box.pose.position
            assert (at.x + fixed.translation.x, at.y + fixed.translation.y) == pytest.approx(
                (true.x[n, k], true.y[n, k]), abs=1e-9
            )
            turned = 2.0 * math.atan2(box.pose.orientation.z, box.pose.orientation.w)
            assert turned == pytest.approx(true.heading[n, k], abs=1e-9)
            assert (box.size.x, box.size.y) == (true.length[n], true.width[n])


def test_who_vanishes_is_deleted_from_the_scene(tmp_path: Path) -> None:
    tracks = read_recording(ROOT / "scenarios" / "cut_in_brake").gt
    valid = tracks.valid.copy()
    valid[1, 5:] = False
    gone = {name: np.where(valid, getattr(tracks, name), np.nan) for name in ("x", "y", "heading", "v")}
    gt = Tracks(**{**vars(tracks), **gone, "valid": valid})
    mcap.write(
        recorded_drive(Recording(name="d", map=MAP, ego="ego", gt=gt, gt_rate=25.0), load(MAP)), tmp_path
    )
    told = [one for _, one in read(tmp_path)["/scene/GT"]]
    assert [[d.id for d in one.deletions] for one in told[:8]] == [[]] * 5 + [["1"]] + [[]] * 2
    assert [len(one.entities) for one in told[4:6]] == [2, 1]


@pytest.mark.parametrize("form", ["osi", "mcap", "foxglove"])
def test_the_same_drive_gives_the_same_bytes_as_osi(tmp_path: Path, form: str) -> None:
    for name in ("a", "b"):
        export_drive(ROOT / "scenarios" / "rear_end", tmp_path / name, form)
    files = {file.name for file in (tmp_path / "a").iterdir()}
    assert files == {file.name for file in (tmp_path / "b").iterdir()}
    for file in sorted(files):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes(), file


def test_a_layout_names_topics_that_are_there(tmp_path: Path) -> None:
    export_drive(ROOT / "scenarios" / "rear_end", tmp_path / "out", "foxglove")
    topics = set(read(tmp_path / "out"))
    panels = json.loads((tmp_path / "out" / "layout.json").read_text(encoding="utf-8"))["configById"]
    assert set(panels["3D!drive"]["topics"]) <= topics
    paths = [path["value"].partition(".")[0] for panel in panels.values() for path in panel.get("paths", [])]
    assert paths
    assert set(paths) <= topics


@pytest.mark.parametrize(
    ("form", "name"), [("osi", "GT.osi"), ("mcap", "drive.mcap"), ("osi", "export.json")]
)
def test_a_map_with_the_name_of_a_file_of_the_export_is_refused(tmp_path: Path, form: str, name: str) -> None:
    drive = tmp_path / "drive"
    shutil.copytree(ROOT / "scenarios" / "rear_end", drive)
    shutil.copy(MAP, drive / name)
    file = drive / "recording.toml"
    file.write_text(
        re.sub('map = ".*"', f'map = "{name}"', file.read_text(encoding="utf-8")), encoding="utf-8"
    )
    with pytest.raises(InputError, match="has the name of a file of the export"):
        export_drive(drive, tmp_path / "out", form)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "UTF-16", "UTF-8"])
def test_a_map_of_any_encoding_comes_back(tmp_path: Path, encoding: str) -> None:
    text = (
        MAP.read_text(encoding="utf-8").partition("?>")[2].replace('<road name="', '<road name="Straße ', 1)
    )
    road = tmp_path / "road.xodr"
    road.write_bytes(f'<?xml version="1.0" encoding="{encoding}"?>{text}'.encode(encoding))
    gt = read_recording(ROOT / "scenarios" / "cut_in_brake").gt
    drive = recorded_drive(Recording(name="d", map=road, ego="ego", gt=gt, gt_rate=25.0), load(road))
    mcap.write(drive, tmp_path)
    back = load(read_osi(tmp_path / "drive.mcap", ego="ego").map)
    names = [etree.parse(path).getroot().find("road").get("name") for path in (road, back.path)]
    assert names[0] == names[1]
    assert "Straße" in names[0]


def test_what_no_file_says_is_noted(tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    shutil.copytree(ROOT / "scenarios" / "rear_end", drive)
    shutil.copy(MAP, drive / "road.xodr")
    file = drive / "recording.toml"
    file.write_text(
        re.sub('map = ".*"', 'map = "road.xodr"', file.read_text(encoding="utf-8")), encoding="utf-8"
    )
    rows = pd.read_csv(drive / "gt.csv")
    rows.loc[(rows.id.astype(str) != "ego") & rows.t.between(1.0, 1.2), "v"] = np.nan
    rows.to_csv(drive / "gt.csv", index=False)
    lost = int(rows.v.isna().sum())
    report = export_drive(drive, tmp_path / "out", "osi", accept=["MISSING_VALUES"])
    assert f"GT: {lost} rows that lack a value are in no file" in report.notes
