"""A known drive, written as strangers do, comes back from the import."""

from __future__ import annotations

import tempfile
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pyproj import Transformer
from recordings.mapped.strangers import EPOCH, LENGTH, MAP, PLACES, SPEED, Way, drive, same, written

from resim.core.errors import InputError
from resim.core.geometry import wrap_angle
from resim.jobs.schemas import schema_of
from resim.recordings import RecordingTables, read_recording, write_tables
from resim.recordings.mapped.reader import read_mapped


def imported(folder: Path, text: str, file: Path | None = None, **more: object) -> RecordingTables:
    mapping = folder / "mapping.toml"
    mapping.write_text(text, encoding="utf-8")
    arguments: dict = {"ego": "ego", "map": MAP, **more}
    return read_mapped(file or folder / "table.csv", columns=mapping, **arguments)


ways = st.builds(
    Way,
    frame=st.sampled_from(["map", "wgs84", "utm"]),
    reference=st.sampled_from(sorted(PLACES)),
    time=st.sampled_from(["s", "ms", "us", "ns", "frames", "iso", "unix"]),
    speed=st.sampled_from(sorted(SPEED)),
    angle=st.sampled_from(["rad", "deg", "mrad"]),
    zero=st.sampled_from(["x", "north"]),
    clockwise=st.booleans(),
    length=st.sampled_from(sorted(LENGTH)),
    mirrored=st.booleans(),
    offset=st.none() | st.tuples(st.floats(-500, 500), st.floats(-500, 500), st.floats(-3, 3)),
    velocity=st.sampled_from(["v", "xy"]),
    separator=st.sampled_from([",", ";"]),
    parquet=st.booleans(),
)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(way=ways, seen=st.sampled_from(["ego", "sensor"]), relative=st.sampled_from(["v", "xy", "relative"]))
def test_every_way_of_writing_gives_the_drive_back(way: Way, seen: str, relative: str) -> None:
    way = replace(way, decimal="," if way.separator == ";" else ".")
    truth = drive()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path, gt = written(folder, truth, way, "gt")
        others = truth[truth["id"] != "ego"]
        sensed = replace(way, frame=seen, velocity=relative, offset=None)
        rows = truth.copy()
        _, sd = written(folder, rows, sensed, "sd")
        found = imported(folder, f"[gt]\n{gt}\n[sd]\n{sd}\n", path)
    same(found.gt, truth)
    assert found.sd is not None
    same(found.sd, truth)
    assert found.sd["gt_id"].tolist() == found.sd["id"].tolist()
    assert len(others) == len(found.sd[found.sd["gt_id"] != "ego"])
    told = found.settings.provenance
    assert ("original_start" in told) == (way.time in ("iso", "unix"))
    if "original_start" in told:
        assert told["original_start"] == f"unix time {EPOCH:.6f} s"


def test_what_a_table_does_not_tell_is_derived_and_said(tmp_path: Path) -> None:
    truth = drive(bend=1e-6)
    _, gt = written(tmp_path, truth, Way(), "table")
    lines = [
        line
        for line in gt.splitlines()
        if line.split(" =")[0] not in ("heading", "v", "length", "width", "kind")
    ]
    found = imported(tmp_path, "[gt]\n" + "\n".join(lines))
    assert np.abs(wrap_angle(found.gt["heading"].to_numpy() - truth["heading"].to_numpy())).max() < 1e-4
    np.testing.assert_allclose(found.gt["v"], truth["v"], atol=1e-3)
    assert set(found.gt["length"]) == {4.7}
    told = found.settings.provenance
    assert told["gt_headings"] == "along the positions over 0.4 s, kept below 0.5 m/s"
    assert told["gt_speeds"] == "of the positions over 0.4 s"
    assert told["gt_sizes"] == "unknown 4.7 x 1.9 m (3 of 3 objects)"
    assert told["gt_kinds"] == "none given: unknown"


def test_headings_follow_velocities_and_a_standing_object_keeps_its_own(tmp_path: Path) -> None:
    rows = "t,id,x,y,vx,vy\n" + "".join(f"{k / 10},ego,{k},0,{10 if k < 5 else 0},0.0\n" for k in range(10))
    (tmp_path / "table.csv").write_text(rows + "0.0,2,9,9,0,0\n0.1,2,9,9,0,0\n")
    found = imported(tmp_path, '[gt]\nid = "id"\nt = "t"\nx = "x"\ny = "y"\nvx = "vx"\nvy = "vy"\n').gt
    own = found[found["id"] == "ego"]
    assert own["heading"].tolist() == [0.0] * 10
    assert own["v"].tolist() == [10.0] * 5 + [0.0] * 5
    assert found.loc[found["id"] == "2", "heading"].isna().all()  # nobody knows where it looks


def test_missing_values_stay_missing_and_the_folder_can_be_read(tmp_path: Path) -> None:
    truth = drive()
    path, gt = written(tmp_path, truth, Way())
    table = pd.read_csv(path, dtype=str)
    table.loc[3, "px"], table.loc[4, "speed"], table.loc[7, "yaw"] = "", "nan", "N/A"
    table.to_csv(path, index=False)
    found = imported(tmp_path, f"[gt]\n{gt}\n")
    assert found.gt[["x", "v", "heading"]].isna().sum().tolist() == [1, 1, 1]
    write_tables(found, tmp_path / "out")
    with pytest.raises(InputError, match=r"x is nan, expected a finite number"):
        read_recording(tmp_path / "out")


def test_rows_that_are_left_out_are_told(tmp_path: Path) -> None:
    truth = drive()
    path, gt = written(tmp_path, truth, Way())
    table = pd.read_csv(path, dtype=str)
    name = tomllib.loads(gt)["id"]
    others = sorted(set(truth["id"]) - {"ego"})
    table["state"] = np.where(table[name] == others[0], "old", "new")
    table.loc[table.index[table[name] == others[1]][:2], "state"] = "old"
    table.to_csv(path, index=False)
    lost = int((table["state"] == "old").sum())
    found = imported(tmp_path, f'[gt]\nwithout = {{ state = "old" }}\n{gt}\n')
    assert len(found.gt) == len(truth) - lost
    assert found.settings.provenance["gt_left_out"] == (
        f"{lost} of {len(truth)} rows by without (state); entirely gone: 1 of 3 ids ({others[0]})"
    )
    none = imported(tmp_path, f'[gt]\nwithout = {{ state = "none" }}\n{gt}\n')
    assert "gt_left_out" not in none.settings.provenance


def test_an_object_list_without_common_ids_is_assigned(tmp_path: Path) -> None:
    truth = drive()
    written(tmp_path, truth, Way(), "gt")
    _, gt = written(tmp_path, truth, Way(), "gt")
    noise = np.random.default_rng(3)
    seen = truth.assign(
        id=[
            {"ego": "900", "7": "41" if t < 2.0 else "42", "8": "17"}[i]
            for i, t in zip(truth["id"], truth["t"], strict=True)
        ],
        x=truth["x"] + noise.normal(0.0, 0.3, len(truth)),
    )
    ghost = seen[seen["id"] == "17"].assign(id="66", x=lambda f: f["x"] + 40.0)
    _, sd = written(tmp_path, pd.concat([seen, ghost], ignore_index=True), Way(speed="km/h"), "sd")
    found = imported(
        tmp_path, f"[gt]\n{gt}\n[sd]\n{sd}\n[match]\nby = 'nearest'\ngate = 3.0\n", tmp_path / "gt.csv"
    )
    assert found.sd is not None
    named = found.sd.drop_duplicates("id").set_index("id")["gt_id"].to_dict()
    assert named == {"900": "ego", "41": "7", "42": "7", "17": "8", "66": ""}
    told = found.settings.provenance["identity"]
    assert "4 of 5 ids matched, median distance 0.2" in told
    assert told.endswith("1 left over: 66; the EGO is detected as 900")


def test_assignment_gives_up_no_pair_for_a_nearer_one(tmp_path: Path) -> None:
    """Two side by side, both seen 1.8 m to the left: the nearest of one is the other's."""
    places = {"ego": 30.0, "a": 0.0, "b": 3.0}
    rows = [(0.1 * k, name, 15.0 * 0.1 * k, y) for k in range(20) for name, y in places.items()]
    frame = pd.DataFrame(rows, columns=["t", "id", "x", "y"])
    frame.to_csv(tmp_path / "table.csv", index=False)
    others = frame[frame["id"] != "ego"]
    others.assign(id=others["id"].map({"a": "1", "b": "2"}), y=others["y"] + 1.8).to_csv(
        tmp_path / "sd.csv", index=False
    )
    one = 'id = "id"\nt = "t"\nx = "x"\ny = "y"\n'
    found = imported(tmp_path, f"[gt]\n{one}[sd]\nfile = 'sd.csv'\n{one}").sd
    assert found is not None
    assert dict(zip(found["id"], found["gt_id"], strict=True)) == {"1": "a", "2": "b"}


@pytest.mark.parametrize(("by", "column"), [("id", ""), ("column", 'gt_id = "truth"\n')])
def test_identities_may_be_told(tmp_path: Path, by: str, column: str) -> None:
    truth = drive()
    _, gt = written(tmp_path, truth, Way(), "gt")
    _, sd = written(tmp_path, truth, Way(), "sd")
    table = pd.read_csv(tmp_path / "sd.csv", dtype=str)
    table.assign(truth=table["who"].where(table["who"] != "8", "")).to_csv(tmp_path / "sd.csv", index=False)
    found = imported(
        tmp_path, f"[gt]\n{gt}\n[sd]\n{sd}\n{column}[match]\nby = '{by}'\n", tmp_path / "gt.csv"
    ).sd
    assert found is not None
    assert found.drop_duplicates("id")["gt_id"].tolist() == ["ego", "7", "8" if by == "id" else ""]


def test_one_table_may_hold_both_and_several_files_one_source(tmp_path: Path) -> None:
    truth = drive()
    path, told = written(tmp_path, truth, Way())
    table = pd.read_csv(path, dtype=str)
    pd.concat([table.assign(source="ref"), table.assign(source="cam")]).to_csv(path, index=False)
    found = imported(
        tmp_path, f"[gt]\n{told}\nonly = {{ source = 'ref' }}\n[sd]\n{told}\nonly = {{ source = 'cam' }}\n"
    )
    assert found.sd is not None
    same(found.gt, truth)
    same(found.sd, truth)
    parts = ""
    for name in ("ego", "7", "8"):
        path, text = written(tmp_path, truth[truth["id"] == name], Way(), f"log_{name}")
        parts += f"[[gt]]\n{text}\n".replace('id = "who"', f'id = {{ value = "{name}" }}')
    same(imported(tmp_path, parts, path).gt, truth)


def test_the_published_schema_takes_what_the_reader_takes(tmp_path: Path) -> None:
    schema = jsonschema.Draft202012Validator(schema_of("mapping"))
    schema.check_schema(schema.schema)
    _, gt = written(tmp_path, drive(), Way(frame="wgs84", time="frames"))
    _, sd = written(tmp_path, drive(), Way(frame="sensor", velocity="relative"), "sd")
    for text in (f"ego = 'ego'\n[gt]\n{gt}\n[sd]\n{sd}\n[match]\nby = 'id'", f"[[gt]]\n{gt}\n[[gt]]\n{gt}"):
        assert schema.is_valid(tomllib.loads(text))
        for wrong in (
            text.replace("id =", "idd =", 1),
            text.replace('"km/h"', "3"),
            text.replace('"m/s"', '"m/h"'),
        ):
            assert wrong == text or not schema.is_valid(tomllib.loads(wrong))


def test_a_window_keeps_the_clock(tmp_path: Path) -> None:
    _, gt = written(tmp_path, drive().assign(t=lambda f: f["t"] + 5.0), Way())
    found = imported(tmp_path, f"[gt]\n{gt}\n", start=6.0, end=7.0)
    assert (found.gt["t"].min(), found.gt["t"].max()) == (pytest.approx(6.0), pytest.approx(7.0))
    assert found.settings.provenance["gt_outside"] == "87 rows before 6 s or after 7 s left out"
    with pytest.raises(InputError, match=r"present from 5 to 8\.9 s, the requested window is 1 to 7 s"):
        imported(tmp_path, f"[gt]\n{gt}\n", start=1.0, end=7.0)


WRONG = {
    "column": ('id = "who"', 'id = "wo"', r"table\.csv: has no column 'wo', which gt\.id names, did you mean 'who'\?"),
    "unit": ('unit = "m/s"', 'unit = "km/u"', r"mapping\.toml: gt\.v\.unit: expected .*'km/h'.*found 'km/u'"),
    "field": ("id =", "idd =", r"gt\.idd: there is no such field, did you mean 'id'\?"),
    "length unit": ('px", unit = "m"', 'px", unit = "deg"', r"gt\.x is in 'deg', but coordinates here are lengths"),
    "no number": ('"speed"', '"who"', r"row 2: who \(gt\.v\) is 'ego', expected a finite number or nothing"),
    "frames": ('unit = "s"', 'unit = "frames"', r"gt\.t is in frames, and nothing says how many a second.*--rate"),
    "iso": ('unit = "s"', 'unit = "iso"', r"row 2: when \(gt\.t\) is '0\.0', expected a time such as"),
    "crs": ("[gt]", '[gt]\ncrs = "EPSG:99"', r"gt\.crs is 'EPSG:99', which pyproj does not know"),
    "degrees": ("[gt]", '[gt]\ncrs = "EPSG:4326"', r"gt\.x is in 'm', but latitude and longitude are angles"),
    "far": ("[gt]", '[gt]\ncrs = "EPSG:32632"', r"lie \d+ km from the map. Is the crs another one"),
    "sensor": ("[gt]", '[gt]\nframe = "sensor"', r'gt: frame = "sensor" needs mounting'),
    "axle": ("[gt]", '[gt]\nreference = "rear axle"', r'reference = "rear axle" needs rear_overhang \[m\]'),
    "only": ("[gt]", "[gt]\nonly = { class = '9' }", r"no row has '9' in 'class' \(gt\.only\)"),
    "file": ('file = "table.csv"', 'file = "tabel.csv"', r"tabel\.csv: there is no such file"),
    "match": ("[gt]", "[match]\nby = 'id'\n[gt]", r"match is given, but there is no table sd"),
    "both": ("[gt]", "[gt]\nvx = 'px'\nvy = 'py'", r"v excludes vx and vy: give one"),
    "pose": ("[gt]", "[gt]\noffset = [1.0, 2.0]", r"gt\.offset\.2: is missing"),
    "ego frame": ("[gt]", '[gt]\nframe = "ego"', r"the EGO itself needs a table in gt with a crs"),
    "kind": ('"2" = "truck"', '"2" = "lorry"', r"gt\.kind\.names\.2: expected .*'truck'.*found 'lorry'"),
    "nothing": ('"who"', "{ }", r"gt\.id: expected a column, or \{ value = \.\.\. \}"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_refuses(tmp_path: Path, case: str) -> None:
    old, new, message = WRONG[case]
    _, gt = written(tmp_path, drive(), Way())
    text = f"[gt]\n{gt}\n"
    assert old in text
    with pytest.raises(InputError, match=message):
        imported(tmp_path, text.replace(old, new, 1))


@pytest.mark.parametrize("rate", [-25.0, 0.0, 1e-300, float("nan"), float("inf")])
def test_refuses_a_rate_that_is_none(tmp_path: Path, rate: float) -> None:
    _, gt = written(tmp_path, drive(), Way(time="frames"))
    with pytest.raises(InputError, match=r"--rate: .* Hz is no rate. Give frames a second, 0.001 to"):
        imported(tmp_path, f"[gt]\n{gt.replace(', rate = 10.0', '')}\n", rate=rate)


def test_refuses_an_ego_that_is_not_there(tmp_path: Path) -> None:
    _, gt = written(tmp_path, drive(), Way())
    with pytest.raises(
        InputError, match=r"ego 'eggo' was not found in gt, did you mean 'ego'\? It has ego, 7, 8"
    ):
        imported(tmp_path, f"[gt]\n{gt}\n", ego="eggo")
    with pytest.raises(InputError, match=r"mapping\.toml: names no ego, and --ego is missing"):
        imported(tmp_path, f"[gt]\n{gt}\n", ego=None)


def test_refuses_tables_without_a_common_time(tmp_path: Path) -> None:
    _, gt = written(tmp_path, drive(), Way(), "gt")
    _, sd = written(tmp_path, drive(), Way(time="unix"), "sd")
    text = r"sd lasts from 1\.7145504e\+09 to .* they have no common time. Compare the units"
    with pytest.raises(InputError, match=text):
        imported(tmp_path, f"[gt]\n{gt}\n[sd]\n{sd}\n", tmp_path / "gt.csv")
    _, sd = written(tmp_path, drive().assign(t=lambda f: f["t"] + 60.0), Way(), "sd")
    with pytest.raises(
        InputError, match=r"is in the frame of the EGO, which has no sample at any of its times"
    ):
        imported(tmp_path, f"[gt]\n{gt}\n[sd]\nframe = 'ego'\n{sd}\n", tmp_path / "gt.csv")


def test_refuses_degrees_without_a_geo_reference_and_swapped_ones(tmp_path: Path) -> None:
    _, gt = written(tmp_path, drive(), Way(frame="wgs84"))
    road = tmp_path / "bare.xodr"
    text = MAP.read_text()
    begin, end = text.index("<geoReference>"), text.index("</geoReference>")
    road.write_text(text[:begin] + text[end + len("</geoReference>") :])
    with pytest.raises(InputError, match=r"bare\.xodr: has no geoReference, which a table with a crs needs"):
        imported(tmp_path, f"[gt]\n{gt}\n", map=road)
    road.write_text(text[:begin] + "<geoReference>nowhere" + text[end:])
    with pytest.raises(InputError, match=r"geoReference is 'nowhere', which pyproj does not know"):
        imported(tmp_path, f"[gt]\n{gt}\n", map=road)
    swapped = gt.replace("breite", "?").replace("laenge", "breite").replace("?", "laenge")
    with pytest.raises(
        InputError, match=r"km from the map. Is the crs another one, or are breite and laenge swapped"
    ):
        imported(tmp_path, f"[gt]\n{swapped}\n")


def test_the_offset_of_the_maps_header_counts(tmp_path: Path) -> None:
    """The map's frame lies at x, y in its projection, turned by hdg."""
    truth = drive()
    _, gt = written(tmp_path, truth, Way(frame="wgs84"))
    text = MAP.read_text()
    road = tmp_path / "moved.xodr"
    road.write_text(
        text.replace("</geoReference>", '</geoReference><offset x="100.0" y="-40.0" z="0.0" hdg="0.3"/>')
    )
    found = imported(tmp_path, f"[gt]\n{gt}\n", map=road).gt
    p = ((truth["x"] - 100.0) + 1j * (truth["y"] + 40.0)) * np.exp(-0.3j)
    same(found, truth.assign(x=p.to_numpy().real, y=p.to_numpy().imag, heading=truth["heading"] - 0.3))


def test_a_system_of_heights_in_the_geo_reference_does_no_harm(tmp_path: Path) -> None:
    """As RoadRunner writes it, with what UTM does not need and the grid of a geoid that few machines have."""
    _, gt = written(tmp_path, drive(), Way(frame="wgs84"))
    text, found = MAP.read_text(), []
    begin, end = text.index("<geoReference>"), text.index("</geoReference>")
    x, y = Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True).transform(11.0, 48.0)
    for more in ("", " +lat_0=37.35 +lon_0=-122.1 +k_0=1 +x_0=0 +y_0=0 +geoidgrids=egm96_15.gtx +vunits=m"):
        road = tmp_path / "utm.xodr"
        utm = f"<geoReference>+proj=utm +zone=32 +datum=WGS84{more} +units=m +no_defs</geoReference>"
        utm += f'<offset x="{x}" y="{y}" z="0.0" hdg="0.0"/>'
        road.write_text(text[:begin] + utm + text[end + len("</geoReference>") :])
        found.append(imported(tmp_path, f"[gt]\n{gt}\n", map=road).gt)
    pd.testing.assert_frame_equal(*found)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", r"is empty \(0 bytes\)"),
        (b"who,when\n", r"has a header and no rows"),
        (b'who,when\n"a,1\nb,2\n', r"not a readable CSV file|goes on over the next lines"),
        (b"who,when\n\xff\xfe,1\n", r"is not a readable CSV file"),
        (b"when,when\n1,2\n", r"has more than one column 'when'"),
    ],
)
def test_refuses_files_that_are_no_tables(tmp_path: Path, raw: bytes, message: str) -> None:
    _, gt = written(tmp_path, drive(), Way())
    (tmp_path / "table.csv").write_bytes(raw)
    with pytest.raises(InputError, match=message):
        imported(tmp_path, f"[gt]\n{gt}\n")


def test_a_file_that_no_table_reads_is_refused(tmp_path: Path) -> None:
    _, gt = written(tmp_path, drive(), Way(), "table")
    other = tmp_path / "other.csv"
    other.write_bytes((tmp_path / "table.csv").read_bytes())
    text = f"[gt]\n{gt}\n" if "file =" in gt else f'[gt]\nfile = "table.csv"\n{gt}\n'
    assert len(imported(tmp_path, text, tmp_path / "table.csv").gt)
    with pytest.raises(InputError, match=r"other\.csv: is read by no table of mapping\.toml"):
        imported(tmp_path, text, other)


def test_rows_of_several_values_are_one_table(tmp_path: Path) -> None:
    truth = drive()
    _, gt = written(tmp_path, truth, Way(), "table")
    column = next(line for line in gt.splitlines() if line.startswith("id =")).partition("=")[2].strip()
    ids = sorted(set(truth["id"]))
    found = imported(
        tmp_path, f"[gt]\n{gt}\nonly = {{ {column} = {ids[:2]!r} }}\n".replace("'", '"'), ego=ids[0]
    )
    assert sorted(set(found.gt["id"])) == ids[:2]
    with pytest.raises(InputError, match="no row has 'nobody'"):
        imported(tmp_path, f'[gt]\n{gt}\nonly = {{ {column} = ["{ids[0]}", "nobody"] }}\n', ego=ids[0])
