"""The folder of a space: space.json, scenarios.parquet, slots.parquet, clusters.parquet, distances.parquet,
moments.parquet."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import check_hashes, file_hash, joined, relative
from resim.core.sealed import sealed
from resim.core.spec import read_sealed_json, to_json
from resim.recordings.tables import read_parquet
from resim.results import merge_parquet, write_json, write_parquet
from resim.space.build import typed
from resim.space.described import report
from resim.space.distance import PairDistances
from resim.space.model import CLUSTERS, COLUMNS, BucketLinks, Space
from resim.space.report import MARK, SpaceReport
from resim.space.shared_traffic import no_moments
from resim.space.traces import read_traces, to_frame

TABLES = ("scenarios.parquet", "slots.parquet", "clusters.parquet", "distances.parquet", "moments.parquet")
WRITTEN_BY, REMEDY = "resim space", "Build the space again with `resim space build`."
MOST_PAIRS = 2_000_000
"""Pairs of a bucket that are all written; of more only those up to NEAR times the threshold."""
NEAR = 2.0
ROWS = 500
"""Rows of a bucket's distances that are computed and written at once."""
LARGEST = 2_000_000_000
"""Bytes of space.json at most."""


def write_space(space: Space, folder: Path, workers: int = 1) -> SpaceReport:
    """Write a space into an existing folder, and give what space.json says. Paths are as seen from the folder."""
    space = _with_paths(space, lambda one: relative(Path(one), Path(os.path.realpath(folder))))
    write_parquet(space.rows, folder / "scenarios.parquet")
    write_parquet(to_frame(space.traces), folder / "slots.parquet")
    write_parquet(space.rows[list(CLUSTERS)], folder / "clusters.parquet")
    write_parquet(space.moments, folder / "moments.parquet")
    _write_distances(space, folder, workers)
    found = report(space, {name: file_hash(folder / name) for name in TABLES})
    write_json(sealed(to_json(found)), folder / MARK)
    return found


def read_report(folder: Path) -> SpaceReport:
    """Read space.json. Raises InputError where it is none, was changed, or is of an earlier version of resim."""
    told = read_sealed_json(folder / MARK, SpaceReport, WRITTEN_BY, REMEDY, largest=LARGEST)
    if found := [one.folder for one in told.sources if Path(one.folder).is_absolute()]:
        problem = f"was written by an earlier version of resim: it names {found[0]} by an absolute path"
        raise InputError(folder / MARK, problem, REMEDY)
    return told


def read_space(folder: Path) -> tuple[Space, SpaceReport]:
    """Read a space, and what its report says: paths are absolute in the space, in the report seen from the folder.

    Raises InputError where it is none, was changed, or is of an earlier version of resim.
    """
    told = read_report(folder)
    check_hashes(folder, told.files, REMEDY)
    rows = read_parquet(folder / "scenarios.parquet").reset_index(drop=True)
    if lost := [name for name in COLUMNS if name not in rows]:
        raise InputError(folder / "scenarios.parquet", f"has no column {lost[0]!r}", REMEDY)
    traces = read_traces(folder / "slots.parquet")
    links = {
        one.bucket: BucketLinks(one.threshold, one.chosen, one.method, one.links) for one in told.buckets
    }
    where = Path(os.path.realpath(folder)) / MARK
    moments = read_parquet(folder / "moments.parquet").astype(no_moments().dtypes.to_dict())
    space = Space(told.settings, told.sources, typed(rows), traces, links, moments)
    return _with_paths(space, lambda one: str(joined(where, one))), told


def _with_paths(space: Space, told: Callable[[str], str]) -> Space:
    """The space with its paths told otherwise: of mined folders, and of scenarios that are recordings ("" for none)."""
    folders = [told(one) if one else "" for one in space.rows["folder"].astype(str)]
    sources = tuple(replace(one, folder=told(one.folder)) for one in space.sources)
    return replace(space, sources=sources, rows=typed(space.rows.assign(folder=folders)))


def _write_distances(space: Space, folder: Path, workers: int) -> None:
    """Write distances.parquet part by part: bucket, one, two, distance."""
    parts = []
    for number, frame in enumerate(_distances(space, workers)):
        parts.append(folder / f".distances-{number}.parquet")
        write_parquet(frame, parts[-1])
    merge_parquet(parts, folder / "distances.parquet")
    for part in parts:
        part.unlink()


def _distances(space: Space, workers: int) -> Iterator[pd.DataFrame]:
    names = space.rows["scenario"].to_numpy(str)
    yield _frame("", names[:0], names[:0], np.zeros(0))
    for bucket, own in space.by_bucket():
        count, most = len(own), np.inf
        if count * (count - 1) // 2 > MOST_PAIRS:
            most = NEAR * space.links[bucket].threshold
        pairs = PairDistances(space.traces.take(own), space.settings.distance, workers)
        every = np.arange(count)
        for low in range(0, count - 1, ROWS):
            part = every[low : low + ROWS]
            found = pairs.between(part, every[low:])
            one, two = np.nonzero((every[low:][None, :] > part[:, None]) & (found <= most))
            yield _frame(bucket, names[own[low + one]], names[own[low + two]], found[one, two])


def _frame(bucket: str, one: np.ndarray, two: np.ndarray, distance: np.ndarray) -> pd.DataFrame:
    columns = {"bucket": np.full(len(one), bucket, dtype=object), "one": one, "two": two}
    return pd.DataFrame({**columns, "distance": distance}).astype(dict.fromkeys(columns, "string"))
