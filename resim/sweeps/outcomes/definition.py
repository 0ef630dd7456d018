"""What an outcome of a sweep's runs is: a column of its table, how it is told, and when a run is good by it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from resim.core.errors import ResimError
from resim.core.schema import Cell

if TYPE_CHECKING:
    from resim.resimulation.drive_outcome import DriveOutcome
    from resim.resimulation.fidelity import StepErrors
    from resim.simulation.case import SimulatedDrive

ColumnType = Literal["text", "flag", "number"]
_TYPES: Mapping[ColumnType, tuple[type, ...]] = {"text": (str,), "flag": (bool,), "number": (int, float)}


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """A run of a sweep, and the measured drive that it is compared with.

    drive: as simulated; pipeline: its errors against the measured drive, None for none. found: what it came to.
    measured_decision, measured_reaction: what the EGO did in the measured drive, and when [s] it first braked.
    """

    drive: SimulatedDrive
    pipeline: StepErrors | None
    found: DriveOutcome
    measured_decision: list[str]
    measured_reaction: float | None


@dataclass(frozen=True, eq=False, kw_only=True)
class OutcomeDefinition:
    """An outcome as it is registered.

    column: its name in the table of runs, of this type. label, unit: in tables and figures. of: gives a run's cell.
    good: the cell of a good run; None for a value, which is neither good nor bad. keeps: what a good run does, as a
    sentence. asked: how `adaptive.outcome` names it, "" where as the column. final: what is not good stays true of a
    run that fails later.
    """

    column: str
    type: ColumnType
    label: str
    of: Callable[[FinishedRun], Cell]
    unit: str = ""
    good: str | bool | None = None
    keeps: str = ""
    asked: str = ""
    final: bool = False

    def cell(self, run: FinishedRun) -> Cell:
        """Give a run's cell, plain and of the column's type; NaN is None. Raises ResimError for any other."""
        value: Any = self.of(run)
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return None
        if isinstance(value, _TYPES[self.type]) and isinstance(value, bool) is (self.type == "flag"):
            return value  # type: ignore[return-value]
        raise ResimError(f"outcome {self.column!r} gave {value!r:.60}, expected {self.type} or None")

    @property
    def name(self) -> str:
        """How `adaptive.outcome` names it."""
        return self.asked or self.column
