"""Runs in which a perception model shows the function what it sees (rGT+M), and what the report files hold of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from resim import fidelity
from resim.fidelity import EGO_ROW, Errors
from resim.perception.model import PerceptionModel
from resim.pipeline.reaction import ego_tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario
from resim.sim.run import End, Run


@dataclass(frozen=True, eq=False)
class PerceivedRun:
    """A run on GT in which a perception model showed the function what it saw.

    seed: of the model's draws. refit: the EGO's trace in the run; pipe: its pipeline error, that less GT; both None
    where the run ended before there was anything to describe. outside, shown: objects in lists that were outside of
    the model's validity, and all. time: wall clock [s] of run and refit.
    """

    seed: int
    run: Run
    refit: Scenario | None
    pipe: Errors | None
    outside: int = 0
    shown: int = 0
    time: float = 0.0


@dataclass(frozen=True, eq=False)
class Perceiving:
    """A perception model, the seeds to run it with, and the parameters that were set by hand ("latency.speed=0.4")."""

    model: PerceptionModel
    seeds: tuple[int, ...]
    overrides: tuple[str, ...] = ()
    hash: str = ""


def end_error(end: End, pipe: Errors | None) -> float | None:
    """Give the pipeline error's distance d [m] of the EGO at the end; None for a run that ended before the scenario."""
    if end != "duration" or pipe is None:
        return None
    known = pipe.d[EGO_ROW][0]
    known = known[np.isfinite(known)]
    return float(known[-1]) if len(known) else None


def seed_reports(
    runs: Sequence[PerceivedRun], network: RoadNetwork, *, ego: str, measured: float | None
) -> list[dict[str, Any]]:
    """Give what report.json holds of each run; measured: reaction [s] of the measured drive."""
    return [_seed_report(p, network, ego, measured) for p in runs]


def _seed_report(p: PerceivedRun, network: RoadNetwork, ego: str, measured: float | None) -> dict[str, Any]:
    driven = None if p.refit is None else ego_tracks(p.refit, network)
    reaction = None if driven is None else fidelity.reaction_time(driven, ego=ego)
    return {
        "seed": p.seed,
        "decision": [] if driven is None else fidelity.decision(driven, network, ego=ego),
        "reaction": reaction,
        "reaction_difference": difference(reaction, measured),
        "errors": {"PIPE": None if p.pipe is None else p.pipe.statistics(EGO_ROW)},
        "end_position_error": end_error(p.run.end, p.pipe),
        "end": p.run.end,
        "failure": p.run.failure or None,
        "collision": bool(p.run.collisions),
        "collisions": [{"t": c.t, "id": c.id} for c in p.run.collisions],
        "outside_validity": p.outside,
        "shown": p.shown,
    }


def same_decision(seeds: Sequence[dict[str, Any]], measured: list[str] | None) -> int:
    """Give how many of the seeds' reports decide as the measured drive; a run that failed decides nothing."""
    return sum(s["decision"] == measured and s["failure"] is None for s in seeds)


def difference(later: float | None, earlier: float | None) -> float | None:
    """Give later minus earlier [s], None where one is."""
    return None if later is None or earlier is None else round(later - earlier, 9)
