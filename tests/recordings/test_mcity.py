"""The Mcity trials: units, frames and identities of the data; and what a trial leaves open reaches the judge."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recordings.mapped.strangers import MAP, geographic
from recordings.mapped.test_judged import T, beside, ego, rows, until, verdicts
from recordings.mercator import transverse_mercator

from resim.core.errors import InputError
from resim.core.geometry import to_frame, wrap_angle
from resim.recordings import Recording, read_recording, read_tables, recording_of, write_tables
from resim.recordings.checked import load_checked
from resim.recordings.checks import CODES
from resim.recordings.formats import mcity
from resim.recordings.formats.mcity_frames import trials
from resim.road.opendrive import load

ORIGIN = {"latitude_0": 42.3005934157, "longitude_0": -83.699283188811}


# latitude, longitude, x, y of pyproj 3.7.2 with the geoReference of mcity.xodr
PROJ = np.array(
    [
        (42.3005934157, -83.699283188811, 0.0, 0.0),
        (42.300947, -83.698649, 52.294724, 39.27603),
        (42.30133359571716, -83.69875622161985, 43.453045, 82.218688),
        (42.2915, -83.7105, -925.06791, -1010.026914),
        (42.3098, -83.6871, 1004.475675, 1022.732029),
        (42.4, -83.5, 16406.961467, 11061.332212),
    ]
)


def test_projection_agrees_with_proj() -> None:
    x, y = transverse_mercator(PROJ[:, 0], PROJ[:, 1], **ORIGIN)
    np.testing.assert_allclose(np.column_stack([x, y]), PROJ[:, 2:], atol=2e-6)


# trial: ids of the EGO, EGO samples seen, frames in the wrong order. Of trial 5 an id of 0.9 x 0.4 m is nobody's.
EXPECTED = {"3": (1, 161, 2), "4": (1, 98, 0), "5": (2, 167, 1), "11": (2, 596, 2)}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Recording]:
    data = Path(__file__).parents[2].parent / "shared" / "data" / "mcity"
    if not data.is_dir():
        pytest.skip("the shared data are not on this machine")
    out = tmp_path_factory.mktemp("mcity")
    for trial in EXPECTED:
        write_tables(mcity.read_mcity(data, trial=trial), out / trial)
    return {trial: read_recording(out / trial) for trial in EXPECTED}


@pytest.mark.parametrize("trial", EXPECTED)
def test_trials_are_recordings_whose_sensor_is_off_by_its_known_error(
    recordings: dict[str, Recording], trial: str
) -> None:
    recording = recordings[trial]
    assert recording.sd is not None
    assert recording.sd_gt_id is not None
    ids, samples, swapped = EXPECTED[trial]
    assert (recording.sd_gt_id == recording.ego).sum() == ids
    assert recording.provenance["frames_put_in_order"] == str(swapped)
    merged = recording.sd_by_gt()
    assert merged is not None
    seen = merged.select([recording.ego])
    truth = recording.gt.at(seen.t)
    error = np.hypot(seen.x - truth.x, seen.y - truth.y)
    assert 0.95 * samples <= np.isfinite(error).sum() <= samples
    assert 0.55 < np.nanmedian(error) < 1.1
    assert recording.gt.t[0] == 0.0
    assert recording.gt_rate == pytest.approx(10.0 if trial == "11" else 50.0, rel=0.01)


@pytest.mark.parametrize("trial", ["3", "4", "5"])
def test_units_and_angles_of_the_perceived_vehicle(recordings: dict[str, Recording], trial: str) -> None:
    recording = recordings[trial]
    merged = recording.sd_by_gt()
    assert merged is not None
    seen = merged.select([recording.ego])
    truth = recording.gt.at(seen.t)
    moving = seen.valid & truth.valid & (truth.v > 2.0)
    assert np.abs(np.median(wrap_angle(seen.heading - truth.heading)[moving])) < np.radians(5.0)
    assert np.median(seen.v[moving] / truth.v[moving]) == pytest.approx(1.0, abs=0.05)
    assert seen.kind.tolist() == ["car"]
    assert 4.5 < seen.length[0] < 5.5


def test_truth_heading_follows_the_path_and_speed_its_length(recordings: dict[str, Recording]) -> None:
    gt = recordings["3"].gt
    dx, dy = to_frame(gt.x[0, 10:], gt.y[0, 10:], gt.x[0, :-10], gt.y[0, :-10], gt.heading[0, 5:-5])
    fast = gt.v[0, 5:-5] > 2.0
    assert np.abs(np.arctan2(dy, dx)[fast]).max() < np.radians(2.0)
    driven = np.hypot(np.diff(gt.x[0]), np.diff(gt.y[0]))[gt.v[0, 1:] > 2.0].sum()
    assert (gt.v[0, 1:] * np.diff(gt.t))[gt.v[0, 1:] > 2.0].sum() == pytest.approx(driven, rel=0.005)
    standing = gt.v[0] < 0.3
    assert standing.any()
    assert len(np.unique(gt.heading[0, : np.argmin(standing)])) == 1


def test_refuses_data_that_are_not_there_or_no_frames(data: Path, tmp_path: Path) -> None:
    network = load(data / "mcity" / "mcity.xodr")
    with pytest.raises(InputError, match=r"holds no truth \(gts/\*\.json\)"):
        mcity.import_trial("3", tmp_path, network)
    (tmp_path / "gts").mkdir()
    (tmp_path / "gts" / "gps_data_3.json").write_text(json.dumps([{"time": 1}]))
    with pytest.raises(InputError, match=r"gps_data_3\.json: is not a list of frames"):
        mcity.import_trial("3", tmp_path, network)
    with pytest.raises(InputError, match=r"holds no trial '7'"):
        mcity.import_trial("7", data / "mcity", network)


@pytest.mark.parametrize("how", ["ids", "files", "one id"])
def test_two_tracked_vehicles_are_each_found_in_what_was_perceived(
    data: Path, tmp_path: Path, how: str
) -> None:
    """Trials 3 and 5 laid onto one clock, in the ways in which two vehicles may stand in the truth."""
    folder = data / "mcity"

    def frames(name: str, later: float = 0.0) -> list[dict]:
        read = json.loads((folder / name).read_text())
        return [{**f, "timestamp": f["timestamp"] + later} for f in read]

    one, seen = frames("gts/gps_data_3.json"), frames("dets/detection_3.json")
    later = one[0]["timestamp"] - frames("gts/gps_data_5.json")[0]["timestamp"]
    two, more = frames("gts/gps_data_5.json", later), frames("dets/detection_5.json", later)
    for frame in more:
        frame["objs"] = [{**o, "id": f"5{o['id']}"} for o in frame["objs"]]
    for frame in two:
        frame["objs"] = [{**o, "id": 0 if how == "one id" else 1} for o in frame["objs"]]
    if how != "files":  # in the frames of the first, at the same index
        one = [{**f, "objs": f["objs"] + (two[k]["objs"] if k < len(two) else [])} for k, f in enumerate(one)]
    (tmp_path / "gts").mkdir()
    (tmp_path / "dets").mkdir()
    (tmp_path / "gts" / "run_a.json").write_text(json.dumps(one))
    if how == "files":
        (tmp_path / "gts" / "run_b.json").write_text(json.dumps(two))
    every = sorted(seen + more, key=lambda f: f["timestamp"])
    (tmp_path / "dets" / "run_17.json").write_text(json.dumps(every))
    network = load(folder / "mcity.xodr")
    assert list(trials(tmp_path)) == ["17"]
    recording = recording_of(mcity.import_trial("17", tmp_path, network))
    assert recording.ego == "vehicle_1"  # there for 28 s, the other for 22 s
    assert recording.gt.ids.tolist() == ["vehicle_1", "vehicle_2"]
    assert recording.sd is not None
    assert recording.sd_gt_id is not None
    own = {n: recording.sd.ids[recording.sd_gt_id == n].tolist() for n in recording.gt.ids.tolist()}
    assert [len(found) for found in own.values()] == [1, 3]  # the EGO's of one, and all of another
    assert all(name.startswith("5") for name in own["vehicle_2"])
    assert not own["vehicle_1"][0].startswith("57")


def test_a_trial_has_to_be_named_and_its_window_begins_at_zero(data: Path) -> None:
    folder = data / "mcity"
    with pytest.raises(InputError, match=r"holds the trials 3, 4, 5, 11. Name one with --trial"):
        mcity.read_mcity(folder)
    with pytest.raises(InputError, match=r"trial 3 has no object 'tram' in its truth. It has vehicle"):
        mcity.read_mcity(folder, trial="3", ego="tram")
    with pytest.raises(InputError, match=r"lasts 28 s, the requested window is 5 to 99 s"):
        mcity.read_mcity(folder, trial="3", start=5.0, end=99.0)
    with pytest.raises(InputError, match=r"--length: 0 m is not the size"):
        mcity.read_mcity(folder, trial="3", length=0.0)
    whole, part = (
        recording_of(mcity.read_mcity(folder, trial="3", **window))
        for window in ({}, {"start": 5.0, "end": 9.0})
    )
    assert part.gt.t[[0, -1]] == pytest.approx([0.0, 4.0], abs=0.025)
    np.testing.assert_array_equal(part.gt.x[0, 0], whole.gt.x[0, np.argmax(whole.gt.t >= 5.0)])


def told(tables: list[pd.DataFrame]) -> list[dict]:
    """Rows as the data's frames have them, with the kind's class."""
    table = pd.concat(tables)
    table["lat"], table["lon"] = geographic(table["x"].to_numpy(), table["y"].to_numpy())
    classes = {"car": "2", "pedestrian": "10", "unknown": "77"}
    frames: dict[float, list[dict]] = {}
    for row in table.itertuples():
        seen = {
            "rotation": row.heading - np.pi,
            "speed": 3.6 * row.v,
            "length": row.length,
            "width": row.width,
        }
        place = {"id": row.id, "lat": row.lat, "lon": row.lon, "classType": classes[row.kind]}
        frames.setdefault(row.t, []).append(place | seen)
    return [{"timestamp": 1.7e9 + t, "objs": objects} for t, objects in sorted(frames.items())]


def judged(
    folder: Path, truth: list[pd.DataFrame], seen: list[pd.DataFrame], **window: float
) -> dict[str, str]:
    """The verdict of `no collision` for each source of a trial."""
    for name, tables in (("gts/t1.json", truth), ("dets/d1.json", seen)):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(json.dumps(told(tables)))
    write_tables(
        mcity.read_mcity(folder, map=MAP, length=4.7, width=1.9, ego="vehicle_1", **window), folder / "rec"
    )
    return verdicts(folder / "rec", tuple(CODES))


def leader() -> pd.DataFrame:
    """A slow car, whom the EGO hits at 4.88 s."""
    return rows("7", 392.0 + 2.0 * T, v=2.0)


def test_a_perception_that_goes_on_after_the_truth_makes_the_truth_invalid(tmp_path: Path) -> None:
    truth = [until(ego(), 4.6), until(leader(), 4.6)]
    found = judged(tmp_path, truth, [ego().assign(id="e"), leader()])
    assert found == {"GT": "INVALID", "SD": "FAIL"}


def test_a_truth_of_others_that_goes_on_makes_it_invalid_and_a_window_cuts_it(tmp_path: Path) -> None:
    truth, seen = [until(ego(), 4.6), leader()], [until(ego(), 4.6).assign(id="e"), until(leader(), 4.6)]
    assert judged(tmp_path, truth, seen)["GT"] == "INVALID"
    (tmp_path / "rec").rename(tmp_path / "whole")
    assert judged(tmp_path, truth, seen, start=0.0, end=4.5) == {"GT": "PASS", "SD": "PASS"}


def test_sizes_and_classes_stay_as_each_row_has_them(tmp_path: Path) -> None:
    """A lorry beside the lane that is 12 m long in 45 % of the rows, and a pedestrian in some."""
    often = np.arange(len(T)) % 20 < 9
    lorry = rows("1", 400.0, -9.75, heading=0.5 * np.pi, length=np.where(often, 12.0, 4.7), width=2.5)
    lorry = lorry.assign(kind=np.where(T < 0.3, "pedestrian", "car"))
    two = [ego(), rows("2", 450.0 + 20.0 * T, -1.75, v=20.0)]
    found = judged(tmp_path, two, [ego().assign(id="e"), lorry])
    assert found == {"GT": "PASS", "SD": "FAIL"}
    sd = read_tables(tmp_path / "rec").sd
    assert sd is not None
    own = sd[sd["id"] == "1"]
    assert own["length"].tolist() == lorry["length"].tolist()
    assert own["kind"].tolist() == lorry["kind"].tolist()
    codes = {(f.code, f.object) for f in load_checked(tmp_path / "rec", accept=tuple(CODES)).findings}
    assert ("SIZE_CHANGES", "1") in codes


def test_a_class_of_one_row_makes_no_pedestrian_of_a_car_in_the_truth(tmp_path: Path) -> None:
    """The EGO touches the car in passing, which it would not touch if that were half a metre wide."""
    car = rows("1", 400.0, -5.25 + 1.5)
    car = car.assign(kind=np.where(T == 0.0, "pedestrian", "car"))
    found = judged(tmp_path, [ego(), car], [ego().assign(id="e")])
    assert found["GT"] != "PASS"  # its size is in doubt


def test_a_truth_that_is_far_longer_than_the_perception_is_read(tmp_path: Path) -> None:
    (tmp_path / "gts").mkdir()
    longer = [
        {**frame, "timestamp": frame["timestamp"] + s}
        for s in (-20.0, 20.0, 0.0)
        for frame in told([rows("1", 400.0)])
    ]
    longer = sorted(longer, key=lambda frame: frame["timestamp"])
    (tmp_path / "gts" / "t2.json").write_text(json.dumps(longer))
    two = [ego(), rows("2", 450.0 + 20.0 * T, -1.75, v=20.0)]
    assert judged(tmp_path, two, [ego().assign(id="e")])["GT"] in ("FAIL", "INVALID")


@pytest.mark.parametrize("other_seen", [False, True])
def test_no_truth_that_shares_some_time_with_the_trial_is_left_out(tmp_path: Path, other_seen: bool) -> None:
    """A car that the EGO hits is tracked from shortly before until long after, and perceived by another sensor then."""
    (tmp_path / "gts").mkdir()
    (tmp_path / "dets").mkdir()
    frames = [frame for frame in told([leader()]) if frame["timestamp"] > 1.7e9 + 4.0]
    late = [{**frame, "timestamp": frame["timestamp"] + s} for s in (0.0, 20.0, 40.0) for frame in frames]
    (tmp_path / "gts" / "t2.json").write_text(json.dumps(late))
    if other_seen:
        (tmp_path / "dets" / "d2.json").write_text(json.dumps(late[100:]))
    (tmp_path / "gts" / "t1.json").write_text(json.dumps(told([ego()])))
    (tmp_path / "dets" / "d1.json").write_text(json.dumps(told([ego().assign(id="e")])))
    tables = mcity.read_mcity(tmp_path, map=MAP, length=4.7, width=1.9, trial="1")
    write_tables(tables, tmp_path / "rec")
    assert tables.settings.ego == "vehicle_1"
    assert verdicts(tmp_path / "rec", tuple(CODES))["GT"] in ("FAIL", "INVALID")


@pytest.mark.parametrize(
    ("more", "offset"),
    [("+y_0=-6", ""), ("+k=1.1", ""), ("", '<offset x="3.0" y="-40.0" z="0.0" hdg="0.0"/>')],
)
def test_all_that_the_maps_geo_reference_and_header_say_counts(
    tmp_path: Path, more: str, offset: str
) -> None:
    text = MAP.read_text()
    begin, end = text.index("<geoReference>"), text.index("</geoReference>") + len("</geoReference>")
    words = f"+proj=tmerc +lat_0=48 +lon_0=11 {more} +datum=WGS84 +units=m +no_defs"
    road = tmp_path / "map.xodr"
    road.write_text(f"{text[:begin]}<geoReference>{words}</geoReference>{offset}{text[end:]}")
    for name, tables in (("gts/t1.json", [ego()]), ("dets/d1.json", [ego()])):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(json.dumps(told(tables)))
    found = mcity.read_mcity(tmp_path, map=road).gt
    x, y = 300.0 + 20.0 * T, np.full(len(T), -5.25)
    if more == "+k=1.1":
        x, y = 1.1 * x, 1.1 * y
    y = y - 6.0 if more == "+y_0=-6" else y
    x, y = (x - 3.0, y + 40.0) if offset else (x, y)
    np.testing.assert_allclose(found["x"], x, atol=0.02)
    np.testing.assert_allclose(found["y"], y, atol=0.02)


def test_a_pedestrian_at_the_ego_is_not_the_ego(tmp_path: Path) -> None:
    person = beside(2.9, 0.9, length=0.5, width=0.5, kind="pedestrian")
    two = [ego(), rows("2", 450.0 + 20.0 * T, -1.75, v=20.0)]
    assert judged(tmp_path, two, [person]) == {"GT": "PASS", "SD": "FAIL"}
