"""`resim runs`, and what the commands put into the catalog."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import duckdb
import pytest

from resim.core.errors import InputError
from resim.results import RUN, SWEEP, remove_results
from resim.results.rows import read_rows

ROOT = Path(__file__).parents[2]
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def catalog(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "catalog.sqlite"
    monkeypatch.setenv("RESIM_CATALOG", str(path))
    return path


@pytest.fixture
def mine(made: Path, tmp_path: Path) -> Path:
    """A copy of the results of each kind, which may be deleted."""
    return shutil.copytree(made, tmp_path / "made")


def listed(call: Call, *options: object) -> list[dict[str, object]]:
    code, out, _ = call("runs", "list", "--json", *options)
    assert code == 0
    found: list[dict[str, object]] = json.loads(out)["results"]
    return found


def test_results_of_every_kind_are_added_listed_and_shown(call: Call, made: Path) -> None:
    folders = [made / name for name in ("run", "assessment", "verification", "sweep", "mining")]
    assert call("runs", "list") == (0, "no results\n", "")
    code, out, _ = call("runs", "add", *folders)
    assert code == 0
    assert "run 'cut_in_brake': FAIL (0/4)" in out
    assert "assessment 'cut_in_brake': not judged" in out
    assert "verification 'two': not verified (1/2)" in out
    assert "sweep 'late': FAIL (0/2)" in out
    assert "mining 'mining': not judged" in out
    assert re.search(r"maneuvers, 1 scenario\b", call("runs", "show", made / "mining")[1])
    assert [(r["kind"], r["state"]) for r in listed(call)] == [
        (kind, "there") for kind in ("mining", "sweep", "verification", "assessment", "run")
    ]
    (sweep,) = listed(call, "--kind", "sweep", "--build", "pilot", "--verdict", "fail")
    assert sweep["table"] == f"{made}/sweep/runs/*.parquet"
    code, out, _ = call("runs", "show", str(sweep["id"])[:6])
    assert code == 0
    assert f"select * from read_parquet('{made}/sweep/runs/*.parquet', hive_partitioning = false)" in out
    assert "2: 0 PASS, 2 FAIL, 0" in out
    told = json.loads(call("runs", "show", made / "run", "--json")[1])
    assert [o["source"] for o in told["outcomes"]] == ["GT", "SD", "rGT", "rSD"]
    assert {i["role"] for i in told["inputs"]} == {"recording", "build", "criteria", "map"}
    code, _, error = call("runs", "list", "--verdict", "bad")
    assert code == 2
    assert "--verdict: there is no 'bad'. There are: PASS, FAIL, INVALID, failed, verified" in error


@pytest.mark.parametrize("name", ["o[1]", "collision=false/verdict=PASS", "o*"])
def test_the_rows_of_a_sweep_are_those_of_its_folder_whatever_its_name(
    call: Call, made: Path, tmp_path: Path, name: str
) -> None:
    folder = shutil.copytree(made / "sweep", tmp_path / "all" / name / "sweep")
    shutil.copytree(made / "sweep", tmp_path / "all" / "o1" / "sweep")
    part = tmp_path / "all" / "o1" / "sweep" / "runs" / "part-00000.parquet"
    duckdb.sql(f"SELECT * REPLACE ('PASS' AS verdict) FROM '{part}'").write_parquet(f"{part}.new")
    Path(f"{part}.new").replace(part)
    hashes = json.loads((folder / "manifest.json").read_text())["files"]
    assert set(read_rows(folder, hashes)["verdict"]) == {"FAIL"}
    code, out, _ = call("runs", "add", folder)
    assert code == 0
    assert "sweep 'late': FAIL (0/2)" in out


@pytest.mark.parametrize(
    "name", ["tracks.parquet", "answers.parquet", "plans.parquet", "report.json", "GT.jscen.json"]
)
def test_results_of_which_a_bit_is_another_are_not_assessed(
    call: Call, made: Path, tmp_path: Path, name: str
) -> None:
    folder = shutil.copytree(made / "run", tmp_path / "run")
    whole = (folder / name).read_bytes()
    (folder / name).write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    code, out, error = call("assess", folder)
    assert (code, out) == (2, "")
    assert f"{folder / name}: was changed after it was written: its SHA-256 is " in error
    assert error.endswith("Run it again.\n")


def test_an_assessment_of_another_run_is_not_added(call: Call, made: Path, tmp_path: Path) -> None:
    drive, build = (
        ROOT / "scenarios" / "cut_in_brake",
        ROOT / "adfunc" / "builds" / "constant_velocity-1.0.toml",
    )
    criteria = ROOT / "scenarios" / "criteria" / "highway.toml"
    call("run", drive, "--build", build, "--criteria", criteria, "--out", tmp_path / "other")
    folder = shutil.copytree(made / "run", tmp_path / "run")
    shutil.copy(tmp_path / "other" / "assessment.json", folder)
    code, _, error = call("runs", "add", folder)
    assert code == 2
    assert (
        "assessment.json: is of another run than run.json and report.json beside it. Run it again." in error
    )


def test_folders_are_added_all_or_none(call: Call, made: Path, tmp_path: Path) -> None:
    code, _, error = call("runs", "add", made / "run", tmp_path / "nowhere")
    assert code == 2
    assert "nowhere: is no folder. Give one that `resim run`" in error
    assert listed(call) == []


def test_a_list_tells_what_is_gone_and_what_was_replaced(call: Call, mine: Path) -> None:
    call("runs", "add", mine / "run", mine / "sweep", mine / "verification")
    shutil.rmtree(mine / "run")
    (mine / "sweep" / "runs" / "part-00001.parquet").touch()
    assert [r["state"] for r in listed(call)] == ["changed", "there", "gone"]
    out = call("runs", "list")[1]
    assert "run (gone)" in out
    assert "sweep (changed)" in out


def test_results_are_forgotten_and_their_folders_stay(call: Call, mine: Path) -> None:
    call("runs", "add", mine / "run", mine / "sweep")
    code, out, _ = call("runs", "rm", mine / "run")
    assert code == 0
    assert out.startswith("forgotten: ")
    assert (mine / "run").is_dir()
    assert [r["kind"] for r in listed(call)] == ["sweep"]
    code, _, error = call("runs", "rm", mine / "run")
    assert code == 2
    assert "`resim runs add FOLDER` puts one in" in error


@pytest.mark.parametrize("kind", ["run", "assessment", "verification", "sweep"])
def test_folders_are_deleted_with_all_that_is_in_them(call: Call, mine: Path, kind: str) -> None:
    call("runs", "add", mine / kind)
    code, out, _ = call("runs", "rm", mine / kind, "--files", "--yes")
    assert code == 0
    assert out.startswith("deleted: ")
    assert not (mine / kind).exists()
    assert not [path for path in mine.iterdir() if path.name.startswith(".")]
    assert listed(call) == []


def test_nothing_is_deleted_before_the_answer(
    call: Call, mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    call("runs", "add", mine / "run")
    for answer in ("", "n\n", "y\n"):
        assert (mine / "run").is_dir()
        assert len(listed(call)) == 1
        monkeypatch.setattr("sys.stdin", io.StringIO(answer))
        code, out, error = call("runs", "rm", mine / "run", "--files")
        if not answer:
            assert code == 2
            assert "--files: asks before it deletes, but there was no answer. Say --yes." in error
        else:
            assert code == 0
            assert ("nothing was removed" if answer == "n\n" else "deleted: ") in out
    assert not (mine / "run").exists()


def test_what_is_not_what_the_catalog_holds_is_never_deleted(call: Call, mine: Path) -> None:
    call("runs", "add", mine / "run", mine / "sweep")
    (mine / "sweep" / "journal" / "notes.txt").touch()
    report = mine / "run" / "report.json"
    report.write_text(report.read_text() + " ")
    code, _, error = call("runs", "rm", mine / "run", "--files", "--yes")
    assert code == 2
    assert "was overwritten after it was added to the catalog. Leave out --files" in error
    code, _, error = call("runs", "rm", mine / "sweep", "--files", "--yes")
    assert code == 2
    assert "holds journal/notes.txt, which is not a resim result" in error
    assert len(listed(call)) == 2
    assert (mine / "sweep" / "manifest.json").is_file()
    assert (mine / "run" / "run.json").is_file()


def test_links_and_folders_of_others_are_not_deleted(mine: Path) -> None:
    (mine / "link").symlink_to(mine / "run")
    with pytest.raises(InputError, match="is a link"):
        remove_results(mine / "link", RUN)
    with pytest.raises(InputError, match=r"is not a results folder \(it has no sweep\.json"):
        remove_results(mine / "run", SWEEP)
    (mine / "sweep" / "runs" / "part-7.parquet").symlink_to(mine / "run" / "run.json")
    with pytest.raises(InputError, match=r"holds runs/part-7\.parquet"):
        remove_results(mine / "sweep", SWEEP)
    (mine / "run" / "report.html").unlink()
    (mine / "run" / "report.html").mkdir()
    with pytest.raises(InputError, match=r"holds report\.html"):
        remove_results(mine / "run", RUN)


@pytest.mark.slow
def test_every_command_puts_its_results_in_and_its_bytes_are_the_same_without(
    call: Call, made: Path, tmp_path: Path
) -> None:
    pilot, out = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml", tmp_path / "out"
    assert call("assess", made / "run", "--out", out / "assessment")[0] == 0
    assert call("verify", made / "two.toml", "--build", pilot, "--out", out / "verification")[0] == 1
    assert call("sweep", made / "late.toml", "--out", out / "sweep")[0] == 0
    criteria = ROOT / "scenarios" / "criteria" / "highway.toml"
    drive = ROOT / "scenarios" / "cut_in_brake"
    assert call("run", drive, "--build", pilot, "--criteria", criteria, "--out", out / "run")[0] == 1
    assert [r["folder"] for r in listed(call)] == [
        str(out / kind) for kind in ("run", "sweep", "verification", "assessment")
    ]
    files = "run/report.json", "run/assessment.json", "assessment/assessment.json"
    for file in (*files, "sweep/runs/part-00000.parquet"):
        assert (out / file).read_bytes() == (made / file).read_bytes()
    call("assess", made / "run", "--out", out / "assessment")
    assert len(listed(call)) == 4


@pytest.mark.parametrize(
    "place", ["nowhere/file.txt/catalog.sqlite", "file.txt", "postgresql://me:secret@127.0.0.1:1/runs"]
)
def test_a_catalog_that_cannot_be_written_costs_one_line_and_no_result(
    call: Call, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    (tmp_path / "file.txt").write_text("no database\n" * 100)
    (tmp_path / "nowhere").touch()
    monkeypatch.setenv("RESIM_CATALOG", place if "//" in place else str(tmp_path / place))
    code, out, error = call("assess", made / "run", "--out", tmp_path / "out")
    assert code == 0
    assert "assessment: " in out
    assert (tmp_path / "out" / "assessment.json").is_file()
    assert error.startswith(
        "resim: warning: the results are complete, but could not be added to the catalog: "
    )
    assert error.count("\n") == 1
    assert "secret" not in error
    assert "Set RESIM_CATALOG to" in error


def test_without_a_catalog_nothing_is_put_in(
    call: Call, made: Path, tmp_path: Path, catalog: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RESIM_CATALOG", "none")
    code, _, error = call("assess", made / "run", "--out", tmp_path / "out")
    assert (code, error) == (0, "")
    assert not catalog.exists()
    code, _, error = call("runs", "list")
    assert code == 2
    assert "RESIM_CATALOG: switches the catalog off. Unset it" in error
