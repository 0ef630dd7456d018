"""What the catalog reads of the folders that the commands write."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
import shutil
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from calling import called
from resealed import edit
from swept import state_hashes

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.recordings.content import content_hash
from resim.results import write_parquet
from resim.results.catalog import Catalog
from resim.results.circumstances import FACET, read_circumstances
from resim.results.entry import CatalogEntry, CatalogInput
from resim.results.lake import ITEM_KINDS
from resim.results.reading import VERDICTS, read_entry

ROOT = Path(__file__).parents[2]
DRIVE = ROOT / "scenarios" / "cut_in_brake"
PILOT = "highway_pilot-1.0"


def hashes(inputs: tuple[CatalogInput, ...]) -> dict[str, str]:
    return {i.role: i.hash for i in inputs}


def test_a_run_is_told_by_its_sources(made: Path) -> None:
    run = read_entry(made / "run")
    assert (run.kind, run.name, run.verdict) == ("run", "cut_in_brake", "FAIL")
    assert run.counts == {"PASS": 0, "FAIL": 4, "INVALID": 0}
    assert [(o.source, o.build, o.verdict) for o in run.outcomes] == [
        (source, PILOT, "FAIL") for source in ("GT", "SD", "rGT", "rSD")
    ]
    assert run.outcomes[0].cause == "distance, braking for comfort"
    assert [o.same_decision for o in run.outcomes] == [None, None, 0.0, 0.0]
    assert hashes(run.inputs)["recording"] == content_hash(DRIVE)
    assert run.names("build") == [PILOT]
    assert run.names("criteria") == ["highway"]
    criteria = hashes(run.inputs)["criteria"][:16]
    for kind in ("run", "verification", "sweep"):
        (made_with,) = (f.name for f in read_entry(made / kind).facts if f.facet == FACET)
        assert f"highway {criteria}" in read_circumstances(made_with)["criteria"]
        assert read_circumstances(made_with)["vehicle"] == "kinematic"


def test_a_space_follows_from_what_was_mined_and_its_recordings(made: Path, tmp_path: Path) -> None:
    assert called("space", "build", made / "mining", "--out", tmp_path / "space") == 0
    found = hashes(read_entry(tmp_path / "space").inputs)
    assert found == {"mining": read_entry(made / "mining").digest, "recording": content_hash(DRIVE)}


def test_a_path_names_a_space_and_not_its_clusters(tmp_path: Path) -> None:
    now, later = "2026-11-01T05:00:00+00:00", "2026-11-02T05:00:00+00:00"
    space = CatalogEntry("space", "space", tmp_path / "space", "here", now, "ab" * 32, "0.1.0", "")
    cluster = dataclasses.replace(space, kind="cluster", name="1.1", digest="cd" * 32, written=later)
    lake = Catalog(str(tmp_path / "catalog.sqlite"))
    lake.add(space, cluster)
    assert lake.get(str(space.folder), ITEM_KINDS).kind == "space"


def test_an_assessment_without_criteria_is_not_judged(made: Path) -> None:
    found = read_entry(made / "assessment")
    assert (found.kind, found.name, found.verdict, found.counts) == ("assessment", "cut_in_brake", "", {})
    run = read_entry(made / "run")
    assert hashes(found.inputs) == {
        **{k: v for k, v in hashes(run.inputs).items() if k not in ("criteria", "map")},
        "run": file_hash(made / "run" / "report.json"),
    }


def test_a_verification_is_told_by_its_recordings(made: Path) -> None:
    found = read_entry(made / "verification")
    assert (found.kind, found.name, found.verdict) == ("verification", "two", "not verified")
    assert found.counts == {"verified": 1, "not verified": 1, "undecided": 0, "invalid": 0, "error": 0}
    assert [(o.recording, o.build, o.verdict) for o in found.outcomes] == [
        ("cut_in_brake", PILOT, "not verified"),
        ("overtake", PILOT, "verified"),
    ]
    assert found.outcomes[0].cause.startswith("sensor: ")
    assert CatalogInput("recording", "cut_in_brake", str(DRIVE), content_hash(DRIVE)) in found.inputs


def test_a_sweep_is_told_by_recording_and_build(made: Path) -> None:
    found = read_entry(made / "sweep")
    assert (found.kind, found.name, found.verdict) == ("sweep", "late", "FAIL")
    (only,) = found.outcomes
    assert (only.recording, only.build, only.runs, only.fails, only.failures) == (
        "cut_in_brake",
        PILOT,
        2,
        2,
        0,
    )
    assert only.cause.startswith("distance (2)")
    assert only.same_decision == 0.5
    assert found.counts == {"PASS": 0, "FAIL": 2, "INVALID": 0, "failed": 0}
    assert {e.verdict for e in map(read_entry, made.glob("*/"))} <= {"", *VERDICTS}


@pytest.mark.parametrize("name", ["odd [1]* name", "it's"])
def test_a_sweep_all_of_whose_runs_failed_is_told(made: Path, tmp_path: Path, name: str) -> None:
    folder = shutil.copytree(made / "sweep", tmp_path / name)
    manifest = json.loads((folder / "manifest.json").read_text())
    (build,) = manifest["inputs"]["builds"]
    rows = pd.DataFrame(
        {"run": [0, 1], "recording": "cut_in_brake", "build": build, "end": "failed", "failure": "crash"}
    )
    write_parquet(rows, folder / "runs" / "part-00000.parquet")
    edit(folder / "manifest.json", lambda said: said.update(columns=list(rows)))
    state_hashes(folder)
    found = read_entry(folder)
    assert found.verdict == "failed"
    assert found.counts == {"PASS": 0, "FAIL": 0, "INVALID": 0, "failed": 2}
    assert found.outcomes[0].same_decision is None


def test_a_folder_is_there_changed_or_gone(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("run", "assessment", "verification", "sweep"):
        folder = shutil.copytree(made / name, tmp_path / name)
        found = read_entry(folder)
        assert found == read_entry(folder)
        assert found.state() == "there"
        assert found.id != read_entry(made / name).id  # of another folder
        page = next(folder.rglob("*.json" if name != "sweep" else "part-*.parquet"))
        for path in folder.glob("*.json"):
            path.write_text(path.read_text().replace("cut_in", "cut-in"))
        page.write_bytes(page.read_bytes() + b" ")
        assert found.state() == "changed"
        shutil.rmtree(folder)
        assert found.state() == "gone"
    monkeypatch.setattr("platform.node", lambda: "another machine")
    assert found.state() == "elsewhere"
    assert read_entry(made / "run").state() == "there"


def test_how_long_it_took_is_nothing_that_tells_results_apart(made: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(made / "run", tmp_path / "run")
    before = read_entry(folder)
    edit(folder / "run.json", lambda run: run.update(times={"map": 1.0}))
    os.utime(folder / "run.json", (0.0, 0.0))
    again = read_entry(folder)
    assert again.id == before.id
    assert again.written == "1970-01-01T00:00:00.000+00:00"


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda f: (f / "manifest.json").unlink(), r"holds a sweep that is not finished\. Finish it with `resim sweep"),
        (lambda f: (f / "manifest.json").write_text("[1]"), r"manifest\.json: was not written by resim"),
        (lambda f: (f / "manifest.json").write_text("{"), r"manifest\.json: is not JSON"),
        (lambda f: replace(f / "manifest.json", '"runs": 2', '"runs": 3'), r"manifest\.json: was changed after"),
        (lambda f: shutil.rmtree(f / "runs"), r"part-00000\.parquet: cannot be read"),
        (lambda f: (f / "runs" / "part-00000.parquet").write_text("x"), r"part-00000\.parquet: was changed after"),
        (lambda f: shutil.rmtree(f), r"is no folder\. Give one that `resim run`"),
    ],
)  # fmt: skip
def test_what_is_no_result_is_told_in_one_line(
    made: Path, tmp_path: Path, spoil: Callable[[Path], None], problem: str
) -> None:
    folder = shutil.copytree(made / "sweep", tmp_path / "sweep")
    spoil(folder)
    with pytest.raises(InputError, match=problem):
        read_entry(folder)
    with pytest.raises(InputError, match="is no folder of results"):
        read_entry(tmp_path)


def test_a_run_that_says_nonsense_is_in_no_state_of_ours(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text('{"perception": "x", "times": 1, "checksum": ""}')
    assert CatalogEntry("run", "x", tmp_path, platform.node(), "", "d", "", "").state() == "changed"
