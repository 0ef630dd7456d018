"""Track tables as people write them, CSV or Parquet: read, and refused with the row that is wrong."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Sequence
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from resim.core.errors import InputError
from resim.core.files import plain_names
from resim.core.schema import COLUMNS, EXISTENCE, GT_ID, OPTIONAL_COLUMNS, REPAIRED, TOLD
from resim.core.spelling import counted, did_you_mean, nearest
from resim.core.tracks import KINDS

FILLED = (
    "MISSING_VALUES", "MISSING_SAMPLES", "GAP", "OUTLIER", "REPEATED_SAMPLES", "ACCELERATION", "YAW_RATE",
    "SPEED_DISAGREES", "HEADING_DISAGREES",
)  # fmt: skip
"""Marks of samples that a repair made, or half of them: nobody saw them so."""
JOINED = "TRACK_BROKEN"
"""Mark of samples that a repair took for those of an object with another id."""
PARTED = "ID_REUSED"
"""Mark of samples that a repair took for those of an object of its own."""
TEXT = ("id", "kind", GT_ID, REPAIRED)
VALUES = ("x", "y", "heading", "v")
"""Columns in which a sample may be missing a value; `resim.recordings.checks` reports it, a recording refuses it."""
BIGGEST = 1e12
"""Largest number [of any unit] in a table: squares and cubes of larger ones are none any more."""

MOST_COLUMNS, LONGEST_HEADER = 5_000, 10_000_000
"""Columns of a table, and bytes of its first line that are looked at: pandas is slow with more."""
MOST_TURNED = 1e4
"""Largest heading [rad], for those that count turns; also what SUMO brings into one turn without a hang."""

_CSV_ERRORS = (
    pd.errors.ParserError, pd.errors.EmptyDataError, pd.errors.ParserWarning, UnicodeDecodeError, OSError
)  # fmt: skip


def read_track_table(path: Path) -> pd.DataFrame:
    """Give the rows of a track table as they stand, indexed by their row number in the file.

    The columns are `core.schema.COLUMNS` and, where the file has them, OPTIONAL_COLUMNS, `gt_id` ("" for
    none), `existence_probability`, `repaired` ("" or the codes of the findings repaired, spaces between) and
    TOLD; other columns are left out. A CSV row's number is its line (the header is line 1), a Parquet row's its
    place from 1. Rows may repeat or run back in time, and VALUES may be NaN. Raises InputError for whatever
    cannot be read at all, a size or kind that is none, or a probability beyond 0 to 1.
    """
    optional = (*OPTIONAL_COLUMNS, EXISTENCE, GT_ID, REPAIRED, *TOLD.values())
    frame = read_table(path, required=COLUMNS, optional=optional, missing=VALUES)
    _check_terms(path, frame)
    return frame


def check_tracks(path: Path, frame: pd.DataFrame) -> None:
    """Refuse sizes that are none, unknown kinds, probabilities beyond 0 to 1, times that repeat or run back.

    frame: track table with `core.tracks.COLUMNS`, indexed by the row's number in the file. Raises InputError.
    """
    _check_terms(path, frame)
    check_times(path, frame)


def check_readable(path: Path, frame: pd.DataFrame) -> None:
    """Refuse in rows that are to be written what `read_track_table` would refuse in them.

    frame: track table as `read_track_table` gives it. Raises InputError naming `path`, where the rows are from.
    """
    if not frame.index.is_unique:
        frame = frame.reset_index(drop=True)
    names = {name: _is_name(name) for name in frame["id"].unique()}
    _refuse(path, frame, ~frame["id"].map(names), "id", "a name of one line that UTF-8 can hold")
    for column in (c for c in frame.columns if c not in TEXT):
        _numbers(path, frame, column, required=column in COLUMNS and column not in VALUES)
    _check_terms(path, frame)


def _is_name(name: str) -> bool:
    try:
        return len(name.splitlines()) == 1 and bool(name.encode())
    except UnicodeEncodeError:
        return False


def check_complete(path: Path, frame: pd.DataFrame) -> None:
    """Refuse rows in which one of VALUES is missing. Raises InputError."""
    for column in VALUES:
        _refuse(path, frame, ~np.isfinite(frame[column]), column, "a finite number")


def _check_terms(path: Path, frame: pd.DataFrame) -> None:
    for column in ("length", "width"):
        _refuse(path, frame, frame[column] <= 0.0, column, "a size above 0 m")
    turned = frame["heading"].abs() > MOST_TURNED
    _refuse(path, frame, turned, "heading", f"radians up to {MOST_TURNED:g}")
    _refuse(path, frame, ~frame["kind"].isin(KINDS), "kind", f"one of {', '.join(KINDS)}", KINDS)
    if EXISTENCE in frame:
        _refuse(path, frame, (frame[EXISTENCE] < 0.0) | (frame[EXISTENCE] > 1.0), EXISTENCE, "0 to 1")


def read_table(
    path: Path,
    *,
    required: Sequence[str],
    optional: Sequence[str] = (),
    text: Sequence[str] = TEXT,
    missing: Sequence[str] = (),
    may_be_empty: bool = False,
) -> pd.DataFrame:
    """Give the wanted columns of a CSV or Parquet file, indexed by the row's number in the file.

    Columns in `text` are strings, "" where empty; all others are floats up to BIGGEST, finite where the column is
    required, finite or NaN where it is optional or one of `missing`. Raises InputError for an unreadable or empty file,
    missing columns, values that are no numbers.
    """
    numbers = [c for c in (*required, *optional) if c not in text]
    frame = read_parquet(path) if path.suffix == ".parquet" else _read_csv(path, numbers, text)
    twice = [c for c in (*required, *optional) if list(frame.columns).count(c) > 1]
    if twice:
        problem = f"has more than one column {', '.join(twice)}"
        raise InputError(path, problem, "Keep the right one, or rename the others.")
    lost = [c for c in required if c not in frame.columns]
    if lost:
        there = ", ".join(map(str, frame.columns))
        problem = f"column {', '.join(lost)} missing{_misspelt(lost[0], frame)}; found {there}"
        raise InputError(path, problem, f"The header must name {', '.join(required)}, separated by commas.")
    if frame.empty and not may_be_empty:
        raise InputError(path, "has a header and no rows", "Write one row per time and object.")
    frame = frame[[*required, *(c for c in optional if c in frame.columns)]].copy()
    for column in frame.columns:
        if column in text:
            frame[column] = frame[column].astype(str).mask(frame[column].isna(), "")
            if column in required:
                _refuse(path, frame, frame[column] == "", column, "a name")
        else:
            needed = column in required and column not in missing
            frame[column] = _numbers(path, frame, column, required=needed)
    return frame


def _misspelt(column: str, frame: pd.DataFrame) -> str:
    """A column of the file that may be the one that is missing, in words; "" where none is alike."""
    alike = nearest(column, map(str, frame.columns))
    return f" (did you write {alike!r} for {column!r}?)" if alike else ""


def row_problem(frame: pd.DataFrame, row: int, what: str) -> str:
    """Give `row 12 (t 0.4, object 'a'): what`, naming what the row holds."""
    at = frame.loc[row]
    named = [f"t {at['t']}"] if "t" in frame.columns else []
    named += [f"object {at['id']!r}"] if "id" in frame.columns else []
    return f"row {row} ({', '.join(named)}): {what}" if named else f"row {row}: {what}"


def _read_csv(path: Path, numbers: Sequence[str], text: Sequence[str]) -> pd.DataFrame:
    """Every row of the CSV that is not blank, indexed by its line number."""
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path.")
    if not path.stat().st_size:
        raise InputError(path, "is empty (0 bytes)", "Write a header line and one row per time and object.")
    with path.open("rb") as file:
        if (count := file.readline(LONGEST_HEADER).count(b",") + 1) > MOST_COLUMNS:
            problem = f"has {count:,} columns or more, up to {MOST_COLUMNS:,} are read"
            raise InputError(path, problem, "Keep those of the format.")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(
                path, encoding="utf-8-sig", index_col=False, skip_blank_lines=False, keep_default_na=False,
                na_values={c: [""] for c in numbers},
                dtype=dict.fromkeys(text, str), float_precision="round_trip", low_memory=False,
            )  # fmt: skip
    except _CSV_ERRORS as e:
        raise InputError(
            path, f"is not a readable CSV file ({' '.join(str(e).split())})",
            "Write UTF-8 text, separated by commas, each row with as many fields as the header.",
        ) from e  # fmt: skip
    _refuse_lines(path, len(frame) + 1)
    frame.columns = pd.Index(_header(path))  # as written: pandas calls a second x x.1
    frame.index = pd.RangeIndex(2, len(frame) + 2)
    blank = (frame.isna() | (frame == "")).all(axis=1)
    return frame.loc[~blank]


def _refuse_lines(path: Path, rows: int) -> None:
    """Raise InputError where a value goes over several lines: a quote that somebody forgot would swallow rows."""
    raw = path.read_bytes()
    if b'"' not in raw or len(raw.splitlines()) == rows:
        return
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines, last = csv.reader(file), 0
        for row in lines:
            if lines.line_num > last + 1:
                found = next((value for value in row if len(value.splitlines()) > 1), "")
                problem = f"row {last + 1}: a value continues on the following lines: {found[:30]!r}..."
                raise InputError(path, problem, 'Take its quote (") away, or the line breaks within quotes.')
            last = lines.line_num


def _header(path: Path) -> list[str]:
    """The names in the first line of a CSV that pandas has read."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        return next(csv.reader(file))


def read_parquet(path: Path) -> pd.DataFrame:
    """Give every column of a Parquet file, rows numbered from 1. Raises InputError."""
    try:
        with duckdb.connect() as db, plain_names([path]) as names:
            frame: pd.DataFrame = db.execute(
                "SELECT * FROM read_parquet(?, hive_partitioning = false)", names
            ).df()
    except Exception as e:  # what DuckDB raises for damaged bytes is not always its own
        raise InputError(
            path, f"is not a readable Parquet file ({' '.join(str(e).splitlines()[:1])})",
            "The file may be truncated: write it again, or give a CSV file.",
        ) from e  # fmt: skip
    frame.index = pd.RangeIndex(1, len(frame) + 1)
    return frame


def _numbers(path: Path, frame: pd.DataFrame, column: str, *, required: bool) -> pd.Series:
    """The column as floats; exact, as Python reads them."""
    expected = f"a finite number up to {BIGGEST:g}" + ("" if required else " or nothing")
    values = frame[column]
    if pd.api.types.is_bool_dtype(values) or not pd.api.types.is_numeric_dtype(values):
        _refuse(path, frame, ~values.map(_is_number), column, expected)
    numbers = values.astype(float)
    _refuse(
        path,
        frame,
        ~(np.abs(numbers) <= BIGGEST) if required else np.abs(numbers) > BIGGEST,
        column,
        expected,
    )
    return numbers


def _is_number(value: object) -> bool:
    if not isinstance(value, str):
        return isinstance(value, float)
    try:
        float(value)
    except ValueError:
        return False
    return "_" not in value  # 1_000 is a number to Python alone


def check_times(path: Path, frame: pd.DataFrame) -> None:
    """Refuse a (t, id) that is a duplicate and an object whose times run backwards. Raises InputError."""
    twice = frame.duplicated(["t", "id"])
    if twice.any():
        row = frame.index[twice.to_numpy()][0]
        problem = row_problem(frame, row, "a row with this time and object comes before it")
        raise InputError(path, problem, "Keep one row per time and object.")
    step = frame.groupby("id", sort=False)["t"].diff()
    if (step < 0.0).any():
        row = frame.index[(step < 0.0).to_numpy()][0]
        earlier = frame.loc[row, "t"] - step.loc[row]
        problem = row_problem(
            frame, row, f"time runs backwards: the object's previous row has t {earlier:.9g}"
        )
        raise InputError(path, problem, "Sort each object's rows by time, or give each drive its own ids.")


def _refuse(
    path: Path, frame: pd.DataFrame, bad: ArrayLike, column: str, expected: str, known: Sequence[str] = ()
) -> None:
    """Raise for the first bad row, and say how many there are. known: names, of which one may be meant."""
    rows = frame.index[np.asarray(bad, dtype=bool)]
    if not len(rows):
        return
    value = frame.loc[rows[0], column]
    shown = repr(value) if isinstance(value, str) else f"{value}"
    meant = did_you_mean(str(value), known)
    others = len(rows) - 1
    more = f" (and {counted(others, 'more row')})" if others else ""
    raise InputError(
        path, row_problem(frame, rows[0], f"{column} is {shown}, expected {expected}{more}{meant}")
    )


def write_parquet(path: Path, frame: pd.DataFrame) -> None:
    """Write a table as Parquet; the same table gives the same bytes."""
    with duckdb.connect() as database:
        database.execute("SET threads = 1")
        database.register("written", frame)
        name = str(path).replace("'", "''")
        database.execute(f"COPY written TO '{name}' (FORMAT parquet, COMPRESSION zstd)")


def complete_rows(frame: pd.DataFrame) -> pd.DataFrame:
    """Give the rows of a track table that lack no value, each time and object once, by time."""
    whole = frame[np.isfinite(frame[list(VALUES)].to_numpy(float)).all(axis=1)]
    ordered: pd.DataFrame = whole.drop_duplicates(["t", "id"]).sort_values("t", kind="stable")
    return ordered
