"""A sweep: which runs, with which parameters; a TOML file, and the table of its runs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from pydantic import Field

from resim.core.errors import InputError
from resim.experiment.design import Parameter, design
from resim.pipeline.suite import Entry, Strict, found_folders, joined, read_strict, read_suite

EXAMPLE = "See scenarios/sweeps/perception_latency.toml."
RUN = "run"
"""Column of the tables: which run it is, counted from 0."""


class SweepFile(Strict):
    """What a sweep's file says; paths from the folder of the file.

    recording, suite: which recordings, one by one or those of a suite. build: the builds. perception: the base model,
    that perception parameters are parameters of. plan, points, seed: see `resim.experiment.design`. seeds: runs of each
    point, the first with seed 0. time_limit: s of wall clock for one run.
    """

    name: str = Field(min_length=1)
    recording: tuple[Entry, ...] = ()
    suite: str | None = None
    build: tuple[str, ...] = Field(min_length=1)
    perception: str | None = None
    criteria: str = Field(min_length=1)
    plan: Literal["grid", "sobol", "halton", "latin_hypercube", "one_at_a_time"] = "grid"
    points: int = Field(default=64, ge=1, le=10_000_000)
    seed: int = Field(default=0, ge=0)
    seeds: int = Field(default=5, ge=1, le=100_000)
    time_limit: float = Field(default=60.0, gt=0.0)
    accept: tuple[str, ...] = ()
    parameter: tuple[Parameter, ...] = Field(min_length=1)


class Sweep(Strict):
    """A sweep with its recordings found, by name."""

    path: Path
    file: SweepFile
    folders: dict[str, Path]

    def beside(self, name: str) -> Path:
        """Give the path of what the file names."""
        return joined(self.path, name)


def read_sweep(path: Path) -> Sweep:
    """Read a sweep and find its recordings. Raises InputError naming every fault."""
    file = read_strict(path, SweepFile, EXAMPLE)
    if bool(file.recording) == (file.suite is not None):
        raise InputError(path, "names both or neither of recording and suite", "Name one of them.")
    names = [p.name for p in file.parameter]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(path, f"parameter {twice[0]!r} stands twice", "Take one away.")
    if file.perception is None and (of := [name for name in names if name.startswith("perception.")]):
        raise InputError(path, f"parameter {of[0]!r} without a model", "Name one with perception = ...")
    if file.suite is not None:
        return Sweep(path=path, file=file, folders=read_suite(joined(path, file.suite)).folders)
    return Sweep(path=path, file=file, folders=found_folders(path, file.recording)[0])


def runs(sweep: Sweep) -> pd.DataFrame:
    """Give a row a run, in order: run, recording, build, point, seed, and each parameter by its name."""
    file = sweep.file
    points = design(file.parameter, file.plan, file.points, file.seed)
    recordings, builds = list(sweep.folders), list(file.build)
    shape = (len(recordings), len(builds), len(points), file.seeds)
    r, b, p, s = (index.ravel() for index in np.indices(shape))
    table = {
        RUN: np.arange(len(r)), "recording": np.array(recordings)[r], "build": np.array(builds)[b],
        "point": p, "seed": s,
    }  # fmt: skip
    return pd.DataFrame(table | {q.name: points[p, k] for k, q in enumerate(file.parameter)})
