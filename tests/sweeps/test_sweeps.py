"""Sweeps: every run is done once, and the table is the same; what kills do to it: `test_faults`."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
import termios
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import duckdb
import jsonschema
import pandas as pd
import pytest
from processes import below
from swept import THREE, write_adaptive

from resim.core.errors import InputError
from resim.core.json_text import json_text
from resim.core.sealed import sealed as with_checksum
from resim.core.spec import to_json
from resim.execution import journal
from resim.execution.journal import JournalEntry
from resim.jobs.schemas import schema_of
from resim.sweeps.result import read_swept
from resim.sweeps.sweep_file import read_sweep_file

ROOT = Path(__file__).parents[2]
Call = Callable[..., tuple[int, str, str]]

SWEEP = """
name = "small"
criteria = "{root}/scenarios/criteria/highway.toml"
build = [{builds}]
perception = "{root}/adfunc/perception/proving_ground.json"
seeds = 1
time_limit = {limit}

[[recording]]
folder = "{root}/scenarios/cut_in_brake"

[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 1.2
steps = 2
"""

FAULTY = '''
import os
import time

from adfunc.highway_pilot import HighwayPilot


class Faulty(HighwayPilot):
    """Crashes the process, hangs, or raises, as its parameter says."""

    def __init__(self, fault):
        super().__init__()
        self.fault = fault

    def step(self, perceived):
        if perceived.t > 1.0:
            if self.fault == "crash":
                os.kill(os.getpid(), 11)
            if self.fault == "hang":
                time.sleep(100.0)
            if self.fault == "raise":
                raise ValueError("no way out")
        return super().step(perceived)
'''


def write(folder: Path, *faults: str, limit: float = 60.0) -> Path:
    """A sweep of highway_pilot 1.0 and of a function with each fault."""
    builds = [f'"{ROOT}/adfunc/builds/highway_pilot-1.0.toml"']
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "faulty.py").write_text(FAULTY)
    for fault in faults:
        head = f'name = "{fault}"\nversion = "1"\nfactory = "faulty:Faulty"\ntime_limit = 1.0\n'
        (folder / f"{fault}.toml").write_text(f'{head}[parameters]\nfault = "{fault}"\n')
        builds.append(f'"{fault}.toml"')
    path = folder / "sweep.toml"
    path.write_text(SWEEP.format(root=ROOT, builds=", ".join(builds), limit=limit))
    return path


def table(out: Path) -> pd.DataFrame:
    return duckdb.sql(f"select * from '{out}/runs/*.parquet'").df()


def bytes_of(out: Path) -> dict[str, str]:
    files = [*sorted((out / "runs").iterdir()), out / "manifest.json"]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A sweep, and its results."""
    folder = tmp_path_factory.mktemp("sweep")
    path = write(folder, "raise", "crash", "hang", limit=20.0)
    start(path, folder / "out", "--workers", "2").wait()
    return path, folder / "out"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A sweep of six runs, and its results, made in one go."""
    path = write(tmp_path_factory.mktemp("whole"))
    path.write_text(path.read_text().replace("seeds = 1", "seeds = 3"))
    assert start(path, path.parent / "out").wait() == 0
    return path, path.parent / "out"


def start(path: Path, out: Path, *more: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "resim", "sweep", str(path), "--out", str(out), *more]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def test_every_run_has_a_row(undisturbed: tuple[Path, Path]) -> None:
    found = table(undisturbed[1])
    assert found["run"].tolist() == list(range(8))
    assert sorted(found["perception.latency.speed"].unique()) == [0.0, 1.2]
    good = found[found.build.str.endswith("highway_pilot-1.0.toml")]
    assert (good.end == "duration").all()
    assert good[good["perception.latency.speed"] == 0.0].decision.tolist() == ["brake, lane_change_left"]
    assert good[good["perception.latency.speed"] == 1.2].decision.tolist() == ["brake"]
    assert not good[good["perception.latency.speed"] == 0.0].same_decision.any()
    assert (good["kpi no collision"] == "PASS").all()
    assert good.risk.between(0.0, 1.0).all()


def test_faults_of_the_function_cost_their_own_runs(undisturbed: tuple[Path, Path]) -> None:
    found = table(undisturbed[1]).set_index("build")
    assert (found.loc["raise.toml"].end == "function_failed").all()
    assert found.loc["raise.toml"].failure.str.contains("no way out").all()
    assert found.loc["raise.toml"][["risk", "collision", "same_decision"]].isna().all(axis=None)
    assert (found.loc["crash.toml"].end == "function_failed").all()
    assert found.loc["crash.toml"].failure.str.contains("ended its process, which was ended by SIGSEGV").all()
    assert (found.loc["hang.toml"].end == "function_failed").all()


@pytest.mark.slow
def test_a_full_disk_loses_nothing(whole: tuple[Path, Path], tmp_path: Path) -> None:
    path = whole[0]
    command = f"ulimit -f 4; exec {sys.executable} -m resim sweep {path} --out {tmp_path / 'out'} --workers 1"
    stopped = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert stopped.returncode == 2
    assert "1-of-1.jsonl: cannot be written" in stopped.stderr
    assert "resume with --resume: nothing is lost" in stopped.stderr
    assert 1 <= len(list(journal.read(tmp_path / "out" / "journal"))) < 6
    assert start(path, tmp_path / "out", "--resume").wait() == 0
    assert bytes_of(tmp_path / "out") == bytes_of(whole[1])


def test_ctrl_c_stops_cleanly(tmp_path: Path) -> None:
    path = write(tmp_path, "hang", limit=100.0)
    process = subprocess.Popen(
        [sys.executable, "-m", "resim", "sweep", str(path), "--out", str(tmp_path / "out"), "--workers", "2"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    children: list[int] = []
    while len(children) < 5 and process.poll() is None:  # who forks, two children, and who keeps each of them
        time.sleep(0.2)
        children = below(process.pid)
    time.sleep(1.0)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to the children too
    _, error = process.communicate(timeout=20.0)
    assert process.returncode == 130
    assert "Traceback" not in error
    assert len(children) >= 5
    for pid in children:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.slow
def test_a_terminal_shows_how_far_it_is(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace("seeds = 1", "seeds = 3"))
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 100))
    command = [sys.executable, "-m", "resim", "sweep", str(path), "--out", str(tmp_path / "out")]
    process = subprocess.Popen(command, stdout=theirs, stderr=theirs, env={**os.environ, "TERM": "xterm"})
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # Linux's end of the file, when the other side is closed
        while part := os.read(ours, 4096):
            shown += part
    os.close(ours)
    said = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode())[-1000:]
    assert process.wait() == 0, said
    assert re.search(r"0 failed [━╸╺ ]+ 6/6 +[0-9.]+/s +0:00:00", said), said
    assert "6 runs, 0 failed" in said


@pytest.mark.parametrize(
    "shard", ["1/²", "²/2", "0/2", "3/2", "1/" + "9" * 5000, "1", "a/b", "-1/2", "1/2/3", "١/2"]
)
def test_what_is_no_shard_is_told(call: Call, tmp_path: Path, shard: str) -> None:
    code, _, error = call("sweep", write(tmp_path), "--out", tmp_path / "out", "--shard", shard)
    assert (code, "Give I/N with I from 1 to N" in error) == (2, True)


def test_shards_give_the_same(whole: tuple[Path, Path], call: Call, tmp_path: Path) -> None:
    for shard in ("2/2", "1/2"):
        assert call("sweep", whole[0], "--out", tmp_path / "parts", "--shard", shard)[0] == 0
    assert bytes_of(tmp_path / "parts") == bytes_of(whole[1])


def test_a_line_that_was_cut_short_is_done_again(tmp_path: Path) -> None:
    path = tmp_path / "1-of-1.jsonl"
    with journal.Journal(path) as file:
        file.append(entry(0))
        file.append(entry(1))
    path.write_bytes(path.read_bytes()[:-3])
    assert [found.run for found in journal.read(tmp_path)] == [0]
    with journal.Journal(path) as file:
        file.append(entry(2))
    assert [found.run for found in journal.read(tmp_path)] == [0, 2]


def entry(run: int) -> JournalEntry:
    return JournalEntry(run, "", {"end": "failed", "failure": "so"}, None)


def test_two_commands_do_not_write_one_journal(tmp_path: Path) -> None:
    path = tmp_path / "1-of-1.jsonl"
    with journal.Journal(path), pytest.raises(InputError, match="another `resim sweep`"):
        journal.Journal(path)
    with journal.Journal(path) as file:
        file.append(entry(0))
    assert len(list(journal.read(tmp_path))) == 1


@pytest.mark.usefixtures("ends")
def test_a_pipe_in_the_place_of_a_journal_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "1-of-1.jsonl"
    os.mkfifo(path)
    with pytest.raises(InputError, match="is not a file"):
        journal.Journal(path)
    with pytest.raises(InputError, match="is not a file"):
        list(journal.read(tmp_path))


def test_a_damaged_journal_is_told_of(undisturbed: tuple[Path, Path], call: Call) -> None:
    path, out = undisturbed
    copy = out.with_name("damaged")
    shutil.copytree(out, copy)
    lines = (out / "journal" / "1-of-1.jsonl").read_text().splitlines(keepends=True)
    (copy / "journal" / "1-of-1.jsonl").write_text("".join([*lines[:3], "rubbish\n", *lines[3:]]))
    code, _, error = call("sweep", str(path), "--out", str(copy), "--resume")
    assert code == 2
    assert "line 4 is damaged" in error


def sealed(said: str) -> str:
    return f"{zlib.crc32(said.encode()):08x} {said}\n"


@pytest.mark.parametrize(
    ("alter", "told"),
    [
        (lambda line: line.replace('"verdict": "', '"verdict": "_'), "line 2 is damaged"),
        (lambda line: line[9:], "line 2 is damaged"),
        (lambda line: line.replace("\n", "") + line, "line 2 is damaged"),
        (lambda line: sealed("[1, 2]"), "line 2 is damaged"),
        (lambda line: sealed(line[9:-2] + ', "mood": "good"}'), "line 2 is damaged"),
        (lambda line: sealed("[" * 100_000), "line 2 is damaged"),
        (
            lambda line: sealed(re.sub(r'"risk": [^,]*', '"risk": ' + "9" * 400, line[9:-1])),
            "line 2 is damaged",
        ),
        (lambda line: sealed(re.sub(r'"risk": [^,]*, ', "", line[9:-1])), "line 2 is damaged"),
        (lambda line: sealed(re.sub(r'"time": [^}]*', '"time": NaN', line[9:-1])), "line 2 is damaged"),
        (lambda line: sealed(re.sub(r'"risk": [^,]*', '"risk": "low"', line[9:-1])), "line 2 is damaged"),
        (
            lambda line: sealed(re.sub(r'"collision": [^,]*', '"collision": 0', line[9:-1])),
            "line 2 is damaged",
        ),
        (lambda line: sealed(re.sub(r'"time": [^}]*', '"time": "long"', line[9:-1])), "line 2 is damaged"),
        (
            lambda line: sealed(re.sub(r'"run": \d+', '"run": 77', line[9:-1])),
            "line 2: run 77 is not in this",
        ),
        (lambda line: sealed(re.sub(r'"run": \d+', '"run": true', line[9:-1])), "line 2 is damaged"),
        (lambda line: sealed(re.sub(r'"plan": "\w+"', '"plan": "0"', line[9:-1])), "is not in this sweep"),
        (
            lambda line: line + sealed(re.sub(r'"end": "\w+"', '"end": "collision"', line[9:-1])),
            "contradicts an earlier line",
        ),
    ],
)
def test_an_altered_journal_is_told_of(
    undisturbed: tuple[Path, Path], call: Call, tmp_path: Path, alter: Callable[[str], str], told: str
) -> None:
    path, out = undisturbed
    copy = shutil.copytree(out, out.with_name(tmp_path.name))
    file = copy / "journal" / "1-of-1.jsonl"
    lines = file.read_text().splitlines(keepends=True)
    assert alter(lines[1]) != lines[1]
    file.write_text("".join([lines[0], alter(lines[1]), *lines[2:]]))
    code, out_text, error = call("sweep", str(path), "--out", str(copy), "--resume")
    assert (code, out_text) == (2, "")
    assert f"{file}: " in error
    assert told in error
    assert "repeated" in error


def test_a_run_that_was_done_twice_with_the_same_result_counts_once(
    undisturbed: tuple[Path, Path], call: Call, tmp_path: Path
) -> None:
    path, out = undisturbed
    copy = shutil.copytree(out, out.with_name(tmp_path.name))
    file = copy / "journal" / "1-of-1.jsonl"
    (copy / "journal" / "2-of-3.jsonl").write_text(file.read_text().splitlines(keepends=True)[1])
    assert call("sweep", str(path), "--out", str(copy), "--resume")[0] == 3  # as its function failed
    assert bytes_of(copy) == bytes_of(out)


@pytest.mark.slow
def test_shards_that_begin_together_share_the_folder(tmp_path: Path) -> None:
    path = write(tmp_path)
    shards = [start(path, tmp_path / "out", "--shard", f"{k}/4", "--workers", "1") for k in (1, 2, 3, 4)]
    assert [shard.wait() for shard in shards] == [0, 0, 0, 0]
    assert len(table(tmp_path / "out")) == 2


@pytest.mark.slow
def test_a_journal_of_a_build_of_the_same_name_is_refused(call: Call, tmp_path: Path) -> None:
    """Names, seeds and parameters are the same."""
    path, other = (write(tmp_path / name, "raise") for name in ("one", "other"))
    code = other.with_name("faulty.py")
    code.write_text(code.read_text() + "# another one\n")
    for sweep, shard in ((path, "1/2"), (other, "2/2")):
        assert call("sweep", sweep, "--out", sweep.parent / "out", "--shard", shard)[0] == 3
    shutil.copy(path.parent / "out" / "journal" / "1-of-2.jsonl", other.parent / "out" / "journal")
    told, _, error = call("sweep", other, "--out", other.parent / "out", "--resume")
    assert told == 2
    assert "is not in this sweep" in error


def test_another_sweep_is_not_gone_on_with(undisturbed: tuple[Path, Path], call: Call) -> None:
    path, out = undisturbed
    code, _, error = call("sweep", str(path), "--out", str(out))
    assert (code, "--resume" in error) == (2, True)
    text = path.read_text()
    path.write_text(text.replace("high = 1.2", "high = 1.3"))
    code, _, error = call("sweep", str(path), "--out", str(out), "--resume")
    path.write_text(text)
    assert code == 2
    assert "sweep.parameter has changed when the sweep began" in error


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "perception.latency.speed",
            "perception.latency.sped",
            "parameter 'perception.latency.sped': there is no such field, did you mean 'speed'? See scen",
        ),
        (
            "perception.latency.speed",
            "function.threat_tme",
            "parameter 'function.threat_tme': in highway_pilot-1.0.toml there is no parameter 'threat_tme', "
            "did you mean 'threat_time'?",
        ),
        (
            "perception.latency.speed",
            "latency.speed",
            "name: expected a name that begins with perception., ",
        ),
        ("perception.latency.speed", "build.name", "build has no parameter 'name'"),
        ('perception = "', '# perception = "', "without a model"),
        ("scenarios/cut_in_brake", "scenarios/nowhere", "nowhere"),
        ("steps = 2", "steps = 1", "steps"),
        ("perception.latency.speed", "build.cycle_time", "expected more than 0"),
        ('cut_in_brake"\n', f'cut_in_brake"\nhash = "{64 * "0"}"\n', "has the hash"),
        (
            '"perception.latency.speed"\nlow = 0.0\nhigh = 1.2',
            '"build.cycle_time"\nlow = 0.04\nhigh = 0.11',
            "not a multiple",
        ),
        ("highway.toml", "nowhere.toml", "nowhere.toml"),
        (
            "seeds = 1",
            'plan = "halton"\npoints = 10000\nseeds = 100000',
            "1,000,000,000 runs; a sweep has up to 1,000,000.",
        ),
    ],
)
def test_mistakes_are_told(tmp_path: Path, call: Call, old: str, new: str, told: str) -> None:
    path = write(tmp_path)
    path.write_text(path.read_text().replace(old, new))
    code, _, error = call("sweep", str(path), "--out", str(tmp_path / "out"))
    assert code == 2
    if "parameter" in told:
        assert error.splitlines()[-1].startswith(f"resim: {path}: ")  # not the model or the build
    assert told in error
    assert "parameter: expected at least" not in error
    assert not (tmp_path / "out").exists()


def test_a_dry_run_says_how_long_it_takes(tmp_path: Path, call: Call) -> None:
    code, out, error = call("sweep", str(write(tmp_path)), "--out", str(tmp_path / "out"), "--dry-run")
    assert (code, error) == (0, "")
    assert re.match(r"2 runs of \d+\.\d+ s each, about \d", out)
    assert not (tmp_path / "out").exists()


def test_a_dry_run_of_a_shard_without_runs(tmp_path: Path, call: Call) -> None:
    path, out = str(write(tmp_path)), str(tmp_path / "out")
    assert call("sweep", path, "--out", out, "--dry-run", "--shard", "7/8") == (0, "0 runs\n", "")


def test_the_manifest_says_what_it_was_made_from(undisturbed: tuple[Path, Path]) -> None:
    manifest = json.loads((undisturbed[1] / "manifest.json").read_text())
    assert manifest["runs"] == 8
    assert manifest["failed"] == 6
    assert manifest["inputs"]["recordings"]["cut_in_brake"]["hash"]
    assert manifest["columns"] == table(undisturbed[1]).columns.tolist()
    schema = jsonschema.Draft202012Validator(schema_of("manifest"))
    schema.validate(manifest)
    assert not schema.is_valid({**manifest, "runs": "8"})
    assert not schema.is_valid({**manifest, "inputs": {**manifest["inputs"], "mood": "good"}})
    begun = json.loads((undisturbed[1] / "sweep.json").read_text())
    schema = jsonschema.Draft202012Validator(schema_of("sweep_begun"))
    schema.validate(begun)
    assert not schema.is_valid({**begun, "mood": "good"})
    assert json_text(with_checksum(to_json(read_swept(undisturbed[1]).manifest))) == (
        undisturbed[1] / "manifest.json"
    ).read_text(encoding="utf-8")


def test_findings_are_told_by_who_examines_a_recording_to_run_it(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command does not examine it as well: that would be the longest part of its start."""
    drive = tmp_path / "drive"
    shutil.copytree(ROOT / "scenarios" / "cut_in_brake", drive)
    text = (drive / "recording.toml").read_text()
    (drive / "recording.toml").write_text(text.replace("../../networks", f"{ROOT}/networks"))
    gt = pd.read_csv(drive / "gt.csv", dtype=str)
    at = gt["t"].astype(float)
    gt[(gt["id"] == "ego") | (at < 2.0) | (at > 4.5)].to_csv(drive / "gt.csv", index=False)
    path = write(tmp_path)
    path.write_text(path.read_text().replace(f"{ROOT}/scenarios/cut_in_brake", str(drive)))

    def examined_twice(*_: object) -> None:
        raise AssertionError("the command examines what its children do")

    monkeypatch.setattr("resim.recordings.checked.examine", examined_twice)
    code, out, error = call("sweep", "run", path, "--out", tmp_path / "out", "--workers", "1")
    assert code == 0, error
    assert out.count("drive: finding: gt 1 at 1.96 s: GAP: no sample from 1.96 to 4.52 s") == 1
    assert "GAP" not in (tmp_path / "out" / "journal" / "1-of-1.jsonl").read_text()


def test_an_adaptive_plan_of_fewer_points_than_its_first_grid_is_refused(call: Call, tmp_path: Path) -> None:
    path = write(tmp_path)
    more = "".join(
        f'[[parameter]]\nname = "perception.latency.{name}"\nlow = 0.0\nhigh = 1.0\nsteps = {steps}\nwidth = 0.5\n'
        for name, steps in (("position", 4), ("heading", 5))
    )
    plan = 'name = "small"\nplan = "adaptive"\npoints = 39\n'
    path.write_text(path.read_text().replace('name = "small"\n', plan) + "width = 0.5\n" + more)
    code, _, error = call("sweep", "run", path, "--out", tmp_path / "out")
    assert code == 2
    assert "points = 39 is less than the 40 of the first grid (steps)" in error
    with pytest.raises(InputError, match="points = 60 is less than the 297 of the first grid"):
        write_adaptive(
            tmp_path / "swept", tuple(p.model_copy(update={"width": 0.1}) for p in THREE), points=60
        )


def test_sumos_drivers_are_not_in_the_direct_engine(tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    whole = (ROOT / "scenarios" / "sweeps" / "perception_latency.toml").read_text()
    reacts = 'traffic = "reactive"\nreactive.drivers = "sumo"\n' + whole
    path.write_text(reacts)
    with pytest.raises(InputError, match="not in the engine"):
        read_sweep_file(path)
    path.write_text(reacts.replace('engine = "direct"', 'engine = "sumo"'))
    assert read_sweep_file(path).reactive.drivers == "sumo"
