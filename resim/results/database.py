"""Where the catalog's database is, and that it has the tables of this version: made, migrated or refused."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

from sqlalchemy import Connection, Engine, Table, create_engine, inspect, text
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError
from sqlalchemy.pool import NullPool

from resim.core.errors import InputError
from resim.results.tables import CHANGE, METADATA, VERSIONS

VARIABLE = "RESIM_CATALOG"
"""Environment variable that says where the catalog is."""
REMEDY = f"Set {VARIABLE} to a file that you may write, to postgresql://USER@HOST/DATABASE, or to none."
VERSION = "2"
"""Of the tables: the newest migration's. Version 1 was before Alembic."""
BUSY = 60
"""s that a process waits for others that write to the file."""
CONNECT = 10
"""s that a server is waited for."""
_LOCK = 0x7265_7369_6D
"""Number of the lock (PostgreSQL) under which tables are made."""


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


def inserting(connection: Connection, table: Table) -> sqlite.Insert | postgresql.Insert:
    """Give the database's own INSERT, which says what to do where the row is there already."""
    return sqlite.insert(table) if connection.dialect.name == "sqlite" else postgresql.insert(table)


def prepare(connection: Connection, name: str) -> None:
    """Make the tables where there are none, migrate older ones; several processes may do so at once.

    Raises InputError for tables of a newer resim, and for a file that is a database of something else.
    """
    if _has_column(connection, "version_num") and _version(connection) == VERSION:
        return
    connection.rollback()
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql("BEGIN IMMEDIATE")  # others wait here; what fails leaves nothing
    else:
        connection.execute(text(f"SELECT pg_advisory_xact_lock({_LOCK})"))
    found = _version(connection)  # another process may have been first
    held = inspect(connection).get_table_names()
    if found is None and held and connection.dialect.name == "sqlite":
        raise InputError(name, f"is a database of something else (it has a table {held[0]!r})", REMEDY)
    if found is None:
        METADATA.create_all(connection)
        _migrate(connection, "stamp")
        connection.execute(CHANGE.insert().values(row=1, number=0))
    elif found == "1":
        connection.exec_driver_sql(f"DROP TABLE {VERSIONS}")  # Alembic has one of its own under this name
        _migrate(connection, "upgrade")
    elif found != VERSION:
        problem = f"is a catalog of version {found}, expected {VERSION} or an older one"
        raise InputError(name, problem, f"Use the resim that wrote it, or another {VARIABLE}.")
    connection.commit()


def _version(connection: Connection) -> str | None:
    """The version of the tables, None where there are none."""
    if _has_column(connection, "version_num"):
        return str(connection.exec_driver_sql(f"SELECT max(version_num) FROM {VERSIONS}").scalar())
    return "1" if _has_column(connection, "version") else None


def _has_column(connection: Connection, name: str) -> bool:
    found = inspect(connection)
    return found.has_table(VERSIONS) and any(c["name"] == name for c in found.get_columns(VERSIONS))


def _migrate(connection: Connection, how: str) -> None:
    """Let Alembic bring the tables to the newest version, or note that they are of it."""
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", "resim.results:migrations")
    config.attributes["connection"] = connection
    getattr(command, how)(config, VERSION)
