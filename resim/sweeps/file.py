"""A sweep: which runs, with which parameters; a TOML file, and the table of its runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import Field

from resim.core.errors import InputError
from resim.core.files import file_hash, joined
from resim.core.geometry import Floats
from resim.core.plugins.frozen import FrozenFile
from resim.core.schema import RUN, Row
from resim.core.spec import Strict
from resim.metrics.criteria import freeze_criteria
from resim.perception.model import freeze_model
from resim.recordings.content import content_hash, refuse_changed
from resim.recordings.listed import found_folders
from resim.simulation.function.interface import freeze_build
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.registry import vehicle_model
from resim.sweeps.plans.adaptive import Lattice, Places, boundary, wanted
from resim.sweeps.sweep_file import Adaptive, SweepFile, read_sweep_file
from resim.sweeps.varied import VariedRuns
from resim.variations.kernels import read_kernels
from resim.verification.suite import read_suite

Indices = NDArray[Any]
LARGEST = 1e15
"""Points that an adaptive plan can choose from."""
MOST = 1_000_000
"""Runs of a sweep: those that are planned are held in memory, and planned anew by each process (12 s for so many)."""


class Sweep(Strict):
    """A sweep with its recordings found, by name.

    frozen: builds, model and criteria as they were when the sweep was read, by the names that its file has for them.
    hashes: of the recordings' content at that time. vehicle: the model that moves the EGO. varied: how recordings are
    varied.
    """

    path: Path
    file: SweepFile
    folders: dict[str, Path]
    frozen: dict[str, FrozenFile] = Field(default_factory=dict)
    hashes: dict[str, str] = Field(default_factory=dict)
    vehicle: str = Kinematic.name
    varied: VariedRuns | None = None

    @property
    def perception(self) -> FrozenFile | None:
        """The base model, None without one."""
        return None if self.file.perception is None else self.frozen[self.file.perception]

    @property
    def criteria(self) -> FrozenFile:
        """What runs are judged by."""
        return self.frozen[self.file.criteria]


def read_sweep(path: Path, vehicle: str = Kinematic.name) -> Sweep:
    """Read a sweep and find its recordings. Raises InputError naming every fault, ResimError for an unknown vehicle."""
    vehicle_model(vehicle)
    file = read_sweep_file(path)
    check_plan(path, file)
    if file.suite is not None:
        suite = read_suite(joined(path, file.suite))
        folders, pinned = suite.folders, suite.hashes
    else:
        folders, pinned = found_folders(path, file.recording)
    if (count := _count(file, len(folders))) > MOST:
        remedy = "Give fewer points, steps or seeds, or split it into several sweeps."
        raise InputError(path, f"asks for up to {count:,} runs; a sweep has up to {MOST:,}", remedy)
    frozen = {name: freeze_build(joined(path, name)) for name in file.build}
    frozen[file.criteria] = freeze_criteria(joined(path, file.criteria))
    if file.perception is not None:
        frozen[file.perception] = freeze_model(joined(path, file.perception))
    hashes = {name: content_hash(folder) for name, folder in folders.items()}
    for name, digest in pinned.items():
        refuse_changed(folders[name], digest)
    return Sweep(
        path=path, file=file, folders=folders, frozen=frozen, hashes=hashes, vehicle=vehicle, varied=_varied(path, file)
    )  # fmt: skip


def _varied(path: Path, file: SweepFile) -> VariedRuns | None:
    """How recordings are varied. Raises InputError for files that cannot be read."""
    told = file.variation
    if told is None:
        return None
    kernels = joined(path, told.kernels)
    verified = None if told.verified is None else joined(path, told.verified)
    read_kernels(kernels)
    return VariedRuns(
        told, FrozenFile(kernels, file_hash(kernels)),
        None if verified is None else FrozenFile(verified, file_hash(verified)), file.accept,
    )  # fmt: skip


def _count(file: SweepFile, recordings: int) -> int:
    """How many runs it is at most."""
    points = file.planned.count(file.parameter, file.points)
    return recordings * len(file.build) * points * file.seeds


def check_plan(path: Path, file: SweepFile) -> None:
    """Raise InputError for parameters that the plan cannot vary."""
    if not file.planned.grows:
        if wide := [p.name for p in file.parameter if p.width is not None]:
            raise InputError(
                path, f"parameter {wide[0]!r} has a width, the plan is {file.plan}", 'plan = "adaptive"'
            )
        return
    for p in file.parameter:
        if p.low is None or p.mean is not None or p.width is None:
            problem = f"parameter {p.name!r}: an adaptive plan needs low, high and width, and no mean"
            raise InputError(path, problem, "Correct it, or choose another plan.")
    first = int(np.prod([p.steps for p in file.parameter]))
    if first > file.points:
        raise InputError(
            path, f"points = {file.points} is less than the {first} of the first grid (steps)", "Give more."
        )
    size = float(np.prod(Lattice.over(file.parameter).counts + 1.0))
    if size > LARGEST:
        raise InputError(path, f"the widths cut the ranges into {size:.0e} points", "Give larger widths.")


def runs(sweep: Sweep, rows: Mapping[int, Row] | None = None) -> pd.DataFrame:
    """Give a row a run, in order: run, recording, build, point, seed, and each parameter by its name.

    rows: the results so far, by run. An adaptive plan has more runs the more results there are; all others ignore them.
    """
    file = sweep.file
    design = file.planned.design
    if design is None:
        return _grown(sweep, rows or {})
    points = design(file.parameter, file.points, file.seed)
    recordings, builds = list(sweep.folders), list(file.build)
    shape = (len(recordings), len(builds), len(points), file.seeds)
    r, b, p, s = (index.ravel() for index in np.indices(shape))
    return _table(sweep, r, b, p, _seeds(points, file.seeds)[p, s], points[p])


def _seeds(points: Floats, count: int) -> Indices:
    """Seeds (R, count) of the runs at points (R, P): drawn from their values, the same ones in every plan.

    Each point has its own, so that what two points say of a parameter is said twice; a point that is there again, as
    values that are listed are in drawn plans, has the next of its seeds. Recordings and builds share them.
    """
    rounded = np.array([[float(f"{value:.9g}") + 0.0 for value in row] for row in points.tolist()])
    words = rounded.reshape(len(points), -1).view(np.uint32).tolist()
    drawn, before = [], Counter[tuple[int, ...]]()
    for row in words:
        copy = before[tuple(row)]
        drawn.append(np.random.SeedSequence(row).generate_state(count * (copy + 1))[count * copy :])
        before[tuple(row)] += 1
    return np.array(drawn, dtype=np.int64).reshape(-1, count)


def _table(
    sweep: Sweep, r: Indices, b: Indices, point: Indices, seed: Indices, values: Floats
) -> pd.DataFrame:
    """Runs in this order: indices (R,) of recording and build, point and seed, and parameters (R, P)."""
    table = {
        RUN: np.arange(len(r)), "recording": np.array(list(sweep.folders))[r],
        "build": np.array(sweep.file.build)[b], "point": point, "seed": seed,
    }  # fmt: skip
    return pd.DataFrame(table | {q.name: values[:, k] for k, q in enumerate(sweep.file.parameter)})


@dataclass(frozen=True)
class SweepBoundary:
    """What an adaptive plan found for one recording and build: how many points it tried, and the cells, by low and high
    of each parameter, in which the outcome changes; known: whether these are as small as asked for.
    """

    recording: str
    build: str
    points: int
    known: bool
    cells: tuple[tuple[tuple[float, float], ...], ...]


def boundaries(sweep: Sweep, rows: Mapping[int, Row]) -> tuple[SweepBoundary, ...]:
    """Give what an adaptive plan found, by recording and build."""
    searches, _ = _searched(sweep, rows)
    recordings, out = list(sweep.folders), []
    for search in searches:
        ends = boundary(search.lattice, search.places, search.good)
        cells = np.stack([search.lattice.values(end) for end in ends], axis=2)
        out.append(SweepBoundary(
            recording=recordings[search.recording], build=sweep.file.build[search.build],
            points=len(search.places), known=not len(wanted(search.lattice, search.places, search.good)),
            cells=tuple(tuple((low, high) for low, high in cell) for cell in cells.tolist()),
        ))  # fmt: skip
    return tuple(out)


def _grown(sweep: Sweep, rows: Mapping[int, Row]) -> pd.DataFrame:
    """The runs of an adaptive plan, as far as they are known."""
    seeds, (searches, parts) = sweep.file.seeds, _searched(sweep, rows)
    sizes = [seeds * len(places) for _, _, places in parts]
    r, b = (np.repeat([part[k] for part in parts], sizes) for k in (0, 1))
    places = np.repeat(np.concatenate([places for _, _, places in parts]), seeds, axis=0)
    lattice = searches[0].lattice
    number = _seeds(lattice.values(places[::seeds]), seeds).ravel()
    return _table(sweep, r, b, lattice.numbers(places), number, lattice.values(places))


def _searched(
    sweep: Sweep, rows: Mapping[int, Row]
) -> tuple[list[_BoundarySearch], list[tuple[int, int, Places]]]:
    """Go round by round: the next one follows from all results of those before; its runs come after theirs.

    Gives the searches, one for each recording and build, and what to run: recording, build, points.
    """
    file, count, parts = sweep.file, 0, []
    lattice = Lattice.over(file.parameter)
    pairs = np.indices((len(sweep.folders), len(file.build))).reshape(2, -1).T.tolist()
    searches = [_BoundarySearch(lattice, r, b) for r, b in pairs]
    whole = True
    while whole and not all(search.done for search in searches):
        for search in searches:
            places = search.next(file.points)
            numbers = count + np.arange(len(places) * file.seeds).reshape(-1, file.seeds)
            count += numbers.size
            parts.append((search.recording, search.build, places))
            results = [[rows.get(n) for n in seeds] for seeds in numbers.tolist()]
            whole &= all(row is not None for seeds in results for row in seeds)
            if whole:
                search.take(places, results, file.adaptive)
    return searches, parts


class _BoundarySearch:
    """The boundary of one recording and build as far as it is known."""

    def __init__(self, lattice: Lattice, recording: int, build: int) -> None:
        self.lattice, self.recording, self.build = lattice, recording, build
        self.places = np.empty((0, len(lattice.first)), dtype=np.intp)
        self.good = np.empty(0, dtype=bool)
        self.done = False

    def next(self, most: int) -> Places:
        """Give the points of the next round, none where the search is done, or it would be more than `most` in all."""
        places = wanted(self.lattice, self.places, self.good)
        self.done = self.done or not 0 < len(places) <= most - len(self.places)
        return places[:0] if self.done else places

    def take(self, places: Places, results: list[list[Row | None]], plan: Adaptive) -> None:
        """Note what came of a round's points."""
        good = [
            np.mean([plan.good(row) for row in seeds if row is not None]) >= plan.share for seeds in results
        ]
        self.places = np.concatenate([self.places, places])
        self.good = np.append(self.good, np.array(good, dtype=bool))
