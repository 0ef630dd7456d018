"""The EGO's speed over time in every drive of a re-simulation, for figures."""

from __future__ import annotations

from typing import Any

import numpy as np

from resim.core.tracks import Tracks
from resim.resimulation.result import Resimulation, of_seed

RATE = 10.0
"""Samples a second [Hz]."""


def speed_traces(result: Resimulation) -> dict[str, Any]:
    """Give the EGO's speed [m/s] in every drive over `t` [s]; of the runs with a perception model a list of them."""
    ego, gt = result.ego, result.described["GT"]
    t = np.round(np.arange(gt.ego.spawn_time, gt.ego.spawn_time + gt.duration + 1e-9, 1.0 / RATE), 9)

    def speed(tracks: Tracks) -> list[float | None]:
        v = tracks.select([ego]).at(t).v[0]
        return [round(float(value), 3) if np.isfinite(value) else None for value in v]

    out: dict[str, Any] = {"t": t.tolist(), "GT": speed(gt.tracks(result.network, t))}
    out |= {source: speed(drive.truth) for source, drive in result.simulated().items()}
    out["rGT+M"] = [speed(result.drives[of_seed(seed)].truth) for seed in result.seeds]
    return out
