"""The catalog's tables: what stands in the database, and where the database is."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from sqlalchemy import (
    JSON,
    Column,
    Connection,
    Engine,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    create_engine,
    inspect,
    select,
    text,
)
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError
from sqlalchemy.pool import NullPool
from sqlalchemy.schema import CreateIndex, CreateTable

from resim.core.errors import InputError

VARIABLE = "RESIM_CATALOG"
"""Environment variable that says where the catalog is."""
REMEDY = f"Set {VARIABLE} to a file that you may write, to postgresql://USER@HOST/DATABASE, or to none."
SCHEMA = 1
"""Version of the tables."""
BUSY = 60
"""s that a process waits for others that write to the file."""
CONNECT = 10
"""s that a server is waited for."""
_LOCK = 0x7265_7369_6D
"""Number of the lock (PostgreSQL) under which tables are made."""

METADATA = MetaData()

CATALOG = Table("resim_catalog", METADATA, Column("version", Integer, primary_key=True))

RESULT = Table(
    "resim_result",
    METADATA,
    Column("id", String, primary_key=True),
    Column("kind", String, nullable=False),
    Column("name", String, nullable=False),
    Column("folder", String, nullable=False),
    Column("host", String, nullable=False),
    Column("written", String, nullable=False),
    Column("digest", String, nullable=False),
    Column("resim", String, nullable=False),
    Column("verdict", String, nullable=False),
    Column("counts", JSON, nullable=False),
    Index("resim_result_folder", "folder"),
    Index("resim_result_written", "written"),
)


def _of_result() -> tuple[Column[str], Column[int]]:
    """Which result a row is of, and its place among the rows of it."""
    result = ForeignKey("resim_result.id", ondelete="CASCADE")
    return Column("result", String, result, primary_key=True), Column("row", Integer, primary_key=True)


INPUT = Table(
    "resim_input",
    METADATA,
    *_of_result(),
    Column("role", String, nullable=False),
    Column("name", String, nullable=False),
    Column("path", String, nullable=False),
    Column("hash", String, nullable=False),
    Index("resim_input_name", "role", "name"),
    Index("resim_input_hash", "hash"),
)

OUTCOME = Table(
    "resim_outcome",
    METADATA,
    *_of_result(),
    Column("recording", String, nullable=False),
    Column("build", String, nullable=False),
    Column("source", String, nullable=False),
    Column("verdict", String, nullable=False),
    Column("cause", String, nullable=False),
    *(Column(name, Integer) for name in ("runs", "passes", "fails", "invalids", "failures", "collisions")),
    Column("same_decision", Float),
    Index("resim_outcome_verdict", "verdict"),
)


def where(environment: Mapping[str, str] = os.environ) -> str | None:
    """Give the path or URL of the catalog that the user has: RESIM_CATALOG, else in the data folder; None for none."""
    told = environment.get(VARIABLE)
    if told is not None:
        return None if told.strip().lower() in ("", "none") else told
    return str(data_folder(environment) / "catalog.sqlite")


def data_folder(environment: Mapping[str, str] = os.environ) -> Path:
    """Give the folder in which resim keeps what belongs to a user."""
    home = Path(environment.get("HOME") or Path.home())
    if sys.platform == "darwin":
        return home / "Library" / "Application Support" / "resim"
    return Path(environment.get("XDG_DATA_HOME") or home / ".local" / "share") / "resim"


def address(catalog: str) -> URL:
    """Give the URL of a path, of sqlite:///PATH or of postgresql://...; what cannot be read is not repeated.

    Raises InputError, in which no password stands.
    """
    if "://" not in catalog:
        return URL.create("sqlite", database=str(Path(catalog).expanduser().absolute()))
    try:
        url = make_url(catalog)
    except (ArgumentError, ValueError):
        raise InputError(VARIABLE, "is no URL that can be read", REMEDY) from None
    if "@" in (url.host or ""):
        raise InputError(VARIABLE, "has an @ in its password", "Write it as %40.")
    backend = url.drivername.partition("+")[0]
    if backend == "sqlite" and url.database and not url.query:
        return address(url.database)
    if backend in ("postgresql", "postgres"):
        return url.set(drivername="postgresql+psycopg")
    if backend == "sqlite":
        raise InputError(VARIABLE, "names no file", "Write sqlite:///PATH, or the path alone.")
    raise InputError(VARIABLE, f"is of a database {backend!r}: SQLite and PostgreSQL are known", REMEDY)


def shown(url: URL) -> str:
    """Give an address as it may be shown: without its password (the query may have one, too), a file by its path."""
    if url.drivername == "sqlite":
        return str(url.database)
    return url.set(drivername="postgresql", query={}).render_as_string(hide_password=True)


def engine(url: URL) -> Engine:
    """Give an engine that keeps no connection open. Raises InputError where the driver of PostgreSQL is missing."""
    if url.drivername == "sqlite":
        Path(str(url.database)).parent.mkdir(parents=True, exist_ok=True)
        return create_engine(url, poolclass=NullPool, connect_args={"timeout": BUSY})
    patience = {} if "connect_timeout" in url.query else {"connect_timeout": CONNECT}
    try:
        return create_engine(url, poolclass=NullPool, connect_args=patience)
    except ImportError:
        raise InputError(
            shown(url), "needs the driver of PostgreSQL", "In resim's own folder: pip install '.[postgresql]'"
        ) from None


def make_tables(connection: Connection, name: str) -> None:
    """Make the tables where there are none; several processes may do so at once.

    Raises InputError for tables of another version of resim, and for a file that is a database of something else.
    """
    held = inspect(connection).get_table_names()
    if CATALOG.name not in held:
        if held and connection.dialect.name == "sqlite":
            raise InputError(name, f"is a database of something else (it has a table {held[0]!r})", REMEDY)
        _make(connection)
    found = connection.scalars(select(CATALOG.c.version)).all()
    if not found:  # whoever made this table is not done yet
        _make(connection)
    elif max(found) != SCHEMA:
        problem = f"is a catalog of version {max(found)}, expected {SCHEMA}"
        raise InputError(name, problem, f"Use the resim that wrote it, or another {VARIABLE}.")


def inserting(connection: Connection, table: Table) -> sqlite.Insert | postgresql.Insert:
    """Give the database's own INSERT, which says what to do where the row is there already."""
    return sqlite.insert(table) if connection.dialect.name == "sqlite" else postgresql.insert(table)


def _make(connection: Connection) -> None:
    if connection.dialect.name == "postgresql":
        connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
    for table in (CATALOG, RESULT, INPUT, OUTCOME):
        connection.execute(CreateTable(table, if_not_exists=True))
        for index in table.indexes:
            connection.execute(CreateIndex(index, if_not_exists=True))
    connection.execute(inserting(connection, CATALOG).values(version=SCHEMA).on_conflict_do_nothing())
    connection.commit()
