"""The catalog, over SQLite and over a PostgreSQL server: what is put in is found again."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from resim.core.errors import InputError
from resim.results.catalog import Catalog
from resim.results.database import address, engine, where
from resim.results.entry import CatalogEntry, CatalogInput, CatalogOutcome
from resim.results.tables import ITEM

HASH = "68b76f997ff01c2d44bf22c0f9b9ea4e67737fab120d4a1615a1173006f5a03a"


def entry(name: str = "late", day: int = 1, build: str = "pilot-1.0", **more: object) -> CatalogEntry:
    told: dict[str, object] = {
        "kind": "sweep",
        "folder": Path("/results") / name,
        "host": "cluster",
        "digest": f"{day:064x}",
        "verdict": "FAIL",
        "counts": {"PASS": 3, "FAIL": 1, "INVALID": 0, "failed": 1},
        "inputs": (
            CatalogInput("recording", "cut_in", "/drives/cut_in", HASH),
            CatalogInput("build", build, "/b.toml", "ab" * 32),
        ),
        "outcomes": (
            CatalogOutcome("cut_in", build, "", "FAIL", "distance (1)", 5, 3, 1, 0, 1, 2, 0.6),
            CatalogOutcome("overtake", build, verdict="INVALID"),
        ),
    } | more
    return CatalogEntry(name=name, written=f"2026-11-{day:02}T05:00:00.000+00:00", resim="0.1.0", **told)  # type: ignore[arg-type]


def test_a_result_comes_back_whole_and_is_never_double(database: str) -> None:
    catalog, one = Catalog(database), entry()
    assert catalog.find() == []
    catalog.add(one)
    catalog.add(one)
    assert Catalog(database).find() == [one]
    later = replace(one, host="laptop", outcomes=one.outcomes[:1], inputs=())
    catalog.add(later)  # the same content in the same folder
    assert catalog.find() == [later]
    catalog.add(replace(one, digest="other"))
    assert len(catalog.find()) == 2


def test_results_are_found_by_kind_build_recording_and_verdict_the_newest_first(database: str) -> None:
    catalog = Catalog(database)
    run = entry("run", 3, "idm-2.0", kind="run", verdict="PASS",
                outcomes=(CatalogOutcome("jam", "idm-2.0", "rGT", "PASS"),),
                inputs=(CatalogInput("recording", "jam_100%", hash="cd" * 32),
                        CatalogInput("build", "idm-2.0")))  # fmt: skip
    newer = entry(
        "newer", 2, inputs=(CatalogInput("build", "pilot-1.1"), CatalogInput("against", "pilot-1.0"))
    )
    older = entry("older", 1)
    for each in (newer, older, run):
        catalog.add(each)
    assert catalog.find() == [run, newer, older]
    assert catalog.find(kind="run") == [run]
    assert catalog.find(build="PILOT-1.0") == [newer, older]
    assert catalog.find(build="abab") == [older]
    assert catalog.find(recording=HASH[:12].upper()) == [older]
    assert catalog.find(recording="cut") == [older]
    assert catalog.find(recording="0%") == [run]
    assert catalog.find(recording="cut%in") == catalog.find(recording="b76f") == []
    assert catalog.find(verdict="pass") == [run]
    assert catalog.find(verdict="INVALID") == [newer, older]
    assert catalog.find(verdict="INVALID", recording="cut", kind="sweep") == [older]
    assert catalog.find(verdict="PAS_") == []


def test_a_result_is_named_by_id_by_some_digits_of_it_or_by_its_folder(database: str) -> None:
    catalog, one, other = Catalog(database), entry("one"), entry("other")
    for each in (one, other):
        catalog.add(each)
    assert catalog.get(one.id) == catalog.get(one.id[:4].upper()) == catalog.get("/results/x/../one") == one
    with pytest.raises(
        InputError, match=rf"^{one.id[:3]}: is no result that .* near: {one.id[:8]}\. `resim runs"
    ):
        catalog.get(one.id[:3])
    with pytest.raises(InputError, match=rf"^other: is no result that .* near: {other.id[:8]}\."):
        catalog.get("other")
    with pytest.raises(InputError, match=r"^: is no result that the catalog .* knows\. `resim"):
        catalog.get("")


def test_digits_that_two_results_begin_with_are_refused(
    database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(CatalogEntry, "id", property(lambda e: f"abcd{e.written[9]}ef012345678"))
    catalog = Catalog(database)
    for day in (1, 2):
        catalog.add(entry(day=day))
    with pytest.raises(
        InputError, match=r"^abcd: 2 results begin so: abcd1ef0, abcd2ef0\. Give more of the id\."
    ):
        catalog.get("abcd")
    assert catalog.get("abcd2").digest.endswith("2")


def test_what_is_forgotten_leaves_nothing_behind(database: str) -> None:
    catalog, one, other = Catalog(database), entry("one"), entry("other")
    for each in (one, other):
        catalog.add(each)
    catalog.forget(one)
    assert catalog.find() == [other]
    with engine(address(database)).connect() as connection:
        for table in ("resim_input", "resim_outcome"):
            assert connection.execute(text(f"SELECT DISTINCT item FROM {table}")).scalars().all() == [
                other.id
            ]


MANY = """
import sys
sys.path.insert(0, sys.argv[1])
from test_catalog import entry
from resim.results.catalog import Catalog
for k in range(10):
    catalog = Catalog(sys.argv[2])
    catalog.add(entry(f"mine {sys.argv[3]} {k}"))
    catalog.add(entry(f"everybody's {k}"))
"""


def test_processes_that_write_at_once_lose_nothing(database: str) -> None:
    command = [sys.executable, "-c", MANY, str(Path(__file__).parent), database]
    processes = [subprocess.Popen([*command, str(k)], stderr=subprocess.PIPE, text=True) for k in range(6)]
    for process in processes:
        _, error = process.communicate(timeout=120)
        assert process.returncode == 0, error
    found = Catalog(database).find()
    assert len({e.name for e in found}) == len(found) == 6 * 10 + 10
    assert all(len(e.outcomes) == len(e.inputs) == 2 for e in found)


def test_a_catalog_of_a_newer_resim_is_refused(database: str) -> None:
    Catalog(database).add(entry())
    with engine(address(database)).begin() as connection:
        connection.execute(text("UPDATE resim_catalog SET version_num = 7"))
    with pytest.raises(
        InputError,
        match=r"is a catalog of version 7, expected 2 or an older one\. Use the resim that wrote it",
    ):
        Catalog(database).find()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ("counts = '{not json'", "holds what no catalog has"),
        ("counts = '[1, 2]'", r"its row of '/results/late' is damaged: counts: expected a table"),
        ("folder = x'ff00fe'", "is damaged|holds what no catalog has"),
    ],
)
def test_a_row_that_was_altered_to_what_no_entry_is_is_told(tmp_path: Path, change: str, told: str) -> None:
    path = tmp_path / "catalog.sqlite"
    Catalog(str(path)).add(entry())
    with sqlite3.connect(path) as database:
        database.execute(f"UPDATE resim_item SET {change}")
    database.close()
    with pytest.raises(InputError, match=f"catalog.sqlite: .*{told}.*Remove the catalog"):
        Catalog(str(path)).find()


def test_what_is_no_catalog_is_refused_and_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("an important text\n" * 100)
    with pytest.raises(
        InputError, match=r"thesis\.txt: cannot be used as the catalog \(file is not a database\)"
    ):
        Catalog(str(tmp_path / "thesis.txt")).add(entry())
    assert (tmp_path / "thesis.txt").read_text() == "an important text\n" * 100
    with sqlite3.connect(tmp_path / "photos.db") as photos:
        photos.execute("CREATE TABLE photo (name TEXT)")
    photos.close()
    with pytest.raises(InputError, match=r"is a database of something else \(it has a table 'photo'\)"):
        Catalog(str(tmp_path / "photos.db")).find()
    with pytest.raises(InputError, match="unable to open database file"):
        Catalog(str(tmp_path)).find()
    with pytest.raises(InputError, match=r"cannot be used as the catalog \(File exists: .*thesis.txt\)"):
        Catalog(str(tmp_path / "thesis.txt" / "catalog.sqlite"))
    with pytest.raises(InputError, match=r"takes no name that is not UTF-8"):
        Catalog(str(tmp_path / "mine.sqlite")).add(entry("bad\udcff"))


@pytest.mark.parametrize(
    ("url", "problem"),
    [
        ("postgresql://me:secret@127.0.0.1:1/runs?password=secret", r"//me:\*\*\*@127.0.0.1:1/runs: .*refused"),
        ("postgresql://me:secret@word@host/runs", "has an @ in its password. Write it as %40"),
        ("postgresql://me:secret@host:port/runs", "is no URL that can be read"),
        ("mysql://me:secret@host/runs", "is of a database 'mysql': SQLite and PostgreSQL are known"),
        ("sqlite://", "names no file"),
    ],
)  # fmt: skip
def test_an_address_that_serves_not_is_told_without_its_password(url: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem) as told:
        Catalog(url).find()
    assert "secret" not in str(told.value)
    assert "word" not in str(told.value).replace("password", "")


def test_a_missing_driver_is_told_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(
        InputError,
        match=r"needs the driver of PostgreSQL\. In resim's own folder: pip install '\.\[postgresql\]'",
    ):
        Catalog("postgresql://me@host/runs")


def test_where_the_catalog_is(monkeypatch: pytest.MonkeyPatch) -> None:
    assert where({"RESIM_CATALOG": "runs.sqlite", "HOME": "/home/me"}) == "runs.sqlite"
    assert where({"RESIM_CATALOG": ""}) is where({"RESIM_CATALOG": "None"}) is None
    monkeypatch.setattr(sys, "platform", "linux")
    assert where({"HOME": "/home/me"}) == "/home/me/.local/share/resim/catalog.sqlite"
    assert where({"HOME": "/home/me", "XDG_DATA_HOME": "/data"}) == "/data/resim/catalog.sqlite"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert where({"HOME": "/Users/me"}) == "/Users/me/Library/Application Support/resim/catalog.sqlite"


def test_paths_and_urls_of_files_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        address("a b.sqlite")
        == address("sqlite:///a b.sqlite")
        == address(f"sqlite:///{tmp_path}/a b.sqlite")
    )
    assert create_engine(address("a.sqlite")).dialect.name == "sqlite"
    assert address("postgres://host/runs") == address("postgresql://host/runs")
    assert ITEM.name.startswith("resim_")
