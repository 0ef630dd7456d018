from __future__ import annotations

import hashlib
import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import duckdb
import pytest
from road import crossing

from resim import __version__
from resim.results.reading import read_entry

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
BUILDS = ROOT / "adfunc" / "builds"
PILOT = str(BUILDS / "highway_pilot-1.0.toml")
RESULTS = [
    "GT.jscen.json", "SD.jscen.json", "proving_ground.xodr", "rGT.jscen.json", "rSD.jscen.json",
    "report.html", "report.json", "run.json", "tracks.parquet", "answers.parquet", "plans.parquet",
    "assessment.json", "asked.json", "kpis.parquet",
]  # fmt: skip

MAP = """<OpenDRIVE><header revMajor="1" revMinor="6"/>{extra}<road id="7" length="500" junction="-1">{link}
<planView><geometry s="0" x="0" y="0" hdg="0" length="500"><line/></geometry></planView>
<lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right>
<lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes>
</road></OpenDRIVE>"""
GT = "t,id,x,y,heading,v,length,width,kind\n" + "".join(
    f"{t / 10},{name},{x + 2.0 * t},-1.75,0.0,20.0,4.7,1.9,car\n"
    for t in range(20)
    for name, x in (("a", 50), ("b", 99))
)
LOST = """class Own:
    def reset(self, setup): pass
    def step(self, perceived): raise ValueError("lost")
    def close(self): pass
"""
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def recording(tmp_path: Path) -> Callable[..., Path]:
    """Write a small recording of two cars, with what is to be wrong in it."""

    def write(*, road: str | Path | None = None, gt: str | bytes | None = GT, name: str = "gt.csv") -> Path:
        folder = tmp_path / "drive"
        folder.mkdir()
        if isinstance(road, Path):
            shutil.copyfile(road, folder / "road.xodr")
        else:
            (folder / "road.xodr").write_text(road or MAP.format(extra="", link=""))
        (folder / "recording.toml").write_text('name = "drive"\nmap = "road.xodr"\nego = "a"\n')
        if gt is not None:
            (folder / name).write_bytes(gt if isinstance(gt, bytes) else gt.encode())
        return folder

    return write


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def digest(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


def refused(answer: tuple[int, str, str], *texts: str) -> None:
    """Exit code 2, nothing on standard output, and one line that says why."""
    code, out, error = answer
    assert code == 2, error
    assert out == ""
    assert error.startswith("resim: ")
    assert error.count("\n") == 1, error
    for text in texts:
        assert text in error


def test_the_main_job_as_a_user_calls_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from resim.cli import main; main()", "run", "scenarios/cut_in_brake"]
    command += ["--build", "adfunc/builds/highway_pilot-1.0.toml", "--out", str(tmp_path / "out")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.splitlines()[0]) == (0, "0 of 8 stages")
    assert names(tmp_path / "out") == sorted(RESULTS)
    assert names(tmp_path) == ["out"]
    for text in ("PIPE_SD", "GT: brake; first braking at 7.", "rGT: brake, lane_change_left", "report.html"):
        assert text in done.stdout
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["decision"]["GT"] == ["brake"]
    assert report["reaction_difference"]["rGT"] < -0.5
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert html.startswith("<!")
    for outside in ('src="http', "src='http", '<link rel="stylesheet" href="http', "@import"):
        assert outside not in html


def test_the_same_run_gives_the_same_bytes(call: Call, tmp_path: Path) -> None:
    for out in ("one", "two"):
        code, _, error = call(
            "run", ROOT / "scenarios" / "cut_in_brake", "--build", PILOT, "--out", tmp_path / out
        )
        assert code == 0, error
    one, two = digest(tmp_path / "one"), digest(tmp_path / "two")
    assert sorted(one) == sorted(RESULTS)
    differing = {name for name in one if one[name] != two[name]}
    assert differing <= {"run.json", "report.html"}  # they hold wall-clock times


def test_results_replace_earlier_ones(call: Call, recording: Callable[..., Path], tmp_path: Path) -> None:
    out, folder = tmp_path / "out", recording()
    for _ in range(2):
        code, _, error = call("run", folder, "--build", BUILDS / "idm-1.0.toml", "--out", out)
        assert code == 0, error
    assert names(out) == ["GT.jscen.json", "answers.parquet", "asked.json", "assessment.json", "kpis.parquet",
                          "plans.parquet", "rGT.jscen.json", "report.html", "report.json", "road.xodr", "run.json",
                          "tracks.parquet"]  # fmt: skip


@pytest.mark.parametrize("vehicle", ["kinematic", "single-track"])
def test_options_reach_the_run(
    call: Call, recording: Callable[..., Path], tmp_path: Path, vehicle: str
) -> None:
    code, _, error = call(
        "run", recording(), "--build", BUILDS / "idm-1.0.toml", "--out", tmp_path / "out", "--vehicle", vehicle,
        "--step", "0.02", "--lead-in", "1", "--seed", "9", "--basis", "gt", "--no-stop-at-collision",
    )  # fmt: skip
    assert code == 0, error
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    text = json.dumps(run)
    assert '"seed": 9' in text
    assert '"step": 0.02' in text
    with duckdb.connect() as db:
        query = f"SELECT count(DISTINCT t) FROM '{tmp_path}/out/tracks.parquet' WHERE source = 'rGT'"
        assert db.execute(query).fetchone() == (96,)


def test_a_function_that_fails_is_a_bad_verdict_with_results(
    call: Call, recording: Callable[..., Path], write_build: Callable[..., Path], tmp_path: Path
) -> None:
    code, out, error = call("run", recording(), "--build", write_build(LOST), "--out", tmp_path / "out")
    assert code == 3
    assert "raised ValueError: lost" in error
    assert "Traceback" not in error + out
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["end"] == {"rGT": "function_failed"}
    assert (tmp_path / "out" / "report.html").stat().st_size > 1000


UNLUCKY = """import random
from resim.simulation.function.interface import Command
class Own:
    def __init__(self): self.luck = random.random()
    def reset(self, setup): pass
    def step(self, perceived):
        if self.luck < 0.5: raise ValueError("lost")  # with seed 1, not with 0
        return Command(0.0, 0.0)
    def close(self): pass
"""


@pytest.mark.parametrize("criteria", [(), ("--criteria", ROOT / "scenarios" / "criteria" / "highway.toml")])
def test_a_seed_that_failed_is_a_failure_when_it_is_assessed_again(
    call: Call, recording: Callable[..., Path], write_build: Callable[..., Path], tmp_path: Path,
    criteria: tuple[object, ...],
) -> None:  # fmt: skip
    model = ROOT / "adfunc" / "perception" / "none.json"
    out, build = tmp_path / "out", write_build(UNLUCKY)
    ran = call("run", recording(), "--build", build, "--perception", model, "--seeds", 2, "--out", out)
    assessed = call("assess", out, *criteria)
    for code, _, error in (ran, assessed):
        assert (code, "rGT+M, seed 1: test-0.1 at t = -3.00 s raised ValueError: lost" in error) == (3, True)
        assert "seed 0" not in error
    assert read_entry(out).verdict == "failed"


def test_a_collision_is_a_result_and_no_failure_of_the_job(call: Call, tmp_path: Path) -> None:
    build = BUILDS / "constant_velocity-1.0.toml"
    code, out, _ = call("run", ROOT / "scenarios" / "rear_end", "--build", build, "--out", tmp_path / "out")
    assert code == 0
    assert "ended by collision" in out


def test_a_truncated_parquet_is_refused(call: Call, recording: Callable[..., Path], tmp_path: Path) -> None:
    folder = recording()
    with duckdb.connect() as db:
        db.execute(
            f"COPY (SELECT * FROM read_csv('{folder}/gt.csv')) TO '{folder}/gt.parquet' (FORMAT parquet)"
        )
    (folder / "gt.csv").unlink()
    whole = (folder / "gt.parquet").read_bytes()
    (folder / "gt.parquet").write_bytes(whole[: len(whole) // 2])
    refused(call("run", folder, "--build", PILOT, "--out", tmp_path / "out"), "gt.parquet")
    assert names(tmp_path) == ["drive"]


@pytest.mark.parametrize("name", ["gt.csv", "gt.parquet"])
def test_an_empty_file_is_refused(
    call: Call, recording: Callable[..., Path], tmp_path: Path, name: str
) -> None:
    refused(call("run", recording(gt=b"", name=name), "--build", PILOT, "--out", tmp_path / "out"), name)
    assert names(tmp_path) == ["drive"]


def test_a_recording_that_is_not_there_is_refused(call: Call, tmp_path: Path) -> None:
    refused(
        call("run", tmp_path / "none", "--build", PILOT, "--out", tmp_path / "out"), "none", "recording.toml"
    )
    assert names(tmp_path) == []


def test_a_map_whose_links_lead_nowhere_is_refused_unless_accepted(
    call: Call, recording: Callable[..., Path], tmp_path: Path
) -> None:
    link = '<link><successor elementType="road" elementId="99" contactPoint="start"/></link>'
    folder = recording(road=MAP.format(extra="", link=link))
    order = ("run", folder, "--build", PILOT, "--out", tmp_path / "out")
    refused(
        call(*order), "road.xodr", "MISSING_ROAD", "road 7: its successor is road 99", "--accept MISSING_ROAD"
    )
    assert names(tmp_path) == ["drive"]
    code, out, error = call(*order, "--accept", "MISSING_ROAD")
    assert code == 0, error
    assert "note: road.xodr: MISSING_ROAD" in out


@pytest.mark.slow
def test_a_real_map_in_pieces_is_refused(call: Call, recording: Callable[..., Path], tmp_path: Path) -> None:
    road = DATA / "xodr" / "edge_cases" / "od_newmarket.xodr"
    if not road.is_file():
        pytest.skip("the shared data are not on this machine")
    answer = call("run", recording(road=road), "--build", PILOT, "--out", tmp_path / "out")
    refused(answer, "road.xodr", "LINE_GAP: road 29", "jumps by 64.428 m")
    assert names(tmp_path) == ["drive"]


@pytest.mark.parametrize(
    ("road", "text"),
    [
        (
            '<!DOCTYPE x [<!ENTITY secret SYSTEM "file:///etc/passwd">]><OpenDRIVE>&secret;</OpenDRIVE>',
            "road.xodr",
        ),
        ("<OpenDRIVE>", "road.xodr"),
        ("no xml", "road.xodr"),
        ("<OpenSCENARIO/>", "road.xodr"),
    ],
)
def test_a_map_that_is_none_is_refused(
    call: Call, recording: Callable[..., Path], tmp_path: Path, road: str, text: str
) -> None:
    answer = call("run", recording(road=road), "--build", PILOT, "--out", tmp_path / "out")
    refused(answer, text)
    assert "root:" not in answer[2]
    assert names(tmp_path) == ["drive"]


def test_a_folder_that_is_not_resims_is_left_alone(
    call: Call, recording: Callable[..., Path], tmp_path: Path
) -> None:
    folder = recording()
    refused(call("run", folder, "--build", PILOT, "--out", folder), "lies within --out, and would be lost")
    refused(
        call("run", folder, "--build", PILOT, "--out", folder / "gt.csv" / "out"),
        "no folder that you may write",
    )
    assert names(folder) == ["gt.csv", "recording.toml", "road.xodr"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (("--step", "0.0333"), "whole milliseconds"),
        (("--basis", "sd"), "has no sensor data"),
    ],
)
def test_options_that_fit_nothing_are_refused(
    call: Call, recording: Callable[..., Path], tmp_path: Path, options: tuple[str, ...], text: str
) -> None:
    refused(call("run", recording(), "--build", PILOT, "--out", tmp_path / "out", *options), text)


def test_an_endless_lead_in_is_refused(call: Call, recording: Callable[..., Path], tmp_path: Path) -> None:
    answer = call("run", recording(), "--build", PILOT, "--out", tmp_path / "out", "--lead-in", "inf")
    assert answer[0] == 2


@pytest.mark.parametrize(
    ("change", "text"),
    [(("highway_pilot", "nothing"), "cannot be read"), (None, "[parameters] do not fit Own")],
)
def test_a_build_that_cannot_be_used_is_refused(
    call: Call, recording: Callable[..., Path], write_build: Callable[..., Path], tmp_path: Path,
    change: tuple[str, str] | None, text: str,
) -> None:  # fmt: skip
    build = PILOT.replace(*change) if change else write_build(LOST, parameters="gain = 1.0")
    refused(call("run", recording(), "--build", build, "--out", tmp_path / "out"), text)
    assert "out" not in names(tmp_path)


@pytest.mark.parametrize(
    "arguments", [("run",), ("run", "x", "--speed", "3"), ("fly",), ("run", "x", "--basis", "no")]
)
def test_a_wrong_call_ends_with_2(call: Call, arguments: tuple[str, ...]) -> None:
    code, out, error = call(*arguments)
    assert (code, out) == (2, "")
    assert "resim" in error


def test_help_and_version(call: Call) -> None:
    assert call("--version") == (0, f"resim {__version__}\n", "")
    for arguments in (("--help",), ("run", "--help"), ("import", "--help")):
        code, out, error = call(*arguments)
        assert (code, error) == (0, "")
        assert "Usage: resim" in out
    _, out, _ = call("run", "--help")
    for option in ("--build", "--out", "--basis", "--vehicle", "--step", "--lead-in", "--seed", "--gui"):
        assert option in out


def test_help_loads_neither_sumo_nor_numpy() -> None:
    program = "import sys, resim.cli; print([m for m in ('numpy', 'libsumo', 'scipy', 'pandas') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_an_import_wants_an_opendrive_map(call: Call, tmp_path: Path) -> None:
    source = DATA / "ngsim" / "USA_US101-5_1_T-1.xml"
    if not source.is_file():
        pytest.skip("the shared data are not on this machine")
    arguments = ("import", "commonroad", source, "--ego", "449", "--out", tmp_path / "out")
    refused(call(*arguments, "--map", source), "root element")
    assert names(tmp_path) == []
    code, out, _ = call(*arguments, "--map", source.with_suffix(".xodr"), "--start", "1", "--end", "7")
    assert (code, "23 objects over 6.00 s, EGO 449" in out) == (0, True)
    done = call(
        "run",
        tmp_path / "out",
        "--build",
        ROOT / "adfunc" / "builds" / "replay-1.0.toml",
        "--out",
        tmp_path / "run",
    )
    assert done[0] == 0


def test_an_import_of_highd_is_put_on_its_map(call: Call, tmp_path: Path) -> None:
    source = DATA / "highd_format" / "us101_22" / "01_tracks.csv"
    if not source.is_file():
        pytest.skip("the shared data are not on this machine")
    road = DATA / "ngsim" / "USA_US101-22_1_T-1.xodr"
    pose = ("--alignment", "-21.7293", "51.5141", "-0.71823")
    code, out, _ = call(
        "import", "highd", source, "--map", road, "--ego", "10", *pose, "--out", tmp_path / "out"
    )
    assert (code, "54 objects" in out) == (0, True)
    code, out, _ = call(
        "run",
        tmp_path / "out",
        "--build",
        ROOT / "adfunc" / "builds" / "replay-1.0.toml",
        "--out",
        tmp_path / "run",
    )
    assert (code, "no driving lane" in out) == (0, False)


def test_a_picture_of_a_map_takes_the_place_of_no_other_file(call: Call, tmp_path: Path) -> None:
    road = tmp_path / "road.xodr"
    road.write_text(MAP.format(extra="", link=""))
    code, _, told = call("map", "plot", road, "--out", road)
    assert (code, told) == (
        2, f"resim: {road}: exists, is not such a resim file, and would be lost. Name another with --out.\n"
    )  # fmt: skip
    assert road.read_text() == MAP.format(extra="", link="")
    for _ in range(2):
        assert call("map", "plot", road, "--out", tmp_path / "road.html")[0] == 0
    assert names(tmp_path) == ["road.html", "road.xodr"]


def test_a_map_without_driving_lanes_is_drawn_all_the_same(call: Call, tmp_path: Path) -> None:
    road = tmp_path / "road.xodr"
    road.write_text(MAP.format(extra="", link="").replace("driving", "sidewalk"))
    code, _, told = call("map", "plot", road, "--out", tmp_path / "road.html")
    assert code == 0
    assert "drawn without the errors of its SUMO net" in told
    assert "has no driving lane" in told
    assert "sidewalk" in (tmp_path / "road.html").read_text()


def test_a_code_that_no_finding_has_is_refused_for_a_map_too(call: Call, tmp_path: Path) -> None:
    road = tmp_path / "road.xodr"
    road.write_text(MAP.format(extra="", link=""))
    code, _, told = call("map", "convert", road, "--out", tmp_path / "out", "--accept", "LANEGAP")
    assert code == 2
    assert told == "resim: --accept: no finding has the code 'LANEGAP', did you mean 'LANE_GAP'?\n"
    assert names(tmp_path) == ["road.xodr"]


def test_a_road_cut_short_is_no_good_map(call: Call, tmp_path: Path) -> None:
    """287 m of 1,724: what is missing is an error of the map, with the road and both lengths."""
    road = tmp_path / "road.xodr"
    road.write_text(MAP.format(extra="", link="").replace('id="7" length="500"', 'id="7" length="1724"'))
    code, out, told = call("map", "check", road)
    assert code == 1
    assert (
        "error    ROAD_LENGTH  road 7: its length is declared as 1724.000 m, its elements end at 500.000 m"
        in out
    )
    code, _, told = call("map", "convert", road, "--out", tmp_path / "out")
    assert (code, "ROAD_LENGTH: road 7" in told, "--accept ROAD_LENGTH" in told) == (2, True, True)
    assert call("map", "convert", road, "--out", tmp_path / "out", "--accept", "ROAD_LENGTH")[0] == 0


def test_what_of_a_maps_rules_is_in_its_net(call: Call, tmp_path: Path) -> None:
    road = tmp_path / "cross.xodr"
    parts = crossing.cross(**crossing.LIGHTS | {"S": crossing.signal("far", 205, s=10.0)})
    road.write_text(f'<OpenDRIVE><header revMajor="1" revMinor="7"/>{"".join(parts)}</OpenDRIVE>')
    _, out, _ = call("map", "check", road)
    assert "in the net: 3 traffic light(s), at 1 junction(s), 0 of them with the program of the map" in out
    assert "not in the net: sign far (road S, s = 10 m): no junction follows within 50 m" in out


def test_a_signal_that_was_ignored_stays_so(call: Call) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        assert call("--version")[0] == 0
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("arguments", ["--version", "check scenarios/overtake"])
@pytest.mark.parametrize(
    ("stream", "why"),
    [
        (">&-", "is closed"),
        (">/dev/full", "does not accept the whole output"),
        ("| exec true", "was closed before the whole output"),
    ],
)
def test_what_cannot_be_told_is_an_error(arguments: str, stream: str, why: str) -> None:
    """The sleep lets the reader be gone."""
    code = f"import time; {'time.sleep(0.3); ' * (stream[0] == '|')}from resim.cli import main; main()"
    command = f"set -o pipefail; {sys.executable} -c '{code}' {arguments} {stream}"
    done = subprocess.run(["bash", "-c", command], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.startswith(f"resim: standard output {why}")
    assert done.stderr.count("\n") == 1
