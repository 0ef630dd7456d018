from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import duckdb
import numpy as np
import pytest

from resim.core.errors import InputError
from resim.recordings import RecordingTables, read_recording, read_tables, recording_of, write_recording

HEADER = "t,id,x,y,heading,v,length,width,kind"
EGO = "0.0,ego,0.0,0.0,0.0,20.0,4.7,1.9,car\n0.1,ego,2.0,0.0,0.0,20.0,4.7,1.9,car\n"
TOML = 'name = "n"\nmap = "../road.xodr"\nego = "ego"\n'
Make = Callable[..., Path]


def parquet(folder: Path, name: str) -> None:
    source, target = folder / f"{name}.csv", folder / f"{name}.parquet"
    with duckdb.connect() as db:
        db.execute(f"COPY (SELECT * FROM read_csv('{source}')) TO '{target}' (FORMAT parquet)")


def test_reads_what_the_folder_holds(make: Make) -> None:
    recording = read_recording(make())
    assert (recording.name, recording.ego, recording.build) == ("cut-in", "ego", "highway_pilot-1.0")
    assert recording.map.name == "road.xodr"
    assert recording.map.is_absolute()
    assert recording.gt_rate == 10.0
    assert recording.sd is None
    assert recording.sd_by_gt() is None
    assert recording.environment == {"fogDensity": "0.5"}
    assert recording.gt.kind.tolist() == ["car", "truck"]
    np.testing.assert_array_equal(recording.gt.valid, [[True, True, True], [True, True, False]])
    np.testing.assert_array_equal(recording.gt.x[0], [0.0, 2.0, 4.0])


def test_parquet_gives_the_same_as_csv(make: Make) -> None:
    folder = make()
    expected = read_recording(folder).gt.to_frame()
    parquet(folder, "gt")
    (folder / "gt.csv").unlink()
    assert read_recording(folder).gt.to_frame().equals(expected)


ODD = ["drive[1]", "drive*", "drive?", "width=1.6", "v=20", "id=7", "a\\[1]", "**", "[", "{a,b}", "~", "it's"]
"""Names of folders that mean something to DuckDB."""


@pytest.mark.parametrize("name", ODD)
def test_parquet_is_read_from_the_folder_of_that_name_and_means_what_it_says(
    make: Make, tmp_path: Path, name: str
) -> None:
    folder = make()
    expected = read_recording(folder).gt.to_frame()
    parquet(folder, "gt")
    (folder / "gt.csv").unlink()
    for decoy in ("drive1", "drives", "a"):
        shutil.copytree(folder, tmp_path / "all" / decoy / "one")
        other = duckdb.sql(f"SELECT * REPLACE (x + 60 AS x) FROM '{folder}/gt.parquet'")
        other.write_parquet(str(tmp_path / "all" / decoy / "one" / "gt.parquet"))
    named = shutil.copytree(folder, tmp_path / "all" / name / "one")
    shutil.copyfile(folder / "../road.xodr", tmp_path / "all" / name / "road.xodr")
    assert read_recording(named).gt.to_frame().equals(expected)


def test_optional_columns_may_have_gaps(make: Make) -> None:
    rows = [line + end for line, end in zip(EGO.splitlines(), (",0.1,", ",,0.2"), strict=True)]
    gt = read_recording(make(gt="\n".join([f"{HEADER},yaw_rate,a", *rows]) + "\n")).gt
    np.testing.assert_array_equal(gt.yaw_rate, [[0.1, np.nan]])
    np.testing.assert_array_equal(gt.a, [[np.nan, 0.2]])


def test_plan_is_read(make: Make) -> None:
    plan = read_recording(make(plan="t,t_plan,x,y,v\n0.0,0.0,0,0,20\n0.0,0.5,10,0,20\n")).plan
    assert plan is not None
    assert plan["x"].tolist() == [0.0, 10.0]


def test_plan_is_written(make: Make, tmp_path: Path) -> None:
    recording = read_recording(make(plan="t,t_plan,x,y,v\n0.0,0.0,0,0,20\n0.0,0.5,10.1,0,20\n"))
    write_recording(recording, tmp_path / "again")
    again = read_recording(tmp_path / "again").plan
    assert again is not None
    assert recording.plan is not None
    assert again.equals(recording.plan)


TABLES = {
    "missing column": (f"{HEADER.replace(',v,', ',speed,')}\n{EGO}", ["column v missing", "found t, id, x"]),
    "empty file": ("", ["is empty (0 bytes)"]),
    "header only": (HEADER + "\n", ["has a header and no rows"]),
    "backwards": (
        f"{HEADER}\n0.5,b,0,0,0,0,4,2,car\n{EGO}0.05,ego,1,0,0,20,4.7,1.9,car\n",
        ["row 5 (t 0.05, object 'ego')", "time runs backwards", "t 0.1", "Sort"],
    ),
    "duplicate": (f"{HEADER}\n{EGO}{EGO}", ["row 4 (t 0.0, object 'ego')", "comes before it"]),
    "nan": (f"{HEADER}\n{EGO}0.2,ego,nan,0,0,20,4.7,1.9,car\n", ["row 4 (t 0.2, object 'ego'): x is nan"]),
    "empty field": (f"{HEADER}\n{EGO}0.2,ego,,0,0,20,4.7,1.9,car\n", ["row 4", "x is nan", "finite number"]),
    "inf": (f"{HEADER}\n{EGO}0.2,ego,1,0,0,-inf,4.7,1.9,car\n", ["row 4", "v is -inf", "finite number"]),
    "text": (f"{HEADER}\n{EGO}0.2,ego,1,0,north,2,4,2,car\n", ["row 4", "heading is 'north'"]),
    "time text": (f"{HEADER}\n{EGO}now,ego,1,0,0,2,4,2,car\n", ["row 4 (t now, object 'ego'): t is 'now'"]),
    "underscore": (f"{HEADER}\n{EGO}0.2,ego,1_0,0,0,2,4,2,car\n", ["row 4", "x is '1_0'"]),
    "semicolons": (HEADER.replace(",", ";") + "\n", ["found t;id;x", "separated by commas"]),
    "no id": (f"{HEADER}\n{EGO}0.2,,1,0,0,2,4,2,car\n", ["row 4", "id is ''", "expected a name"]),
    "kind": (
        f"{HEADER}\n{EGO}0.2,b,1,0,0,2,4,2,lorry\n0.3,b,1,0,0,2,4,2,lorry\n",
        ["row 4", "kind is 'lorry'", "car, van, truck", "(and 1 more row)"],
    ),
    "width": (f"{HEADER}\n{EGO}0.2,b,1,0,0,2,4,0,car\n", ["row 4", "width is 0.0", "above 0 m"]),
    "length": (f"{HEADER}\n{EGO}0.2,b,1,0,0,2,-4,1,car\n", ["row 4", "length is -4.0", "above 0 m"]),
    "long row": (f"{HEADER}\n{EGO}0.2,b,1,0,0,2,4,2,car,7\n", ["not a readable CSV", "line 4", "saw 10"]),
    "all rows long": (f"{HEADER}\n0.2,b,1,0,0,2,4,2,car,7\n", ["not a readable CSV"]),
    "short row": (f"{HEADER}\n{EGO}0.2,b,1\n", ["row 4", "is nan"]),
    "binary": ("PAR1\x00\x00\n\x00", ["missing; found"]),
    "lines in a field": (
        f"{HEADER},note\n{EGO.replace('car', 'car,')}"
        '0.2,ego,4,0,0,20,4.7,1.9,car,"x\n0.3,ego,6,0,0,20,4.7,1.9,car,y"\n',
        ["row 4: a value continues on the following lines: 'x\\n0.3,ego", "Take its quote"],
    ),
    "one sample": (f"{HEADER}\n{EGO.splitlines()[0]}\n", ["no object has two samples"]),
}  # fmt: skip


@pytest.mark.parametrize("case", TABLES)
def test_refuses_a_ground_truth_that_cannot_be_used(make: Make, case: str) -> None:
    text, expected = TABLES[case]
    folder = make(gt=text, toml=TOML)
    with pytest.raises(InputError) as caught:
        read_recording(folder)
    message = str(caught.value)
    assert message.startswith(str(folder / "gt.csv"))
    for part in expected:
        assert part in message


SETTINGS = {
    "not toml": ("name = cut-in\n", ["recording.toml", "is not TOML", "line 1"]),
    "all at once": (
        'nam = "x"\nmap = "../road.xodr"\nego = true\ngt_rate = "fast"\n',
        [
            "name: is missing",
            "nam: there is no such field",
            "ego: ",
            "found True",
            "gt_rate: ",
            "found 'fast'",
        ],
    ),
    "environment": (
        TOML + "[environment]\nfog = 1\n",
        ["environment.fog: there is no such field"],
    ),
    "no map": (TOML.replace("road", "rod"), ["recording.toml", "map: there is no file", "rod.xodr"]),
    "ego": (TOML.replace('"ego"', '"me"'), ["ego 'me' was not found in gt.csv", "holds ego, a"]),
    "lost sd": (TOML + "sd_rate = 10\n", ["sd_rate is 10", "neither sd.csv nor sd.parquet"]),
    "missing": (None, ["recording.toml", "cannot be read (No such file or directory)"]),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_refuses_settings_that_cannot_be_used(make: Make, case: str) -> None:
    toml, expected = SETTINGS[case]
    with pytest.raises(InputError) as caught:
        read_recording(make(toml=toml))
    for part in expected:
        assert part in str(caught.value)


def test_refuses_no_ground_truth_and_two(make: Make) -> None:
    folder = make()
    parquet(folder, "gt")
    with pytest.raises(InputError, match=r"holds both gt\.csv and gt\.parquet"):
        read_recording(folder)
    (folder / "gt.csv").unlink()
    (folder / "gt.parquet").unlink()
    with pytest.raises(InputError, match=r"holds neither gt\.csv nor gt\.parquet"):
        read_recording(folder)


def test_refuses_a_truncated_parquet_file(make: Make) -> None:
    folder = make()
    parquet(folder, "gt")
    (folder / "gt.csv").unlink()
    whole = (folder / "gt.parquet").read_bytes()
    (folder / "gt.parquet").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"gt\.parquet: is not a readable Parquet file"):
        read_recording(folder)


def test_refuses_a_bad_row_of_a_parquet_file(make: Make) -> None:
    folder = make(gt=f"{HEADER}\n{EGO}0.2,ego,,0,0,20,4.7,1.9,car\n")
    parquet(folder, "gt")
    (folder / "gt.csv").unlink()
    with pytest.raises(InputError, match=r"gt\.parquet: row 3 \(t 0\.2, object 'ego'\): x is nan"):
        read_recording(folder)


SD = f"{HEADER},gt_id,existence_probability"
SENSOR = {
    "identity changes": (
        f"{SD}\n0.0,7,1,0,0,2,4,2,car,a,1\n0.1,7,1,0,0,2,4,2,car,ego,1\n",
        ["row 3 (t 0.1, object '7')", "gt_id is 'ego', the object's first row has 'a'", "a new id"],
    ),
    "unknown": (f"{SD}\n0.0,7,1,0,0,2,4,2,car,zz,1\n", ["row 2", "gt_id 'zz' was not found in the ground"]),
    "probability": (
        f"{SD}\n0.0,7,1,0,0,2,4,2,car,a,1.5\n",
        ["row 2", "existence_probability is 1.5", "0 to 1"],
    ),
}


@pytest.mark.parametrize("case", SENSOR)
def test_refuses_sensor_data_that_cannot_be_used(make: Make, case: str) -> None:
    text, expected = SENSOR[case]
    folder = make(sd=text)
    with pytest.raises(InputError) as caught:
        read_recording(folder)
    assert str(caught.value).startswith(str(folder / "sd.csv"))
    for part in expected:
        assert part in str(caught.value)


def test_writing_refuses_a_folder_in_use_and_leaves_nothing_behind(make: Make, tmp_path: Path) -> None:
    recording = read_recording(make())
    with pytest.raises(InputError, match="exists already"):
        write_recording(recording, tmp_path / "cut_in")
    with pytest.raises(InputError, match="cannot be written"):
        write_recording(recording, tmp_path / "road.xodr" / "new")
    with pytest.raises(InputError, match=r"there is no file .*nowhere\.xodr"):
        write_recording(recording, tmp_path / "new", map_reference="../nowhere.xodr")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut_in", "road.xodr"]


def test_written_folder_is_self_contained_or_refers_to_the_shared_map(make: Make, tmp_path: Path) -> None:
    recording = read_recording(make())
    write_recording(recording, tmp_path / "deep" / "copy")
    assert read_recording(tmp_path / "deep" / "copy").map == tmp_path / "deep" / "copy" / "road.xodr"
    write_recording(recording, tmp_path / "linked", map_reference="../road.xodr")
    assert sorted(p.name for p in (tmp_path / "linked").iterdir()) == ["gt.csv", "recording.toml"]
    assert read_recording(tmp_path / "linked").map == tmp_path / "road.xodr"


FAULTY = f"""{HEADER}
{EGO}0.1,ego,9.0,0.0,0.0,20.0,4.7,1.9,car
0.3,ego,6.0,0.0,0.0,20.0,4.7,1.9,car
0.2,ego,4.0,0.0,0.0,20.0,5.0,1.9,car
0.4,ego,,0.0,0.0,20.0,4.7,1.9,car
"""


def test_tables_hold_the_faults_that_a_recording_refuses(make: Make) -> None:
    tables = read_tables(make(gt=FAULTY, toml=TOML))
    assert tables.gt["t"].tolist() == [0.0, 0.1, 0.1, 0.3, 0.2, 0.4]
    assert np.isnan(tables.gt["x"].iloc[-1])
    with pytest.raises(InputError, match=r"gt\.csv: row 7 .*x is nan"):
        recording_of(tables)


def test_lenient_keeps_the_first_row_sorts_and_drops_what_misses_values(make: Make) -> None:
    gt = recording_of(read_tables(make(gt=FAULTY, toml=TOML)), lenient=True).gt
    np.testing.assert_array_equal(gt.t, [0.0, 0.1, 0.2, 0.3])
    np.testing.assert_array_equal(gt.x, [[0.0, 2.0, 4.0, 6.0]])
    assert gt.length.tolist() == [4.7]


def test_lenient_refuses_an_ego_of_which_nothing_is_left(make: Make) -> None:
    text = f"{HEADER}\n0.0,ego,,0,0,20,4,2,car\n0.0,b,1,0,0,20,4,2,car\n0.1,b,1,0,0,20,4,2,car\n"
    with pytest.raises(InputError, match="ego 'ego' has no row without missing values"):
        recording_of(read_tables(make(gt=text, toml=TOML)), lenient=True)


def test_what_was_repaired_is_kept_counted_and_written(make: Make, tmp_path: Path) -> None:
    rows = [line + end for line, end in zip(EGO.splitlines(), (",", ",OUTLIER GAP"), strict=True)]
    recording = read_recording(make(gt="\n".join([f"{HEADER},repaired", *rows]) + "\n", toml=TOML))
    assert recording.repaired == {"gt": {"GAP": 1, "OUTLIER": 1}}
    write_recording(recording, tmp_path / "again")
    assert read_recording(tmp_path / "again").repaired == recording.repaired


def test_tables_of_a_recording_give_it_again(make: Make) -> None:
    sd = f"{HEADER},gt_id,existence_probability\n0.0,7,1,0,0,2,4,2,car,a,0.5\n0.1,7,1,0,0,2,4,2,car,a,\n"
    recording = read_recording(make(sd=sd))
    again = recording_of(RecordingTables.of(recording))
    assert again.gt.to_frame().equals(recording.gt.to_frame())
    assert (again.sd_gt_id, again.environment) == (recording.sd_gt_id, recording.environment)
    np.testing.assert_array_equal(again.existence_probability, recording.existence_probability)


@pytest.mark.parametrize("name", ["sd.csv", "plan.csv", "sd.parquet"])
def test_what_is_no_file_is_not_passed_over(make: Make, name: str) -> None:
    """A pipe would have been taken for no sensor data at all."""
    folder = make()
    os.mkfifo(folder / name)
    with pytest.raises(InputError, match=f"{name}: is not a regular file"):
        read_recording(folder)
    (folder / name).unlink()
    (folder / name).symlink_to("nowhere.csv")
    with pytest.raises(InputError, match="dangling link"):
        read_recording(folder)


def test_two_columns_of_one_name_are_refused(make: Make) -> None:
    rows = [f"{line},99.0" for line in EGO.splitlines()]
    with pytest.raises(InputError, match=r"gt\.csv: has more than one column x\. Keep the right one"):
        read_recording(make(gt="\n".join([f"{HEADER},x", *rows]) + "\n"))
