"""Version 2: from a catalog of results to one of everything. Version 1 was made before there were migrations.

The tables stand here as they were then, whatever they are today.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice
from typing import Any

import sqlalchemy as sa
from alembic import op

from resim.results.words import words_of

revision, down_revision = "2", None
_OLD = ("result", "input", "outcome")
_EACH = 10_000
_Sorted = sa.String().with_variant(sa.String(collation="C"), "postgresql")


def upgrade() -> None:
    """Make the new tables, take over what the old ones hold, and drop those."""
    held = sa.inspect(op.get_bind()).get_table_names()
    old = [name for name in _OLD if f"resim_{name}" in held]
    for name in old:
        for index in sa.inspect(op.get_bind()).get_indexes(f"resim_{name}"):
            op.drop_index(str(index["name"]), f"resim_{name}")
        op.rename_table(f"resim_{name}", f"resim_{name}_1")
    _make_items()
    _make_details()
    _make_own(with_tasks="resim_task" not in held)
    if len(old) == len(_OLD):
        _take_over()
    for name in reversed(old):
        op.drop_table(f"resim_{name}_1")


def _text(*names: str, kind: Any = _Sorted) -> list[sa.Column[Any]]:
    return [sa.Column(name, kind, nullable=False) for name in names]


def _table(name: str, *columns: Any, indexes: dict[str, list[str]], **more: Any) -> None:
    op.create_table(f"resim_{name}", *columns, **more)
    for index, of in indexes.items():
        op.create_index(f"resim_{name}_{index}", f"resim_{name}", of)


def _make_items() -> None:
    _table(
        "item", sa.Column("id", _Sorted, primary_key=True), *_text("kind", "name", "folder"),
        *_text("host", kind=sa.String), *_text("written", "digest"), *_text("resim", kind=sa.String),
        *_text("verdict"), *_text("counts", "files", kind=sa.JSON), *_text("fault", kind=sa.String),
        sa.Column("risk", sa.Float),
        indexes={
            "folder": ["folder"], "digest": ["digest"],
            **{name: [name, "id"] for name in ("written", "name", "risk", "verdict")},
            **{f"kind_{name}": ["kind", name, "id"] for name in ("written", "name", "risk")},
        },
    )  # fmt: skip


def _make_details() -> None:
    def of_item() -> list[sa.Column[Any]]:
        item = sa.ForeignKey("resim_item.id", ondelete="CASCADE")
        return [
            sa.Column("item", _Sorted, item, primary_key=True),
            sa.Column("row", sa.Integer, primary_key=True),
        ]

    _table(
        "input", *of_item(), *_text("role", kind=sa.String), *_text("name"), *_text("path", kind=sa.String),
        *_text("hash"), indexes={"name": ["role", "name", "hash"], "hash": ["hash"]},
    )  # fmt: skip
    counts = ("runs", "passes", "fails", "invalids", "failures", "collisions")
    _table(
        "outcome", *of_item(), *_text("recording", kind=sa.String), *_text("hash"),
        *_text("build", "source", kind=sa.String), *_text("verdict"), *_text("cause", kind=sa.String),
        *(sa.Column(name, sa.Integer) for name in counts), sa.Column("same_decision", sa.Float),
        indexes={"verdict": ["verdict", "hash"], "hash": ["hash", "verdict"]},
    )  # fmt: skip
    _table(
        "fact", *of_item(), *_text("hash"), *_text("facet", kind=sa.String), *_text("name"),
        sa.Column("value", sa.Float),
        indexes={"name": ["facet", "name", "hash"], "hash": ["hash", "facet", "name", "value"]},
    )  # fmt: skip
    item = sa.ForeignKey("resim_item.id", ondelete="CASCADE")
    _table(
        "word", sa.Column("word", _Sorted, primary_key=True), sa.Column("item", _Sorted, item, primary_key=True),
        indexes={"item": ["item"]}, sqlite_with_rowid=False,
    )  # fmt: skip


def _make_own(*, with_tasks: bool) -> None:
    paths = [sa.Column(name, sa.String, primary_key=True) for name in ("path", "host")]
    _table("root", *paths, indexes={})
    row = sa.Column("row", sa.Integer, primary_key=True, autoincrement=False)
    _table("change", row, sa.Column("number", sa.Integer, nullable=False), indexes={})
    op.execute("INSERT INTO resim_change VALUES (1, 0)")
    if with_tasks:
        _table(
            "task", sa.Column("id", sa.String, primary_key=True), *_text("job", kind=sa.String),
            *_text("words", "again", kind=sa.JSON), *_text("folder", "host", "state", kind=sa.String),
            sa.Column("priority", sa.Integer, nullable=False), *_text("place", "created", kind=sa.Float),
            *(sa.Column(name, sa.Float) for name in ("begun", "ended")), *_text("attempt", "losses", kind=sa.Integer),
            *_text("server", kind=sa.String), *_text("beat", kind=sa.Float), *_text("stop", kind=sa.Boolean),
            sa.Column("code", sa.Integer), *_text("told", kind=sa.String), *_text("changed", kind=sa.Float),
            indexes={"state": ["state", "host"], "created": ["created"]},
        )  # fmt: skip


def _take_over() -> None:
    told = "kind, name, folder, host, written, digest, resim, verdict, counts"
    op.execute(
        f"INSERT INTO resim_item (id, {told}, files, fault) SELECT id, {told}, '{{}}', '' FROM resim_result_1"
    )
    op.execute("INSERT INTO resim_input SELECT result, row, role, name, path, hash FROM resim_input_1")
    told = "build, source, verdict, cause, runs, passes, fails, invalids, failures, collisions, same_decision"
    its = (
        "SELECT max(i.hash) FROM resim_input_1 i WHERE i.result = o.result AND i.role = 'recording' "
        "AND i.name = o.recording"
    )
    op.execute(
        f"INSERT INTO resim_outcome SELECT result, row, recording, coalesce(({its}), ''), {told} FROM resim_outcome_1 o"
    )
    connection = op.get_bind()
    words = _words(connection)
    while some := [*islice(words, _EACH)]:
        connection.execute(sa.text("INSERT INTO resim_word (word, item) VALUES (:word, :item)"), some)


def _words(connection: sa.Connection) -> Iterator[dict[str, str]]:
    inputs: dict[str, list[str]] = {}
    for item, name in connection.execute(sa.text("SELECT item, name FROM resim_input")):
        inputs.setdefault(item, []).append(name)
    for item, name, folder in connection.execute(sa.text("SELECT id, name, folder FROM resim_item")).all():
        for word in words_of(name, os.fspath(folder), *inputs.get(item, ())):
            yield {"word": word, "item": item}
