"""Drives in which a perception model shows the function what it sees (rGT+M), and how drives are compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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


def same_decision(seeds: Sequence[Mapping[str, Any]], measured: list[str] | None) -> int:
    """Give how many of the seeds' reports decide as the measured drive; a run that failed decides nothing."""
    return sum(s["decision"] == measured and s["failure"] is None for s in seeds)


def difference(later: float | None, earlier: float | None) -> float | None:
    """Give later minus earlier [s], None where one is."""
    return None if later is None or earlier is None else round(later - earlier, 9)
