"""A known drive, written as logs of messages by the libraries that others write with, comes back from the import."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings.logs import written as w
from recordings.mapped.strangers import MAP, drive

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.recordings import RecordingTables, read_tables, recording_of, write_tables
from resim.recordings.logs import mdf_child
from resim.recordings.mapped.guess import fill_ins, guess
from resim.recordings.mapped.reader import read_mapped

ROS = w.Ros()
EAST, NORTH = 999_999.123456, 5_345_678.654321
"""m: positions as UTM has them."""
DRAWN = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def imported(path: Path, mapping: str, **more: object) -> RecordingTables:
    columns = path.parent / "mapping.toml"
    columns.write_text(mapping, encoding="utf-8")
    arguments: dict = {"map": MAP, **more}
    return read_mapped(path, columns=columns, **arguments)


def assert_exact(found: pd.DataFrame, truth: pd.DataFrame) -> None:
    """The drive is given back to the last digit of what the log holds: 1e-9 s, 1e-6 m."""
    found = found.sort_values(["t", "id"]).reset_index(drop=True)
    truth = truth.sort_values(["t", "id"]).reset_index(drop=True)
    assert found["id"].tolist() == truth["id"].tolist()
    for column, far in {"t": 1e-9, "x": 1e-6, "y": 1e-6, "v": 1e-9}.items():
        np.testing.assert_allclose(found[column], truth[column], rtol=0.0, atol=far, err_msg=column)
    assert np.abs(wrap_angle(found["heading"] - truth["heading"])).max() < 1e-9


def far_away(steps: int = 6) -> pd.DataFrame:
    """The drive at UTM's coordinates, at times that have all nine decimals."""
    truth = drive(steps=steps)
    t = truth["t"].map({old: n * 0.100000007 for n, old in enumerate(sorted(truth["t"].unique()))})
    return truth.assign(x=truth["x"] + EAST, y=truth["y"] + NORTH, t=np.round(t, 9))


def named(truth: pd.DataFrame) -> pd.DataFrame:
    """The drive with UUIDs for ids, as Autoware has it."""
    return truth.assign(id=[n if n == "ego" else w.uuid(n).tobytes().hex() for n in truth["id"]])


@DRAWN
@given(
    form=st.sampled_from(
        ["mcap", "mcap of one message a chunk", "bag 8", "bag 9", "db3", "messages compressed", "big-endian"]
    ),
    kind=st.sampled_from(
        [
            w.TRACKED,
            w.PREDICTED,
            w.TRACKED.replace("autoware_", "autoware_auto_"),
            w.PREDICTED.replace("autoware_", "autoware_auto_"),
        ]
    ),
    defined=st.booleans(),
)
def test_autowares_objects_and_ego_come_back_to_the_last_digit(form: str, kind: str, defined: bool) -> None:
    truth = far_away()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        messages = w.sent(ROS, truth, kind)
        if form.startswith(("mcap", "big")):
            chunk = {"defined": defined, "little_endian": form != "big-endian"}
            path = w.to_mcap(
                ROS, messages, folder / "a.mcap", use_chunking=form != "mcap of one message a chunk", **chunk
            )
        else:
            version = 9 if form == "bag 9" else 8
            path = w.to_bag(
                ROS, messages, folder / "bag", version=version, compressed=form.startswith("messages")
            )
            path = next(path.glob("*.db3")) if form == "db3" else path
        found = imported(path, w.autoware_mapping(kind))
    assert_exact(found.gt, named(truth))
    assert found.gt.drop_duplicates("id").set_index("id")["kind"].tolist() == ["car", "truck", "car"]
    assert found.settings.provenance["original_start"] == "unix time 1714550400.123456789 s"
    assert found.settings.provenance["source"] == path.name


@DRAWN
@given(encoding=st.sampled_from(["json", "protobuf"]), compression=st.sampled_from(["NONE", "LZ4", "ZSTD"]))
def test_scenes_as_json_and_protobuf_come_back(encoding: str, compression: str) -> None:
    from mcap.writer import CompressionType

    truth = far_away()
    with tempfile.TemporaryDirectory() as name:
        path = w.to_scene_mcap(
            truth, Path(name) / "a.mcap", encoding, compression=CompressionType[compression]
        )
        found = imported(path, w.SCENE_MAPPING)
    assert_exact(found.gt, truth)
    assert sorted(found.gt["length"].unique()) == [4.2, 4.6, 10.0]


def test_signals_of_mdf_come_back(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    truth = far_away()
    groups, tables = {}, []
    for name, rows in truth.groupby("id"):
        groups[f"object {name}"] = {
            "time": rows["t"].to_numpy(), "pos": rows[["x", "y"]].to_numpy(),
            "yaw": np.degrees(rows["heading"].to_numpy()), "v": rows["v"].to_numpy(),
        }  # fmt: skip
        tables.append(f'''[[gt]]
topic = "object {name}"
id = {{ value = "{name}" }}
t = {{ column = "log_time", unit = "ns" }}
x = "pos.0"
y = "pos.1"
heading = {{ column = "yaw", unit = "deg" }}
v = "v"
''')
    path = w.to_mdf(groups, tmp_path / "a.mf4")
    found = imported(path, 'ego = "ego"\n' + "\n".join(tables))
    assert_exact(found.gt, truth)
    assert found.settings.provenance["original_start"] == "unix time 1714550400.123456789 s"
    by_number = imported(path, 'ego = "ego"\n' + tables[2].replace('"object ego"', '"3"'))
    assert_exact(by_number.gt, truth[truth["id"] == "ego"])
    message = (
        r"a\.mf4: has no messages of topic 'objekt', which gt\.topic names.*Its topics are: object 7 \(log_"
    )
    with pytest.raises(InputError, match=message):
        imported(path, 'ego = "ego"\n' + tables[2].replace('"object ego"', '"objekt"'))
    message = r"a\.mf4: group object ego has no channel 'velocity', which gt\.v names.*It has .*yaw"
    with pytest.raises(InputError, match=message):
        imported(path, 'ego = "ego"\n' + tables[2].replace('"v"', '"velocity"'))


@settings(DRAWN, max_examples=4)
@given(
    far=st.sampled_from([0.0, 1e6, -5.4e6]),
    start=st.sampled_from([0, 1_714_550_400_123_456_789]),
    v=st.floats(0, 60),
)
def test_no_digit_of_mdf_is_lost(far: float, start: int, v: float) -> None:
    """At UTM's coordinates and times of today, of files that begin at any time."""
    pytest.importorskip("asammdf")
    truth = drive(steps=6)
    truth = truth[truth["id"] == "ego"].assign(x=lambda r: r.x + far, y=lambda r: r.y + 2.0 * far, v=v)
    channels = {c: truth[c].to_numpy(float) for c in ("x", "y", "heading", "v")} | {
        "time": truth["t"].to_numpy()
    }
    text = (
        'ego = "ego"\n[gt]\ntopic = "A"\nid = { value = "ego" }\nt = { column = "log_time", unit = "ns" }\n'
    )
    text += "".join(f'{c} = "{c}"\n' for c in ("x", "y", "heading", "v"))
    with tempfile.TemporaryDirectory() as name:
        found = imported(w.to_mdf({"A": channels}, Path(name) / "a.mf4", start_ns=start), text)
    assert_exact(found.gt.assign(t=found.gt["t"] - found.gt["t"].min()), truth)


def test_samples_of_mdf_that_are_not_valid_are_missing(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    n, invalid = 5, np.array([False, True, False, False, True])
    channels = {
        "time": np.arange(n) / 10.0, "x": np.arange(n) + 0.5, "count": np.arange(n, dtype="uint8"),
        "word": np.array([b"a", b"bb", b"c", b"d", b"e"]), "pos": np.arange(2.0 * n).reshape(n, 2),
    }  # fmt: skip
    found = mdf_child.read(str(w.to_mdf({"A": channels}, tmp_path / "a.mf4", invalid=invalid)), "A")
    missing = np.where(invalid, np.nan, 0.0)
    np.testing.assert_array_equal(found["x"], channels["x"] + missing)
    np.testing.assert_array_equal(found["count"], channels["count"] + missing)
    np.testing.assert_array_equal(found["pos.1"], channels["pos"][:, 1] + missing)
    assert found["word"].tolist() == ["a", "", "c", "d", ""]
    whole = mdf_child.read(str(w.to_mdf({"A": channels}, tmp_path / "b.mf4")), "A")
    assert whole["count"].dtype == np.uint8
    assert whole["word"].tolist() == ["a", "bb", "c", "d", "e"]


@pytest.mark.parametrize("auto", ["", "auto_"])
@pytest.mark.parametrize("kind", ["tracked", "predicted", "detected"])
def test_the_mappings_that_ship_read_what_autoware_records(tmp_path: Path, kind: str, auto: str) -> None:
    truth = drive()
    truth.loc[truth["id"] == "ego", ["length", "width"]] = 4.89, 1.896
    package = f"autoware_{auto}perception_msgs/msg"
    topic = "/perception/object_recognition/objects" if kind == "predicted" else w.OBJECTS
    own = "Predicted" if kind == "predicted" else "Tracked"
    messages = list(w.sent(ROS, truth, f"{package}/{own}Objects", topic, axle=4.89 / 2 - 1.1))
    if kind == "detected":
        messages += w.detections(ROS, truth, f"{package}/DetectedObjects", axle=4.89 / 2 - 1.1)
    path = w.to_bag(ROS, iter(messages), tmp_path / "bag")
    columns = tmp_path / "mapping.toml"
    columns.write_text(guess(path, columns), encoding="utf-8")
    assert len(fill_ins(columns.read_text(encoding="utf-8"))) == (2 if kind == "detected" else 1)
    assert columns.read_text(encoding="utf-8").count(f"autoware_{kind}.toml") == 0  # they are called as here
    found = read_mapped(path, map=MAP, columns=columns)
    assert_exact(found.gt, named(truth))
    assert set(found.gt["kind"]) == {"car", "truck"}
    if kind == "detected":
        assert found.sd is not None
        assert found.sd["t"].min() == pytest.approx(w.DELAY * 1e-9, abs=1e-9)
        seen = found.sd[found.sd["x"].notna()]  # the last was recorded after the EGO's last sample
        assert set(seen["gt_id"]) == set(named(truth)["id"]) - {"ego"}
    write_tables(found, tmp_path / "out")
    assert "ego" in recording_of(read_tables(tmp_path / "out"), lenient=True).gt.ids


def test_the_ego_is_taken_from_tf_and_polygons_are_left_out(tmp_path: Path) -> None:
    truth = drive(steps=5)
    path = w.to_mcap(ROS, w.sent_with_tf(ROS, truth, polygon="8"), tmp_path / "a.mcap")
    text = w.autoware_mapping(more='without = { "shape.type" = "2" }')
    ego = text.replace(
        f'topic = "{w.EGO_TOPIC}"',
        'topic = "/tf"\nlist = "transforms"\nonly = { child_frame_id = "base_link" }',
    )
    ego = ego.replace("pose.pose.position", "transform.translation", 2).replace(
        '"pose.pose.orientation"', '"transform.rotation"'
    )
    found = imported(path, ego.replace('v = "twist.twist.linear.x"\n', "", 1))
    assert set(found.gt["id"]) == set(named(truth)["id"]) - {w.uuid("8").tobytes().hex()}
    own, told = found.gt[found.gt["id"] == "ego"], truth[truth["id"] == "ego"]
    np.testing.assert_allclose(own[["t", "x", "y", "heading"]], told[["t", "x", "y", "heading"]], atol=1e-6)
    assert recording_of(found).ego == "ego"


def test_a_quaternion_gives_the_heading_of_a_vehicle_that_leans(tmp_path: Path) -> None:
    rows = ["t,x,y,qx,qy,qz,qw"]
    for k in range(4):
        turn = ROS.pose(0.0, 0.0, 0.3 + 0.1 * k, roll=0.2).pose.orientation
        rows.append(f"{k / 10},{k},0,{turn.x},{turn.y},{turn.z},{turn.w}")
    (tmp_path / "a.csv").write_text("\n".join([*rows, "0.4,4,0,0,0,0,0"]))
    mapping = '[gt]\nid = { value = "ego" }\nt = "t"\nx = "x"\ny = "y"\n'
    mapping += 'heading = { quaternion = ["qx", "qy", "qz", "qw"] }\n'
    found = imported(tmp_path / "a.csv", 'ego = "ego"\n' + mapping).gt["heading"].tolist()
    assert found[:4] == pytest.approx([0.3, 0.4, 0.5, 0.6], abs=1e-9)
    assert np.isnan(found[4])  # which says nothing
    (tmp_path / "a.csv").write_text("\n".join([*rows, "0.4,4,0,0,0,0,2"]))
    with pytest.raises(
        InputError,
        match=r"a\.csv: row 6: qw .*heading\.quaternion\) is '2', expected w of a quaternion of length 1",
    ):
        imported(tmp_path / "a.csv", 'ego = "ego"\n' + mapping)
    with pytest.raises(InputError, match=r"heading.*expected a column"):
        imported(tmp_path / "a.csv", 'ego = "ego"\n' + mapping.replace("{ quat", '{ column = "qx", quat'))


def test_whole_nanoseconds_of_a_csv_lose_no_digit(tmp_path: Path) -> None:
    times = [w.ORIGIN + k * 100_000_007 for k in range(5)]
    rows = "\n".join(f"{time},{k},0" for k, time in enumerate(times))
    (tmp_path / "a.csv").write_text(f"t,x,y\n{rows}\n")
    mapping = (
        'ego = "ego"\n[gt]\nid = { value = "ego" }\nt = { column = "t", unit = "ns" }\nx = "x"\ny = "y"\n'
    )
    found = imported(tmp_path / "a.csv", mapping)
    assert found.gt["t"].tolist() == [k * 100_000_007 / 1e9 for k in range(5)]


def test_the_likeliest_class_counts_and_a_message_has_fields_for_all_its_rows(tmp_path: Path) -> None:
    truth = drive(steps=3)
    path = w.to_mcap(ROS, w.sent(ROS, truth), tmp_path / "a.mcap")
    text = w.autoware_mapping(
        more='only = { "header.frame_id" = "map" }\nexistence = "existence_probability"'
    )
    assert set(imported(path, text).gt["kind"]) == {"car", "truck"}
    with pytest.raises(InputError, match=r"no row has 'odom' in 'header.frame_id' \(gt\.only\)"):
        imported(path, text.replace('"map"', '"odom"'))


def test_a_bag_in_parts_is_read_whole_and_a_lost_part_is_told(tmp_path: Path) -> None:
    truth = drive(steps=8)
    folder = w.to_bag(ROS, w.sent(ROS, truth), tmp_path / "bag")
    first = next(folder.glob("*.db3"))
    half = truth[truth["t"] > 0.35]
    other = w.to_bag(ROS, w.sent(ROS, half), tmp_path / "other")
    next(other.glob("*.db3")).rename(folder / "bag_1.db3")
    early = w.to_bag(ROS, w.sent(ROS, truth[truth["t"] < 0.35]), tmp_path / "early")
    next(early.glob("*.db3")).replace(first)
    metadata = (folder / "metadata.yaml").read_text()
    listed = f"  relative_file_paths:\n  - {first.name}\n"
    assert listed in metadata
    (folder / "metadata.yaml").write_text(metadata.replace(listed, listed + "  - bag_1.db3\n"))
    assert_exact(imported(folder, w.autoware_mapping()).gt, named(truth))
    (folder / "bag_1.db3").unlink()
    with pytest.raises(
        InputError, match=r"bag: has no file bag_1\.db3, which metadata\.yaml names\. Copy the whole bag"
    ):
        imported(folder, w.autoware_mapping())


def test_a_bag_of_compressed_files_is_read_once_they_are_decompressed(tmp_path: Path) -> None:
    import zstandard

    truth = drive(steps=4)
    folder = w.to_bag(ROS, w.sent(ROS, truth), tmp_path / "bag")
    part = next(folder.glob("*.db3"))
    zipped = part.with_name(f"{part.name}.zstd")
    zipped.write_bytes(zstandard.ZstdCompressor().compress(part.read_bytes()))
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace(f"- {part.name}\n", f"- {zipped.name}\n", 1))
    whole = part.rename(tmp_path / "whole")
    with pytest.raises(
        InputError, match=r"\.db3\.zstd: is a file that zstd compressed\. Decompress it first: zstd -d"
    ):
        imported(folder, w.autoware_mapping())
    whole.rename(part)
    assert_exact(imported(folder, w.autoware_mapping()).gt, named(truth))


WRONG = {
    "topic": (f'"{w.EGO_TOPIC}"', '"/localization/kinematics"',
              r"no messages of topic '/localization/kinematics', which gt\.topic names, did you mean '/loc"),
    "no topic": (f'topic = "{w.EGO_TOPIC}"\n', "",
                 r"is a log of many topics, and gt of the mapping names no topic\. Its topics are: /local"),
    "list": ('list = "objects"', 'list = "object"',
             r"message \d+ .* it has no list 'object': it has header, objects\. Check `list`"),
    "no list": ('list = "objects"', 'list = "header"', r"header is a structure, expected a list"),
    "column": ('"shape.dimensions.x"', '"shape.dimension.x"',
               r"no field 'shape\.dimension\.x', which gt\.length names, did you mean 'shape\.dim"),
    "structure": ('"object_id.uuid"', '"object_id"',
                  r"has no field 'object_id', which gt\.id names.*It has log_time, classification\.label"),
    "ros": ('topic = "/percep', 'ros = "hydro"\ntopic = "/percep', r"gt\.1\.ros"),
    "list of a table": (f'topic = "{w.OBJECTS}"\n', "", r"list and ros need a topic"),
}  # fmt: skip
"""What is changed in the mapping, and what is said."""


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_in_a_mapping_is_told_with_what_is_there(tmp_path: Path, case: str) -> None:
    path = w.to_mcap(ROS, w.sent(ROS, drive(steps=2)), tmp_path / "a.mcap")
    old, new, message = WRONG[case]
    assert old in w.autoware_mapping()
    with pytest.raises(InputError, match=message):
        imported(path, w.autoware_mapping().replace(old, new))


def test_a_table_has_no_topic(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("t,x\n0,1\n")
    with pytest.raises(
        InputError, match=r"b\.csv: is no log \(MCAP, rosbag2 or MDF4\), but gt names the topic"
    ):
        imported(tmp_path / "b.csv", w.autoware_mapping())


def test_a_topic_without_objects_is_told(tmp_path: Path) -> None:
    truth = drive(steps=2)
    path = w.to_mcap(ROS, w.sent(ROS, truth[truth["id"] == "ego"]), tmp_path / "a.mcap")
    with pytest.raises(
        InputError,
        match=r"gt: objects is empty in all 2 messages of /perception.*Name a topic in which objects are",
    ):
        imported(path, w.autoware_mapping())


def test_an_empty_list_at_some_times_is_no_fault(tmp_path: Path) -> None:
    truth = drive(steps=4)
    some = truth[(truth["id"] == "ego") | (truth["t"] > 0.15)]
    assert_exact(
        imported(w.to_mcap(ROS, w.sent(ROS, some), tmp_path / "a.mcap"), w.autoware_mapping()).gt, named(some)
    )
