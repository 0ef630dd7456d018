from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.core.tracks import Tracks
from resim.recordings import Alignment, read_commonroad, read_highd, read_recording, write_recording
from resim.recordings.formats.registry import FORMATS

TRACKS = "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,laneId\n"
META = "id,class,drivingDirection\n"
RECORDING = "id,frameRate\n1,25\n"
Write = Callable[..., Path]

CENTRE = (
    "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,"
    "xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration\n"
)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(tracks: str, meta: str, recording: str = RECORDING) -> Path:
        (tmp_path / "road.xodr").write_text("<OpenDRIVE/>")
        (tmp_path / "07_tracksMeta.csv").write_text(meta)
        (tmp_path / "07_recordingMeta.csv").write_text(recording)
        path = tmp_path / "07_tracks.csv"
        path.write_text(tracks)
        return path

    return write


def read(path: Path, ego: str, start: float | None = None, end: float | None = None) -> Tracks:
    return read_highd(path, map=path.parent / "road.xodr", ego=ego, start=start, end=end).gt


def test_box_corner_and_image_frame_become_centre_and_map_frame(write: Write) -> None:
    rows = "11,1,100,20,5,2,30,3,1,0,4\n12,1,101.2,20.12,5,2,30,3,1,0,4\n"
    gt = read(write(TRACKS + rows, META + "1,Truck,2\n"), "1")
    assert gt.kind.tolist() == ["truck"]
    np.testing.assert_allclose(gt.t, [0.0, 0.04])
    np.testing.assert_allclose(gt.x, [[102.5, 103.7]])
    np.testing.assert_allclose(gt.y, [[-21.0, -21.12]])
    np.testing.assert_allclose(gt.heading, np.arctan2(-3.0, 30.0))
    np.testing.assert_allclose(gt.v, np.hypot(30.0, 3.0))
    assert gt.a is not None
    np.testing.assert_allclose(gt.a, 30.0 / np.hypot(30.0, 3.0))
    assert (gt.length[0], gt.width[0]) == (5.0, 2.0)


def test_a_standing_vehicle_keeps_its_heading(write: Write) -> None:
    speeds = {"1": (0.0, -9.0, -0.1, 0.0), "2": (0.0, 0.0, 0.0, 0.0), "3": (0.0, 0.2, 0.0, 0.1)}
    rows = "".join(
        f"{frame},{i},0,{i}0,5,2,{v},0.3,0,0,4\n" for i, vs in speeds.items() for frame, v in enumerate(vs)
    )
    gt = read(write(TRACKS + rows, META + "1,Car,1\n2,Car,1\n3,Car,2\n"), "1")
    moving = np.arctan2(-0.3, -9.0)
    np.testing.assert_allclose(gt.heading[0], moving)
    np.testing.assert_allclose(gt.v[0, 1], np.hypot(9.0, 0.3))
    np.testing.assert_allclose(gt.heading[1], np.pi)
    np.testing.assert_allclose(gt.heading[2], 0.0)


def test_centre_columns_of_ind_round_exid(write: Write) -> None:
    rows = (
        "7,3,0,0,10,-4,350,1.8,4.5,19.696,-3.473,0,0,20,0,0,0\n7,3,1,1,10.8,-4.1,350,1.8,4.5,19.696,-3.473,0,0,20,0,0,0\n"
        "7,4,0,0,1,2,90,0,0,0,1.5,0,0.5,1.5,0,0,0\n7,4,1,1,1,2.1,90,0,0,0,1.5,0,0.5,1.5,0,0,0\n"
        "7,5,1,0,1,2,45,2.5,9,0,0,0,0,0,0,0,0\n"
    )
    meta = "recordingId,trackId,class\n7,3,van\n7,4,pedestrian\n7,5,tram\n"
    path = write(CENTRE + rows, meta, "recordingId,frameRate\n7,25.0\n")
    recording = read_highd(path, map=path.parent / "road.xodr", ego="3")
    gt = recording.gt
    assert gt.kind.tolist() == ["van", "pedestrian", "unknown"]
    np.testing.assert_allclose(gt.heading[0], np.radians(-10.0))
    np.testing.assert_allclose(gt.v[:2, 0], [20.0, 1.5], atol=1e-3)
    np.testing.assert_allclose(gt.y[0], [-4.0, -4.1])
    assert (gt.length[0], gt.width[0]) == (4.5, 1.8)
    assert (gt.length[1], gt.width[1]) == (0.5, 0.5)
    assert recording.provenance["assumed_sizes"] == "pedestrian 0.5 x 0.5 m: 4"


ROWS = "".join(f"{f},1,{f},0,5,2,25,0,0,0,4\n" for f in range(1, 11))
ROWS += "".join(f"{f},2,{f},9,5,2,25,0,0,0,4\n" for f in (5, 6, 8))


def test_window_begins_at_zero_and_keeps_who_is_there_in_part(write: Write) -> None:
    path = write(TRACKS + ROWS, META + "1,Car,2\n2,Car,2\n")
    recording = read_highd(path, map=path.parent / "road.xodr", ego="1", start=0.08, end=0.2)
    np.testing.assert_allclose(recording.gt.t, [0.0, 0.04, 0.08, 0.12])
    np.testing.assert_array_equal(recording.gt.valid[1], [False, False, True, True])
    assert recording.provenance["original_start"] == "0.08 s"
    assert read(path, "1").t[-1] == pytest.approx(0.36)
    assert read(path, "2", 0.16, 0.2).ids.tolist() == ["1", "2"]


REFUSED = {
    "span": (ROWS, META + "1,Car,2\n2,Car,2\n", "1", (0.1, 3.0), r"ego '1' is present from 0 to 0\.36 s, .* 3 s"),
    "gap": (ROWS, META + "1,Car,2\n2,Car,2\n", "2", (None, None), r"ego '2' is missing at t 0\.24 s \(1 of 4"),
    "ego": (ROWS, META + "1,Car,2\n2,Car,2\n", "9", (None, None), r"ego '9' was not found; the file has 1, 2"),
    "meta": (ROWS, META + "1,Car,2\n", "1", (None, None), r"07_tracksMeta\.csv: has no row for vehicle '2'"),
    "twice": (ROWS, META + "1,Car,2\n1,Car,2\n", "1", (None, None), r"vehicle '1' is a duplicate"),
    "row": (ROWS + "10,1,4,0,5,2,25,0,0,0,4\n", META + "1,Car,2\n2,Car,2\n", "1", (None, None), r"row 15 \(t 0\.36"),
    "size": (ROWS.replace("5,2", "0,2"), META + "1,Car,2\n2,Car,2\n", "1", (None, None), r"length is 0\.0"),
    "between": (ROWS, META + "1,Car,2\n2,Car,2\n", "1", (0.05, 0.07), r"has no sample from 0\.05 to 0\.07 s"),
    "frame": (ROWS.replace("3,1,3", "3.5,1,3"), META + "1,Car,2\n2,Car,2\n", "1", (None, None), r"frame is 3\.5"),
    "column": (ROWS, "id,class\n1,Car\n", "1", (None, None), "column drivingDirection missing; found id, class"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refuses(write: Write, case: str) -> None:
    rows, meta, ego, (start, end), message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        read(write(TRACKS + rows, meta), ego, start, end)


@pytest.mark.parametrize("rate", ["0", "-25", "1e-12", "1e12"])
def test_refuses_a_frame_rate_that_is_none(write: Write, rate: str) -> None:
    path = write(TRACKS + ROWS, META + "1,Car,2\n2,Car,2\n", f"id,frameRate\n1,{rate}\n")
    with pytest.raises(
        InputError, match=r"07_recordingMeta\.csv: frameRate is .*, expected 0\.001 to 10000 Hz"
    ):
        read(path, "1")


def test_refuses_a_table_of_too_many_columns(write: Write) -> None:
    wide = TRACKS.strip() + "".join(f",c{k}" for k in range(100_000))
    with pytest.raises(
        InputError, match=r"07_tracks\.csv: has 100,011 columns or more, up to 5,000 are read"
    ):
        read(write(f"{wide}\n{'1,' * 100_010}1\n", META + "1,Car,2\n"), "1")


def test_refuses_an_alignment_that_is_none(write: Write) -> None:
    path = write(TRACKS + ROWS, META + "1,Car,2\n2,Car,2\n")
    (form,) = (one for one in FORMATS if one.name == "highd")
    with pytest.raises(InputError, match=r"--alignment: is .*nan"):
        form.reader(path, map=path.parent / "road.xodr", ego="1", alignment=(np.nan, 0.0, 0.0))


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    far=st.sampled_from([0.0, 1e6, -5.4e6]), heading=st.floats(-3.1, 3.1), v=st.floats(1.0, 60.0),
    first=st.integers(0, 10**6), centred=st.booleans(),
)  # fmt: skip
def test_no_digit_is_lost(
    write: Write, far: float, heading: float, v: float, first: int, centred: bool
) -> None:
    """At UTM's coordinates states are equal to 1e-6 m, times of frames to 1e-9 s; in both kinds of columns."""
    k = np.arange(4)
    vx, vy = float(v * np.cos(heading)), float(v * np.sin(heading))
    x, y = far + vx * 0.04 * k, 2.0 * far + vy * 0.04 * k
    places = [*enumerate(zip(x.tolist(), y.tolist(), strict=True), start=first)]
    if centred:
        turned = float(np.degrees(heading))
        rows = "".join(
            f"7,1,{n},0,{a!r},{b!r},{turned!r},1.8,4.5,{vx!r},{vy!r}{',0' * 6}\n" for n, (a, b) in places
        )
        path = write(CENTRE + rows, "recordingId,trackId,class\n7,1,car\n", "recordingId,frameRate\n7,25\n")
    else:
        rows = "".join(
            f"{n},1,{a - 2.25!r},{-b - 0.9!r},4.5,1.8,{vx!r},{-vy!r},0,0,1\n" for n, (a, b) in places
        )
        path = write(TRACKS + rows, META + "1,Car,2\n")
    gt = read(path, "1")
    np.testing.assert_allclose(gt.t, 0.04 * k, rtol=0, atol=1e-9)
    np.testing.assert_allclose([gt.x[0], gt.y[0]], [x, y], rtol=0, atol=1e-6)
    np.testing.assert_allclose(gt.heading[0], heading, rtol=0, atol=1e-9)
    np.testing.assert_allclose(gt.v[0], v, rtol=0, atol=1e-9)


def test_refuses_files_that_are_not_there(tmp_path: Path, write: Write) -> None:
    with pytest.raises(InputError, match=r"is not named XX_tracks\.csv"):
        read(tmp_path / "drive.csv", "1")
    with pytest.raises(InputError, match=r"08_recordingMeta\.csv: there is no such file"):
        read(tmp_path / "08_tracks.csv", "1")
    path = write(TRACKS + ROWS, META + "1,Car,2\n2,Car,2\n")
    with pytest.raises(InputError, match=r"no\.xodr: map: there is no file"):
        read_highd(path, map=tmp_path / "no.xodr", ego="1")


def rigid(source: np.ndarray, target: np.ndarray) -> Alignment:
    """The turn and shift that bring points (K, 2) onto others with the least squares."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = np.cos(turn), np.sin(turn)
    x, y = target.mean(axis=0) - np.array([[c, -s], [s, c]]) @ source.mean(axis=0)
    return Alignment(x=float(x), y=float(y), rotation=float(turn))


def test_the_sample_lands_on_the_drive_it_was_made_from(data: Path, tmp_path: Path) -> None:
    csv = data / "highd_format" / "us101_22" / "01_tracks.csv"
    xml, road = data / "ngsim" / "USA_US101-22_1_T-1.xml", data / "ngsim" / "USA_US101-22_1_T-1.xodr"
    table = pd.read_csv(csv.with_name("01_idmap.csv"), dtype=str)
    names = dict(zip(table["sourceObstacleId"], table["id"], strict=True))
    ego = "703"
    source = read_commonroad(xml, map=road, ego=ego).gt
    plain = read_highd(csv, map=road, ego=names[ego]).gt.select(names[i] for i in source.ids)
    there = source.valid & plain.valid
    assert there.sum() == source.valid.sum() == plain.valid.sum()
    points = [np.column_stack([t.x[there], t.y[there]]) for t in (plain, source)]
    alignment = rigid(points[0], points[1])
    recording = read_highd(csv, map=road, ego=names[ego], alignment=alignment)
    aligned = recording.gt.select(names[i] for i in source.ids)
    assert np.hypot(aligned.x - source.x, aligned.y - source.y)[there].max() < 0.01
    assert np.abs(wrap_angle(aligned.heading - source.heading)[there]).max() < 1e-3
    assert np.abs(aligned.v - source.v)[there].max() < 0.01
    np.testing.assert_allclose(aligned.length, source.length, atol=1e-3)
    write_recording(recording, tmp_path / "drive")
    pd.testing.assert_frame_equal(read_recording(tmp_path / "drive").gt.to_frame(), recording.gt.to_frame())


def test_both_driving_directions_of_the_published_schema(data: Path) -> None:
    csv = data / "highd_format" / "ika_schema_example" / "01_tracks.csv"
    gt = read_highd(csv, map=csv, ego="2").gt
    np.testing.assert_allclose(gt.heading[:, 0], [0.0, np.pi])
    assert (gt.v > 0.0).all()
