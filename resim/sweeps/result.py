"""A finished sweep: what it was made from, and the table of its runs."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import MISSING

from resim.core import remedies
from resim.core.errors import InputError, ResimError
from resim.core.spec import read_sealed_json
from resim.execution import journal
from resim.metrics.criteria import read_criteria
from resim.results.rows import read_rows
from resim.sweeps.manifest import SweepBegun, SweepInputs, SweepManifest
from resim.sweeps.outcomes.registry import OUTCOMES
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.sweep_file import SweepFile

RESUME = "Do what is missing: resim sweep FILE --out {folder} --resume"
RESULTS = ("decision", *(outcome.column for outcome in OUTCOMES))
"""Columns of every run that has a result (`resim.sweeps.one_run`)."""


@dataclass(frozen=True, eq=False)
class SweepResult:
    """A finished sweep in its folder: manifest.json, and a row a run."""

    folder: Path
    manifest: SweepManifest
    rows: pd.DataFrame

    @property
    def inputs(self) -> SweepInputs:
        """What the results follow from."""
        return self.manifest.inputs

    @property
    def file(self) -> SweepFile:
        """What the sweep's file said."""
        return self.inputs.sweep

    @property
    def parameters(self) -> tuple[SweepParameter, ...]:
        """What was varied."""
        return self.file.parameter

    def unit(self, criterion: str) -> str:
        """The unit of a criterion's value; "" where it has none, or no run could be judged."""
        told = self.rows.get(f"unit {criterion}", pd.Series(dtype=object)).dropna()
        return "" if told.empty or told.iloc[0] == "1" else str(told.iloc[0])


def limits(swept: SweepResult) -> dict[str, str]:
    """Say what each criterion asks for, by name; nothing where their file is not any more what it was in the sweep."""
    told = swept.inputs.criteria
    try:
        found = read_criteria(Path(os.path.normpath(swept.folder / told.path)))
    except ResimError:
        return {}
    if found.hash != told.hash:
        return {}
    words = {"below": "not below", "above": "not above", "beyond": "not beyond ±"}
    return {
        c.name: f"{c.measure} {words[c.side]} {c.limit:g} {swept.unit(c.name)}".replace("± ", "±").rstrip()
        + (f" for {c.duration:g} s" if c.duration else "")
        for c in found.criteria
    }


def read_swept(folder: Path) -> SweepResult:
    """Read a sweep's folder. Raises InputError where there is none, where it is not finished, or damaged."""
    resume = RESUME.format(folder=shlex.quote(str(folder)))
    if not (folder / "sweep.json").is_file():
        raise InputError(folder, "holds no sweep", remedies.SWEPT)
    path = folder / "manifest.json"
    if not path.is_file():
        done = len({entry.run for entry in journal.read(folder / "journal")})
        raise InputError(folder, f"its sweep is not finished, {done} runs are there so far", resume)
    manifest = read_sealed_json(path, SweepManifest, "resim sweep", resume)
    if manifest.inputs.sweep.planned.grows and manifest.boundaries is MISSING:
        raise InputError(path, "is not what `resim sweep` writes: boundaries: are missing", resume)
    _check_cells(manifest, path, resume)
    begun = read_sealed_json(folder / "sweep.json", SweepBegun, "resim sweep", resume)
    if _without_paths(manifest.versions, manifest.inputs) != _without_paths(begun.versions, begun.inputs):
        raise InputError(path, "does not say what sweep.json says", resume)
    rows, count = read_rows(folder, dict(manifest.files)), manifest.runs
    if len(rows) != count or rows["run"].nunique() != count:
        raise InputError(folder / "runs", f"holds {len(rows)} runs, expected {count}", resume)
    if lost := [name for name in manifest.columns if name not in rows]:
        raise InputError(folder / "runs", f"has no column {lost[0]!r}", resume)
    unknown = [name for name in RESULTS if name not in rows]  # as where every run failed before it began
    return SweepResult(folder, manifest, rows.reindex(columns=[*rows.columns, *unknown]))


def _without_paths(versions: Mapping[str, str], inputs: SweepInputs) -> Any:
    """Both, but for where files lie: a folder of results may be moved."""
    files = [*inputs.builds.items(), *inputs.recordings.items()]
    files += [("criteria", inputs.criteria)] + (
        [] if inputs.perception is None else [("", inputs.perception)]
    )
    return (
        dict(versions),
        inputs.sweep,
        inputs.vehicle,
        [(n, f.model_copy(update={"path": ""})) for n, f in files],
    )


def _check_cells(manifest: SweepManifest, path: Path, remedy: str) -> None:
    """Raise InputError where a boundary has cells of more or fewer parameters than the sweep."""
    many = len(manifest.inputs.sweep.parameter)
    for told in manifest.found():
        if any(len(cell) != many for cell in told.cells):
            problem = f"is not what `resim sweep` writes: boundaries: a cell does not have {many} parameters"
            raise InputError(path, problem, remedy)
