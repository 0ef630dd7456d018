"""The tables of the catalog's database: the one definition of them.

`ITEM` has a row for everything that there is: results, recordings, maps, builds, ... What it follows from is in
`INPUT`, its verdicts in `OUTCOME`, what else is known in `FACT`, the words by which it is found in `WORD`. All of these
follow from files alone, and are made again from them. `ROOT`, `TASK` and `CHANGE` are state of their own. Who changes a
table writes a migration as well (`resim.results.migrations`).
"""

from __future__ import annotations

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
)

METADATA = MetaData()
VERSIONS = "resim_catalog"
"""Table in which Alembic keeps the version of the others."""
Sorted = String().with_variant(String(collation="C"), "postgresql")
"""A text in the order of its bytes, whatever the language of the server."""

ITEM = Table(
    "resim_item",
    METADATA,
    Column("id", Sorted, primary_key=True),
    Column("kind", Sorted, nullable=False),
    Column("name", Sorted, nullable=False),
    Column("folder", Sorted, nullable=False),
    Column("host", String, nullable=False),
    Column("written", Sorted, nullable=False),
    Column("digest", Sorted, nullable=False),
    Column("resim", String, nullable=False),
    Column("verdict", Sorted, nullable=False),
    Column("counts", JSON, nullable=False),
    Column("files", JSON, nullable=False),
    Column("fault", String, nullable=False),
    Column("risk", Float),
    Index("resim_item_folder", "folder"),
    Index("resim_item_digest", "digest"),
    *(Index(f"resim_item_{column}", column, "id") for column in ("written", "name", "risk", "verdict")),
    *(Index(f"resim_item_kind_{column}", "kind", column, "id") for column in ("written", "name", "risk")),
)


def _of_item() -> tuple[Column[str], Column[int]]:
    """Which item a row is of, and its place among the rows of it."""
    item = ForeignKey("resim_item.id", ondelete="CASCADE")
    return Column("item", Sorted, item, primary_key=True), Column("row", Integer, primary_key=True)


INPUT = Table(
    "resim_input",
    METADATA,
    *_of_item(),
    Column("role", String, nullable=False),
    Column("name", Sorted, nullable=False),
    Column("path", String, nullable=False),
    Column("hash", Sorted, nullable=False),
    Index("resim_input_name", "role", "name", "hash"),
    Index("resim_input_hash", "hash"),
)

OUTCOME = Table(
    "resim_outcome",
    METADATA,
    *_of_item(),
    Column("recording", String, nullable=False),
    Column("hash", Sorted, nullable=False),
    Column("build", String, nullable=False),
    Column("source", String, nullable=False),
    Column("verdict", Sorted, nullable=False),
    Column("cause", String, nullable=False),
    *(Column(name, Integer) for name in ("runs", "passes", "fails", "invalids", "failures", "collisions")),
    Column("same_decision", Float),
    Index("resim_outcome_verdict", "verdict", "hash"),
    Index("resim_outcome_hash", "hash", "verdict"),
)

FACT = Table(
    "resim_fact",
    METADATA,
    *_of_item(),
    Column("hash", Sorted, nullable=False),
    Column("facet", String, nullable=False),
    Column("name", Sorted, nullable=False),
    Column("value", Float),
    Index("resim_fact_name", "facet", "name", "hash"),
    Index("resim_fact_hash", "hash", "facet", "name", "value"),
)

WORD = Table(
    "resim_word",
    METADATA,
    Column("word", Sorted, primary_key=True),
    Column("item", Sorted, ForeignKey("resim_item.id", ondelete="CASCADE"), primary_key=True),
    Index("resim_word_item", "item"),
    sqlite_with_rowid=False,
)

ROOT = Table(
    "resim_root",
    METADATA,
    Column("path", String, primary_key=True),
    Column("host", String, primary_key=True),
)

CHANGE = Table(
    "resim_change",
    METADATA,
    Column("row", Integer, primary_key=True, autoincrement=False),
    Column("number", Integer, nullable=False),
)

TASK = Table(
    "resim_task",
    METADATA,
    Column("id", String, primary_key=True),
    Column("job", String, nullable=False),
    Column("words", JSON, nullable=False),
    Column("again", JSON, nullable=False),
    Column("folder", String, nullable=False),
    Column("host", String, nullable=False),
    Column("state", String, nullable=False),
    Column("priority", Integer, nullable=False),
    Column("place", Float, nullable=False),
    Column("created", Float, nullable=False),
    Column("begun", Float),
    Column("ended", Float),
    Column("attempt", Integer, nullable=False),
    Column("losses", Integer, nullable=False),
    Column("server", String, nullable=False),
    Column("beat", Float, nullable=False),
    Column("stop", Boolean, nullable=False),
    Column("code", Integer),
    Column("told", String, nullable=False),
    Column("changed", Float, nullable=False),
    Index("resim_task_state", "state", "host"),
    Index("resim_task_created", "created"),
)

INDEX = (ITEM, INPUT, OUTCOME, FACT, WORD)
"""What follows from files alone."""
