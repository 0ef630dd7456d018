"""Exported drives, read back by code of the tests: everybody is where the recording has it, in every format."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import DATA, ROOT
from lxml import etree

from resim.core.errors import InputError
from resim.jobs.export import export_openscenario

pytest.importorskip("scenariogeneration")


class Played:
    """What a player makes of a file: boxes of entities over time, by linear interpolation of their polylines."""

    def __init__(self, path: Path) -> None:
        self.root = etree.parse(path).getroot()
        self.names = [one.get("name") for one in self.root.iterfind("Entities/ScenarioObject")]

    def box(self, name: str) -> pd.DataFrame:
        """t, x, y of the middle of the box, and heading."""
        at = self.root.find(f"Entities/ScenarioObject[@name='{name}']")
        middle = float(at.find(".//Center").get("x"))
        rows = []
        for vertex in self.root.iterfind(f".//ManeuverGroup[@name='group {name}']//Vertex"):
            place = vertex.find("Position/WorldPosition")
            x, y, h = (float(place.get(axis)) for axis in "xyh")
            rows.append((float(vertex.get("time")), x + middle * np.cos(h), y + middle * np.sin(h), h))
        return pd.DataFrame(rows, columns=["t", "x", "y", "heading"])

    def times(self, name: str, action: str) -> list[float]:
        group = f".//ManeuverGroup[@name='group {name}']//Event[Action//{action}]"
        return [float(one.get("value")) for one in self.root.xpath(f"{group}//SimulationTimeCondition")]


def resim(*order: object) -> None:
    subprocess.run(
        [sys.executable, "-m", "resim", *map(str, order)], cwd=ROOT, check=True, capture_output=True
    )


def measured(folder: Path, name: str) -> pd.DataFrame:
    rows = pd.read_csv(folder / "gt.csv") if (folder / "gt.csv").is_file() else None
    assert rows is not None
    rows = rows.assign(t=rows.t - rows.t.min())
    return rows[rows.id.astype(str) == name]


@pytest.mark.parametrize("drive", ["cut_in_brake", "rear_end", "overtake"])
@pytest.mark.parametrize("version", ["1.1", "1.2", "1.3"])
def test_everybody_is_where_the_recording_has_it(tmp_path: Path, drive: str, version: str) -> None:
    folder = ROOT / "scenarios" / drive
    report = export_openscenario(folder, tmp_path / "out", version=version)
    assert [*report.sources] == ["GT", "SD"]
    assert (tmp_path / "out" / report.map).read_bytes() == (
        ROOT / "networks" / "proving_ground.xodr"
    ).read_bytes()
    file = Played(tmp_path / "out" / "GT.xosc")
    assert file.root.find("FileHeader").get("revMinor") == version[-1]
    assert len(file.names) > 1
    for name in file.names:
        own = "ego" if name == "Ego" else name.removeprefix("object_")
        true, found = measured(folder, own), file.box(name)
        inside = true[(true.t >= found.t.iloc[0]) & (true.t <= found.t.iloc[-1])]
        assert len(inside) > 0.98 * len(true)
        off = np.hypot(
            np.interp(inside.t, found.t, found.x) - inside.x, np.interp(inside.t, found.t, found.y) - inside.y
        )
        assert off.max() < 0.05, name
        assert (np.diff(found.t) > 0.0).all()


@pytest.mark.parametrize("clock", [-7.5, 100.0, 1_732_500_000.0])
def test_a_clock_that_begins_at_any_time_counts_from_the_start(tmp_path: Path, clock: float) -> None:
    at_zero = ROOT / "scenarios" / "cut_in_brake"
    shifted = tmp_path / "shifted"
    shutil.copytree(at_zero, shifted)
    for name in ("gt.csv", "sd.csv", "plan.csv"):
        rows = pd.read_csv(shifted / name)
        for column in {"t", "t_plan"} & set(rows):
            rows[column] += clock
        rows.to_csv(shifted / name, index=False)
    file, road = shifted / "recording.toml", ROOT / "networks" / "proving_ground.xodr"
    text = file.read_text(encoding="utf-8")
    file.write_text(re.sub('map = ".*"', f'map = "{road}"', text), encoding="utf-8")
    found = []
    for k, folder in enumerate((at_zero, shifted)):
        export_openscenario(folder, tmp_path / f"out{k}")
        found.append(Played(tmp_path / f"out{k}" / "GT.xosc"))
    assert found[0].names == found[1].names
    for name in found[0].names:
        one, two = (file.box(name) for file in found)
        np.testing.assert_allclose(two.t, one.t, rtol=0, atol=1e-6)
        np.testing.assert_allclose(two[["x", "y"]], one[["x", "y"]], rtol=0, atol=2e-4)


def test_the_same_drive_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        export_openscenario(ROOT / "scenarios" / "overtake", tmp_path / name)
    one, two = (
        {file.name: file.read_bytes() for file in (tmp_path / name).iterdir()} for name in ("one", "two")
    )
    assert one == two


def test_who_comes_late_or_goes_early_is_there_no_longer_than_that(tmp_path: Path) -> None:
    """A vehicle that waited on the road for its first time, or after its last, would be an obstacle."""
    source = ROOT / "scenarios" / "cut_in_brake"
    folder = tmp_path / "drive"
    folder.mkdir()
    rows = pd.read_csv(source / "gt.csv")
    other = rows[rows.id.astype(str) != "ego"].id.iloc[0]
    rows = rows[(rows.id != other) | rows.t.between(2.0, 5.0)]
    rows.to_csv(folder / "gt.csv", index=False)
    (folder / "recording.toml").write_text(
        f'name = "late"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    export_openscenario(folder, tmp_path / "out")
    file = Played(tmp_path / "out" / "GT.xosc")
    own = f"object_{other}"
    assert file.times(own, "AddEntityAction") == [2.0]
    assert file.times(own, "DeleteEntityAction") == [5.0]
    assert file.times("Ego", "AddEntityAction") == file.times("Ego", "DeleteEntityAction") == []
    init = {one.get("entityRef") for one in file.root.iterfind("Storyboard/Init//Private")}
    assert init == {*file.names} - {own}
    stop = file.root.find("Storyboard/StopTrigger//SimulationTimeCondition")
    assert float(stop.get("value")) == pytest.approx(rows[rows.id.astype(str) == "ego"].t.max())


def test_names_are_unique_and_may_be_written(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    rows = pd.read_csv(ROOT / "scenarios" / "cut_in_brake" / "gt.csv")
    other = rows[rows.id.astype(str) != "ego"].id.iloc[0]
    parts = [rows[rows.id.astype(str) == "ego"]]
    parts += [
        rows[rows.id == other].assign(id=name, x=rows.x + 60.0 * (k + 1))
        for k, name in enumerate(["a <&> b", "a _&_ b", "A _&_ B"])
    ]
    pd.concat(parts).to_csv(folder / "gt.csv", index=False)
    (folder / "recording.toml").write_text(
        f'name = "names"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    export_openscenario(folder, tmp_path / "out", accept=[])
    names = Played(tmp_path / "out" / "GT.xosc").names
    assert len({name.lower() for name in names}) == len(names) == 4
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyzABE_go.-j") for name in names)


@pytest.mark.skipif(not (DATA / "ngsim").is_dir(), reason="needs ../shared/data")
def test_real_traffic_is_where_it_was_measured(tmp_path: Path) -> None:
    """Against the file of the data set, read by the test: 54 vehicles at 30 m of a motorway."""
    source = DATA / "ngsim" / "USA_US101-22_1_T-1.xml"
    order = ["import", "commonroad", source, "--map", source.with_suffix(".xodr"), "--ego", "659"]
    resim(*order, "--out", tmp_path / "drive")
    export_openscenario(tmp_path / "drive", tmp_path / "out")
    file = Played(tmp_path / "out" / "GT.xosc")
    root = etree.parse(source).getroot()
    off = []
    for obstacle in root.iterfind("obstacle"):
        name = "Ego" if obstacle.get("id") == "659" else f"object_{obstacle.get('id')}"
        if name not in file.names:
            continue
        found = file.box(name)
        for state in obstacle.iterfind(".//*[time]"):
            t = float(state.findtext("time/exact"))  # s in this version
            if state.find("position/point") is None or not found.t.iloc[0] <= t <= found.t.iloc[-1]:
                continue
            x, y = (float(state.findtext(f"position/point/{axis}")) for axis in "xy")
            off.append(np.hypot(np.interp(t, found.t, found.x) - x, np.interp(t, found.t, found.y) - y))
    assert len(off) > 1000
    assert np.sqrt(np.mean(np.square(off))) < 0.1
    assert np.quantile(off, 0.99) < 0.3


@pytest.mark.parametrize(
    ("drive", "version", "why"),
    [
        ("nowhere", "1.2", "there is no such file or folder"),
        ("", "1.2", "holds neither recording.toml nor run.json"),
        ("overtake", "2.0", "is '2.0', expected 1.1, 1.2, 1.3"),
        ("overtake/gt.csv", "1.2", "is no JSCEN file"),
    ],
)
def test_what_cannot_be_exported_is_refused(tmp_path: Path, drive: str, version: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        export_openscenario(ROOT / "scenarios" / drive, tmp_path / "out", version=version)
    assert not (tmp_path / "out").exists()
