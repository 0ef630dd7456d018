"""What the guess makes of strangers' tables is what they meant, or says that somebody has to fill it in."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pytest
from recordings.mapped.strangers import MAP, Way, drive, geographic, same, written

from resim.core.errors import InputError
from resim.recordings.mapped.guess import fill_ins, guess
from resim.recordings.mapped.mapping import read_mapping
from resim.recordings.mapped.reader import read_mapped
from resim.road.opendrive import load

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data"
WAYS = {
    "compass": Way(frame="wgs84", time="iso", speed="km/h", angle="deg", zero="north", clockwise=True),
    "utm": Way(frame="utm", time="unix", separator=";", decimal=",", speed="mph"),
    "plain": Way(),
    "parquet": Way(time="ms", angle="deg", speed="km/h", parquet=True),
    "clockwise": Way(clockwise=True, time="us"),
    "cm": Way(speed="cm/s", time="ns", zero="north"),
}


def filled(text: str) -> str:
    """The kinds, which are numbers in these tables, filled in."""
    return text.replace('"1" = "unknown", "2" = "unknown"', '"1" = "car", "2" = "truck"')


@pytest.mark.parametrize("name", WAYS)
def test_a_guessed_mapping_gives_the_drive_back(tmp_path: Path, name: str) -> None:
    truth = drive()
    path, _ = written(tmp_path, truth, WAYS[name], "gt")
    out = tmp_path / "mapping.toml"
    text = guess(path, out, network=load(MAP))
    out.write_text(filled(text))
    same(read_mapped(path, map=MAP, columns=out).gt, truth)


@pytest.mark.parametrize("grid", [False, True])
def test_german_names_are_read(tmp_path: Path, grid: bool) -> None:
    """Beside positions Länge and Breite are the sides of a box; without, those of the Earth's grid."""
    told = {"x": "Ostwert [m]", "y": "Nordwert [m]", "length": "Länge [m]", "width": "Breite [m]"}
    if grid:
        told = {"lon": "Länge", "lat": "Breite"}
    columns = {"t": "Zeit_s", "id": "Objekt-Nr", "heading": "Kurs [Grad]", "v": "Geschwindigkeit [km/h]",
               "kind": "Fahrzeugart", **told}  # fmt: skip
    frame = drive()
    frame["lat"], frame["lon"] = geographic(frame["x"].to_numpy(), frame["y"].to_numpy())
    frame = frame.assign(
        id=frame["id"].replace("ego", "Ego-Fahrzeug"),
        heading=np.degrees(0.5 * np.pi - frame["heading"]),
        v=3.6 * frame["v"],
        kind=frame["kind"].replace({"car": "PKW", "truck": "LKW"}),
    )
    path = tmp_path / "fahrt.csv"
    frame[list(columns)].rename(columns=columns).to_csv(path, index=False)
    text = guess(path, tmp_path / "m.toml", network=load(MAP))
    (tmp_path / "m.toml").write_text(text)
    tables = read_mapped(path, map=MAP, columns=tmp_path / "m.toml")
    assert tables.settings.ego == "Ego-Fahrzeug"
    truth = drive().assign(id=lambda f: f["id"].replace("ego", "Ego-Fahrzeug"))
    for name in ("x", "y", "v", *([] if grid else ["length", "width"])):
        np.testing.assert_allclose(tables.gt[name], truth[name], atol=1e-4 if grid else 1e-6, err_msg=name)
    assert tables.gt["kind"].tolist() == truth["kind"].tolist()


def test_a_speed_that_is_not_what_its_name_says_is_asked_about(tmp_path: Path) -> None:
    """As that of a relative speed in km/h: no unit is taken for it."""
    path = tmp_path / "gt.csv"
    frame = drive()
    frame.rename(columns={"v": "v [km/h]"}).assign(**{"v [km/h]": 2.23694 * frame["v"]}).to_csv(
        path, index=False
    )
    (line,) = [
        line for line in guess(path, tmp_path / "m.toml", network=load(MAP)).splitlines() if "v [km" in line
    ]
    assert line.startswith("# v = ")
    assert "as of mph" in line


def test_a_sensors_table_is_guessed_beside_it(tmp_path: Path) -> None:
    truth = drive()
    path, _ = written(tmp_path, truth, WAYS["compass"], "gt")
    seen, _ = written(tmp_path, truth, Way(frame="ego", velocity="xy", time="unix"), "sd")
    out = tmp_path / "mapping.toml"
    text = guess(path, out, sensor=seen, network=load(MAP))
    left = fill_ins(text)
    assert any(line.startswith("# heading") for line in left)
    assert any(line.startswith("# vx") and "relative" in line for line in left)
    for line in left:
        if line.startswith(("# heading", "# vx", "# vy")):
            text = text.replace(line, line.removeprefix("# "))
    out.write_text(filled(text))
    with pytest.raises(InputError, match=r"sd\.frame: expected 'map', 'ego' or 'sensor', found '\?'"):
        read_mapping(out)  # the map has roads there, too
    out.write_text(filled(text).replace('frame = "?"', 'frame = "ego"'))
    found = read_mapped(path, map=MAP, columns=out).sd
    assert found is not None
    same(found, truth)


def test_a_mirrored_y_is_told_by_the_map(tmp_path: Path) -> None:
    network = load(MAP)
    x, y = network.to_xy("1", -2, np.linspace(400.0, 440.0, 41), 0.0)
    table = pd.DataFrame({"time_ms": np.arange(41) * 50, "x": x, "y": -y})
    table.to_csv(tmp_path / "t.csv", index=False)
    text = guess(tmp_path / "t.csv", tmp_path / "m.toml", network=network)
    (tmp_path / "m.toml").write_text(text)
    assert read_mapping(tmp_path / "m.toml").gt[0].mirrored
    assert 'id = { value = "ego" }' in text
    assert '{ column = "time_ms", unit = "ms" }' in text


def test_what_the_table_does_not_tell_is_left_to_fill_in(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t,x,y,heading,v\n,,,,\nnan,,,,\n0.1,,,,\n")
    assert "FILL IN: the positions" in guess(tmp_path / "t.csv", tmp_path / "m.toml", network=load(MAP))
    (tmp_path / "t.csv").write_text("a1,a2\n1,2\n3,4\n")
    text = guess(tmp_path / "t.csv", tmp_path / "m.toml")
    assert len(fill_ins(text)) >= 6
    (tmp_path / "m.toml").write_text(text)
    with pytest.raises(InputError, match=r"gt\.id: is missing|gt\.t: is missing"):
        read_mapping(tmp_path / "m.toml")


def table(folder: Path, order: list[str]) -> Path:
    """A table whose names say nothing of time and ids: two objects at 25 Hz, one of them from 1 s on."""
    t = 0.04 * np.arange(100)
    rows = pd.concat(
        [
            pd.DataFrame({"c1": t[n:], "c2": k, "x": 5.0 * t[n:], "y": 4.0 * k, "q": np.sin(t[n:])})
            for k, n in ((7, 0), (9, 25))
        ]
    )
    rows.sort_values(order).to_csv(folder / "t.csv", index=False)
    return folder / "t.csv"


@pytest.mark.parametrize("order", [["c1", "c2"], ["c2", "c1"]])
def test_times_and_ids_without_names_are_proposed_by_their_numbers(tmp_path: Path, order: list[str]) -> None:
    text = guess(table(tmp_path, order), tmp_path / "m.toml")
    (ids,) = (line for line in fill_ins(text) if line.startswith("# id = "))
    assert ids.startswith('# id = "c2"')
    assert "2 values in 175 rows" in ids
    if order == ["c1", "c2"]:
        (clock,) = (line for line in fill_ins(text) if line.startswith("# t = "))
        assert clock.startswith('# t = { column = "c1"')
        assert "it never falls down the table, and its steps are 0.04" in clock
    assert '"q"' not in "".join(line for line in fill_ins(text) if line.startswith(("# id", "# t ")))


def test_a_time_without_a_name_is_proposed_by_the_steps_of_each_object(tmp_path: Path) -> None:
    path = table(tmp_path, ["c2", "c1"])
    path.write_text(path.read_text().replace("c1,c2,x,y,q", "c1,track,x,y,q"))
    (clock,) = (line for line in fill_ins(guess(path, tmp_path / "m.toml")) if line.startswith("# t = "))
    assert clock.startswith('# t = { column = "c1"')
    assert "of each object, and its steps are 0.04" in clock


def test_an_id_that_stands_twice_at_a_time_is_none(tmp_path: Path) -> None:
    path = table(tmp_path, ["c1", "c2"])
    rows = pd.read_csv(path).rename(columns={"c1": "time"})
    rows["sensor"] = 3
    rows.to_csv(path, index=False)
    (ids,) = (line for line in fill_ins(guess(path, tmp_path / "m.toml")) if line.startswith("# id = "))
    assert "c2: 2 values in 175 rows, none twice at a time" in ids
    assert "sensor" not in ids


def test_names_and_values_of_a_table_add_no_line(tmp_path: Path) -> None:
    rows = pd.DataFrame(
        {"t": [0.0, 0.1], "x": [0.0, 1.0], "y": [0.0, 0.0], "id": ['a"b', 'a"b'], "type": ["]\nego", "x"]}
    )
    rows["type"] = ['bus"]', "x\\"]
    rows.to_csv(tmp_path / "t.csv", index=False)
    (tmp_path / "m.toml").write_text(guess(tmp_path / "t.csv", tmp_path / "m.toml"))
    told = read_mapping(tmp_path / "m.toml")
    assert told.gt[0].kind is not None
    assert set(told.gt[0].kind.names) == {'bus"]', "x\\"}


def test_the_command_writes_it_and_never_over_another(tmp_path: Path) -> None:
    path, _ = written(tmp_path, drive(), replace(WAYS["compass"]), "gt")
    words = [sys.executable, "-m", "resim", "import", "guess", str(path), "--map", str(MAP), "--out"]
    done = subprocess.run(
        [*words, str(tmp_path / "m.toml")], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert "1 lines to fill in" in done.stdout
    again = subprocess.run(
        [*words, str(tmp_path / "m.toml")], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert (again.returncode, "exists already" in again.stderr) == (2, True)


def test_a_real_recording_is_guessed(tmp_path: Path) -> None:
    """highD's columns of the published schema: frames, corners of boxes."""
    csv = DATA / "highd_format" / "us101_22" / "01_tracks.csv"
    if not csv.is_file():
        pytest.skip("the shared data are not on this machine")
    text = guess(csv, tmp_path / "m.toml")
    assert 'id = "id"' in text
    assert any(line.startswith("# t =") and "frames" in line for line in fill_ins(text))
    rated = text.replace("# t =", "t =").replace("# ego =", "ego =")
    (tmp_path / "m.toml").write_text(rated)
    road = DATA / "ngsim" / "USA_US101-22_1_T-1.xodr"
    found = read_mapped(csv, map=road, columns=tmp_path / "m.toml", rate=10.0)
    assert found.gt["id"].nunique() > 20


def headings_of(folder: Path, heading: object, *, name: str = "heading") -> list[str]:
    """What the guess says of the headings of somebody who drives straight on, and of one who stands aside."""
    t = np.round(np.arange(0.0, 4.0, 0.04), 2)
    own = pd.DataFrame({"t": t, "id": "ego", "x": 20.0 * t, "y": 0.0, name: 0.0, "v": 20.0})
    aside = pd.DataFrame({"t": t, "id": "1", "x": 100.0, "y": 9.0, name: heading, "v": 0.0})
    pd.concat([own, aside]).to_csv(folder / "t.csv", index=False)
    text = guess(folder / "t.csv", folder / "m.toml")
    return [line for line in text.splitlines() if line.lstrip("# ").startswith("heading =")]


def test_headings_beyond_a_turn_are_no_radians(tmp_path: Path) -> None:
    (line,) = headings_of(tmp_path, 44.0)
    assert line.startswith('# heading = { column = "heading", unit = "deg"')
    assert "FILL IN" in line
    assert "rad, x" not in line
    (line,) = headings_of(tmp_path, 44.0, name="heading_rad")
    assert "FILL IN: numbers up to 44 are no radians" in line


def test_conventions_that_fit_equally_are_all_named_and_none_is_taken(tmp_path: Path) -> None:
    (line,) = headings_of(tmp_path, 0.7)
    assert line.startswith("# heading = ")
    assert "FILL IN" in line
    for other in ("rad, x, clockwise true", "deg, x, clockwise false", "deg, x, clockwise true"):
        assert other in line


@pytest.mark.parametrize("names", ["t,t,x,y", "id,id,x,y", "t,id,x,x", "t,v,v,y"])
def test_a_column_that_is_there_twice_is_told(tmp_path: Path, names: str) -> None:
    (tmp_path / "t.csv").write_text(f"{names}\n0,1,2,3\n1,1,2,3\n")
    with pytest.raises(
        InputError, match=r"t\.csv: has more than one column '(t|id|x|v)', which gt\.\w+ names"
    ):
        guess(tmp_path / "t.csv", tmp_path / "m.toml")


def test_a_sensor_that_sees_where_the_truth_drives_may_be_in_the_maps_frame(tmp_path: Path) -> None:
    t = np.round(np.arange(0.0, 8.0, 0.04), 2)
    own = pd.DataFrame({"t": t, "id": "ego", "x": 20.0 + 20.0 * t, "y": -5.25})
    own.to_csv(tmp_path / "gt.csv", index=False)
    own.assign(id="9", x=120.0).to_csv(tmp_path / "sd.csv", index=False)
    for x, y in ((120.0, -5.25), (-30.0, 30.0)):  # where it drives, and beside
        own.assign(id="9", x=x, y=y).to_csv(tmp_path / "sd.csv", index=False)
        left = fill_ins(guess(tmp_path / "gt.csv", tmp_path / "m.toml", sensor=tmp_path / "sd.csv"))
        assert any(line.startswith('frame = "?"') and '"map"' in line for line in left)
    own.drop(columns=["x", "y"]).assign(lat=48.0 + 1e-5 * t, lon=11.0).to_csv(
        tmp_path / "gt.csv", index=False
    )
    for network, sure in ((None, False), (load(MAP), False)):
        text = guess(tmp_path / "gt.csv", tmp_path / "m.toml", sensor=tmp_path / "sd.csv", network=network)
        assert ('\nframe = "ego"' in text) is sure
    own.assign(x=own["x"] + 5000.0).to_csv(tmp_path / "gt.csv", index=False)
    text = guess(tmp_path / "gt.csv", tmp_path / "m.toml", sensor=tmp_path / "sd.csv")
    assert '\nframe = "ego"' in text  # the map's roads are far from there


PARQUET = {
    "ids that are null": "t, NULL::VARCHAR AS id, x, y",
    "ids that are lists": "t, [1, 2] AS id, x, y",
    "positions that are lists": "t, id, [x, 2.0] AS x, y",
    "times that are lists": "[t] AS t, id, x, y",
    "times of year 1": "TIMESTAMP '0001-01-01' AS t, id, x, y",
    "times without end": "'infinity'::TIMESTAMP AS t, id, x, y",
    "times that are intervals": "INTERVAL 3 DAYS AS t, id, x, y",
}


@pytest.mark.parametrize("unit", ["s", "iso"])
@pytest.mark.parametrize("what", PARQUET)
def test_values_that_no_cell_should_hold_are_told(tmp_path: Path, what: str, unit: str) -> None:
    path = tmp_path / "t.parquet"
    rows = "(SELECT unnest([0.0, 0.1, 0.2]) AS t, 'ego' AS id, 1.0 AS x, 2.0 AS y)"
    with duckdb.connect() as db:
        db.execute(f"COPY (SELECT {PARQUET[what]} FROM {rows}) TO '{path}' (FORMAT parquet)")
    assert fill_ins(guess(path, tmp_path / "g.toml"))
    mapping = f'ego = "ego"\n[gt]\nid = "id"\nt = {{ column = "t", unit = "{unit}" }}\nx = "x"\ny = "y"\n'
    (tmp_path / "m.toml").write_text(mapping)
    with pytest.raises(InputError, match=r"t\.parquet: row 1: (t|id|x) \(gt\.\w+\) is .*, expected"):
        read_mapped(path, map=MAP, columns=tmp_path / "m.toml")


def test_a_first_line_without_end_is_no_header(tmp_path: Path) -> None:
    path = tmp_path / "zeros.csv"
    with path.open("wb") as file:
        file.truncate(2_000_000_000)
    with pytest.raises(InputError, match="first line has more than 1,000,000 characters"):
        guess(path, tmp_path / "m.toml")


def test_a_table_of_too_many_columns_is_none(tmp_path: Path) -> None:
    path = tmp_path / "wide.csv"
    path.write_text(",".join(f"c{k}" for k in range(100_000)) + "\n" + "1," * 99_999 + "1\n")
    with pytest.raises(InputError, match="it has 100,000 columns, up to 5,000 are read"):
        guess(path, tmp_path / "m.toml")
