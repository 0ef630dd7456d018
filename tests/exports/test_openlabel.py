"""Labels hold what the drive holds, and a published checker finds nothing wrong with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import DATA, ROOT
from exports.drives import MAP, assert_same, recordings
from hypothesis import HealthCheck, given, settings

from resim.core.errors import InputError
from resim.core.tracks import Tracks
from resim.exports.openlabel import labels
from resim.jobs.export import export_drive, recorded_drive
from resim.recordings import Recording, read_commonroad, read_recording
from resim.road.opendrive import load

core = pytest.importorskip("openlabel_checker.core")

TYPES = {
    "VehicleCar": "car", "VehicleTruck": "truck", "VehicleBus": "bus", "VehicleCycle": "bicycle",
    "HumanPedestrian": "pedestrian", "RoadUser": "unknown",
}  # fmt: skip


def issues(file: Path) -> list[str]:
    """What the checker says."""
    return [issue.message for issue in core.check_file(str(file)).issues]


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=40)
@given(recording=recordings())
def test_what_goes_out_is_read_as_it_was(recording: Recording) -> None:
    """States to 1e-6 m, and times to what a number of 64 bits holds, as somebody reads them who has the file alone."""
    drive = recorded_drive(recording, load(MAP))
    for layer in drive.layers:
        told = json.loads(json.dumps(labels(layer, drive)))["openlabel"]
        true = layer.tracks
        lacks = {name for name in ("z",) if true.z is None or np.isnan(true.z[true.valid]).any()}
        found = tracks_of(told)
        assert_same(Tracks(**{**vars(found), **dict.fromkeys(lacks)}), true, 0.0)


def tracks_of(told: dict[str, Any]) -> Tracks:
    """What labels say of everybody."""
    uids, frames = [*told["objects"]], [told["frames"][str(k)] for k in range(len(told["frames"]))]
    boxes = np.full((len(uids), len(frames), 10), np.nan)
    more: dict[str, np.ndarray] = {}
    for k, frame in enumerate(frames):
        for uid, one in frame["objects"].items():
            data = one["object_data"]
            boxes[uids.index(uid), k, :9] = data["cuboid"][0]["val"]
            for number in data["num"]:
                column = more.setdefault(number["name"], np.full(boxes.shape[:2], np.nan))
                column[uids.index(uid), k] = number["val"]
    objects = [told["objects"][uid] for uid in uids]
    for row, one in zip(boxes, objects, strict=True):
        inside = np.zeros(len(frames), dtype=bool)
        for span in one["frame_intervals"]:
            inside[span["frame_start"] : span["frame_end"] + 1] = True
        np.testing.assert_array_equal(inside, ~np.isnan(row[:, 0]))
    return Tracks(
        t=np.array([float(frame["frame_properties"]["timestamp"]) for frame in frames]),
        ids=np.array([one["name"] for one in objects]), kind=np.array([TYPES[one["type"]] for one in objects]),
        x=boxes[..., 0], y=boxes[..., 1], z=boxes[..., 2] - 0.5 * boxes[..., 8], heading=boxes[..., 5],
        length=np.nanmax(boxes[..., 6], axis=1), width=np.nanmax(boxes[..., 7], axis=1),
        valid=~np.isnan(boxes[..., 0]), v=more.pop("v"), **more,
    )  # fmt: skip


def test_a_result_is_labelled(result: Path, tmp_path: Path) -> None:
    report = export_drive(result, tmp_path / "out", "openlabel")
    assert {"GT", "SD", "rGT", "rSD", "rGT+M0", "perceived rGT"} <= set(report.sources)
    for name in report.sources.values():
        assert issues(tmp_path / "out" / name) == [], name
    told = json.loads((tmp_path / "out" / "rGT.openlabel.json").read_text(encoding="utf-8"))["openlabel"]
    judged = json.loads((result / "assessment.json").read_text(encoding="utf-8"))["rGT"]
    (verdict,) = [tag["tag_data"] for tag in told["tags"].values() if tag["type"] == "Verdict"]
    assert verdict == judged["verdict"]
    events = {event["type"] for event in told["events"].values()}
    assert {"MotionDecelerate", "Criterion"} <= events


def test_objects_are_where_the_drive_has_them(tmp_path: Path) -> None:
    folder = ROOT / "scenarios" / "cut_in_brake"
    export_drive(folder, tmp_path / "out", "openlabel")
    told = json.loads((tmp_path / "out" / "GT.openlabel.json").read_text(encoding="utf-8"))["openlabel"]
    true = read_recording(folder).gt
    assert len(told["frames"]) == len(true.t)
    for uid, one in told["objects"].items():
        n = true.index(one["name"])
        assert one["type"] == "VehicleCar"
        for k, frame in told["frames"].items():
            (box,) = frame["objects"][uid]["object_data"]["cuboid"]
            x, y, _, _, _, heading, length, width, _ = box["val"]
            row = [
                true.x[n, int(k)],
                true.y[n, int(k)],
                true.heading[n, int(k)],
                true.length[n],
                true.width[n],
            ]
            assert [x, y, heading, length, width] == pytest.approx(row, abs=1e-12)
            assert float(frame["frame_properties"]["timestamp"]) == pytest.approx(true.t[int(k)], abs=1e-9)


def test_maneuvers_are_actions(tmp_path: Path) -> None:
    """The corner case: the other one changes from the left lane to the EGO's, and brakes; SD is not looked at."""
    export_drive(ROOT / "scenarios" / "cut_in_brake", tmp_path / "out", "openlabel")
    assert issues(tmp_path / "out" / "GT.openlabel.json") == []
    told, seen = (
        json.loads((tmp_path / "out" / f"{name}.openlabel.json").read_text(encoding="utf-8"))["openlabel"]
        for name in ("GT", "SD")
    )
    assert "actions" not in seen
    (change,) = [one for one in told["actions"].values() if one["type"] == "lane_change_right"]
    (who,) = [one["val"] for one in change["action_data"]["text"] if one["name"] == "object"]
    assert told["objects"][who]["name"] == "1"
    (span,) = change["frame_intervals"]
    begin, end = (
        told["frames"][str(span[name])]["frame_properties"]["timestamp"]
        for name in ("frame_start", "frame_end")
    )
    gt = read_recording(ROOT / "scenarios" / "cut_in_brake").gt
    y = np.interp([float(begin), float(end)], gt.t, gt.y[gt.index("1")])
    assert y == pytest.approx([-1.75, -5.25], abs=0.2)  # from lane centre to lane centre


def test_labels_of_ones_own_are_actions_too(tmp_path: Path) -> None:
    drive, out = ROOT / "scenarios" / "cut_in_brake", tmp_path / "out"
    file = tmp_path / "labels.toml"
    file.write_text('[[label]]\nname = "mine"\nfunction = "own:find"\n')
    head = (
        "import os\nfrom resim.mining.maneuver import LabelledManeuver as M\ndef find(features, found):\n    "
    )
    (tmp_path / "own.py").write_text(f"{head}return [M('mine', 0, 0, 10, 0)]\n")
    export_drive(drive, out, "openlabel", labels=file)
    assert issues(out / "GT.openlabel.json") == []
    told = json.loads((out / "GT.openlabel.json").read_text(encoding="utf-8"))["openlabel"]
    assert {"mine", "lane_change_right"} <= {one["type"] for one in told["actions"].values()}
    before = (out / "GT.openlabel.json").read_bytes()
    (tmp_path / "own.py").write_text(f"{head}os._exit(0)\n")
    with pytest.raises(InputError, match=r"labels\.toml: its labels could not be found: .*ended its process"):
        export_drive(drive, out, "openlabel", labels=file)
    assert (out / "GT.openlabel.json").read_bytes() == before


def test_who_comes_and_goes_is_in_the_frames_in_which_it_is_there(tmp_path: Path) -> None:
    true = read_recording(ROOT / "scenarios" / "cut_in_brake").gt
    valid = true.valid.copy()
    valid[1, :3] = valid[1, 7:9] = valid[1, 20:] = False
    gone = {name: np.where(valid, getattr(true, name), np.nan) for name in ("x", "y", "heading", "v")}
    gt = Tracks(**{**vars(true), **gone, "valid": valid})
    drive = recorded_drive(Recording(name="d", map=MAP, ego="ego", gt=gt, gt_rate=25.0), load(MAP))
    told = labels(drive.layers[0], drive)
    spans = {one["name"]: one["frame_intervals"] for one in told["openlabel"]["objects"].values()}
    assert [(s["frame_start"], s["frame_end"]) for s in spans["1"]] == [(3, 6), (9, 19)]
    assert [(s["frame_start"], s["frame_end"]) for s in spans["ego"]] == [(0, len(true.t) - 1)]
    file = tmp_path / "x.json"
    file.write_text(json.dumps(told), encoding="utf-8")
    assert issues(file) == []


@pytest.mark.skipif(not (DATA / "ngsim").is_dir(), reason="needs ../shared/data")
def test_real_traffic_is_labelled(tmp_path: Path) -> None:
    source = DATA / "ngsim" / "USA_US101-22_1_T-1.xml"
    recording = read_commonroad(source, map=source.with_suffix(".xodr"), ego="636")
    drive = recorded_drive(recording, load(recording.map))
    told = labels(drive.layers[0], drive)
    assert len(told["openlabel"]["objects"]) == len(recording.gt.joined())
    file = tmp_path / "x.json"
    file.write_text(json.dumps(told), encoding="utf-8")
    assert issues(file) == []
