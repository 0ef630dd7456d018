"""`resim mine`: what it writes can be mined, run and resumed; a bad recording is told of, and the others are mined."""

from __future__ import annotations

import base64
import gzip
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from mining.planted import Drive, path_of, smooth, steady, tracks_of, write_motorway

from resim.core.errors import InputError
from resim.jobs.mine import MineOptions, mine, read_mined
from resim.mining.around import AroundOptions, peaks
from resim.mining.page.graphs import counted_over_time
from resim.recordings import Recording, read_recording, write_recording
from resim.recordings.checked import load_checked
from resim.results import MINING, remove_results
from resim.road.opendrive import load
from resim.scenario.jscen import read_jscen

Call = Callable[..., tuple[int, str, str]]
SHIPPED = Path(__file__).parents[2] / "scenarios"


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A recording with one lane change ahead of its EGO, and sensor data of both."""
    road = write_motorway(tmp_path / "motorway.xodr")
    path = path_of(load(road), "7", -2, 520.0, 360.0)
    change = Drive("b", lambda t: 40.0 + 15.0 * t, lambda t: smooth(t, 3.0, 5.0, 3.5), end=12.0)
    gt = tracks_of(
        path, [Drive("a", steady(15.0), end=12.0), change, Drive("far", lambda t: 250.0 + 15.0 * t, end=3.0)]
    )
    sd = replace(gt, t=gt.t + 0.02).without("a").without("far")
    recording = Recording("drive", road, "a", gt, 25.0, sd=sd, sd_rate=25.0, sd_gt_id=np.array(["b"]))
    write_recording(recording, tmp_path / "drive")
    return tmp_path / "drive"


def test_a_scenario_is_a_recording_and_a_jscen_file_of_its_window(tmp_path: Path, drive: Path) -> None:
    found = mine([drive], tmp_path / "out")
    row = found.scenarios.iloc[0]
    assert len(found.scenarios) == 1
    assert (row["ego"], row["members"], row["tag"], row["labels"], row["vehicles"]) == (
        "a",
        "b",
        "left",
        "lane_change_left",
        2,
    )
    cut = load_checked(tmp_path / "out" / row["folder"])
    assert cut.ego == "a"
    assert set(cut.gt.ids) == {"a", "b"}
    assert cut.gt.t[0] == 0.0
    assert cut.gt.t[-1] == pytest.approx(row["end"] - row["start"])
    assert cut.sd is not None
    assert cut.sd.t[0] == pytest.approx(0.02)
    whole = read_recording(drive).gt
    first = int(np.searchsorted(whole.t, row["start"] - 1e-9))
    assert cut.gt.x[0, 0] == pytest.approx(whole.x[0, first])
    scenario = read_jscen(tmp_path / "out" / row["jscen"])
    assert scenario.ego.id == "a"
    assert scenario.duration == pytest.approx(cut.gt.t[-1])
    assert (tmp_path / "out" / row["jscen"]).with_name(scenario.map).is_file()
    again = mine([tmp_path / "out" / row["folder"]], tmp_path / "again", MineOptions(fit=False))
    assert again.labels["follow_lane"] >= 1  # what is cut out is a recording like any other


def test_what_was_mined_goes_into_a_run_a_suite_and_a_sweep(tmp_path: Path, drive: Path, call: Call) -> None:
    found = mine([drive], tmp_path / "out")
    folder = tmp_path / "out" / found.scenarios.iloc[0]["folder"]
    build = SHIPPED.parent / "adfunc" / "builds" / "replay-1.0.toml"
    criteria = SHIPPED / "criteria" / "highway.toml"

    code, out, err = call("run", str(folder), "--build", str(build), "--out", str(tmp_path / "run"))
    assert code == 0, out + err
    assert (tmp_path / "run" / "report.html").is_file()

    suite = tmp_path / "suite.toml"
    code, out, err = call(
        "suite", "new", str(folder.parent), "--out", str(suite), "--criteria", str(criteria)
    )
    assert code == 0, out + err
    code, out, err = call(
        "verify",
        str(suite),
        "--build",
        str(build),
        "--driven-by",
        "unknown",
        "--out",
        str(tmp_path / "verify"),
    )
    assert code == 0, out + err
    (told,) = json.loads((tmp_path / "verify" / "verification.json").read_text("utf-8"))["recordings"]
    assert told["verdict"] == "verified"

    swept = tmp_path / "sweep.toml"
    swept.write_text(
        f"""name = "mined"
criteria = "{criteria}"
build = ["{build.with_name("idm-1.0.toml")}"]
plan = "grid"
seeds = 1
perception = "{SHIPPED.parent / "adfunc" / "perception" / "field_of_view.json"}"
[[recording]]
folder = "{folder}"
[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 0.5
steps = 2
""",
        "utf-8",
    )
    code, out, err = call("sweep", str(swept), "--out", str(tmp_path / "sweep"))
    assert (code, "2 runs, 0 failed" in out) == (0, True), out + err


def test_bad_recordings_are_told_of_and_the_others_are_mined(tmp_path: Path, drive: Path) -> None:
    broken, elsewhere = tmp_path / "broken", tmp_path / "elsewhere"
    shutil.copytree(drive, broken)
    (broken / "gt.csv").write_text("t,id\n0,a\n")
    recording = read_recording(drive)
    write_recording(
        replace(
            recording, gt=replace(recording.gt, x=recording.gt.x + 5e3), sd=None, sd_gt_id=None, sd_rate=None
        ),
        elsewhere,
    )
    one = tmp_path / "one"
    write_recording(
        replace(recording, gt=recording.gt.select(["a"]), sd=None, sd_gt_id=None, sd_rate=None), one
    )
    heard = []
    found = mine(
        [broken, tmp_path / "missing", elsewhere, one, drive],
        tmp_path / "out",
        MineOptions(fit=False),
        heard=heard.append,
    )
    assert [f.recording for f in found.report.failures] == ["broken", "missing", "elsewhere"]
    assert "OFF_MAP" in found.report.failures[2].why
    assert [p.recording for p in found.report.parts] == ["one", "drive"]
    assert any("one object" in note for note in found.report.parts[0].notes)
    assert len(heard) == 5
    page = (tmp_path / "out" / "mined.html").read_text("utf-8")
    assert "not mined" in page
    assert "drive+a+1" in page
    told = (tmp_path / "out" / "pages" / "drive.html").read_text("utf-8").partition('<div id="time"')[2]
    drawn = json.loads(gzip.decompress(base64.b64decode(told.partition('gzip">')[2].partition("<")[0])))
    own = found.maneuvers[found.maneuvers["recording"] == "drive"]
    assert drawn["layout"]["yaxis"]["ticktext"] == sorted(own["label"].unique())  # every label, over time
    with pytest.raises(InputError, match="no recording could be mined"):
        mine([broken], tmp_path / "none")


def test_a_recording_of_which_most_is_off_the_map_is_mined_with_a_note(tmp_path: Path, drive: Path) -> None:
    recording = read_recording(drive)
    gt = recording.gt
    aside = np.where(gt.ids == "b", 0.0, 60.0)[:, None]
    write_recording(
        replace(recording, gt=replace(gt, y=gt.y + aside), sd=None, sd_gt_id=None, sd_rate=None),
        tmp_path / "off",
    )
    found = mine([tmp_path / "off"], tmp_path / "out", MineOptions(fit=False, accept=("OFF_MAP",)))
    (part,) = found.report.parts
    assert part.off_lane > 0.5
    assert (
        "of the samples of vehicles are on no driven lane of motorway.xodr: another frame, or another map?"
        in part.notes[0]
    )
    assert "another frame, or another map?" in (tmp_path / "out" / "mined.html").read_text("utf-8")


def test_a_study_is_resumed_and_a_changed_recording_mined_anew(tmp_path: Path, drive: Path) -> None:
    out, options = tmp_path / "out", MineOptions(fit=False)
    first = mine([drive], out, options)
    with pytest.raises(InputError, match="resume=True"):
        mine([drive], out, options)
    when = (out / "parts" / "drive" / "maneuvers.parquet").stat().st_mtime_ns
    again = mine([drive], out, replace(options, resume=True))
    assert (out / "parts" / "drive" / "maneuvers.parquet").stat().st_mtime_ns == when
    assert again.scenarios.equals(first.scenarios)
    table = (drive / "gt.csv").read_text().splitlines()
    (drive / "gt.csv").write_text("\n".join(line for line in table if ",far," not in line) + "\n")
    anew = mine([drive], out, replace(options, resume=True))
    assert anew.report.parts[0].objects == 2
    assert read_mined(out).report == anew.report
    (out / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"):
        mine([drive], out, replace(options, resume=True))


@pytest.mark.parametrize("fit", [False, True])
def test_a_resumed_study_names_a_recording_where_it_lies_now(tmp_path: Path, drive: Path, fit: bool) -> None:
    out, options = tmp_path / "out", MineOptions(fit=fit, resume=True)
    mine([drive], out, options)
    when = (out / "parts" / "drive" / "maneuvers.parquet").stat().st_mtime_ns
    (tmp_path / "archive").mkdir()
    moved = tmp_path / "archive" / "drive"
    shutil.move(drive, moved)
    shutil.copy(tmp_path / "motorway.xodr", tmp_path / "archive")
    found = mine([moved], out, options)
    assert (
        out / "parts" / "drive" / "maneuvers.parquet"
    ).stat().st_mtime_ns == when  # it was not mined again
    assert (out / found.report.parts[0].folder).resolve() == moved
    assert read_mined(out).report.parts[0].folder == "../archive/drive"


@pytest.mark.slow
def test_what_was_taken_away_or_changed_of_an_earlier_study_is_made_again(
    tmp_path: Path, drive: Path
) -> None:
    out, options = tmp_path / "out", MineOptions(resume=True)
    first = mine([drive], out, options).scenarios
    scenario, file = out / first["folder"].iloc[0], out / first["jscen"].iloc[0]
    before = {path: path.read_bytes() for path in (scenario / "gt.csv", file)}
    for spoil in (
        lambda: shutil.rmtree(scenario), file.unlink, lambda: (out / "parts/drive/part.json").write_text("{}"),
        lambda: (out / "parts/drive/maneuvers.parquet").write_bytes(b"PAR1"),
    ):  # fmt: skip
        spoil()
        assert mine([drive], out, options).scenarios.equals(first)
        assert {path: path.read_bytes() for path in before} == before


def test_scenarios_of_other_thresholds_have_jscen_files_of_their_own_windows(
    tmp_path: Path, drive: Path
) -> None:
    out = tmp_path / "out"
    mine([drive], out, MineOptions(around=AroundOptions("follow_lane", before=1.0, after=1.0), resume=True))
    row = mine([drive], out, MineOptions(resume=True)).scenarios.iloc[0]
    assert read_jscen(out / row["jscen"]).duration == pytest.approx(row["duration"])


def test_an_input_within_the_folder_of_results_is_refused(tmp_path: Path, drive: Path) -> None:
    out = tmp_path / "out"
    found = mine([drive], out, MineOptions(fit=False))
    inside = out / found.scenarios["folder"].iloc[0]
    with pytest.raises(InputError, match="lies within --out"):
        mine([inside], out, MineOptions(fit=False, resume=True))
    assert inside.is_dir()


def test_results_are_deleted_whole_or_not_at_all(tmp_path: Path, drive: Path) -> None:
    out = tmp_path / "out"
    found = mine([drive], out)
    note = out / found.scenarios["folder"].iloc[0] / "note.txt"
    note.write_text("mine")
    with pytest.raises(InputError, match=r"note\.txt"):
        remove_results(out, MINING)
    note.unlink()
    remove_results(out, MINING)
    assert not out.exists()


def test_one_scenario_is_drawn_and_played(tmp_path: Path, drive: Path, call: Call) -> None:
    out, picture = tmp_path / "out", tmp_path / "one.svg"
    name = mine([drive], out, MineOptions(fit=False)).scenarios["scenario"].iloc[0]
    code, told, _ = call(
        "mined", out, "--scenario", name, "--picture", picture, "--player", tmp_path / "one.html"
    )
    assert code == 0
    assert "labels: lane_change_left" in told
    drawn = ElementTree.parse(picture).getroot()
    space = {"s": "http://www.w3.org/2000/svg"}
    assert {text.text for text in drawn.findall("s:text", space)} == {"a", "b"}
    lines = [
        line.get("points", "").split() for line in drawn.findall("s:polyline[@stroke-width='1.6']", space)
    ]
    cut = read_recording(out / "recordings" / name).gt
    assert {len(line) for line in lines} == {int(n) for n in cut.valid.sum(axis=1)}
    assert "one.html" in told
    assert call("mined", out, "--scenarios", "--label", "lane_change_left")[1].endswith("1 scenario\n")
    assert call("mined", out, "--scenarios", "--label", "cut_in_left")[1] == "0 scenarios\n"
    picture.write_text("<svg/>")
    code, _, error = call("mined", out, "--scenario", name, "--picture", picture)
    assert (code, picture.read_text()) == (2, "<svg/>")
    assert "would be lost" in error
    code, _, error = call("mined", out, "--picture", picture)
    assert "--scenario" in error


def test_speeders_and_who_stands_are_counted_at_each_time() -> None:
    start, end = np.array([0.0, 1.0, 1.0, 5.0]), np.array([2.0, 1.5, 5.0, 6.0])
    t, count = counted_over_time(start, end)
    for now in np.arange(-0.25, 7.0, 0.5):
        told = count[t <= now][-1] if (t <= now).any() else 0
        assert told == ((start <= now) & (now < end)).sum()


@pytest.mark.parametrize("what", ["TTC", "decision", "strong_braking"])
def test_around_cuts_out_the_moments_of_the_recordings_own_ego(tmp_path: Path, what: str) -> None:
    around = AroundOptions(what, before=2.0, after=1.5, most=2)
    found = mine([SHIPPED / "cut_in_brake"], tmp_path / "out", MineOptions(around=around, fit=False))
    rows = found.scenarios
    assert 1 <= len(rows) <= 2
    ego = read_recording(SHIPPED / "cut_in_brake").ego
    assert set(rows["ego"]) == {ego}
    assert set(rows["labels"]) == {f"around {what}"}
    assert (rows["duration"] <= 8.0).all()
    assert all((tmp_path / "out" / folder / "sd.csv").is_file() for folder in rows["folder"])


def test_peaks_of_a_measure_are_found_also_at_its_ends() -> None:
    none = -np.inf
    assert peaks(np.array([3.0, 1.0, none, 2.0, 2.0, 2.0, 0.0, 5.0])).tolist() == [0, 4, 7]
    assert peaks(np.array([none, none])).tolist() == []


def test_quiet_tells_only_of_recordings_that_are_not_mined(tmp_path: Path, drive: Path, call: Call) -> None:
    words = "mine", drive, "--out", tmp_path / "out", "--scenarios", "rows", "--quiet"
    assert call(*words) == (0, "", "")
    code, said, error = call(*words[:2], tmp_path / "missing", *words[2:])
    assert (code, said) == (0, "")
    assert error.startswith("missing: not mined: ")


def test_an_unknown_measure_or_label_is_refused_once_before_any_recording_is_read(
    tmp_path: Path, drive: Path
) -> None:
    heard: list[object] = []
    with pytest.raises(InputError, match="TTX") as e:
        mine([drive], tmp_path / "out", MineOptions(around=AroundOptions("TTX")), heard=heard.append)
    assert not heard
    assert str(e.value).startswith("--around: there is no measure or label 'TTX'")
    assert not (tmp_path / "out").exists()


@pytest.fixture
def crowd(tmp_path: Path) -> list[Path]:
    """Two recordings with lane changes that many EGOs see."""
    folders = []
    road = write_motorway(tmp_path / "motorway.xodr")
    path = path_of(load(road), "7", -2, 520.0, 360.0)
    for name, begin in (("one", 2.0), ("two", 3.0)):
        changes = Drive("c", lambda t: 60.0 + 15.0 * t, lambda t, b=begin: smooth(t, b, 4.0, 3.5), end=9.0)  # type: ignore[misc]
        rest = [Drive(f"r{k}", lambda t, k=k: 20.0 * k + 15.0 * t, end=9.0) for k in range(3)]  # type: ignore[misc]
        gt = tracks_of(path, [*rest, changes], rate=10.0)
        write_recording(Recording(name, road, "r0", gt, 10.0), tmp_path / name)
        folders.append(tmp_path / name)
    return folders


def bytes_of(out: Path) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@pytest.mark.slow
def test_any_number_of_workers_and_a_killed_call_give_the_same_bytes(
    tmp_path: Path, crowd: list[Path]
) -> None:
    alone = mine(crowd, tmp_path / "alone", MineOptions(workers=1))
    assert len(alone.scenarios) >= 4
    assert alone.scenarios["jscen"].str.endswith(".jscen.json").all()
    mine(crowd, tmp_path / "together", MineOptions(workers=2))
    expected = bytes_of(tmp_path / "alone")
    assert bytes_of(tmp_path / "together") == expected
    out = tmp_path / "killed"
    command = [sys.executable, "-m", "resim", "mine", *map(str, crowd), "--out", str(out), "--workers", "2"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not list(out.glob("maps/*/*.jscen.json")) and process.poll() is None:
        time.sleep(0.02)
    process.kill()
    process.wait()
    kept = {path: path.stat().st_mtime_ns for path in out.glob("maps/*/*.jscen.json")}
    assert kept
    mine(crowd, out, MineOptions(workers=2, resume=True))
    assert bytes_of(out) == expected
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items())


def test_other_thresholds_leave_no_jscen_file_of_before(tmp_path: Path, crowd: list[Path]) -> None:
    out = tmp_path / "out"
    mine(crowd[:1], out, MineOptions(workers=1))
    (tmp_path / "labels.toml").write_text("[extraction]\nahead = 25.0\nbefore = 0.5\n")
    options = MineOptions(labels=tmp_path / "labels.toml", workers=1)
    mine(crowd[:1], out, replace(options, resume=True))
    mine(crowd[:1], tmp_path / "fresh", options)
    again, fresh = (
        {path.name: path.read_bytes() for path in folder.glob("maps/*/*.jscen.json")}
        for folder in (out, tmp_path / "fresh")
    )
    assert again == fresh
