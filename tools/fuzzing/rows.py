"""Damages the rows and columns of tables, CSV and Parquet."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random

import duckdb

from fuzzing.trees import value
from fuzzing.values import TEXTS

Rows = list[list[str]]
TYPES = ("VARCHAR", "INTEGER", "BIGINT", "HUGEINT", "DECIMAL(18, 3)", "REAL", "BOOLEAN", "DATE", "TIMESTAMP", "BLOB",
         "VARCHAR[]", "STRUCT(a VARCHAR)", "UUID", "INTERVAL")  # fmt: skip


def csv(rng: Random, data: bytes) -> bytes:
    """Give the CSV text with one to four damages to its rows, columns and cells."""
    rows = [line.split(",") for line in data.decode().splitlines()]
    for _ in range(rng.choice((1, 1, 2, 3, 4))):
        if rows:
            rows = rng.choice(ALL)(rng, rows)
    text = "\n".join(",".join(row) for row in rows) + rng.choice(("\n", "\n", "", "\n\n\n", "\n,,,\n"))
    way = rng.random()
    if way < 0.04:
        text = text.replace(",", rng.choice((";", "\t", ", ", ",,")))
    elif way < 0.06:
        text = text.replace(".", ",")
    return text.encode()


def _column(rng: Random, rows: Rows) -> int:
    return rng.randrange(max(len(rows[0]), 1))


def _drop_column(rng: Random, rows: Rows) -> Rows:
    at = _column(rng, rows)
    return [row[:at] + row[at + 1 :] for row in rows]


def _double_column(rng: Random, rows: Rows) -> Rows:
    at, to = _column(rng, rows), _column(rng, rows)
    return [row[:to] + row[at : at + 1] + row[to:] for row in rows]


def _order_columns(rng: Random, rows: Rows) -> Rows:
    order = list(range(len(rows[0])))
    rng.shuffle(order)
    keep_header = rng.random() < 0.5
    return [
        row if (n == 0 and keep_header) else [row[i] for i in order if i < len(row)]
        for n, row in enumerate(rows)
    ]


def _whole_column(rng: Random, rows: Rows) -> Rows:
    at, new = _column(rng, rows), value(rng, "1.0")
    return [rows[0], *([*row[:at], new, *row[at + 1 :]] for row in rows[1:])]


def _scale_column(rng: Random, rows: Rows) -> Rows:
    at, factor = (
        _column(rng, rows),
        rng.choice((1e-3, 1e3, 1e12, 1e18, 1e150, 1e300, 0.0, -1.0, 1e-12, 1e-300)),
    )

    def scaled(cell: str) -> str:
        try:
            return repr(float(cell) * factor)
        except ValueError:
            return cell

    return [rows[0], *([*row[:at], *map(scaled, row[at : at + 1]), *row[at + 1 :]] for row in rows[1:])]


def _every_own(rng: Random, rows: Rows) -> Rows:
    """Every row its own value: as many objects, or times, as there are rows."""
    at = _column(rng, rows)
    return [rows[0], *([*row[:at], str(n), *row[at + 1 :]] for n, row in enumerate(rows[1:]))]


def _drop_rows(rng: Random, rows: Rows) -> Rows:
    start = rng.randrange(len(rows))
    return rows[:start] + rows[start + int(rng.random() ** 3 * len(rows)) + 1 :]


def _double_rows(rng: Random, rows: Rows) -> Rows:
    start = rng.randrange(len(rows))
    part = rows[start : start + rng.choice((1, 1, 5, 100))]
    return rows[:start] + part * rng.choice((1, 1, 2, 20)) + rows[start:]


def _shuffle_rows(rng: Random, rows: Rows) -> Rows:
    inner = rows[1:]
    rng.shuffle(inner)
    return [rows[0], *inner]


def _cells(rng: Random, rows: Rows) -> Rows:
    rows = [list(row) for row in rows]
    for _ in range(rng.choice((1, 1, 2, 5, 50))):
        row = rng.choice(rows)
        if row:
            at = rng.randrange(len(row))
            row[at] = rng.choice(
                (value(rng, row[at]), rng.choice(TEXTS), f'"{row[at]}"', f'"{row[at]}', "a,b", '"a\nb"', "")
            )
    return rows


def _ragged(rng: Random, rows: Rows) -> Rows:
    at = rng.randrange(len(rows))
    return [*rows[:at], rows[at][: rng.randrange(12)] + ["1"] * rng.randrange(3), *rows[at + 1 :]]


ALL: tuple[Callable[[Random, Rows], Rows], ...] = (
    _drop_column, _double_column, _order_columns, _whole_column, _scale_column, _scale_column, _every_own,
    _drop_rows, _double_rows, _shuffle_rows, _cells, _cells, _cells, _cells, _ragged,
)  # fmt: skip


def parquet(rng: Random, csv_text: bytes) -> bytes:
    """Give a Parquet file of the CSV's rows, with columns of other types, without columns, or without rows."""
    with tempfile.TemporaryDirectory() as folder, duckdb.connect(config={"threads": 1}) as db:
        source, target = Path(folder) / "in.csv", Path(folder) / "out.parquet"
        source.write_bytes(csv_text)
        db.execute(f"CREATE TABLE rows AS SELECT * FROM read_csv('{source}')")
        names = [str(row[0]) for row in db.execute("DESCRIBE rows").fetchall()]
        chosen = {name: f'"{name}"' for name in names}
        for _ in range(rng.choice((0, 1, 1, 2))):
            name = rng.choice(names)
            cast = f'TRY_CAST("{name}" AS {rng.choice(TYPES)})'
            chosen[name] = rng.choice(
                (cast, cast, "NULL", "[1, 2]", "{'a': 1}", "'NaN'::DOUBLE", "''", "1e300")
            )
        if rng.random() < 0.2:
            del chosen[rng.choice(names)]
        which = rng.choice(("", "", "", "LIMIT 0", "LIMIT 1", "UNION ALL SELECT * FROM picked"))
        columns = ", ".join(f'{text} AS "{name}"' for name, text in chosen.items())
        try:
            db.execute(f"CREATE VIEW picked AS SELECT {columns} FROM rows")
            db.execute(f"COPY (SELECT * FROM picked {which}) TO '{target}' (FORMAT parquet)")
        except duckdb.Error:
            db.execute(f"COPY rows TO '{target}' (FORMAT parquet)")
        data = target.read_bytes()
    return data if rng.random() < 0.6 else data[: rng.randrange(len(data))]
