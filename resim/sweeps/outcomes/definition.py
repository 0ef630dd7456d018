"""What an outcome of a sweep's runs is: a column of its table, how it is told, and when a run is good by it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from resim.core.schema import Cell

if TYPE_CHECKING:
    from resim.resimulation.drive_outcome import DriveOutcome
    from resim.resimulation.fidelity import StepErrors
    from resim.simulation.case import SimulatedDrive

ColumnType = Literal["text", "flag", "number"]


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

    @property
    def name(self) -> str:
        """How `adaptive.outcome` names it."""
        return self.asked or self.column
