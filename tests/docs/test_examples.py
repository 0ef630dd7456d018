"""The examples on the pages work as they stand."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

import msgpack
import numpy as np
import pages
import pandas as pd
import pytest
from pages import DOCS, PAGES, ROOT
from recordings.mapped.strangers import LON_0, convergence, geographic

from resim.core.geometry import to_frame
from resim.jobs.function import check_function
from resim.jobs.space import read_space_settings
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings import read_recording
from resim.recordings.settings import read_settings
from resim.resimulation import ResimulationOptions
from resim.road.driven_route import Route
from resim.road.opendrive import load
from resim.simulation.function.interface import (
    AdFunction,
    Command,
    EgoState,
    Perceived,
    Setup,
    load_build,
)
from resim.simulation.naturalistic.settings import read_naturalistic
from resim.simulation.vehicles.kinematic import Kinematic
from resim.sweeps.engines import ENGINES, what_differs
from resim.sweeps.file import read_sweep
from resim.sweeps.one_run import prepare_sweep, run_together
from resim.verification.suite import read_suite

Done = Callable[..., None]
GUIDES = DOCS / "guides"
EXTEND = DOCS / "extend"
ROAD = load(ROOT / "networks" / "proving_ground.xodr")
RUN_HERE = {
    "library.py",
    "resimulate_both.py",
    "find_recordings.py",
    "my_pilot.py",
    "my_pilot.toml",
    "my_acc.py",
    "acc_pilot.py",
    "acc_pilot.toml",
    "batch_pilot.py",
    "batch_pilot.toml",
    "planner.py",
    "planner.toml",
    "follow.toml",
    "container.toml",
    "reactive_planner.toml",
    "careful.toml",
    "cut_in.toml",
    "my_measures.py",
    "recording.toml",
    "mapping.toml",
    "mine.toml",
    "neighbours.toml",
    "variations.toml",
    "space.toml",
    "ego.toml",
}
RUN_ELSEWHERE = {
    "agent.py",
    "participant.toml",
    "unit.toml",
    "first.toml",
    "second.toml",
    "late.toml",
    "rows.py",
    "read_table.py",
}
"""By the tests of agents, of units, of the tutorial and of Parquet files."""


def example(page: Path, name: str) -> str:
    return pages.named(page, name.rpartition(".")[2].replace("py", "python"))[name]


def test_every_example_is_run() -> None:
    every = {
        name
        for page in PAGES
        if page.parent != EXTEND
        for language in ("python", "toml")
        for name in pages.named(page, language)
    }
    assert every == RUN_HERE | RUN_ELSEWHERE
    for page in EXTEND.glob("*.md"):
        test = Path(__file__).with_name(f"test_extend_{page.stem}.py")
        assert f'"{page.name}"' in test.read_text(), page.name


def test_the_library_example_prints_what_it_says() -> None:
    said = example(ROOT / "README.md", "library.py")
    done = subprocess.run([sys.executable, "-c", said], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (expected,) = re.findall(r"print\(.*\)  # (.*)", said)
    assert done.stdout.strip() == expected


def test_the_lake_is_asked_as_its_guide_says(tmp_path: Path) -> None:
    said = example(GUIDES / "lake.md", "find_recordings.py")
    begin = "from resim.jobs.lake import lake_add\nlake_add(['scenarios/cut_in_brake'])\n"
    done = subprocess.run(
        [sys.executable, "-c", begin + said], cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "RESIM_CATALOG": str(tmp_path / "catalog.sqlite")},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "cut_in_brake" in done.stdout


@pytest.mark.slow
def test_the_guides_library_example_runs() -> None:
    said = example(GUIDES / "resimulate.md", "resimulate_both.py")
    done = subprocess.run([sys.executable, "-c", said], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    errors = dict(line.split() for line in done.stdout.splitlines())
    assert float(errors["SIM_GT"]) < 1e-9  # replay: every simulation error is zero
    assert set(errors) == set(re.findall(r"`((?:S|FIT|SIM|PIPE)\w*)`", steps_table()))


def steps_table() -> str:
    return "\n".join(
        row for row in pages.text(GUIDES / "resimulate.md").splitlines() if row.startswith("| `")
    )


@pytest.fixture
def done(call: Callable[..., tuple[int, str, str]]) -> Done:
    """Call `resim`, and see that all is well."""

    def run(*words: object) -> None:
        code, _, error = call(*words)
        assert code == 0, error

    return run


def test_the_example_function_plugs_in(done: Done, tmp_path: Path) -> None:
    for name in ("my_pilot.py", "my_pilot.toml"):
        (tmp_path / name).write_text(example(GUIDES / "function.md", name))
    done(
        "run",
        ROOT / "scenarios" / "rear_end",
        "--build",
        tmp_path / "my_pilot.toml",
        "--out",
        tmp_path / "out",
    )
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["build"] == {"name": "my_pilot", "version": "0.1", "drove": False}
    assert report["decision"]["rGT"] == ["brake"]


@pytest.mark.slow
def test_the_example_drives_many_runs_at_once(tmp_path: Path) -> None:
    for name in ("batch_pilot.py", "batch_pilot.toml"):
        (tmp_path / name).write_text(example(GUIDES / "function.md", name))
    build = load_build(tmp_path / "batch_pilot.toml")
    criteria = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
    prepared = prepare_sweep(read_recording(ROOT / "scenarios" / "rear_end"), criteria)
    model = read_model(ROOT / "adfunc" / "perception" / "proving_ground.json")
    direct = ResimulationOptions(engine=ENGINES["direct"])
    assert build.in_batches
    together = run_together(prepared, build, [(model, seed) for seed in range(3)], direct)
    for seed, (drive, row) in enumerate(together):
        ((alone, its),) = run_together(prepared, build, [(model, seed)], direct)
        assert what_differs((drive.fingerprint(), row), (alone.fingerprint(), its)) == ""
        assert drive.failure == ""


def acc_pilot(folder: Path, *, acc: str = "") -> Path:
    """Write the guide's example of an ACC into a folder, with another `my_acc.py` if given, and give its build file."""
    folder.mkdir()
    for name in ("my_acc.py", "acc_pilot.py", "acc_pilot.toml"):
        (folder / name).write_text(example(GUIDES / "function.md", name))
    if acc:
        (folder / "my_acc.py").write_text(acc)
    return folder / "acc_pilot.toml"


def test_the_example_acc_drives_behind_its_lead(done: Done, tmp_path: Path) -> None:
    build, out = acc_pilot(tmp_path / "mine"), tmp_path / "out"
    done(
        "run", ROOT / "scenarios" / "neighbours" / "jam_end", "--build", build, "--basis", "gt", "--out", out
    )
    report = json.loads((out / "report.json").read_text())
    assert report["build"] == {"name": "acc_pilot", "version": "0.1", "drove": False}
    assert report["decision"]["rGT"] == ["brake"]
    assert report["end"]["rGT"] == "duration"


def pilot_in(folder: Path, start: EgoState, *, acc: str) -> AdFunction:
    """Give the example of an ACC on the proving ground, with an `acc` that gives this."""
    build = load_build(acc_pilot(folder, acc=f"def acc(gap, speed, lead_speed):\n    return {acc}\n"))
    with build.factory.afresh():
        pilot = build.make()
    steps = (("1",), ("2",))
    pilot.reset(Setup(ROAD, start, (0.0, 0.0), 4.7, 1.9, 0.04, 0, route=Route(steps)))
    return pilot


def seen(ego: EgoState, *others: tuple[float, ...]) -> Perceived:
    """Give what is perceived: others are x, y, heading in the map, v, length, height above the EGO's road."""
    x, y, heading, v, length, z = np.array(others, dtype=float).reshape(-1, 6).T
    ids, kind = np.arange(len(x)).astype(str), np.full(len(x), "car")
    x_ego, y_ego = to_frame(x, y, ego.x, ego.y, ego.heading)
    return Perceived(
        0.0, ego, ids, kind, x_ego, y_ego, heading - ego.heading, v, length, np.full(len(x), 1.9), z
    )


def on_lane(lane: int, s: float, turn: float = 0.0) -> tuple[float, float, float]:
    """Give x, y and heading on the centre of a lane of the proving ground's first road."""
    x, y = ROAD.to_xy("1", lane, s, 0.0)
    return float(x), float(y), float(ROAD.lane_heading("1", lane, s)) + turn


def test_the_example_acc_keeps_its_lane_through_bends_and_onto_the_next_road(tmp_path: Path) -> None:
    start = EgoState(*on_lane(-2, 1000.0), 25.0)
    pilot, vehicle = pilot_in(tmp_path / "mine", start, acc="0.0"), Kinematic()
    state, states = vehicle.settle(start), []
    for _ in range(1500):
        answer = pilot.step(seen(state.ego))
        assert isinstance(answer, Command)
        state = vehicle.step(state, answer.acceleration, answer.curvature, 0.04)
        states.append(state.ego)
    x, y, heading, v = np.array(states)[:, :4].T
    at = ROAD.to_road(x, y, heading=heading)
    assert [at.road[0], at.road[-1]] == ["1", "2"]
    assert np.abs(at.t).max() < 0.3
    assert v == pytest.approx(25.0, abs=1e-6)


@pytest.mark.parametrize(
    ("gives", "expected"), [("-gap", "gap"), ("-lead_speed", "lead_speed"), ("-speed", "speed")]
)
def test_the_example_acc_is_told_of_the_nearest_object_in_its_lane(
    tmp_path: Path, gives: str, expected: str
) -> None:
    ego = EgoState(*on_lane(-2, 1500.0), 20.0)  # in a bend of 400 m radius
    pilot = pilot_in(tmp_path / "mine", ego, acc=gives)
    answer = pilot.step(
        seen(
            ego,
            (*on_lane(-2, 1620.0), 8.0, 4.0, 0.0),  # farther
            (*on_lane(-2, 1580.0, 0.5), 10.0, 12.0, np.nan),  # the lead, turned against the lane
            (*on_lane(-1, 1520.0), 9.0, 4.0, 0.0),  # beside
            (*on_lane(-2, 1480.0), 9.0, 4.0, 0.0),  # behind
            (*on_lane(-2, 1530.0), 9.0, 4.0, 15.0),  # on a bridge
        )
    )
    x, y = ROAD.to_xy("1", -2, np.linspace(1500.0, 1580.0, 10_000), 0.0)
    way = float(np.hypot(np.diff(x), np.diff(y)).sum())
    right = {"gap": way - 0.5 * (4.7 + 12.0), "lead_speed": 10.0 * np.cos(0.5), "speed": 20.0}
    assert isinstance(answer, Command)
    assert answer.acceleration == pytest.approx(-right[expected], abs=0.01)


def test_the_example_measure_is_judged(done: Done, tmp_path: Path) -> None:
    for name in ("my_measures.py", "mine.toml"):
        (tmp_path / name).write_text(example(GUIDES / "measure.md", name))
    done(
        "assess",
        ROOT / "scenarios" / "overtake",
        "--criteria",
        tmp_path / "mine.toml",
        "--out",
        tmp_path / "out",
    )
    found = json.loads((tmp_path / "out" / "assessment.json").read_text())
    clear = found["criteria"]["keeps clear"]
    assert (clear["verdict"], clear["unit"], clear["limit"]) == ("PASS", "m", 3.0)
    assert clear["value"] == min(min(v) for v in found["measures"]["distance between centres"].values())


def test_the_example_suite_and_recording_are_read(tmp_path: Path) -> None:
    for name in ("scenarios", "adfunc", "networks"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "mine.toml").write_text(example(GUIDES / "verify.md", "mine.toml"))
    assert len(read_suite(tmp_path / "mine.toml").folders) == 12
    (tmp_path / "recording.toml").write_text(example(GUIDES / "recordings.md", "recording.toml"))
    assert read_settings(tmp_path / "recording.toml").ego == "ego"


def test_a_table_of_ones_own_comes_to_a_report_as_the_guide_says(done: Done, tmp_path: Path) -> None:
    """A drive that ships, as a stranger has it: degrees, compass and km/h, and a sensor's list with ids of its own."""
    drive = read_recording(ROOT / "scenarios" / "cut_in_brake")
    assert drive.sd is not None
    truth = drive.gt.to_frame().replace({"id": {"ego": "17", "1": "4"}})
    lat, lon = geographic(truth["x"].to_numpy(), truth["y"].to_numpy())
    compass = np.degrees(0.5 * np.pi + convergence(lat, lon, LON_0) - truth["heading"]) % 360.0
    told = {
        "time_ms": np.round(1e3 * truth["t"]).astype(int), "track": truth["id"], "lat": lat, "lon": lon,
        "heading": compass, "speed_kmh": 3.6 * truth["v"], "length": truth["length"], "width": truth["width"],
        "class": truth["kind"].map({"car": "1", "truck": "2"}),
    }  # fmt: skip
    pd.DataFrame(told).to_csv(tmp_path / "truth.csv", index=False)
    seen = drive.sd.without("ego").to_frame()
    own = drive.gt.select(["ego"]).at(np.unique(seen["t"])).to_frame().set_index("t")
    x, y, turn, v = (seen["t"].map(own[c]).to_numpy() for c in ("x", "y", "heading", "v"))
    dx, dy = to_frame(seen["x"], seen["y"], x, y, turn)
    apart = (seen["v"] * np.exp(1j * seen["heading"]) - v * np.exp(1j * turn)).to_numpy() * np.exp(-1j * turn)
    told = {
        "stamp": seen["t"], "obj": "203", "dx": dx - 2.3, "dy": dy, "yaw": seen["heading"] - turn,
        "vrel_x": apart.real, "vrel_y": apart.imag,
    }  # fmt: skip
    pd.DataFrame(told).to_csv(tmp_path / "objects.csv", index=False)
    (tmp_path / "mapping.toml").write_text(example(GUIDES / "recordings.md", "mapping.toml"))
    for name in ("my_pilot.py", "my_pilot.toml"):
        (tmp_path / name).write_text(example(GUIDES / "function.md", name))
    road = ROOT / "networks" / "proving_ground.xodr"
    csv, columns, out = (tmp_path / name for name in ("truth.csv", "mapping.toml", "my_drive"))
    done("import", "table", csv, "--map", road, "--columns", columns, "--out", out)
    found = read_recording(out)
    assert found.sd_gt_id is not None
    assert found.sd_gt_id.tolist() == ["4"]
    assert found.gt.select(["17"]).x == pytest.approx(drive.gt.select(["ego"]).x, abs=1e-3)
    seen_again = found.sd_by_gt()
    assert seen_again is not None
    assert seen_again.select(["4"]).x == pytest.approx(drive.sd.select(["1"]).x, abs=1e-2)
    done("check", out)
    done(
        "import",
        "guess",
        csv,
        "--sd",
        tmp_path / "objects.csv",
        "--map",
        road,
        "--out",
        tmp_path / "guessed.toml",
    )
    guessed = (tmp_path / "guessed.toml").read_text()
    for line in ('crs = "EPSG:4326"', 'unit = "ms"', 'unit = "km/h"', 'zero = "north", clockwise = true'):
        assert line in guessed
    sensor = guessed.partition("[sd]")[2]
    for line in ('id = "obj"', 't = { column = "stamp", unit = "s" }', 'x = { column = "dx"', 'y = { column = "dy"',
                 'vx = { column = "vrel_x", unit = "m/s", relative = true }'):  # fmt: skip
        assert f"\n{line}" in sensor, line
    build = tmp_path / "my_pilot.toml"
    done("run", out, "--build", build, "--out", tmp_path / "mine")
    assert json.loads((tmp_path / "mine" / "report.json").read_text())["build"]["name"] == "my_pilot"


def test_a_suite_is_not_good_for_fields_that_it_does_not_know(tmp_path: Path) -> None:
    said = example(GUIDES / "verify.md", "mine.toml").replace("agreement", "agrement")
    (tmp_path / "mine.toml").write_text(said)
    with pytest.raises(Exception, match="agrement"):
        read_suite(tmp_path / "mine.toml")


@pytest.mark.slow
def test_a_function_from_outside_is_checked_as_the_guide_has_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a Python without resim, and in C++ with the command that the guide gives."""
    monkeypatch.delenv("PYTHONPATH", raising=False)
    page = GUIDES / "outside.md"
    for name in ("planner.py", "planner.toml", "follow.toml"):
        (tmp_path / name).write_text(example(page, name), encoding="utf-8")
    bare = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", bare], check=True)
    (site,) = bare.glob("lib/python*/site-packages")
    for module in (msgpack, np):
        home = Path(module.__file__).parent
        (site / home.name).symlink_to(home)
        libraries = home.with_name(f"{home.name}.libs")
        if libraries.is_dir():
            (site / libraries.name).symlink_to(libraries)
    nowhere = subprocess.run(
        [bare / "bin" / "python", "-c", "import resim"], capture_output=True, check=False, cwd=tmp_path
    )
    assert b"No module named 'resim'" in nowhere.stderr
    found = check_function(tmp_path / "planner.toml")
    assert found.good, found.checks
    if shutil.which("c++") is None:
        pytest.skip("needs a C++ compiler")
    (line,) = [words for words in pages.blocks(page, "") if words.startswith("c++")]
    shutil.copy(ROOT / "adfunc" / "cpp" / "follow.cpp", tmp_path)
    include = str(ROOT / "resim" / "function")
    subprocess.run(shlex.split(line.replace("$(resim function include)", include)), cwd=tmp_path, check=True)
    found = check_function(tmp_path / "follow.toml")
    assert found.good, found.checks


def test_the_build_of_a_container_is_as_the_guide_has_it(tmp_path: Path) -> None:
    pytest.importorskip("grpc")
    page = GUIDES / "outside.md"
    (tmp_path / "container.toml").write_text(example(page, "container.toml"), encoding="utf-8")
    program = load_build(tmp_path / "container.toml").program
    assert program is not None
    assert "container sha256:6c3c62... is what answers at localhost:50051" in program.unpinned
    (line,) = [line for line in (ROOT / "adfunc" / "cpp" / "Dockerfile").read_text().splitlines()
               if line.startswith("ENTRYPOINT")]  # fmt: skip
    assert " ".join(re.findall(r'"(.*?)"', line)) in pages.text(page)


def test_the_readme_has_every_extra() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"\| extra \|.*?\n\n", text, re.DOTALL)
    told = [
        name for row in table.strip().splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])
    ]
    assert sorted(told) == sorted(project["optional-dependencies"])


def test_the_build_of_somebody_elses_planner_is_as_the_guide_has_it() -> None:
    said = example(GUIDES / "foreign_planner.md", "reactive_planner.toml")
    build = ROOT / "adfunc" / "builds" / "reactive_planner-2025.1.toml"
    assert tomllib.loads(said) == tomllib.loads(build.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_drives_whose_truth_is_known_are_made_as_the_guide_says(
    done: Done, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each command of the page, in its order, with few of the recipes and with traffic of a few seconds."""
    page = GUIDES / "generate.md"
    for name in ("scenarios", "adfunc", "networks"):
        (tmp_path / name).symlink_to(ROOT / name)
    (tmp_path / "cut_in.toml").write_text(example(page, "cut_in.toml"))
    monkeypatch.chdir(tmp_path)
    some = tmp_path / "some" / "of" / "these"
    some.mkdir(parents=True)
    for path in (ROOT / "scenarios" / "catalog" / "generate").glob("highway_lead_c*.toml"):
        shutil.copy(path, some)
    less = {"0.05": "0.003", "scenarios/catalog/generate": "some/of/these"}
    said = {
        "out/cut_in": 1,
        "out/kinds": 3,
        "out/traffic": 1,
        "out/drives": 1,
        "out/sensed": 1,
        "out/town": 2,
        "out/augmented": 5,
    }
    for words in pages.commands(page):
        done(*(less.get(word, word) for word in words[1:]))
        if words[1] in ("generate", "traffic", "augment"):
            out = Path(words[words.index("--out") + 1])
            folders = (
                [out] if (out / "truth.csv").is_file() else [one for one in out.iterdir() if one.is_dir()]
            )
            assert len(folders) == said[str(out)]
    truth = pd.read_csv("out/cut_in/truth.csv")
    assert truth["label"].tolist() == ["speeding", "lane_change_right", "cut_in_right"]
    assert truth["t"].to_numpy() == pytest.approx([0.0, 3.35, 3.3], abs=0.1)


def test_settings_of_the_space_and_of_traffic_with_an_ego_are_read(tmp_path: Path) -> None:
    file = tmp_path / "space.toml"
    file.write_text(example(GUIDES / "space.md", "space.toml"))
    assert read_space_settings(file).distance.warp == 2.0
    traffic = tmp_path / "ego.toml"
    shipped = (ROOT / "scenarios" / "traffic" / "motorway.toml").read_text()
    traffic.write_text(f"{shipped}\n{example(GUIDES / 'generate.md', 'ego.toml')}")
    assert read_naturalistic(traffic).ego.sight == 120.0


@pytest.mark.slow
def test_reactive_traffic_is_as_its_file_says(tmp_path: Path) -> None:
    file = tmp_path / "careful.toml"
    file.write_text(example(ROOT / "docs" / "formats" / "traffic.md", "careful.toml"))
    order = [
        sys.executable,
        "-m",
        "resim",
        "run",
        "scenarios/rear_end",
        "--basis",
        "gt",
        "--traffic",
        str(file),
    ]
    order += ["--build", "adfunc/builds/idm-1.0.toml", "--out", str(tmp_path / "out")]
    done = subprocess.run(order, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    said = json.loads((tmp_path / "out" / "run.json").read_text())["traffic"]
    assert (said["hand_over"]["harder"], said["truck"]["time_gap"], said["car"]["time_gap"]) == (
        0.5,
        2.0,
        1.2,
    )


def test_the_settings_of_variations_are_read(tmp_path: Path) -> None:
    from resim.variations.settings import read_variation_settings

    path = tmp_path / "neighbours.toml"
    path.write_text(example(ROOT / "docs" / "formats" / "variation.md", path.name), encoding="utf-8")
    found = read_variation_settings(path)
    assert ([one.name for one in found.vehicle], found.box, found.limits.braking) == (["van"], 0.005, 9.0)


def test_the_sweep_over_variations_of_the_tutorial_is_read(tmp_path: Path) -> None:
    for name in ("adfunc", "scenarios"):
        (tmp_path / name).symlink_to(ROOT / name)
    path = tmp_path / "variations.toml"
    text = example(ROOT / "docs" / "tutorials" / "space.md", path.name)
    assert 'verified = "out/verified/verification.json"' in text
    drive = str(ROOT / "scenarios" / "cut_in_brake")
    text = text.replace("verified =", "# verified =").replace("out/mined_drives/recordings/000+194+1", drive)
    path.write_text(text, encoding="utf-8")
    found = read_sweep(path)
    assert found.file.parameter[0].levels().tolist() == [float(n) for n in range(51)]
    assert found.file.variation is not None
