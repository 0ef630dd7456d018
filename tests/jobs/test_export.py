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
from resim.jobs.export import export_drive, export_openscenario
from resim.road.opendrive import load

scenariogeneration = pytest.importorskip("scenariogeneration")


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


def test_characters_that_xml_cannot_hold_are_left_out(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    rows = pd.read_csv(ROOT / "scenarios" / "cut_in_brake" / "gt.csv", dtype={"id": str})
    other = rows[rows.id != "ego"].id.iloc[0]
    rows.assign(id=rows.id.replace(other, "a\x01b\ufffec")).to_csv(folder / "gt.csv", index=False)
    (folder / "recording.toml").write_text(
        f'name = "x\\u0001y"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    export_openscenario(folder, tmp_path / "out", accept=[])
    root = etree.parse(tmp_path / "out" / "GT.xosc").getroot()
    assert root.find("FileHeader").get("description") == "x_y: GT"
    assert "a_b_c" in [one.get("name") for one in root.iterfind(".//Vehicle")]


@pytest.mark.skipif(not (DATA / "ngsim").is_dir(), reason="needs ../shared/data")
@pytest.mark.slow
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


def schema(version: str) -> etree.XMLSchema:
    """The schema that scenariogeneration ships."""
    named = {"1.1": "1_1", "1.2": "1_2", "1.3": "1_3_1"}[version]
    file = Path(scenariogeneration.__file__).parents[1] / "schemas" / f"OpenSCENARIO_{named}.xsd"
    return etree.XMLSchema(etree.parse(file))


def late(home: Path) -> Path:
    """A drive of the EGO, of who changes into its lane, and of who is there from 2 to 5 s."""
    rows = pd.read_csv(ROOT / "scenarios" / "cut_in_brake" / "gt.csv")
    other = rows[rows.id.astype(str) != "ego"].id.iloc[0]
    later = rows[rows.id == other].assign(id="late", x=rows.x + 80.0)
    folder = home / "late"
    folder.mkdir()
    pd.concat([rows, later[later.t.between(2.0, 5.0)]]).to_csv(folder / "gt.csv", index=False)
    (folder / "recording.toml").write_text(
        f'name = "late"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    return folder


def speeds(root: etree._Element, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and speeds of an entity's profile, or of its chain of changes."""
    group = root.find(f".//ManeuverGroup[@name='group {name}']")
    entries = group.findall(".//SpeedProfileEntry")
    if entries:
        begin = float(group.xpath(".//Event[.//SpeedProfileAction]//SimulationTimeCondition/@value")[0])
        times = begin + np.cumsum([float(one.get("time")) for one in entries])
        return times, np.array([float(one.get("speed")) for one in entries])
    private = root.xpath(f"Storyboard/Init//Private[@entityRef='{name}']//AbsoluteTargetSpeed/@value")
    times, v = [0.0] * len(private), [float(one) for one in private]
    for one in group.iterfind(".//Event"):
        if (change := one.find(".//SpeedAction")) is None:
            continue
        begin = float(one.find(".//SimulationTimeCondition").get("value"))
        assert not times or begin == pytest.approx(times[-1])  # each goes on where the one before ends
        times.append(begin + float(change.find("SpeedActionDynamics").get("value")))
        v.append(float(change.find(".//AbsoluteTargetSpeed").get("value")))
    return np.array(times), np.array(v)


@pytest.mark.parametrize("version", ["1.1", "1.2", "1.3"])
def test_a_route_leads_over_the_lanes_that_were_driven_at_the_speeds_that_were(
    tmp_path: Path, version: str
) -> None:
    folder = late(tmp_path)
    export_openscenario(folder, tmp_path / "out", version=version, style="route")
    export_openscenario(folder, tmp_path / "traces", version=version)
    root = etree.parse(tmp_path / "out" / "GT.xosc").getroot()
    schema(version).assertValid(root.getroottree())
    traces, network = Played(tmp_path / "traces" / "GT.xosc"), load(ROOT / "networks" / "proving_ground.xodr")
    assert not root.findall(".//FollowTrajectoryAction")
    for name in traces.names:
        told = traces.box(name)
        way = np.cumsum(np.hypot(np.diff(told.x), np.diff(told.y)))
        t, v = speeds(root, name)
        assert (t[0], t[-1]) == (pytest.approx(told.t.iloc[0]), pytest.approx(told.t.iloc[-1]))
        assert len(t) < 40
        driven = np.interp(told.t, t, v)
        driven = np.cumsum(0.5 * (driven[1:] + driven[:-1]) * np.diff(told.t))
        assert np.abs(driven - way).max() < 0.02 * (t[-1] - t[0])
        points = root.findall(f".//Route[@name='route {name}']//LanePosition")
        assert len(points) >= 2
        for one in points:
            x, y = network.to_xy(
                one.get("roadId"),
                int(one.get("laneId")),
                float(one.get("s")),
                float(one.get("offset")),
            )
            assert np.hypot(told.x - x, told.y - y).min() < 3.0  # the rear axle is behind the box's middle
        lanes = [one.get("laneId") for one in points]
        at = network.to_road(told.x.to_numpy(), told.y.to_numpy())
        assert lanes[0] == str(at.lane[0])
        assert lanes[-1] == str(at.lane[-1])
    init = root.xpath("Storyboard/Init//Private[.//AssignRouteAction]/@entityRef")
    assert sorted(init) == sorted(set(traces.names) - {"object_late"})
    event = root.xpath(".//Event[.//AssignRouteAction]//SimulationTimeCondition/@value")
    assert [float(one) for one in event] == [2.0]


def test_who_stands_has_no_route(tmp_path: Path) -> None:
    rows = pd.read_csv(ROOT / "scenarios" / "cut_in_brake" / "gt.csv")
    ego = rows[rows.id.astype(str) == "ego"]
    parked = ego.assign(id="parked", x=ego.x.iloc[0] + 200.0, y=ego.y.iloc[0], v=0.0, heading=0.0)
    for column in ("a", "yaw_rate"):
        if column in parked:
            parked[column] = 0.0
    folder = tmp_path / "parked"
    folder.mkdir()
    pd.concat([ego, parked]).to_csv(folder / "gt.csv", index=False)
    (folder / "recording.toml").write_text(
        f'name = "parked"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    export_openscenario(folder, tmp_path / "out", style="route")
    root = etree.parse(tmp_path / "out" / "GT.xosc").getroot()
    assert root.xpath(".//Route/@name") == ["route Ego"]
    assert speeds(root, "object_parked")[1] == pytest.approx(0.0, abs=0.02)


def test_a_style_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--style: is 'roads', expected trajectory or route"):
        export_openscenario(ROOT / "scenarios" / "overtake", tmp_path / "out", style="roads")


def test_what_the_files_do_not_say_is_noted(tmp_path: Path) -> None:
    """Rows beyond the EGO's time, who was seen once, and rows that lack a value: verdicts on the drive know of them."""
    folder = tmp_path / "drive"
    folder.mkdir()
    rows = pd.read_csv(ROOT / "scenarios" / "cut_in_brake" / "gt.csv")
    other = rows[rows.id.astype(str) != "ego"].iloc[[50]].assign(id="9", x=lambda r: r.x + 60.0)
    rows = pd.concat([rows[(rows.id.astype(str) != "ego") | (rows.t < 6.0)], other]).reset_index(drop=True)
    rows.loc[rows.index[101:104], "v"] = np.nan
    late = int((rows.t > rows.t[rows.id.astype(str) == "ego"].max() + 1e-6).sum())
    lost = int(rows.v.isna().sum())
    rows.to_csv(folder / "gt.csv", index=False)
    (folder / "recording.toml").write_text(
        f'name = "d"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    report = export_openscenario(folder, tmp_path / "out", accept=["MISSING_VALUES", "GAP"])
    assert report.notes == (
        f"GT: {lost} rows that lack a value are in no file",
        f"GT: {late} rows before the EGO's first or after its last are in no file",
        "GT: 1 objects that no spline describes are in no file: 9",
    )


@pytest.mark.parametrize(
    ("form", "needs", "clock"), [("foxglove", "foxglove", 5e9), ("rosbag", "rosbags", 2.2e9)]
)
def test_times_that_a_clock_does_not_count_to_are_refused(
    tmp_path: Path, form: str, needs: str, clock: float
) -> None:
    pytest.importorskip(needs)
    folder = tmp_path / "drive"
    folder.mkdir()
    rows = pd.read_csv(ROOT / "scenarios" / "rear_end" / "gt.csv")
    (folder / "recording.toml").write_text(
        f'name = "d"\nmap = "{ROOT}/networks/proving_ground.xodr"\nego = "ego"\n', encoding="utf-8"
    )
    for first, fits in ((clock, False), (-clock, True), (1.7e9, True)):
        rows.assign(t=rows.t + first).to_csv(folder / "gt.csv", index=False)
        if fits:
            assert [*export_drive(folder, tmp_path / "out", form).sources] == ["GT"]
            continue
        with pytest.raises(InputError, match=r"has times up to .* s, and the clock of .* ends at"):
            export_drive(folder, tmp_path / "out", form)


@pytest.mark.slow
def test_runs_that_broke_off_are_told(tmp_path: Path) -> None:
    """Who sees rGT alone takes it for a whole drive."""
    (tmp_path / "fails.py").write_text(
        "from resim.function import Command\n\n\nclass Fails:\n"
        "    def __init__(self, **parameters):\n        pass\n\n"
        "    def reset(self, *arguments):\n        pass\n\n"
        "    def step(self, perceived):\n"
        "        if perceived.t > 2.0:\n            raise ValueError('enough')\n"
        "        return Command(0.0, 0.0)\n\n    def close(self):\n        pass\n",
        encoding="utf-8",
    )
    (tmp_path / "fails.toml").write_text(
        'name = "fails"\nversion = "1"\nfactory = "fails:Fails"\n', encoding="utf-8"
    )
    run = tmp_path / "run"
    order = ["run", "scenarios/cut_in_brake", "--build", tmp_path / "fails.toml", "--out", run]
    done = subprocess.run(
        [sys.executable, "-m", "resim", *map(str, order)], cwd=ROOT, check=False, capture_output=True
    )
    assert done.returncode == 3, done.stderr
    told = "rGT broke off (function failed): what would have followed is not known"
    assert told in export_openscenario(run, tmp_path / "xosc").notes
    assert told in export_drive(run, tmp_path / "labels", "openlabel").notes


@pytest.mark.skipif(shutil.which("esmini") is None, reason="needs esmini on PATH")
def test_esmini_plays_what_is_exported(tmp_path: Path) -> None:
    """Its log has the reference points; at the vertices they are where they were written."""
    export_openscenario(ROOT / "scenarios" / "cut_in_brake", tmp_path / "out")
    order = [
        "esmini",
        "--osc",
        "GT.xosc",
        "--headless",
        "--fixed_timestep",
        "0.01",
        "--csv_logger",
        "log.csv",
        "--traj_filter",  # else it passes over vertices within 0.1 m of each other
        "0",
    ]
    subprocess.run(order, cwd=tmp_path / "out", check=True, capture_output=True)
    lines = (tmp_path / "out" / "log.csv").read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("Index [-]"))
    keys = [key.strip() for key in lines[head].split(",")]
    log = pd.DataFrame([[one.strip() for one in line.split(",")][: len(keys)] for line in lines[head + 1 :]])
    log.columns = keys[: log.shape[1]]
    t = log["TimeStamp [s]"].astype(float)
    file = Played(tmp_path / "out" / "GT.xosc")
    for k, name in enumerate(file.names, start=1):
        x, y = (log[f"#{k} World_Position_{axis} [m]"].astype(float) for axis in "XY")
        box = file.box(name)
        middle = float(file.root.find(f"Entities/ScenarioObject[@name='{name}']//Center").get("x"))
        box = box.assign(x=box.x - middle * np.cos(box.heading), y=box.y - middle * np.sin(box.heading))
        inside = t <= box.t.iloc[-1]
        off = np.hypot(np.interp(t, box.t, box.x) - x, np.interp(t, box.t, box.y) - y)[inside]
        assert inside.sum() > 800
        assert off.max() < 1e-3, f"{name}: esmini is {off.max():.6f} m off"
