"""Argoverse 2: a known drive in its published columns comes back, and what is wrong in them is told."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings.mapped.strangers import MAP, _to_parquet, drive

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.recordings import RecordingTables, recording_of
from resim.recordings.formats.argoverse import read_argoverse
from resim.recordings.formats.argoverse_log import AHEAD, read_tracker
from resim.recordings.tables import read_parquet

FIRST = 315_966_253_660_357_000
"""ns, of the first annotation."""
STEP = 99_533_003
"""ns between annotations."""
needs_pyarrow = pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="needs pyarrow")


def scenario(folder: Path, **changed: Any) -> Path:
    """A scenario of motion forecasting."""
    truth = drive(steps=11)
    v = truth["v"] * np.exp(1j * truth["heading"])
    table = pd.DataFrame(
        {
            "observed": True, "track_id": truth["id"].replace("ego", "AV"),
            "object_type": truth["id"].map({"ego": "vehicle", "7": "bus", "8": "cyclist"}), "object_category": 1,
            "timestep": np.round(truth["t"] * 10).astype(int), "position_x": truth["x"], "position_y": truth["y"],
            "heading": truth["heading"], "velocity_x": v.to_numpy().real, "velocity_y": v.to_numpy().imag,
            "scenario_id": "0a1e", "start_timestamp": float(FIRST), "end_timestamp": float(FIRST + 10**9),
            "num_timestamps": 11, "focal_track_id": "7", "city": "austin",
        }
    )  # fmt: skip
    cone = table.iloc[[0]].assign(track_id="cone", object_type="construction")
    path = folder / "scenario_0a1e.parquet"
    _to_parquet(pd.concat([table, cone]).assign(**changed), path)
    return path


def read(path: Path, **more: Any) -> RecordingTables:
    return read_argoverse(path, map=MAP, **more)


def test_a_scenario_of_motion_forecasting_comes_back(tmp_path: Path) -> None:
    truth = drive(steps=11)
    found = read(scenario(tmp_path))
    gt = found.gt.sort_values(["t", "id"])
    told = truth.assign(id=truth["id"].replace("ego", "AV")).sort_values(["t", "id"])
    assert gt["id"].tolist() == told["id"].tolist()
    np.testing.assert_allclose(gt[["t", "x", "y", "v"]], told[["t", "x", "y", "v"]], atol=1e-9)
    assert np.abs(wrap_angle(gt["heading"].to_numpy() - told["heading"].to_numpy())).max() < 1e-9
    assert gt.drop_duplicates("id").set_index("id")["kind"].to_dict() == {
        "AV": "car",
        "7": "bus",
        "8": "bicycle",
    }
    assert found.settings.ego == "AV"
    assert found.settings.provenance["gt_left_out"] == "1 construction"
    assert "bus 12 x 2.55 m" in found.settings.provenance["gt_sizes"]
    assert found.sd is None
    assert recording_of(found).gt_rate == pytest.approx(10.0)


def test_the_folder_of_a_scenario_another_ego_and_a_window(tmp_path: Path) -> None:
    scenario(tmp_path)
    found = read(tmp_path, ego="7", start=0.2, end=0.6)
    assert found.settings.ego == "7"
    assert sorted(found.gt["t"].unique()) == [0.2, 0.3, 0.4, 0.5, 0.6]


def test_others_are_kept_where_the_ego_ends_early(tmp_path: Path) -> None:
    path = scenario(tmp_path)
    table = read_parquet(path)
    _to_parquet(table[(table["track_id"] != "AV") | (table["timestep"] < 6)], path)
    found = read(path)
    assert found.gt.groupby("id")["t"].max().to_dict() == {"AV": 0.5, "7": 1.0, "8": 1.0}
    assert "10 rows before 0 s or after 0.5 s" in found.settings.provenance["without_ego"]
    assert "without_ego" not in read(path, end=0.5).settings.provenance


@settings(deadline=None, max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(far=st.sampled_from([0.0, 1e6, -5.4e6]), heading=st.floats(-3.1, 3.1), v=st.floats(-5.0, 40.0))
def test_no_digit_is_lost(tmp_path: Path, far: float, heading: float, v: float) -> None:
    """At UTM's coordinates states are equal to 1e-6 m; times count from the first one, to 1e-9 s."""
    truth = drive(steps=11)
    moved = {"position_x": truth["x"] + far, "position_y": truth["y"] + 2.0 * far, "heading": heading}
    speed = {"velocity_x": v * np.cos(heading), "velocity_y": v * np.sin(heading)}
    whole = read_parquet(scenario(tmp_path))
    whole = whole[whole["track_id"] != "cone"].reset_index(drop=True).assign(**moved, **speed)
    _to_parquet(whole, tmp_path / "scenario_0a1e.parquet")
    gt = read(tmp_path).gt.sort_values(["t", "id"])
    told = truth.assign(id=truth["id"].replace("ego", "AV")).sort_values(["t", "id"])
    np.testing.assert_allclose(gt["t"], told["t"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(gt[["x", "y"]], told[["x", "y"]] + [far, 2.0 * far], rtol=0, atol=1e-6)
    np.testing.assert_allclose(gt[["heading", "v"]], [[heading, v]] * len(gt), rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"heading": "left"}, r"row 1: heading is 'left', expected a finite number"),
        ({"end_timestamp": float(FIRST)}, r"expected time steps 0\.1 s apart\. Download"),
        ({"num_timestamps": "many"}, r"num_timestamps are .*, many, expected time steps"),
        ({"heading": 1e9}, r"heading is 1e\+09, expected radians up to 10000"),
        ({"object_type": "static"}, r"has no road user, only static"),
        ({"timestep": 3}, r"ego 'AV' is present from 0.3 to 0.3 s"),
        ({"track_id": "1"}, r"ego 'AV' was not found.*It has 1\."),
    ],
)
def test_a_wrong_scenario_is_told(tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=r"scenario_0a1e\.parquet.*" + message):
        read(scenario(tmp_path, **changed))


def test_a_time_step_that_is_a_duplicate_is_told(tmp_path: Path) -> None:
    path = scenario(tmp_path)
    with pytest.raises(
        InputError, match=r"scenario_0a1e\.parquet.*a row with this time and object comes before it"
    ):
        read(scenario(tmp_path, timestep=read_parquet(path)["timestep"].replace(4, 5).to_numpy()))


def test_what_is_neither_log_nor_scenario_is_told(tmp_path: Path) -> None:
    (tmp_path / "map").mkdir()
    with pytest.raises(
        InputError, match=r"has neither annotations\.feather nor one scenario_\*\.parquet; it has map"
    ):
        read(tmp_path)
    (tmp_path / "a.csv").write_text("x")
    with pytest.raises(InputError, match=r"a\.csv: is neither the folder of a log nor a \.parquet file"):
        read(tmp_path / "a.csv")
    path = scenario(tmp_path)
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(InputError, match="is not a readable Parquet file"):
        read(path)
    with pytest.raises(InputError, match=r"t\.feather: is sensor data, but a scenario of motion forecasting"):
        read(scenario(tmp_path), sd=tmp_path / "t.feather")


def test_a_missing_pyarrow_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("annotations", "city_SE3_egovehicle"):
        (tmp_path / f"{name}.feather").write_bytes(b"ARROW1")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"Feather files need pyarrow\. In resim's own folder: pip install '\.\[argoverse\]'"
    ):
        read(tmp_path)


def feather(frame: pd.DataFrame, path: Path) -> Path:
    """Write as Argoverse does, in a process of its own, as pyarrow is no part of this one."""
    csv = path.with_suffix(".csv")
    frame.to_csv(csv, index=False, float_format="%.17g")
    code = "import sys, pandas; t = {'track_uuid': str, 'log_id': str}; pandas.read_csv(sys.argv[1], dtype=t, float_precision='round_trip').to_feather(sys.argv[2], compression='lz4')"  # noqa: E501
    subprocess.run([sys.executable, "-c", code, str(csv), str(path)], check=True)
    csv.unlink()
    return path


def turned(yaw: np.ndarray, roll: float = 0.0) -> dict[str, np.ndarray]:
    """Columns of the quaternions that first roll, then yaw."""
    half, lean = 0.5 * np.asarray(yaw), 0.5 * roll
    return {
        "qw": np.cos(half) * np.cos(lean),
        "qx": np.cos(half) * np.sin(lean),
        "qy": np.sin(half) * np.sin(lean),
        "qz": np.sin(half) * np.cos(lean),
    }


def log(folder: Path, steps: int = 12) -> tuple[Path, pd.DataFrame, pd.DataFrame]:
    """A log's folder, the drive, and its boxes in the AV's frame."""
    folder.mkdir()
    truth = drive(steps=steps)
    truth["stamp"] = FIRST + np.round(truth["t"] * 10).astype("int64") * STEP
    own = truth[truth["id"] == "ego"].set_index("stamp")
    axle = own["x"] + 1j * own["y"] - AHEAD * np.exp(1j * own["heading"])
    poses = pd.DataFrame(
        {
            "timestamp_ns": own.index,
            **turned(own["heading"].to_numpy()),
            "tx_m": axle.to_numpy().real,
            "ty_m": axle.to_numpy().imag,
            "tz_m": 60.0,
        }
    )
    between = poses.assign(timestamp_ns=poses["timestamp_ns"] + 5_000_000)  # poses come at many times
    feather(pd.concat([poses, between]).sort_values("timestamp_ns"), folder / "city_SE3_egovehicle.feather")
    rows = truth[truth["id"] != "ego"]
    heading = rows["stamp"].map(own["heading"])
    place = (rows["x"] + 1j * rows["y"] - rows["stamp"].map(axle)).to_numpy() * np.exp(
        -1j * heading.to_numpy()
    )
    boxes = pd.DataFrame(
        {
            "timestamp_ns": rows["stamp"], "track_uuid": "uuid-" + rows["id"],
            "category": rows["id"].map({"7": "BOX_TRUCK", "8": "REGULAR_VEHICLE"}), "length_m": rows["length"],
            "width_m": rows["width"], "height_m": 1.5, **turned((rows["heading"] - heading).to_numpy()),
            "tx_m": place.real, "ty_m": place.imag, "tz_m": 0.9, "num_interior_pts": 5,
        }
    )  # fmt: skip
    bollard = boxes.iloc[[0]].assign(track_uuid="b", category="BOLLARD")
    feather(pd.concat([boxes, bollard]), folder / "annotations.feather")
    return folder, truth, boxes


@needs_pyarrow
def test_a_sensor_log_comes_back_in_the_frame_of_the_city(tmp_path: Path) -> None:
    folder, truth, boxes = log(tmp_path / "7fab")
    shifted = boxes.assign(tx_m=boxes["tx_m"] + 0.5, score=0.8, track_uuid=boxes["track_uuid"].str[-1:])
    found = read(folder, sd=feather(shifted, tmp_path / "tracker.feather"))
    told = truth.assign(
        id=truth["id"].map({"ego": "AV", "7": "uuid-7", "8": "uuid-8"}), t=(truth["stamp"] - FIRST) / 1e9
    )
    gt, told = found.gt.sort_values(["t", "id"]), told.sort_values(["t", "id"])
    assert gt["id"].tolist() == told["id"].tolist()
    np.testing.assert_allclose(gt["t"], told["t"], atol=1e-9)
    np.testing.assert_allclose(gt[["x", "y"]], told[["x", "y"]], atol=1e-6)
    np.testing.assert_allclose(gt["heading"], told["heading"], atol=1e-9)
    np.testing.assert_allclose(gt["v"], told["v"], rtol=0.01)  # annotations have none, and steps are 0.0995 s
    assert gt.drop_duplicates("id").set_index("id")["kind"].to_dict() == {
        "AV": "car",
        "uuid-7": "truck",
        "uuid-8": "car",
    }
    assert gt["z"].tolist() == pytest.approx([60.0 if n == "AV" else 60.15 for n in gt["id"]])
    assert found.settings.provenance["gt_left_out"] == "1 BOLLARD"
    assert found.sd is not None
    assert found.sd.groupby("id")["gt_id"].first().to_dict() == {"7": "uuid-7", "8": "uuid-8"}
    assert set(found.sd["existence_probability"]) == {0.8}
    assert "0.50 m ahead" in found.settings.provenance["sd_bias"]


@needs_pyarrow
def test_a_pose_that_is_no_rotation_is_told_with_its_file(tmp_path: Path) -> None:
    folder, _, boxes = log(tmp_path / "7fab", steps=4)
    file = folder / "city_SE3_egovehicle.feather"
    poses = pd.read_feather(file)
    stamp = int(boxes["timestamp_ns"].iloc[0])
    poses.loc[poses["timestamp_ns"] == stamp, "qw"] = 3.0
    feather(poses, file)
    with pytest.raises(InputError) as told:
        read(folder)
    assert str(told.value).startswith(f"{file}: at {stamp} ns: the quaternion has length 3")


@needs_pyarrow
@pytest.mark.slow
def test_boxes_of_a_tracker_may_come_in_any_order(tmp_path: Path) -> None:
    folder, _, boxes = log(tmp_path / "7fab")
    found = [
        read(folder, sd=feather(table, tmp_path / "tracker.feather")).sd
        for table in (boxes.sort_values("timestamp_ns"), boxes.sort_values("track_uuid"))
    ]
    assert all(one is not None and one["t"].is_monotonic_increasing for one in found)
    ordered = [one.sort_values(["t", "id"]).reset_index(drop=True) for one in found if one is not None]
    pd.testing.assert_frame_equal(*ordered)


@needs_pyarrow
@pytest.mark.slow
def test_a_wrong_tracker_is_told(tmp_path: Path) -> None:
    folder, _, boxes = log(tmp_path / "7fab", steps=4)
    tracker = tmp_path / "tracker.feather"

    def told(table: pd.DataFrame) -> str:
        with pytest.raises(InputError) as e:
            read_tracker(feather(table, tracker), folder, FIRST)
        assert str(e.value).startswith(f"{tracker}: ")
        return str(e.value)

    assert "row 1: the quaternion has length 3" in told(boxes.assign(qw=3.0))
    assert "row 1: length_m is 0, expected a number" in told(boxes.assign(length_m=0))
    assert "row 1: tx_m is nan, expected a number" in told(boxes.assign(tx_m=np.nan))
    assert "row 1: at 5 ns the log has no pose of the AV" in told(boxes.assign(timestamp_ns=5))
    assert "has no road user, only 2 SIGN" in told(boxes.assign(category="SIGN"))
    assert "has no row with log_id '7fab'; it has another" in told(boxes.assign(log_id="another"))
    assert "has no column qx; it has timestamp_ns" in told(boxes.drop(columns="qx"))
    tracker.write_bytes(tracker.read_bytes()[:100])
    with pytest.raises(
        InputError, match=r"tracker\.feather: is damaged or incomplete, or no Feather file \(Arrow"
    ):
        read_tracker(tracker, folder, FIRST)


@needs_pyarrow
def test_numbers_that_no_measurement_has_are_named(tmp_path: Path) -> None:
    folder, _, boxes = log(tmp_path / "7fab", steps=4)
    for column in ("qw", "tx_m"):
        feather(boxes.assign(**{column: 1e300}), folder / "annotations.feather")
        with pytest.raises(InputError, match=rf"row 1: {column} is 1e\+300, expected a number up to"):
            read(folder)
