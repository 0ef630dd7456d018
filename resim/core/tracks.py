"""Tracks: the motion of N objects at T common times, the one struct of arrays that walks through resim."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats, unwrap_angle, wrap_angle
from resim.core.schema import COLUMNS as COLUMNS
from resim.core.schema import OPTIONAL_COLUMNS as OPTIONAL_COLUMNS

ObjectKind = Literal[
    "car", "van", "truck", "bus", "trailer", "motorcycle", "bicycle", "pedestrian", "unknown"
]
KINDS: tuple[str, ...] = get_args(ObjectKind)

PART = "~"
"""What stands between an object's id and the number of its part (see `Tracks.split`)."""

Strings = NDArray[np.str_]

_SAME = 1e-9  # s; times this near to each other are one


def whole_id(name: str, known: Iterable[str]) -> str:
    """Give the id of the object whose part this is, if that one is known; else the name itself."""
    base, _, number = name.rpartition(PART)
    return base if number.isdigit() and base in known else name


@dataclass(frozen=True, eq=False)
class Tracks:
    """Motion of N objects at T times. Samples that do not exist are NaN and not `valid`.

    Attributes:
        t: (T,) s, strictly increasing.
        ids: (N,) names, each once.
        kind: (N,) of KINDS.
        x: (N, T) m, box centre, map frame.
        y: (N, T) m, box centre, map frame.
        heading: (N, T) rad, anticlockwise from +x.
        v: (N, T) m/s along the heading.
        length: (N,) m.
        width: (N,) m.
        valid: (N, T) whether the sample is there.
        yaw_rate: (N, T) rad/s, None where it was not measured.
        a: (N, T) m/s², None where it was not measured.
        z: (N, T) m, height of the road under the box centre, NaN where it is not known, None where it was not measured.
    """

    t: Floats
    ids: Strings
    kind: Strings
    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    length: Floats
    width: Floats
    valid: Bools
    yaw_rate: Floats | None = None
    a: Floats | None = None
    z: Floats | None = None

    def __post_init__(self) -> None:
        n, samples = len(self.ids), len(self.t)
        if len(set(self.ids.tolist())) != n:
            raise ResimError("tracks: an object id is a duplicate")
        if samples > 1 and not np.all(np.diff(self.t) > 0.0):
            raise ResimError("tracks: times must increase strictly")
        for name in ("x", "y", "heading", "v", "valid", *OPTIONAL_COLUMNS):
            value = getattr(self, name)
            if value is not None and value.shape != (n, samples):
                raise ResimError(f"tracks: {name} has shape {value.shape}, expected {(n, samples)}")
        for name in ("kind", "length", "width"):
            if getattr(self, name).shape != (n,):
                raise ResimError(f"tracks: {name} has shape {getattr(self, name).shape}, expected {(n,)}")
        for name in ("x", "y", "heading", "v"):
            if not np.isfinite(getattr(self, name)[self.valid]).all():
                raise ResimError(f"tracks: {name} holds NaN in a valid sample")

    def __len__(self) -> int:
        return len(self.ids)

    def index(self, object_id: str) -> int:
        """Give the row of the object.

        Args:
            object_id: Id of the object.

        Raises:
            ResimError: There is no such object.
        """
        rows = np.flatnonzero(self.ids == object_id)
        if not len(rows):
            raise ResimError(f"no object {object_id!r} among {', '.join(self.ids[:20])}")
        return int(rows[0])

    def select(self, ids: Iterable[str]) -> Tracks:
        """Give the tracks of these objects, in this order.

        Args:
            ids: Ids of the objects.
        """
        return self._rows([self.index(i) for i in ids])

    def without(self, object_id: str) -> Tracks:
        """Give the tracks of all objects but this one.

        Args:
            object_id: Id of the object; one that is not there leaves all.
        """
        return self._rows(np.flatnonzero(self.ids != object_id))

    def window(self, start: float, end: float) -> Tracks:
        """Give the samples with start <= t <= end [s], and of the objects those that have one there.

        Args:
            start: First time [s].
            end: Last time [s].
        """
        keep = (self.t >= start) & (self.t <= end)
        cut = self.samples(np.flatnonzero(keep))
        return cut._rows(np.flatnonzero(cut.valid.any(axis=1)))

    def samples(self, rows: ArrayLike) -> Tracks:
        """Give the samples at these places in `t`, in this order, which must be that of time.

        Args:
            rows: (K,) places in `t`.
        """
        rows = np.asarray(rows, dtype=int)
        taken = {name: value[:, rows] for name, value in self._arrays().items() if value.ndim == 2}
        return replace(self, t=self.t[rows], **taken)

    def shifted(self, dt: float) -> Tracks:
        """Give the same tracks dt [s] later.

        Args:
            dt: s.
        """
        return replace(self, t=self.t + dt)

    def span(self) -> tuple[Floats, Floats]:
        """Give the first and last valid time (N,), (N,) [s] of each object, NaN where it has none."""
        if not len(self.t):
            return np.full(len(self), np.nan), np.full(len(self), np.nan)
        first = self.t[np.argmax(self.valid, axis=1)]
        last = self.t[len(self.t) - 1 - np.argmax(self.valid[:, ::-1], axis=1)]
        seen = self.valid.any(axis=1)
        return np.where(seen, first, np.nan), np.where(seen, last, np.nan)

    def at(self, t: ArrayLike, *, max_gap: float = 0.3) -> Tracks:
        """Interpolate linearly at times t (K,) [s].

        A time is valid for an object if it coincides with a sample or lies between two that are at most
        max_gap [s] apart; nothing is extrapolated.

        Args:
            t: (K,) s.
            max_gap: Longest gap [s] that is interpolated.
        """
        t = np.asarray(t, dtype=float)
        names = ("x", "y", "heading", "v", *OPTIONAL_COLUMNS)
        columns = [name for name in names if getattr(self, name) is not None]
        out = {name: np.full((len(self), len(t)), np.nan) for name in columns}
        own_times = np.array_equal(t, self.t)
        for n in range(len(self)):
            known = np.flatnonzero(self.valid[n])
            if not len(known):
                continue
            if own_times and known[-1] - known[0] < len(known):  # nothing lies between samples
                for name in columns:
                    out[name][n, known] = getattr(self, name)[n, known]
                continue
            own = self.t[known]
            after = np.clip(np.searchsorted(own, t - _SAME, side="left"), 0, len(own) - 1)
            before = np.clip(np.searchsorted(own, t + _SAME, side="right") - 1, 0, len(own) - 1)
            hit = (
                (t >= own[0] - _SAME) & (t <= own[-1] + _SAME) & (own[after] - own[before] <= max_gap + _SAME)
            )
            for name in columns:
                values = getattr(self, name)[n, known]
                if name == "heading":
                    values = unwrap_angle(values)
                out[name][n, hit] = np.interp(t[hit], own, values)
        out["heading"] = wrap_angle(out["heading"])
        return replace(self, t=t, valid=np.isfinite(out["x"]), **out)

    def split(self, max_gap: float, *, keep: str) -> Tracks:
        """Give tracks in which no object is missing for more than max_gap [s]: one that comes back is another one.

        The parts of object `5` are called `5`, `5~2`, `5~3`.

        Args:
            max_gap: Longest time [s] for which an object may be missing.
            keep: Id of the object that is left whole.

        Raises:
            ResimError: An id reads as a part of another already.
        """
        if part_ids := self.parts():
            whole = whole_id(part_ids[0], set(self.ids.tolist()))
            raise ResimError(
                f"the id {part_ids[0]!r} reads as a part of object {whole!r}; give it another name"
            )
        rows: list[int] = []
        parts: list[NDArray[np.intp]] = []
        names: list[str] = []
        for n, name in enumerate(self.ids.tolist()):
            known = np.flatnonzero(self.valid[n])
            late = np.flatnonzero(np.diff(self.t[known]) > max_gap + _SAME) + 1
            for k, part in enumerate([known] if name == keep else np.split(known, late), start=1):
                rows.append(n)
                parts.append(part)
                names.append(name if k == 1 else f"{name}{PART}{k}")
        if len(rows) == len(self):
            return self
        valid = np.zeros((len(rows), len(self.t)), dtype=bool)
        for row, part in enumerate(parts):
            valid[row, part] = True
        every = {name: values[rows] for name, values in self._arrays().items()}
        moved = {c: np.where(valid, v, np.nan) for c, v in every.items() if v.ndim == 2 and c != "valid"}
        return replace(self, **{**every, **moved, "ids": np.array(names, dtype=str), "valid": valid})

    def parts(self) -> list[str]:
        """Give the ids that are parts of another object (see `split`)."""
        ids = set(self.ids.tolist())
        return [name for name in self.ids.tolist() if whole_id(name, ids) != name]

    def joined(self) -> Tracks:
        """Give the tracks with the parts of an object in one row again; inverse of `split`."""
        ids = set(self.ids.tolist())
        names = [whole_id(name, ids) for name in self.ids.tolist()]
        first = {name: names.index(name) for name in dict.fromkeys(names)}
        if len(first) == len(self):
            return self
        out = {c: v[list(first.values())].copy() for c, v in self._arrays().items()}
        out["ids"] = np.array(list(first), dtype=str)
        for n, row in enumerate(list(first).index(name) for name in names):
            there = self.valid[n]
            for column, values in self._arrays().items():
                if values.ndim == 2:
                    out[column][row, there] = values[n, there]
        return replace(self, **out)

    def to_frame(self) -> pd.DataFrame:
        """Give a table with one row per time and valid object, by time, then in the order of `ids`."""
        sample, row = np.nonzero(self.valid.T)
        table = {
            "t": self.t[sample], "id": self.ids[row], "x": self.x[row, sample], "y": self.y[row, sample],
            "heading": self.heading[row, sample], "v": self.v[row, sample],
            "length": self.length[row], "width": self.width[row], "kind": self.kind[row],
        }  # fmt: skip
        for name in OPTIONAL_COLUMNS:
            if (value := getattr(self, name)) is not None:
                table[name] = value[row, sample]
        return pd.DataFrame(table)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> Tracks:
        """Make tracks of a table with COLUMNS (and maybe OPTIONAL_COLUMNS), one row per time and object.

        Objects stand in the order of their first row, times are the union of all. Length, width and kind
        are those of an object's first row.

        Args:
            frame: COLUMNS in SI units, one row a time and object.
        """
        t, sample = np.unique(frame["t"].to_numpy(float), return_inverse=True)
        row, names = pd.factorize(frame["id"].astype(str), use_na_sentinel=False)
        first = frame.groupby(row, sort=True).first()

        def spread(column: str) -> Floats:
            out = np.full((len(names), len(t)), np.nan)
            out[row, sample] = frame[column].to_numpy(float)
            return out

        values = {c: spread(c) for c in ("x", "y", "heading", "v", *OPTIONAL_COLUMNS) if c in frame.columns}
        valid = np.zeros((len(names), len(t)), dtype=bool)
        valid[row, sample] = True
        return cls(
            t=t, ids=np.array(names, dtype=str), kind=np.array(first["kind"], dtype=str), valid=valid,
            length=first["length"].to_numpy(float), width=first["width"].to_numpy(float), **values,
        )  # fmt: skip

    @classmethod
    def concatenate(cls, parts: list[Tracks]) -> Tracks:
        """Give the objects of all parts in one.

        Args:
            parts: Tracks with the same times.

        Raises:
            ResimError: They do not share their times.
        """
        if any(not np.array_equal(part.t, parts[0].t) for part in parts):
            raise ResimError("tracks: only parts with the same times can be concatenated")

        def rows(name: str) -> Floats:
            return np.concatenate([getattr(part, name) for part in parts])

        def measured(name: str) -> Floats | None:
            return rows(name) if all(getattr(part, name) is not None for part in parts) else None

        names = ("ids", "kind", "x", "y", "heading", "v", "length", "width", "valid")
        optional = {name: measured(name) for name in OPTIONAL_COLUMNS}
        return cls(t=parts[0].t, **{name: rows(name) for name in names}, **optional)  # type: ignore[arg-type]

    def _rows(self, rows: ArrayLike) -> Tracks:
        rows = np.asarray(rows, dtype=int)
        return replace(self, **{name: value[rows] for name, value in self._arrays().items()})

    def _arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that has a row per object."""
        return {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if f.name != "t" and getattr(self, f.name) is not None
        }
