"""Repaired folders: written beside the original, told on the command line, and known to a run made of them."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from resim.recordings import RecordingTables, read_recording, read_tables, write_recording, write_tables
from resim.recordings.checks import examine
from resim.recordings.formats.mcity import import_trial
from resim.recordings.repairs import repair
from resim.road.opendrive import RoadNetwork, load

ROOT = Path(__file__).parents[3]
MCITY = ROOT.parent / "shared" / "data" / "mcity"
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def drive(tmp_path: Path) -> Callable[..., Path]:
    """A recording folder with a clock that jumps, a gap, and with `torn` a jump that nobody can repair."""

    def make(*, torn: bool = False) -> Path:
        folder = tmp_path / "drive"
        shutil.copytree(ROOT / "scenarios" / "rear_end", folder)
        shutil.copy(ROOT / "networks" / "proving_ground.xodr", folder)
        settings = (folder / "recording.toml").read_text().replace("../../networks/", "")
        (folder / "recording.toml").write_text(settings)
        gt = pd.read_csv(folder / "gt.csv", dtype={"id": str}, float_precision="round_trip")
        gt = gt[~((gt["id"] == "1") & gt["t"].between(1.0, 1.5))]
        gt.loc[gt["t"] > 3.0, "t"] += 0.2
        if torn:
            gt.loc[(gt["id"] == "1") & (gt["t"] > 2.0), "y"] += 9.0
        gt.to_csv(folder / "gt.csv", index=False)
        return folder

    return make


def digest(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()}


def test_a_repaired_copy_is_written_and_the_original_stays(
    call: Call, drive: Callable[..., Path], tmp_path: Path
) -> None:
    folder = drive()
    before = digest(folder)
    code, out, error = call("check", folder, "--fix", tmp_path / "fixed")
    assert (code, error) == (0, "")
    assert digest(folder) == before
    assert sorted(digest(tmp_path / "fixed")) == ["gt.csv", "proving_ground.xodr", "recording.toml", "sd.csv"]
    for text in ("error    CLOCK_JUMP", "--fix would", "repaired CLOCK_JUMP  gt: the whole table, samples: ",
                 "repaired GAP  gt: 1 object(s), samples: ", "left:\nnothing found", "fixed: written"):  # fmt: skip
        assert text in out
    assert out.index("error    CLOCK_JUMP") < out.index("repaired CLOCK_JUMP") < out.index("left:")
    settings = read_tables(tmp_path / "fixed").settings
    told = settings.provenance["repaired"]
    assert told.startswith("from drive, --max-gap 1 --outliers robust: gt CLOCK_JUMP ")
    assert "gt GAP 13 samples" in told
    assert call("check", tmp_path / "fixed") == (0, "nothing found\n", "")
    call("check", folder, "--fix", tmp_path / "again")
    assert digest(tmp_path / "again") == digest(tmp_path / "fixed")
    call("check", tmp_path / "fixed", "--fix", tmp_path / "twice")
    assert "; then from fixed" in read_tables(tmp_path / "twice").settings.provenance["repaired"]
    for name in ("gt.csv", "sd.csv"):
        assert digest(tmp_path / "twice")[name] == digest(tmp_path / "fixed")[name]


def test_errors_that_are_left_are_a_bad_verdict(
    call: Call, drive: Callable[..., Path], tmp_path: Path
) -> None:
    code, out, error = call("check", drive(torn=True), "--fix", tmp_path / "fixed")
    assert code == 1
    assert "error    POSITION_JUMP" in out[out.index("left:") :]
    assert error == f"resim: {tmp_path / 'fixed'}: 1 error(s) left\n"
    assert (tmp_path / "fixed" / "gt.csv").is_file()


@pytest.mark.parametrize(
    ("arguments", "texts"),
    [
        (["--max-gap", "2"], ["--max-gap", "--fix OUT"]),
        (["--outliers", "robust"], ["--outliers", "--fix OUT"]),
        (["--fix", "{}/fixed", "--outliers", "median"], ["'median'", "robust, moving-average"]),
        (["--fix", "{}/fixed", "--max-gap", "-1"], ["-1 s", "0 to 60 s"]),
        (["--fix", "{}/drive"], ["exists already"]),
        (["--fix", "{}/drive/fixed"], ["lies in", "stays as it is"]),
    ],
)
def test_calls_that_cannot_be_done_are_refused(
    call: Call, drive: Callable[..., Path], tmp_path: Path, arguments: list[str], texts: list[str]
) -> None:
    folder = drive()
    before = digest(folder)
    code, out, error = call("check", folder, *(a.format(tmp_path) for a in arguments))
    assert (code, out) == (2, "")
    assert error.count("\n") == 1
    for text in texts:
        assert text in error
    assert digest(folder) == before
    assert [p.name for p in tmp_path.iterdir()] == ["drive"]


def test_many_findings_of_a_kind_are_told_once(call: Call, tmp_path: Path) -> None:
    tables = read_tables(ROOT / "scenarios" / "overtake")
    gt = tables.gt.copy()
    for k in range(9):
        gt = gt[~((gt["id"] == "2") & gt["t"].between(1.0 + k, 1.5 + k))]
    write_tables(RecordingTables(**{**vars(tables), "gt": gt}), tmp_path / "many")
    code, out, _ = call("check", tmp_path / "many")
    assert code == 0
    assert out.count("no sample from") == 5
    assert "warning  GAP  gt: ... and 4 more of this code" in out


def test_tables_are_written_as_recordings_are(tmp_path: Path) -> None:
    recording = read_recording(ROOT / "scenarios" / "overtake")
    write_recording(recording, tmp_path / "one")
    write_tables(read_tables(tmp_path / "one"), tmp_path / "two")
    assert digest(tmp_path / "one") == digest(tmp_path / "two")


def test_a_run_tells_what_was_repaired(call: Call, drive: Callable[..., Path], tmp_path: Path) -> None:
    call("check", drive(), "--fix", tmp_path / "fixed")
    build = ROOT / "adfunc" / "builds" / "replay-1.0.toml"
    code, _, error = call("run", tmp_path / "fixed", "--build", build, "--out", tmp_path / "out")
    assert code == 0, error
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    counts = report["repaired"]["gt"]
    assert counts["GAP"] == 13
    assert counts["CLOCK_JUMP"] > 50
    assert report["findings"] == []
    assert any("were repaired before" in line for line in report["warnings"])
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "samples of gt were repaired before: CLOCK_JUMP" in html


@pytest.fixture(scope="module")
def mcity() -> RoadNetwork:
    if not MCITY.is_dir():
        pytest.skip("no shared data")
    return load(MCITY / "mcity.xodr")


@pytest.mark.parametrize("trial", ["3", "5"])
def test_real_recordings_have_fewer_findings_after(mcity: RoadNetwork, trial: str) -> None:
    before = import_trial(trial, MCITY, mcity)
    result = repair(before, mcity)
    assert len(result.left) < len(examine(before, mcity))
    assert result.left == examine(result.tables, mcity)
    assert repair(result.tables, mcity).done == ()
