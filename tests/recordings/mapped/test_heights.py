from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from crossing import BRIDGE, bridge_height, crossing_rows, write_map

from resim.recordings import read_recording, write_tables
from resim.recordings.mapped.guess import guess
from resim.recordings.mapped.reader import read_mapped
from resim.recordings.tables import read_track_table

MAPPING = """ego = "ego"

[gt]
id = "id"
t = "t"
x = "x"
y = "y"
heading = "heading"
v = "v"
length = "length"
width = "width"
kind = "kind"
{}
"""


def over(t, x, y):
    return bridge_height(y)


@pytest.mark.parametrize(
    ("line", "factor", "above"),
    [
        ('z = "altitude"', 1.0, 0.0),
        ('z = { column = "altitude", unit = "ft" }', 0.3048, 0.0),
        ("z = { value = 3.5 }", 1.0, None),
        ("", 1.0, None),
    ],
)
def test_a_column_of_altitude_is_the_height(tmp_path, line, factor, above):
    rows = crossing_rows(over, over).rename(columns={"z": "altitude"})
    told = rows.assign(altitude=rows["altitude"] / factor)
    told.to_csv(tmp_path / "all.csv", index=False)
    (tmp_path / "mapping.toml").write_text(MAPPING.format(line), encoding="utf-8")
    road = write_map(tmp_path / "map.xodr", north=BRIDGE)
    tables = read_mapped(tmp_path / "all.csv", map=road, columns=tmp_path / "mapping.toml")
    if not line:
        assert "z" not in tables.gt
        return
    expected = np.full(len(rows), 3.5) if above is None else rows["altitude"].to_numpy(float)
    np.testing.assert_allclose(tables.gt["z"], expected, atol=1e-9)
    write_tables(tables, tmp_path / "out")
    again = read_recording(tmp_path / "out").gt
    assert again.z is not None
    np.testing.assert_allclose(again.to_frame()["z"], expected, atol=1e-6)


def test_a_guess_proposes_it_by_its_name(tmp_path):
    rows = crossing_rows(over, over).rename(columns={"z": "Altitude_m"})
    rows.to_csv(tmp_path / "all.csv", index=False)
    told = guess(tmp_path / "all.csv", tmp_path / "mapping.toml")
    assert 'z = { column = "Altitude_m", unit = "m" }' in told
    rows.drop(columns="Altitude_m").to_csv(tmp_path / "none.csv", index=False)
    assert "\nz = " not in guess(tmp_path / "none.csv", tmp_path / "mapping.toml")


def test_a_height_may_be_missing_in_rows(tmp_path):
    rows = crossing_rows(over, over)
    rows.loc[rows["t"] > 5.0, "z"] = np.nan
    rows.to_csv(tmp_path / "gt.csv", index=False)
    read = read_track_table(tmp_path / "gt.csv")
    pd.testing.assert_series_equal(read["z"].reset_index(drop=True), rows["z"].reset_index(drop=True))
