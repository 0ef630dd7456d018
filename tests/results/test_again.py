"""The command that results say makes them again: it carries all that was said, and makes the same."""

from __future__ import annotations

import contextlib
import inspect
import shutil
from pathlib import Path
from typing import get_args

import pytest
from calling import called

from resim.cli.offered import OFFERED
from resim.cli.parameters import WITHOUT_EFFECT, option_of
from resim.jobs.lake import again
from resim.results.asked import AGAIN, FILE, AskedResults, AskedValue, read_asked, write_asked
from resim.results.entry import digest
from resim.results.reading import read_entry

ROOT = Path(__file__).parents[2]
DRIVE, PILOT = ROOT / "scenarios" / "cut_in_brake", ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
CRITERIA, LATENCY = (
    ROOT / "scenarios" / "criteria" / "highway.toml",
    ROOT / "adfunc" / "perception" / "latency.json",
)
RESULTS = ("run", "assess", "verify", "sweep", "mine", "space", "space-grow")
"""Jobs that make results of which the catalog knows."""


def nowhere(digest: str) -> None:
    return None


def command(folder: Path) -> list[str]:
    """The words of the command that results are made again by, of files where they were."""
    return again(read_entry(folder), nowhere)


@pytest.fixture(autouse=True)
def _no_catalog(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RESIM_CATALOG", "none")


def repeated(folder: Path, *words: object) -> list[str]:
    """Make results, and make them again as they say; gives the words, of which the result must be the same."""
    kind = read_entry(folder / "one").kind if called(*words, "--out", folder / "one") in (0, 1, 3) else "run"
    told = command(folder / "one")
    with contextlib.chdir(folder):  # as it stands there
        assert called(*told[1:]) in (0, 1, 3)
    assert told[-2:] == ["--out", AGAIN]
    assert digest(folder / "one", kind) == digest(folder / AGAIN, kind), told
    assert command(folder / AGAIN) == told
    return told[:-2]


def test_a_run_is_made_again_with_all_that_was_said(tmp_path: Path) -> None:
    (tmp_path / "traffic.toml").write_text("[car]\ntime_gap = 1.5\n")
    told = repeated(
        tmp_path, "run", DRIVE, "--build", PILOT, "--criteria", CRITERIA, "--basis", "gt", "--no-stop-at-collision",
        "--perception", LATENCY, "--set", "latency.speed=0.3", "--seeds", 1, "--seed", 4, "--step", 0.05, "--lead-in",
        2, "--vehicle", "single-track", "--traffic", tmp_path / "traffic.toml", "--verdict-of", "rGT",
    )  # fmt: skip
    assert told == [
        "resim", "run", str(DRIVE), "--build", str(PILOT), "--basis", "gt", "--vehicle", "single-track", "--step",
        "0.05", "--lead-in", "2.0", "--seed", "4", "--traffic", str(tmp_path / "traffic.toml"),
        "--no-stop-at-collision", "--criteria", str(CRITERIA), "--perception", str(LATENCY), "--set",
        "latency.speed=0.3", "--seeds", "1", "--verdict-of", "rGT",
    ]  # fmt: skip
    (tmp_path / "traffic.toml").write_text("[car]\ntime_gap = 2.5\n")  # what it was made of is nowhere
    assert command(tmp_path / "one") == []


@pytest.mark.slow
def test_an_assessment_mining_and_a_space_are_made_again(tmp_path: Path, made: Path) -> None:
    shutil.copytree(made / "run", tmp_path / "run")
    for name in ("assessed", "mined", "space"):
        (tmp_path / name).mkdir()
    told = repeated(tmp_path / "assessed", "assess", tmp_path / "run", "--path", "state", "--seed", 2, "--mode",
                    "published", "--criteria", CRITERIA)  # fmt: skip
    assert told[1:4] == ["assess", "drive", str(tmp_path / "run")]
    told = repeated(tmp_path / "mined", "mine", DRIVE, "--around", "risk", "--scenarios", "recordings")
    assert told[1:] == ["mine", str(DRIVE), "--around", "risk", "--scenarios", "recordings"]
    (tmp_path / "settings.toml").write_text("threshold = 0.5\n")
    told = repeated(
        tmp_path / "space", "space", "build", made / "mining", "--settings", tmp_path / "settings.toml"
    )
    assert told[1:3] == ["space", "build"]


def test_mining_with_a_recording_that_cannot_be_read_is_made_again(tmp_path: Path) -> None:
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "recording.toml").write_text("name = ")
    told = repeated(tmp_path, "mine", DRIVE, tmp_path / "broken", "--scenarios", "rows")
    assert told[1:] == ["mine", str(DRIVE), str(tmp_path / "broken"), "--scenarios", "rows"]
    (tmp_path / "broken" / "recording.toml").write_text("name = 1")
    assert command(tmp_path / "one") == []


def test_a_verification_is_made_again(tmp_path: Path) -> None:
    suite = tmp_path / "one.toml"
    suite.write_text(
        f'name = "one"\ncriteria = "{CRITERIA}"\nreports = 0\nagreement = 0.5\n[[recording]]\nfolder = "{DRIVE}"\n'
    )
    told = repeated(tmp_path, "verify", suite, "--build", PILOT, "--perception", LATENCY, "--set", "latency.speed=0.1",
                    "--seeds", 6, "--driven-by", "unknown", "--vary", "speed", "--workers", 1)  # fmt: skip
    assert told[5:] == ["--perception", str(LATENCY), "--set", "latency.speed=0.1", "--seeds", "6", "--vary", "speed",
                        "--driven-by", "unknown"]  # fmt: skip


def test_a_sweep_and_a_space_that_grew_are_made_again(made: Path, tmp_path: Path) -> None:
    (tmp_path / "sweep").mkdir()
    assert repeated(tmp_path / "sweep", "sweep", "run", made / "late.toml")[1:3] == ["sweep", "run"]
    assert called("space", "build", made / "mining", "--out", tmp_path / "space") == 0
    assert (
        called(
            "mine", ROOT / "scenarios" / "overtake", "--scenarios", "recordings", "--out", tmp_path / "mined"
        )
        == 0
    )
    (tmp_path / "grown").mkdir()
    told = repeated(tmp_path / "grown", "space", "grow", tmp_path / "space", tmp_path / "mined")
    assert told[1:] == ["space", "grow", str(tmp_path / "space"), str(tmp_path / "mined")]


def test_a_run_of_a_sweep_is_said_to_be_made_of_the_sweep(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made / "run", tmp_path / "one")
    swept = AskedValue("", str(made / "sweep"), digest(made / "sweep", "sweep"))
    write_asked(AskedResults(("sweep", "repeat"), (swept, AskedValue("", "0"))), tmp_path / "one")
    assert command(tmp_path / "one")[1:] == ["sweep", "repeat", str(made / "sweep"), "0", "--out", AGAIN]


def test_results_that_others_wrote_over_are_not_said_to_be_made_so(tmp_path: Path, made: Path) -> None:
    shutil.copytree(made / "assessment", tmp_path / "one")
    assert read_asked(read_entry(tmp_path / "one")) is not None
    text = (tmp_path / "one" / FILE).read_text()
    (tmp_path / "one" / FILE).write_text(text.replace('"assess"', '"demo"'))  # it is sealed
    assert read_asked(read_entry(tmp_path / "one")) is None
    shutil.copy(made / "run" / FILE, tmp_path / "one" / FILE)  # of other results
    assert read_asked(read_entry(tmp_path / "one")) is None


@pytest.mark.parametrize("name", RESULTS)
def test_every_parameter_is_carried_or_changes_nothing(name: str) -> None:
    offered = OFFERED[name]
    carried = [p for p in inspect.signature(offered.job, eval_str=True).parameters.values()
               if p.name not in WITHOUT_EFFECT]  # fmt: skip
    names = [option_of(get_args(p.annotation)[1], p.name, is_flag=True)[0] for p in carried]
    arguments = names.count("")
    assert arguments <= 2
    assert len({*names} - {""}) == len(names) - arguments  # each has a name of its own
    assert {p.name for p in carried} == EXPECTED[name]


EXPECTED: dict[str, set[str]] = {
    "run": {
        "recording", "build", "basis", "vehicle", "step", "lead_in", "seed", "traffic", "stop_at_collision", "criteria",
        "perception", "settings", "seeds", "accept", "verdict_of", "record",
    },
    "assess": {"drive", "criteria", "mode", "path", "prediction", "road_aware", "seed", "accept", "verdict_of"},
    "verify": {"suite", "build", "against", "perception", "settings", "seeds", "vary", "driven_by", "vehicle"},
    "sweep": {"file", "vehicle"},
    "mine": {"recordings", "labels", "around", "scenarios", "accept"},
    "space": {"mined", "settings"},
    "space-grow": {"space", "mined"},
}  # fmt: skip
"""What has to be said to make results again; a new parameter is added here, or told to change nothing."""
