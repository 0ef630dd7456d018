"""A catalog in SQL: finds results, recordings and all else again, wherever their folders lie.

`resim.results.tables` says what stands where. SQLite needs no server; PostgreSQL serves many machines.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import (
    ColumnElement,
    Connection,
    Row,
    Select,
    Table,
    delete,
    exists,
    func,
    insert,
    or_,
    select,
    update,
)
from sqlalchemy.exc import SQLAlchemyError

from resim.core.errors import InputError
from resim.core.faults import describe
from resim.results.database import REMEDY, address, engine, inserting, prepare, shown, where
from resim.results.entry import (
    KINDS,
    NAME,
    CatalogEntry,
    CatalogFact,
    CatalogInput,
    CatalogOutcome,
    ItemKind,
    ResultKind,
)
from resim.results.tables import CHANGE, FACT, INPUT, ITEM, OUTCOME, WORD
from resim.results.words import words_of

_ENTRY = TypeAdapter(CatalogEntry)
_PARTS: Mapping[Table, tuple[str, type[CatalogInput | CatalogOutcome | CatalogFact]]] = {
    INPUT: ("inputs", CatalogInput), OUTCOME: ("outcomes", CatalogOutcome), FACT: ("facts", CatalogFact)
}  # fmt: skip
"""Tables of what an entry has several of."""
ANEW = "Remove the catalog, and put the results in again by `resim runs add FOLDER`."
SHORT, LEAST = 8, 4
"""Digits of an id that are shown, and that have to be given."""
AT_ONCE = 500
"""Values in one query: databases take a limited number."""


class Catalog:
    """A catalog at a path or URL; tables are made when it is first used.

    Every method raises InputError where the database cannot be reached, read or written, is none, or is of another
    version. No error tells a password.
    """

    def __init__(self, at: str) -> None:
        url = address(at)
        self.name = shown(url)
        with self._explain_sql_errors():
            self._engine = engine(url)
        self._looked = False

    def add(self, *entries: CatalogEntry) -> None:
        """Put entries in, all or none, each in the place of what is known of the same content in the same folder."""
        with self.changing() as connection:
            for entry in entries:
                put(connection, entry)
            rate(connection, entries)

    def find(
        self,
        *,
        kind: ResultKind | None = None,
        build: str | None = None,
        recording: str | None = None,
        verdict: str | None = None,
    ) -> list[CatalogEntry]:
        """Give all results that match, the newest first.

        build, recording: part of a label or name, or a hash or its beginning, in any case. verdict: over all, or of any
        outcome; in any case.
        """
        wanted: list[ColumnElement[bool]] = [ITEM.c.kind.in_(KINDS if kind is None else (kind,))]
        if build is not None:
            wanted.append(following_from(("build", "against"), _named(build)))
        if recording is not None:
            wanted.append(following_from(("recording",), _named(recording)))
        if verdict is not None:
            of_any = _has(OUTCOME, func.lower(OUTCOME.c.verdict) == verdict.lower())
            wanted.append(or_(func.lower(ITEM.c.verdict) == verdict.lower(), of_any))
        return self._entries(select(ITEM).where(*wanted))

    def get(self, wanted: str, kinds: Iterable[ItemKind] = tuple(KINDS)) -> CatalogEntry:
        """Give a result, or what else is of these kinds, by its id, four or more digits of it, or its folder: what it
        holds now, else what it held last.

        Raises InputError where there is none or more than one, naming near ones.
        """
        of_kind = select(ITEM).where(ITEM.c.kind.in_([*kinds]))
        digits = wanted.lower()
        like = self._entries(of_kind.where(*begins(ITEM.c.id, digits)).limit(6)) if digits else []
        if like and len(digits) >= LEAST:
            if len(like) > 1:
                told = ", ".join(sorted(e.id[: max(SHORT, len(wanted) + 2)] for e in like[:5]))
                many = "more than 5" if len(like) > 5 else len(like)
                raise InputError(wanted, f"{many} results begin so: {told}", "Give more of the id.")
            return like[0]
        path = os.path.normpath(Path(wanted).absolute())
        if of_folder := self._entries(of_kind.where(ITEM.c.folder == path)):
            # a path names the space, not one of its clusters
            of_folder.sort(key=lambda e: e.kind == "cluster")
            return next((e for e in of_folder if e.state() == "there"), of_folder[0])
        near = self._entries(of_kind.where(ITEM.c.name == wanted).limit(5)) or like[:5]
        told = f"; near: {', '.join(e.id[:SHORT] for e in near)}" if near else ""
        if set(kinds) <= KINDS.keys():
            remedy = "`resim runs list` shows all; `resim runs add FOLDER` puts one in."
            raise InputError(wanted, f"is no result that the catalog {self.name} knows{told}", remedy)
        remedy = "`resim lake find` shows all; `resim lake add PATH` registers more."
        raise InputError(wanted, f"is nothing that the lake {self.name} knows{told}", remedy)

    def entries(self, ids: Sequence[str]) -> list[CatalogEntry]:
        """Give what has these ids, the newest first; those that there are."""
        return self._entries(select(ITEM).where(ITEM.c.id.in_(ids)))

    def of_folder(self, folder: Path) -> list[CatalogEntry]:
        """Give what a folder holds or held, the newest first."""
        return self._entries(select(ITEM).where(ITEM.c.folder == os.path.normpath(folder.absolute())))

    def forget(self, *entries: CatalogEntry) -> None:
        """Take entries out; their folders stay as they are."""
        with self.changing() as connection:
            drop(connection, [entry.id for entry in entries])
            rate(connection, entries)

    def _entries(self, items: Select[Any]) -> list[CatalogEntry]:
        with self.connected() as connection:
            rows = connection.execute(items.order_by(ITEM.c.written.desc(), ITEM.c.id)).all()
            ids = [row.id for row in rows]
            told = {table: _by_item(connection, table, ids) for table in _PARTS}
        return [self._entry(row, {table: of.get(row.id, []) for table, of in told.items()}) for row in rows]

    def _entry(self, row: Row[Any], parts: Mapping[Table, list[Row[Any]]]) -> CatalogEntry:
        """The entry that rows hold. Raises InputError where they were altered to what no entry is."""
        told = {key: value for key, value in row._mapping.items() if key not in ("id", "risk")}
        for table, (name, kind) in _PARTS.items():
            told[name] = [{f.name: part._mapping[f.name] for f in fields(kind)} for part in parts[table]]
        try:
            return _ENTRY.validate_python(told)
        except ValidationError as e:
            what = f"its row of {str(row.folder)!r:.200} is damaged: {describe(e.errors(), CatalogEntry)}"
            raise InputError(self.name, what, ANEW) from None

    @contextmanager
    def changing(self) -> Iterator[Connection]:
        """A transaction that changes the index, for modules of this package; who watches is told.

        It begins with the row that all of them change, so that they wait for each other, and none for itself.
        """
        with self.connected() as connection, connection.begin():
            connection.execute(update(CHANGE).values(number=CHANGE.c.number + 1))
            yield connection

    def version(self) -> int:
        """Give what is another one after every change of the index."""
        with self.connected() as connection:
            return int(connection.scalar(select(CHANGE.c.number)) or 0)

    @contextmanager
    def connected(self) -> Iterator[Connection]:
        """A connection, for modules of this package; errors of the database are InputError."""
        with self._explain_sql_errors(), self._engine.connect() as connection:
            if connection.dialect.name == "sqlite":
                connection.exec_driver_sql("PRAGMA foreign_keys = ON")
            if not self._looked:
                prepare(connection, self.name)
                self._looked = True
            connection.rollback()  # what was read is done with; a transaction begins with what it writes
            yield connection

    @contextmanager
    def _explain_sql_errors(self) -> Iterator[None]:
        """Errors of the database in one line."""
        try:
            yield
        except SQLAlchemyError as e:
            reason = str(getattr(e, "orig", None) or e).strip().splitlines()[0]
            raise InputError(self.name, f"cannot be used as the catalog ({reason})", REMEDY) from None
        except json.JSONDecodeError as e:
            raise InputError(self.name, f"holds what no catalog has ({e})", ANEW) from None
        except OSError as e:
            raise InputError(
                self.name, f"cannot be used as the catalog ({e.strerror}: {e.filename})", REMEDY
            ) from None
        except UnicodeError as e:
            raise InputError(self.name, f"takes no name that is not UTF-8 ({e})", "Rename it.") from None


def user_catalog() -> Catalog | None:
    """Give the catalog that RESIM_CATALOG names, else the one in the user's data folder; None for none."""
    at = where()
    return None if at is None else Catalog(at)


def put(connection: Connection, entry: CatalogEntry) -> None:
    """Write an entry into the tables, in the place of the one with its id."""
    row = {column.name: getattr(entry, column.name) for column in ITEM.columns if column.name != "risk"}
    risks = [f.value for f in entry.facts if f.facet == "risk" and f.value is not None]
    row |= {
        "folder": str(entry.folder), "counts": dict(entry.counts), "files": dict(entry.files),
        "risk": max(risks, default=None),
    }  # fmt: skip
    written = inserting(connection, ITEM).values(row)
    connection.execute(written.on_conflict_do_update(index_elements=[ITEM.c.id], set_=row))
    content = {i.name: i.hash for i in entry.inputs if i.role == "recording"}
    for table, (name, _) in _PARTS.items():
        told = [{"item": entry.id, "row": k, **asdict(one)} for k, one in enumerate(getattr(entry, name))]
        if table is OUTCOME:
            told = [{**one, "hash": content.get(one["recording"], "")} for one in told]
        _replace(connection, table, entry.id, told)
    own = [f.name for f in entry.facts if f.facet == NAME]
    words = words_of(entry.name, str(entry.folder), *own, *(i.name for i in entry.inputs))
    _replace(connection, WORD, entry.id, [{"word": word, "item": entry.id} for word in words])


def _replace(connection: Connection, table: Table, item: str, rows: list[dict[str, Any]]) -> None:
    connection.execute(delete(table).where(table.c.item == item))
    if rows:
        connection.execute(insert(table), rows)


def drop(connection: Connection, ids: Sequence[str]) -> None:
    """Take entries out of the tables."""
    for k in range(0, len(ids), AT_ONCE):
        connection.execute(delete(ITEM).where(ITEM.c.id.in_(ids[k : k + AT_ONCE])))


def rate(connection: Connection, entries: Iterable[CatalogEntry]) -> None:
    """Note the highest risk that any result tells of recordings: those entries, and those that entries tell of."""
    changed = {f.hash for e in entries for f in e.facts if f.facet == "risk"}
    changed |= {e.digest for e in entries if e.kind not in KINDS}
    highest = select(func.max(FACT.c.value)).where(FACT.c.facet == "risk", FACT.c.hash == ITEM.c.digest)
    hashes = sorted(changed - {""})
    for k in range(0, len(hashes), AT_ONCE):
        of = ITEM.c.digest.in_(hashes[k : k + AT_ONCE]) & ITEM.c.kind.not_in(KINDS)
        connection.execute(update(ITEM).where(of).values(risk=highest.scalar_subquery()))


def begins(column: ColumnElement[str], text: str) -> tuple[ColumnElement[bool], ...]:
    """Conditions that a text begins so, which an index answers."""
    return column >= text, column < text + "\U0010ffff"


def _by_item(connection: Connection, table: Table, ids: Sequence[str]) -> dict[str, list[Row[Any]]]:
    found: dict[str, list[Row[Any]]] = {}
    for k in range(0, len(ids), AT_ONCE):
        of = table.c.item.in_(ids[k : k + AT_ONCE])
        for row in connection.execute(select(table).where(of).order_by(table.c.item, table.c.row)):
            found.setdefault(row.item, []).append(row)
    return found


def following_from(roles: tuple[str, ...], *told: ColumnElement[bool]) -> ColumnElement[bool]:
    """Give the condition that an item follows from something in any of these roles of which all this is true."""
    return ITEM.c.id.in_(select(INPUT.c.item).where(INPUT.c.role.in_(roles), *told))


def _named(wanted: str) -> ColumnElement[bool]:
    return or_(
        INPUT.c.name.icontains(wanted, autoescape=True), INPUT.c.hash.istartswith(wanted, autoescape=True)
    )


def _has(table: Any, condition: ColumnElement[bool]) -> ColumnElement[bool]:
    return exists().where(table.c.item == ITEM.c.id, condition)
