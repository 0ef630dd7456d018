"""What of a catalog follows from no files, and is lost with it: the queue, the registered paths, and where results lie
that commands entered elsewhere; with the audit trail, the users and the key of the Supervisor's cookies, kept in one
file."""

from __future__ import annotations

import json
import os
import tarfile
from io import BytesIO
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from sqlalchemy import insert, select

from resim.core.errors import InputError
from resim.core.files import open_file
from resim.results.catalog import Catalog
from resim.results.database import VERSION
from resim.results.queue import QueuedTask
from resim.results.scanning import enter, entered_of
from resim.results.tables import ROOT, TASK

STATE = (ROOT, TASK)
OWN = ("audit.jsonl", "serve.key", "users.json")
"""Files beside the catalog that are state, too."""
RESULTS = "results"
_TABLES, _LARGEST = "tables.json", 1_000_000_000
_TASK, _FOLDERS = TypeAdapter(QueuedTask), TypeAdapter(list[str])
_LATEST = 10_000_000_000
"""s since 1970 of the latest time that anybody means; numbers of tasks are smaller."""


def back_up(catalog: Catalog, data: Path, file: Path) -> dict[str, int]:
    """Write a backup that this user alone may read; says how much of each there is. data: folder of the user's files.

    Raises InputError where the file is there already, or cannot be written.
    """
    with catalog.connected() as connection:
        rows = {
            table.name: [dict(row._mapping) for row in connection.execute(select(table))] for table in STATE
        }
    entered = [str(folder) for folder in entered_of(catalog)]
    told = json.dumps({"resim-backup": VERSION, **rows, RESULTS: entered}).encode()
    counts = {name: len(of) for name, of in rows.items()} | ({RESULTS: len(entered)} if entered else {})
    try:
        descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise InputError(file, "is there already", "Name a new file.") from None
    except (OSError, ValueError) as e:
        raise InputError(file, f"cannot be written ({e})", "Name another file.") from e
    try:
        with os.fdopen(descriptor, "wb") as out, tarfile.open(fileobj=out, mode="w:gz") as archive:
            for name in OWN:
                if (data / name).is_file():
                    _add(archive, name, (data / name).read_bytes())
                    counts[name] = 1
            _add(archive, _TABLES, told)
    except OSError as e:
        file.unlink(missing_ok=True)  # half of it
        raise InputError(file, f"cannot be written: {e.strerror}", "Name another file.") from e
    return counts


def restore(catalog: Catalog, data: Path, file: Path) -> dict[str, int]:
    """Put back what a backup holds: tasks and paths that are not there, and files that are not; says how many of each.

    Results that lie below no registered path are entered again, where they are. Nothing that is there is changed.
    Raises InputError for what is no backup of this version.
    """
    rows, entered, held = _read(file)
    try:
        data.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise InputError(data, f"cannot be made ({e.strerror})", "Name another folder.") from e
    counts = {}
    with catalog.changing() as connection:
        for table in STATE:
            keys = list(table.primary_key.columns)
            known = {tuple(row) for row in connection.execute(select(*keys))}
            new = [row for row in rows[table.name] if tuple(row[key.name] for key in keys) not in known]
            if new:
                connection.execute(insert(table), new)
            counts[table.name] = len(new)
    if entered:
        counts[RESULTS] = enter(catalog, entered)
    for name, content in held.items():
        try:
            descriptor = os.open(data / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            continue
        with os.fdopen(descriptor, "wb") as out:
            out.write(content)
        counts[name] = 1
    return counts


def _add(archive: tarfile.TarFile, name: str, content: bytes) -> None:
    member = tarfile.TarInfo(name)
    member.size, member.mode = len(content), 0o600
    archive.addfile(member, BytesIO(content))


def _read(file: Path) -> tuple[dict[str, list[dict[str, Any]]], list[Path], dict[str, bytes]]:
    """Tables, folders of results and files of a backup: by their names alone, so that nothing is written elsewhere."""
    remedy = "Give a file that `resim lake backup` wrote."
    held: dict[str, bytes] = {}
    try:
        with open_file(file, remedy) as opened, tarfile.open(fileobj=opened, mode="r:gz") as archive:
            for member in archive:
                content = archive.extractfile(member) if member.isfile() and member.size < _LARGEST else None
                if member.name in (*OWN, _TABLES) and content is not None:
                    held[member.name] = content.read()
        told = json.loads(held.pop(_TABLES))
        version = told["resim-backup"]
        rows = {table.name: _rows(table, told[table.name]) for table in STATE}
        entered = [Path(folder) for folder in _FOLDERS.validate_python(told[RESULTS], strict=True)]
        if any("\0" in str(folder) or not folder.is_absolute() for folder in entered):
            raise ValueError("names what is no folder")
    except (OSError, EOFError, tarfile.TarError, ValueError, KeyError, TypeError, RecursionError) as e:
        raise InputError(file, "is no backup that can be read", remedy) from e
    if version != VERSION:
        raise InputError(
            file, f"is a backup of version {version}, expected {VERSION}", "Use the resim that wrote it."
        )
    return rows, entered, held


def _rows(table: Any, told: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows that a queue can hold. Raises ValueError, KeyError or TypeError for others."""
    rows = [{column.name: row[column.name] for column in table.columns} for row in told]
    for row in rows:
        if table is TASK:
            _TASK.validate_json(json.dumps(row), strict=True)
        numbers = [v for v in row.values() if isinstance(v, int | float)]
        texts = [v for v in row.values() if not isinstance(v, int | float | list | None)]
        if not all(abs(n) < _LATEST for n in numbers) or not all(
            isinstance(t, str) and "\0" not in t for t in texts
        ):
            raise ValueError("holds what no queue has")
    return rows
