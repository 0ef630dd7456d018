"""A finished sweep: what it was made from, and the table of its runs."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import ValidationError

from resim.core.errors import InputError, ResimError
from resim.core.sealed import read_sealed
from resim.execution import journal
from resim.metrics.criteria import read_criteria
from resim.results.rows import read_rows
from resim.sweeps.outcomes.registry import OUTCOMES
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS

SCHEMA = "resim-sweep-1"
RESUME = "Do what is missing: resim sweep FILE --out {folder} --resume"
RESULTS = ("decision", *(outcome.column for outcome in OUTCOMES))
"""Columns of every run that has a result (`resim.sweeps.prepared`)."""


@dataclass(frozen=True, eq=False)
class SweepResult:
    """A finished sweep in its folder: manifest.json, its parameters, and a row a run."""

    folder: Path
    manifest: dict[str, Any]
    parameters: tuple[SweepParameter, ...]
    rows: pd.DataFrame

    @property
    def inputs(self) -> dict[str, Any]:
        """What the results follow from (`resim.sweeps.execution.inputs`)."""
        found: dict[str, Any] = self.manifest["inputs"]
        return found

    @property
    def file(self) -> dict[str, Any]:
        """What the sweep's file said."""
        found: dict[str, Any] = self.inputs["sweep"]
        return found

    def unit(self, criterion: str) -> str:
        """The unit of a criterion's value; "" where it has none, or no run could be judged."""
        told = self.rows.get(f"unit {criterion}", pd.Series(dtype=object)).dropna()
        return "" if told.empty or told.iloc[0] == "1" else str(told.iloc[0])


def limits(swept: SweepResult) -> dict[str, str]:
    """Say what each criterion asks for, by name; nothing where their file is not any more what it was in the sweep."""
    told = swept.inputs["criteria"]
    try:
        found = read_criteria(Path(os.path.normpath(swept.folder / told["path"])))
    except ResimError:
        return {}
    if found.hash != told["hash"]:
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
        raise InputError(folder, "holds no sweep", "Name the folder that `resim sweep --out` wrote.")
    path = folder / "manifest.json"
    if not path.is_file():
        done = len({entry["run"] for entry in journal.read(folder / "journal")})
        raise InputError(folder, f"its sweep is not finished, {done} runs are there so far", resume)
    try:
        manifest = read_sealed(path, resume)
        if manifest["schema"] != SCHEMA:
            raise InputError(path, f"has the schema {manifest['schema']!r}, expected {SCHEMA}", resume)
        parameters = tuple(SweepParameter.model_validate(p) for p in manifest["inputs"]["sweep"]["parameter"])
        columns, count = [str(name) for name in manifest["columns"]], int(manifest["runs"])
        hashes: dict[str, str] = {str(name): str(told) for name, told in manifest["files"].items()}
        _check_boundaries(manifest, len(parameters))
        begun = folder / "sweep.json"
        held = read_sealed(begun, resume)
        if _without_paths(manifest, held) != _without_paths(held, held):
            raise InputError(path, "does not say what sweep.json says", resume)
    except (ValueError, KeyError, TypeError, AttributeError, ValidationError) as e:
        raise InputError(path, "is not what `resim sweep` writes", resume) from e
    rows = read_rows(folder, hashes)
    if len(rows) != count or rows["run"].nunique() != count:
        raise InputError(folder / "runs", f"holds {len(rows)} runs, expected {count}", resume)
    if lost := [name for name in columns if name not in rows]:
        raise InputError(folder / "runs", f"has no column {lost[0]!r}", resume)
    unknown = [name for name in RESULTS if name not in rows]  # as where every run failed before it began
    return SweepResult(folder, manifest, parameters, rows.reindex(columns=[*rows.columns, *unknown]))


def _without_paths(told: Any, held: Any) -> Any:
    """What is told under the names of `held`, but where files lie: a folder of results may be moved."""
    if not isinstance(told, dict) or not isinstance(held, dict):
        return told
    return {name: _without_paths(told.get(name), value) for name, value in held.items() if name != "path"}


def _check_boundaries(manifest: dict[str, Any], parameters: int) -> None:
    """Raise KeyError, TypeError or ValueError where an adaptive sweep's manifest does not have its boundaries, and
    ResimError where the plan is unknown."""
    if PLANS[manifest["inputs"]["sweep"]["plan"]].grows:
        for told in manifest["boundaries"]:
            np.array(told["cells"], dtype=float).reshape(-1, parameters, 2)
            _ = told["recording"], told["build"], told["known"]
