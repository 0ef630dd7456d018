"""A catalog of results in SQL: finds runs, assessments, verifications and sweeps again, wherever their folders lie.

One row a folder in `resim_result`, what went into it in `resim_input`, its verdicts in `resim_outcome`. SQLite needs no
server; PostgreSQL serves many machines.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError
from sqlalchemy import (
    ColumnElement,
    Connection,
    Row,
    Select,
    delete,
    exists,
    func,
    insert,
    or_,
    select,
)
from sqlalchemy.exc import SQLAlchemyError

from resim.core.errors import InputError
from resim.core.faults import describe
from resim.results.entry import CatalogEntry, CatalogInput, CatalogOutcome, ResultKind
from resim.results.tables import (
    INPUT,
    OUTCOME,
    REMEDY,
    RESULT,
    address,
    engine,
    inserting,
    make_tables,
    shown,
    where,
)

_ENTRY = TypeAdapter(CatalogEntry)
ANEW = "Remove the catalog, and put the results in again by `resim runs add FOLDER`."
SHORT, LEAST = 8, 4
"""Digits of an id that are shown, and that have to be given."""


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

    def add(self, entry: CatalogEntry) -> None:
        """Put a result in, in the place of what is known of the same content in the same folder."""
        row = _result_row(entry)
        with self.connected() as connection, connection.begin():
            put = inserting(connection, RESULT).values(row)
            connection.execute(put.on_conflict_do_update(index_elements=[RESULT.c.id], set_=row))
            for table, told in (
                (INPUT, _rows(entry.id, entry.inputs)),
                (OUTCOME, _rows(entry.id, entry.outcomes)),
            ):
                connection.execute(delete(table).where(table.c.result == entry.id))
                if told:
                    connection.execute(insert(table), told)

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
        wanted = []
        if kind is not None:
            wanted.append(RESULT.c.kind == kind)
        if build is not None:
            wanted.append(_has_input(("build", "against"), build))
        if recording is not None:
            wanted.append(_has_input(("recording",), recording))
        if verdict is not None:
            of_any = _has(OUTCOME, func.lower(OUTCOME.c.verdict) == verdict.lower())
            wanted.append(or_(func.lower(RESULT.c.verdict) == verdict.lower(), of_any))
        return self._entries(select(RESULT).where(*wanted))

    def get(self, wanted: str) -> CatalogEntry:
        """Give a result by its id, four or more digits of it, or its folder: what it holds now, else what it held last.

        Raises InputError where there is none or more than one, naming near ones.
        """
        ids = self._ids()
        if found := [i for i in ids if i.startswith(wanted.lower()) and len(wanted) >= LEAST]:
            if len(found) > 1:
                told = ", ".join(i[: max(SHORT, len(wanted) + 2)] for i in found[:5])
                raise InputError(wanted, f"{len(found)} results begin so: {told}", "Give more of the id.")
            return self._entries(select(RESULT).where(RESULT.c.id == found[0]))[0]
        of_folder = self.of_folder(Path(wanted))
        if of_folder:
            return next((e for e in of_folder if e.state() == "there"), of_folder[0])
        named = self._entries(select(RESULT).where(RESULT.c.name == wanted))
        alike = get_close_matches(wanted, [i[: len(wanted)] for i in ids]) if wanted else []
        near = [e.id for e in named] or [i for i in ids if i[: len(wanted)] in alike]
        told = f"; near: {', '.join(i[:SHORT] for i in near[:5])}" if near else ""
        remedy = "`resim runs list` shows all; `resim runs add FOLDER` puts one in."
        raise InputError(wanted, f"is no result that the catalog {self.name} knows{told}", remedy)

    def entries(self, ids: Sequence[str]) -> list[CatalogEntry]:
        """Give the results with these ids, the newest first; those that there are."""
        return self._entries(select(RESULT).where(RESULT.c.id.in_(ids)))

    def of_folder(self, folder: Path) -> list[CatalogEntry]:
        """Give the results that a folder holds or held, the newest first."""
        return self._entries(select(RESULT).where(RESULT.c.folder == os.path.normpath(folder.absolute())))

    def forget(self, entry: CatalogEntry) -> None:
        """Take a result out; its folder stays as it is."""
        with self.connected() as connection, connection.begin():
            connection.execute(delete(RESULT).where(RESULT.c.id == entry.id))

    def _ids(self) -> Sequence[str]:
        with self.connected() as connection:
            return connection.scalars(select(RESULT.c.id)).all()

    def _entries(self, results: Select[Any]) -> list[CatalogEntry]:
        with self.connected() as connection:
            rows = connection.execute(results.order_by(RESULT.c.written.desc(), RESULT.c.id)).all()
            ids = results.with_only_columns(RESULT.c.id)
            inputs = _by_result(
                connection, select(INPUT).where(INPUT.c.result.in_(ids)).order_by(INPUT.c.row)
            )
            outcomes = _by_result(
                connection, select(OUTCOME).where(OUTCOME.c.result.in_(ids)).order_by(OUTCOME.c.row)
            )
        return [self._entry(row, inputs.get(row.id, []), outcomes.get(row.id, [])) for row in rows]

    def _entry(self, row: Row[Any], inputs: list[Row[Any]], outcomes: list[Row[Any]]) -> CatalogEntry:
        """The entry that rows hold. Raises InputError where they were altered to what no entry is."""
        told = {key: value for key, value in row._mapping.items() if key != "id"}
        told["inputs"] = [_fields(CatalogInput, i) for i in inputs]
        told["outcomes"] = [_fields(CatalogOutcome, o) for o in outcomes]
        try:
            return _ENTRY.validate_python(told)
        except ValidationError as e:
            what = f"its row of {str(row.folder)!r:.200} is damaged: {describe(e.errors(), CatalogEntry)}"
            raise InputError(self.name, what, ANEW) from None

    @contextmanager
    def connected(self) -> Iterator[Connection]:
        """A connection, for modules of this package; errors of the database are InputError."""
        with self._explain_sql_errors(), self._engine.connect() as connection:
            if connection.dialect.name == "sqlite":
                connection.exec_driver_sql("PRAGMA foreign_keys = ON")
            if not self._looked:
                make_tables(connection, self.name)
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


def _result_row(entry: CatalogEntry) -> dict[str, Any]:
    row = {column.name: getattr(entry, column.name) for column in RESULT.columns}
    return {**row, "folder": str(entry.folder), "counts": dict(entry.counts)}


def _rows(result: str, several: Sequence[CatalogInput | CatalogOutcome]) -> list[dict[str, Any]]:
    return [{"result": result, "row": k, **asdict(one)} for k, one in enumerate(several)]


def _fields(kind: type[CatalogInput | CatalogOutcome], row: Row[Any]) -> dict[str, Any]:
    return {f.name: row._mapping[f.name] for f in fields(kind)}


def _by_result(connection: Connection, rows: Select[Any]) -> dict[str, list[Row[Any]]]:
    found: dict[str, list[Row[Any]]] = {}
    for row in connection.execute(rows):
        found.setdefault(row.result, []).append(row)
    return found


def _has_input(roles: tuple[str, ...], wanted: str) -> ColumnElement[bool]:
    told = or_(
        INPUT.c.name.icontains(wanted, autoescape=True), INPUT.c.hash.istartswith(wanted, autoescape=True)
    )
    return _has(INPUT, INPUT.c.role.in_(roles) & told)


def _has(table: Any, condition: ColumnElement[bool]) -> ColumnElement[bool]:
    return exists().where(table.c.result == RESULT.c.id, condition)
