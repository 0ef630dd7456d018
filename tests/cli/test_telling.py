"""`--json`, `--quiet` and `--verbose`, which mean the same in every command."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from conftest import ROOT, Call

from resim.cli import app as resim
from resim.cli import assess

DRIVE = ROOT / "scenarios" / "cut_in_brake"
BUILD = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
CRITERIA = ROOT / "scenarios" / "criteria" / "highway.toml"
MAP = ROOT / "networks" / "proving_ground.xodr"


def commands(group: Any, name: str = "resim") -> Iterator[tuple[str, Any]]:
    for word, one in group.commands.items():
        below = f"{name} {word}"
        yield from commands(one, below) if hasattr(one, "commands") else [(below, one)]


def test_every_command_has_them_and_a_short_help() -> None:
    every = dict(commands(typer.main.get_command(resim)))
    assert len(every) > 20
    for name, command in every.items():
        options = {word for p in command.params for word in p.opts}
        assert options >= {"--json", "--quiet", "-q", "--verbose", "-v"}, name
        assert "-h" in command.context_settings.get("help_option_names", ["-h"]), name


@pytest.mark.slow
def test_a_run_is_its_files_as_one_object_and_a_bad_verdict_is_told_all_the_same(
    call: Call, tmp_path: Path
) -> None:
    words = ("run", DRIVE, "--build", BUILD, "--criteria", CRITERIA, "--out", tmp_path / "out")
    code, out, err = call(*words, "--json")
    told = json.loads(out)
    assert code == 1
    assert told["problem"] in err
    assert told["out"] == str(tmp_path / "out")
    for name in ("report", "assessment"):
        assert told[name] == json.loads((tmp_path / "out" / f"{name}.json").read_text())
    code, out, err = call(*words, "--quiet")
    assert (code, out) == (1, "")
    assert err.splitlines() == [f"resim: {told['problem']}"]
    command = [sys.executable, "-m", "resim", *map(str, words), "--verbose"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    for stage in ("map", "fit GT", "run SD", "errors"):
        assert any(line.endswith(f": {stage}") for line in done.stderr.splitlines()), done.stderr


@pytest.mark.slow
def test_an_assessment_needs_no_folder(call: Call, tmp_path: Path) -> None:
    code, out, _ = call("assess", DRIVE, "--json")
    alone = json.loads(out)
    assert (code, alone["out"]) == (0, None)
    call("assess", DRIVE, "--out", tmp_path / "out", "--quiet")
    assert alone["assessment"] == json.loads((tmp_path / "out" / "assessment.json").read_text())


def test_a_command_tells_its_own_results_whoever_writes_into_the_folder_then(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"

    def by_another(folder: Path) -> None:
        for name in ("report.json", "assessment.json"):
            (folder / name).write_text('{"of": "another command"}')

    monkeypatch.setattr(assess, "register", by_another)
    build = ROOT / "adfunc" / "builds" / "replay-1.0.toml"
    code, said, _ = call("run", DRIVE, "--build", build, "--basis", "gt", "--out", out, "--json")
    assert code == 0
    assert json.loads((out / "report.json").read_text()) == {"of": "another command"}
    assert json.loads(said)["report"]["build"]["name"] == "replay"
    assert "rGT" in json.loads(said)["assessment"]


@pytest.mark.parametrize(
    ("words", "keys"),
    [
        (("check", DRIVE), {"findings", "map", "flaws"}),
        (("map", "check", MAP), {"map", "flaws", "problems"}),
        (("perception", "show", ROOT / "adfunc/perception/latency.json"), {"model"}),
        (("runs", "list"), {"results"}),
    ],
)
def test_what_others_tell(call: Call, words: tuple[object, ...], keys: set[str], monkeypatch: pytest.MonkeyPatch,
                          tmp_path: Path) -> None:  # fmt: skip
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    code, out, _ = call(*words, "--json")
    assert (code, set(json.loads(out))) == (0, keys)
    assert call(*words, "--quiet")[:2] == (0, "")


def test_findings_are_told_with_all_that_is_known_of_them(call: Call, tmp_path: Path) -> None:
    drive = tmp_path / "drive"
    drive.mkdir()
    for file in DRIVE.iterdir():
        (drive / file.name).write_bytes(file.read_bytes())
    settings = drive / "recording.toml"
    settings.write_text(settings.read_text().replace('"../../networks', f'"{ROOT}/networks'))
    gt = (drive / "gt.csv").read_text().splitlines()
    (drive / "gt.csv").write_text("\n".join([*gt, gt[-1]]) + "\n")  # the last row twice
    code, out, _ = call("check", drive, "--json")
    found = json.loads(out)["findings"]
    assert code in (0, 1)
    assert {f["code"] for f in found}
    assert all({"severity", "code", "text", "meaning", "start", "end"} <= set(f) for f in found)


def test_what_contradicts_is_refused(call: Call) -> None:
    assert call("check", DRIVE, "--quiet", "--json")[0] == 2
    code, out, err = call("check", DRIVE, "-q", "-v")
    assert (code, out) == (2, "")
    assert "--quiet: contradicts --verbose" in err
