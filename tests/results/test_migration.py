"""A database of an older version is migrated where it lies, and loses nothing; over SQLite and PostgreSQL."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    insert,
)

from resim.results.catalog import Catalog
from resim.results.database import VERSION, address, engine
from resim.results.entry import CatalogEntry, CatalogInput, CatalogOutcome
from resim.results.lake import LakeQuery, find_page
from resim.results.overview import CatalogOverview
from resim.results.queue import TaskQueue
from resim.results.tables import METADATA, VERSIONS

FIRST = MetaData()
"""Version 1, as it was."""
_WHOLE: dict[str, Any] = {"nullable": False}


def _texts(*names: str) -> list[Column[str]]:
    return [Column(name, String, **_WHOLE) for name in names]


def _of_result() -> list[Column[Any]]:
    key = ForeignKey("resim_result.id", ondelete="CASCADE")
    return [Column("result", String, key, primary_key=True), Column("row", Integer, primary_key=True)]


Table("resim_catalog", FIRST, Column("version", Integer, primary_key=True))
Table(
    "resim_result", FIRST, Column("id", String, primary_key=True),
    *_texts("kind", "name", "folder", "host", "written", "digest", "resim", "verdict"),
    Column("counts", JSON, **_WHOLE), Index("resim_result_folder", "folder"), Index("resim_result_written", "written"),
)  # fmt: skip
Table(
    "resim_input", FIRST, *_of_result(), *_texts("role", "name", "path", "hash"),
    Index("resim_input_name", "role", "name"), Index("resim_input_hash", "hash"),
)  # fmt: skip
Table(
    "resim_outcome", FIRST, *_of_result(), *_texts("recording", "build", "source", "verdict", "cause"),
    *(Column(name, Integer) for name in ("runs", "passes", "fails", "invalids", "failures", "collisions")),
    Column("same_decision", Float), Index("resim_outcome_verdict", "verdict"),
)  # fmt: skip
Table(
    "resim_task", FIRST, Column("id", String, primary_key=True), *_texts("job"), Column("words", JSON, **_WHOLE),
    Column("again", JSON, **_WHOLE), *_texts("folder", "host", "state"), Column("priority", Integer, **_WHOLE),
    Column("place", Float, **_WHOLE), Column("created", Float, **_WHOLE),
    *(Column(name, Float) for name in ("begun", "ended")),
    Column("attempt", Integer, **_WHOLE), Column("losses", Integer, **_WHOLE), *_texts("server"),
    Column("beat", Float, **_WHOLE), Column("stop", Boolean, **_WHOLE), Column("code", Integer), *_texts("told"),
    Column("changed", Float, **_WHOLE), Index("resim_task_state", "state", "host"),
    Index("resim_task_created", "created"),
)  # fmt: skip
TASK = {
    "id": "ab12", "job": "run", "words": ["run", "--", "/d"], "again": [], "folder": "/tasks/ab12", "host": "h",
    "state": "waiting", "priority": 3, "place": 5.5, "created": 5.5, "attempt": 0, "losses": 0, "server": "",
    "beat": 0.0, "stop": False, "told": "", "changed": 5.5,
}  # fmt: skip
ENTRIES = [
    CatalogEntry(
        kind="run", name=f"drive {k}", folder=Path(f"/out/a {k}"), host="h", written=f"2026-01-0{k}T00:00:00.000+00:00",
        digest=f"{k:064x}", resim="0.1.0", verdict="PASS", counts={"PASS": k},
        inputs=(
            CatalogInput("recording", "cut_in", "/d", "ab" * 32), CatalogInput("build", "pilot-1.0", hash="cd" * 32),
        ),
        outcomes=(
            CatalogOutcome("cut_in", "pilot-1.0", "rGT", "PASS", "", same_decision=0.5),
            CatalogOutcome("?", "", runs=k),
        ),
    )
    for k in (3, 2, 1)
]  # fmt: skip


def make_first(database: str, *, tasks: bool = True) -> None:
    """A database as version 1 made and filled it."""
    url = address(database)
    with engine(url).begin() as connection:
        FIRST.create_all(connection, [t for t in FIRST.sorted_tables if tasks or t.name != "resim_task"])
        connection.execute(insert(FIRST.tables["resim_catalog"]).values(version=1))
        if tasks:
            connection.execute(insert(FIRST.tables["resim_task"]).values(TASK))
        for one in ENTRIES:
            row = {c.name: getattr(one, c.name) for c in FIRST.tables["resim_result"].columns}
            connection.execute(insert(FIRST.tables["resim_result"]).values(row | {"folder": str(one.folder)}))
            for table, parts in (("resim_input", one.inputs), ("resim_outcome", one.outcomes)):
                for k, part in enumerate(parts):
                    told = {"result": one.id, "row": k, **vars(part)}
                    connection.execute(insert(FIRST.tables[table]).values(told))


@pytest.mark.parametrize("tasks", [True, False])
def test_results_and_the_queue_of_the_first_version_are_all_there(database: str, tasks: bool) -> None:
    make_first(database, tasks=tasks)
    catalog = Catalog(database)
    assert catalog.find() == ENTRIES
    assert catalog.find(recording="abab") == ENTRIES
    if tasks:
        (task,) = TaskQueue(catalog).unfinished()
        assert {name: getattr(task, name) for name in TASK} == {
            **TASK,
            "words": tuple(TASK["words"]),
            "again": (),
        }  # type: ignore[arg-type]
    else:
        assert TaskQueue(catalog).unfinished() == []
    assert find_page(catalog, LakeQuery("pilot cut")).count == 3
    assert {o.verdict for o in CatalogOverview(catalog).newest_of(["ab" * 32])} == {"PASS"}
    assert Catalog(database).find() == ENTRIES  # and the next one finds the version as it is


@pytest.mark.parametrize("first", [True, False])
def test_the_tables_are_those_that_the_code_knows(database: str, first: bool) -> None:
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    if first:
        make_first(database)
    Catalog(database).version()
    with engine(address(database)).connect() as connection:
        context = MigrationContext.configure(
            connection, opts={"version_table": VERSIONS, "compare_type": True}
        )
        assert compare_metadata(context, METADATA) == []
        assert context.get_current_revision() == VERSION


def test_the_newest_migration_is_the_version_that_is_expected() -> None:
    from alembic.config import Config
    from alembic.script import ScriptDirectory

    config = Config()
    config.set_main_option("script_location", "resim.results:migrations")
    assert ScriptDirectory.from_config(config).get_heads() == [VERSION]


MANY = "import sys; from resim.results.catalog import Catalog; print(len(Catalog(sys.argv[1]).find()))"


def test_processes_that_migrate_at_once_lose_nothing(database: str) -> None:
    make_first(database)
    command = [sys.executable, "-c", MANY, database]
    processes = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(6)
    ]
    for process in processes:
        out, error = process.communicate(timeout=120)
        assert (process.returncode, out.strip()) == (0, "3"), error
    assert Catalog(database).find() == ENTRIES


def test_a_migration_that_fails_changes_nothing(database: str, monkeypatch: pytest.MonkeyPatch) -> None:
    make_first(database)
    monkeypatch.setattr("resim.results.words._WORD", None)
    with pytest.raises(AttributeError):
        Catalog(database).find()
    monkeypatch.undo()
    assert Catalog(database).find() == ENTRIES
