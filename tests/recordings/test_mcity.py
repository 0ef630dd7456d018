from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from resim.core.errors import InputError
from resim.core.geometry import to_frame, wrap_angle
from resim.recordings import Recording, read_recording, recording_of, write_tables
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
    x, y = mcity.transverse_mercator(PROJ[:, 0], PROJ[:, 1], **ORIGIN)
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
