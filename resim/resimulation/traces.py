"""The EGO's speed over time in every drive of a re-simulation, for figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import MISSING, Field

from resim.core.clock import regular
from resim.core.tracks import Tracks
from resim.resimulation.result import Resimulation, of_seed

RATE = 10.0
"""Samples a second [Hz]."""

Speeds = tuple[float | None, ...]
"""Speeds [m/s] over the times of `SpeedTraces`, None where there is no EGO."""


@dataclass(frozen=True)
class SpeedTraces:
    """The EGO's speed over `t` [s] in each drive; over_seeds: in each run with a perception model."""

    t: tuple[float, ...]
    GT: Speeds
    rGT: Speeds | MISSING = MISSING
    rSD: Speeds | MISSING = MISSING
    over_seeds: Annotated[tuple[Speeds, ...], Field(alias="rGT+M")] = ()

    def single(self) -> dict[str, Speeds]:
        """Give the speeds by drive, of those without a perception model that are there."""
        found = {"GT": self.GT, "rGT": self.rGT, "rSD": self.rSD}
        return {name: speeds for name, speeds in found.items() if speeds is not MISSING}


def speed_traces(result: Resimulation) -> SpeedTraces:
    """Give the EGO's speed [m/s] in every drive."""
    ego, gt = result.ego, result.described["GT"]
    t = np.round(regular(gt.ego.spawn_time, gt.duration, 1.0 / RATE), 9)

    def speed(tracks: Tracks) -> Speeds:
        v = tracks.select([ego]).at(t).v[0]
        return tuple(round(float(value), 3) if np.isfinite(value) else None for value in v)

    return SpeedTraces(
        t=tuple(t.tolist()),
        GT=speed(gt.tracks(result.network, t)),
        over_seeds=tuple(speed(result.drives[of_seed(seed)].truth) for seed in result.seeds),
        **{source: speed(drive.truth) for source, drive in result.simulated().items()},
    )
