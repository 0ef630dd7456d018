"""Drives in which a perception model shows the function what it sees (rGT+M), and how drives are compared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from resim.perception.model import PerceptionModel
from resim.resimulation.fidelity import EGO_ROW, StepErrors
from resim.simulation.case import SimulatedDrive


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


def same_decision(
    runs: Iterable[tuple[tuple[str, ...], str | None]], measured: tuple[str, ...] | None
) -> int:
    """Give how many runs, each its decision and failure, decide as the measured drive; a failed one decides nothing."""
    return sum(decision == measured and failure is None for decision, failure in runs)


def difference(later: float | None, earlier: float | None) -> float | None:
    """Give later minus earlier [s], None where one is."""
    return None if later is None or earlier is None else round(later - earlier, 9)
