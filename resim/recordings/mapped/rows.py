"""The rows of somebody's table: read as they stand, and each column in SI units, with the row that is wrong."""

from __future__ import annotations

import csv
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.core.spelling import did_you_mean
from resim.recordings.logs.kinds import log_kind
from resim.recordings.logs.raw import listed
from resim.recordings.logs.topics import TopicQuery, topic_table, topics
from resim.recordings.mapped.mapping import Column, CoordinateColumn, HeadingColumn, TableMapping, TimeColumn
from resim.recordings.mapped.units import DEGREES, FACTORS, LENGTHS, TIMES
from resim.recordings.tables import BIGGEST, read_parquet

LONGEST = 1_000_000
"""Characters of a header; what has more is no table."""
MOST_COLUMNS = 5_000
NOTHING = ("", "nan", "na", "n/a", "null", "none")
"""What stands for a value that is missing, in any case."""


@dataclass(frozen=True, eq=False)
class SourceTable:
    """Rows of a table.

    path: the file; where: the table in the mapping (gt, sd); frame: by row number in the file; left_out: what the
    mapping's `without` left out, in words.
    """

    path: Path
    where: str
    mapping: TableMapping
    frame: pd.DataFrame
    left_out: str = ""

    def __len__(self) -> int:
        return len(self.frame)

    def numbers(self, name: str, column: Column | None = None) -> Floats | None:
        """Give the column of this field in SI units (K,), NaN where missing; None where the mapping has none."""
        told: Any = column or getattr(self.mapping, name)
        if told is None:
            return None
        if isinstance(told, HeadingColumn) and told.quaternion is not None:
            return self._yaw(told)
        return self._raw(name, told) * FACTORS[told.unit]

    def nanoseconds(self) -> NDArray[np.int64] | None:
        """Give the times (K,) [ns] where they are whole numbers, or of a calendar: no digit is lost; else None."""
        told = self.mapping.t
        values = self._column("t", told.column)
        if told.unit == "iso":
            self._iso(told)
            return calendar_nanoseconds(values)
        unit = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}.get(told.unit)
        if unit is None:
            return None
        if not pd.api.types.is_integer_dtype(values):
            if not values.map(lambda v: isinstance(v, str) and v.strip().isdecimal()).all():
                return None
            values = values.map(int)
        if values.isna().any() or values.abs().max() > (1 << 62) // unit:
            return None
        return values.to_numpy("int64") * unit

    def coordinates(self, *, degrees: bool) -> tuple[Floats, Floats]:
        """Give the positions to the east (ahead) and to the north (left) [m, or degrees] (K,)."""
        east, north = (self._coordinate(name, own, degrees) for name, own in self.mapping.places)
        return east, north

    def times(self, rate: float | None) -> Floats:
        """Give the times (K,) [s]; rate [Hz] of frames, where the mapping has none."""
        told = self.mapping.t
        if told.unit == "iso":
            return self._iso(told)
        raw = self._raw("t", told)
        self.refuse(~np.isfinite(raw), "t", told, "a number")
        if told.unit != "frames":
            return raw * TIMES[told.unit]
        if (rate := rate or told.rate) is None:
            problem = f"{self.where}.t is in frames, and nothing says how many a second"
            raise InputError(self.path, problem, "Give t = { ..., rate = 25.0 } in the mapping, or --rate.")
        return raw / rate

    def texts(self, name: str) -> pd.Series | None:
        """Give the column of this field as text, "" where missing; None where the mapping has none."""
        told: Any = getattr(self.mapping, name)
        if told is None:
            return None
        if told.value is not None:
            return pd.Series(told.value, index=self.frame.index, dtype=object)
        values = self._column(name, told.column)
        self.refuse(values.map(_is_many), name, told, "one name, not several values")
        return values.map(_text)

    def plain_numbers(self, column: str) -> Floats:
        """Give a column as it stands (K,), NaN where missing. Raises InputError where it holds no numbers."""
        return self._raw(column, CoordinateColumn(column=column))

    def words(self, column: str) -> pd.Series:
        """Give a column as text."""
        return self._column(column, column).map(_text)

    def refuse(self, bad: Any, name: str, column: Column, expected: str) -> None:
        """Raise InputError for the first of the bad rows (K,)."""
        places = np.flatnonzero(np.asarray(bad, dtype=bool))
        if not len(places):
            return
        if column.column is None:
            what = f"{self.where}.{name} is {getattr(column, 'value', None)!r} in the mapping"
            raise InputError(self.path, f"{what}, expected {expected}", "Correct the mapping.")
        row, found = self.frame.index[places[0]], _text(self.frame[column.column].iloc[places[0]])
        more = f" (and {len(places) - 1} more rows)" if len(places) > 1 else ""
        told = found if len(found) <= 60 else found[:60] + "..."
        text = f"row {row}: {column.column} ({self.where}.{name}) is {told!r}, expected {expected}{more}"
        raise InputError(self.path, text, "Correct the rows, or the unit in the mapping.")

    def _coordinate(self, name: str, told: CoordinateColumn, degrees: bool) -> Floats:
        units = DEGREES if degrees else LENGTHS
        unit = told.unit or ("deg" if degrees else "m")
        if unit not in units:
            what = "latitude and longitude are angles" if degrees else "coordinates here are lengths"
            problem = f"{self.where}.{name} is in {unit!r}, but {what}"
            raise InputError(self.path, problem, f"Units: {', '.join(units)}.")
        return self._raw(name, told) * units[unit]

    def _raw(self, name: str, told: Any) -> Floats:
        """The column's numbers as they stand, NaN where missing."""
        if told.column is None:
            return np.full(len(self), float(told.value))
        values = self._column(name, told.column)
        if pd.api.types.is_numeric_dtype(values) and not pd.api.types.is_bool_dtype(values):
            found = values.to_numpy(float, na_value=np.nan)
            wrong = np.isinf(found)
        else:
            parsed = [_number(value, self.mapping.decimal) for value in values]
            found = np.array([np.nan if p is None else p for p in parsed], dtype=float)
            wrong = np.array([p is None for p in parsed], dtype=bool)
        self.refuse(wrong | (np.abs(found) > LARGEST), name, told, "a finite number or nothing")
        return found

    def _yaw(self, told: HeadingColumn) -> Floats:
        """The angle [rad] about the vertical of a rotation: of its x axis, seen from above; NaN where it is missing."""
        columns = [CoordinateColumn(column=name) for name in told.parts]
        x, y, z, w = (self._raw("heading.quaternion", column) for column in columns)
        norm = np.sqrt(x * x + y * y + z * z + w * w)
        wrong = (norm > 0.0) & (np.abs(norm - 1.0) > UNIT_NORM)
        self.refuse(wrong, "heading.quaternion", columns[3], "w of a quaternion of length 1")
        yaw = np.arctan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return np.where(norm > 0.0, yaw, np.nan)

    def _iso(self, told: TimeColumn) -> Floats:
        values = self._column("t", told.column)
        found = calendar_seconds(values)
        expected = "a time such as 2024-05-01T12:00:00.040Z, of the years {} to {}".format(*YEARS)
        self.refuse(~np.isfinite(found), "t", told, expected)
        return found

    def _column(self, name: str, column: str) -> pd.Series:
        return column_of(self.path, self.frame, column, f"{self.where}.{name}")


UNIT_NORM = 0.05
"""By how much the length of a quaternion may differ from 1."""
YEARS = (1900, 2200)
"""Of times of a calendar: nanoseconds since 1970 go from 1678 to 2262."""
NO_TIME = np.iinfo(np.int64).min
"""In place of a time [ns] that is missing."""
LARGEST = max(BIGGEST, 1e19)
"""Largest number in a column: of Unix times in ns."""


def calendar_seconds(values: pd.Series) -> Floats:
    """Give the Unix times (K,) [s] of ISO 8601 texts or time stamps, UTC without a zone; NaN where there is none."""
    found = calendar_nanoseconds(values)
    return np.where(found == NO_TIME, np.nan, found / 1e9)


def calendar_nanoseconds(values: pd.Series) -> NDArray[np.int64]:
    """Give the same [ns], NO_TIME where there is none."""
    out = np.full(len(values), NO_TIME)
    if pd.api.types.is_numeric_dtype(values):  # which pandas takes for nanoseconds
        return out
    single = values.mask(values.map(_is_many))
    try:
        stamps = pd.to_datetime(single, utc=True, format="ISO8601", errors="coerce")
    except (ValueError, TypeError, OverflowError):  # what it cannot coerce, such as intervals
        return out
    known = stamps.notna().to_numpy() & stamps.dt.year.between(*YEARS).to_numpy()
    out[known] = stamps[known].dt.as_unit("ns").astype("int64").to_numpy()
    return out


def column_of(path: Path, frame: pd.DataFrame, column: str, field: str) -> pd.Series:
    """Give a column of the table. Raises InputError where there is none, naming the field of the mapping."""
    if not frame.columns.is_unique or column not in frame.columns:
        names = [str(name) for name in frame.columns]
        if names.count(column) == 1:
            only: pd.Series = frame.iloc[:, names.index(column)]
            return only
        what = "has more than one column" if column in names else "has no column"
        hint = did_you_mean(column, names, cutoff=0.5)
        raise InputError(path, f"{what} {column!r}, which {field} names{hint}", f"It has {', '.join(names)}.")
    found: pd.Series = frame[column]
    return found


def read_rows(path: Path, mapping: TableMapping, where: str) -> SourceTable:
    """Read a table's rows that the mapping wants. Raises InputError."""
    frame = _frame(path, mapping, where)
    for column, wanted in mapping.only.items():
        values = (wanted,) if isinstance(wanted, str) else wanted
        there = column_of(path, frame, column, f"{where}.only").map(_text)
        lost = [value for value in values if not (there == value).any()]
        if lost or not values:
            missing = lost[0] if lost else "nothing"
            raise InputError(
                path, f"no row has {missing!r} in {column!r} ({where}.only)", "Correct the mapping."
            )
        frame = frame[there.isin(values)]
    wanted_rows = frame
    for column, unwanted in mapping.without.items():
        values = (unwanted,) if isinstance(unwanted, str) else unwanted
        frame = frame[~column_of(path, frame, column, f"{where}.without").map(_text).isin(values)]
        if frame.empty:
            raise InputError(path, f"{where}.without leaves no row: all have {column} {', '.join(values)}")
    return SourceTable(path, where, mapping, frame, _left_out(wanted_rows, frame, mapping))


def _left_out(before: pd.DataFrame, after: pd.DataFrame, mapping: TableMapping) -> str:
    """How many rows `without` left out, and how many ids have no row any more; "" for none."""
    lost = len(before) - len(after)
    if not lost:
        return ""
    text = f"{lost} of {len(before)} rows by without ({', '.join(mapping.without)})"
    column = None if mapping.id is None else mapping.id.column
    if column is None or column not in before.columns:
        return text
    known = set(before[column].map(_text))
    gone = sorted(known - set(after[column].map(_text)))
    names = ", ".join(gone[:10]) + (", ..." if len(gone) > 10 else "")
    return f"{text}; entirely gone: {len(gone)} of {len(known)} ids ({names})" if gone else text


def _frame(path: Path, mapping: TableMapping, where: str) -> pd.DataFrame:
    """The rows of a table, or of a topic of a log, whatever the file is."""
    kind = log_kind(path)
    if kind is not None:
        columns = {column: f"{where}.{field}" for column, field in mapping.columns.items()}
        query = TopicQuery(mapping.topic, mapping.list, columns, where, mapping.ros)
        return topic_table(path, kind, query)
    if mapping.topic is not None:
        problem = f"is no log (MCAP, rosbag2 or MDF4), but {where} names the topic {mapping.topic!r}"
        raise InputError(path, problem, "Give the log, or leave out topic for a CSV or Parquet table.")
    return read_any(path, mapping.separator)


def read_any(path: Path, separator: str = ",", *, rows: int | None = None) -> pd.DataFrame:
    """Give all columns of a CSV as text, of a Parquet file as they are, by row number in the file.

    rows: how many of the first are wanted; None: all.
    """
    if (kind := log_kind(path)) is not None:
        remedy = f"Name one as topic in the mapping (docs/formats/mapping.md). They are: {listed(topics(path, kind))}."
        raise InputError(path, "is a log of topics, of which a mapping cannot be guessed", remedy)
    frame = read_parquet(path) if path.suffix == ".parquet" else _csv(path, separator, rows)
    if frame.empty:
        raise InputError(path, "has a header and no rows", "Give a table with one row per time and object.")
    frame.columns = pd.Index([str(name).strip() for name in frame.columns])
    return frame


def _csv(path: Path, separator: str, rows: int | None) -> pd.DataFrame:
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path, and file in the mapping.")
    if not path.stat().st_size:
        raise InputError(path, "is empty (0 bytes)", "Give a table with a header line.")
    try:
        with warnings.catch_warnings(), path.open(encoding="utf-8-sig", newline="") as file:
            warnings.simplefilter("error", pd.errors.ParserWarning)
            if len(file.readline(LONGEST)) == LONGEST:
                raise ValueError(f"its first line has more than {LONGEST:,} characters")
            file.seek(0)
            header = next(csv.reader(file, delimiter=separator))
            if len(header) > MOST_COLUMNS:
                raise ValueError(f"it has {len(header):,} columns, up to {MOST_COLUMNS:,} are read")
            frame = pd.read_csv(
                path, sep=separator, encoding="utf-8-sig", index_col=False, skip_blank_lines=False, header=None,
                skiprows=1, names=range(len(header)), keep_default_na=False, dtype=str, low_memory=False,
                nrows=rows,
            )  # fmt: skip
    except (
        pd.errors.ParserError,
        pd.errors.EmptyDataError,
        pd.errors.ParserWarning,
        UnicodeDecodeError,
        OSError,
        csv.Error,
        StopIteration,
        ValueError,
        TypeError,
    ) as e:
        raise InputError(
            path, f"is not a readable CSV file ({' '.join(str(e).split())})",
            "Write UTF-8 text, each row as many fields as the header; separator in the mapping says what is between.",
        ) from e  # fmt: skip
    frame.columns = pd.Index(header)
    frame.index = pd.RangeIndex(2, len(frame) + 2)
    frame = frame.fillna("")
    broken = frame.apply(lambda values: values.str.contains("\n", regex=False)).any(axis=1)
    if broken.any():
        problem = f"row {frame.index[broken][0]}: a value continues on the following lines"
        raise InputError(path, problem, 'Take its quote (") away, or the line breaks within quotes.')
    told: pd.DataFrame = frame[(frame.apply(lambda values: values.str.strip()) != "").any(axis=1)]
    return told


def _text(value: object) -> str:
    """A cell as text; whole numbers without a point."""
    if _is_many(value):
        return " ".join(str(value).split())
    if pd.isna(value):  # type: ignore[call-overload]
        return ""
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value).strip()


def _is_many(value: object) -> bool:
    """Whether a cell holds several values: a list, an array, a structure."""
    return not pd.api.types.is_scalar(value)


def _number(value: object, decimal: str) -> float | None:
    """A cell as a number, NaN where it is missing, None where it is neither."""
    if isinstance(value, bool) or _is_many(value):
        return None
    text = _text(value) if not isinstance(value, str) else value.strip()
    if text.casefold() in NOTHING:
        return np.nan
    if "_" in text or (decimal == "," and "." in text):
        return None
    try:
        found = float(text.replace(decimal, "."))
    except ValueError:
        return None
    return found if np.isfinite(found) else None
