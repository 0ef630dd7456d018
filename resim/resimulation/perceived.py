"""Drives in which a perception model shows the function what it sees (rGT+M), and how drives are compared."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from resim.perception.model import PerceptionModel
from resim.resimulation.fidelity import EGO_ROW, StepErrors
from resim.simulation.case import End, SimulatedDrive


@dataclass(frozen=True, eq=False)
class PerceptionSetup:
    """A perception model, and the runs with it.

    Attributes:
        model: The model.
        seeds: A run each.
        overrides: Parameters that were set by hand, such as "latency.speed=0.4".
        hash: SHA-256 of the model's file; "" for a model that is of none.
    """

    model: PerceptionModel
    seeds: tuple[int, ...]
    overrides: tuple[str, ...] = ()
    hash: str = ""


def end_error(drive: SimulatedDrive, pipe: StepErrors | None) -> float | None:
    """Give the pipeline error's distance d [m] of the EGO at the end; None where the drive ended early."""
    if drive.end != "duration" or pipe is None:
        return None
    known = pipe.d[EGO_ROW][0]
    known = known[np.isfinite(known)]
    return float(known[-1]) if len(known) else None


def decides_as(decision: Sequence[str], measured: Sequence[str], end: str) -> bool | None:
    """Say whether a run makes the measured decision; None where it broke off before that is shown.

    end: as `SimulatedDrive.end`. What a run that ended early did decides where it is no beginning of what was measured;
    else the EGO might have done the rest, or something more.
    """
    if end == "duration":
        return list(decision) == list(measured)
    return None if list(decision) == list(measured)[: len(decision)] else False


def same_decision(
    runs: Iterable[tuple[tuple[str, ...], End, str | None]], measured: tuple[str, ...] | None
) -> int:
    """Give how many runs, each its decision, end and failure, are shown to decide as the measured drive.

    One that failed decides nothing, and one that collided or left the road did not show it to the end.
    """
    if measured is None:
        return 0
    return sum(failure is None and decides_as(did, measured, end) is True for did, end, failure in runs)


def difference(later: float | None, earlier: float | None) -> float | None:
    """Give later minus earlier [s], None where one is."""
    return None if later is None or earlier is None else round(later - earlier, 9)
