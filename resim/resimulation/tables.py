"""What a re-simulation holds, as tables: tracks, answers, plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.geometry import Floats, wrap_angle
from resim.core.schema import ANSWER_COLUMNS, PLAN_COLUMNS, SOURCE
from resim.resimulation.result import Resimulation, own_tracks
from resim.simulation.function.interface import Perceived


def tracks_frame(result: Resimulation) -> pd.DataFrame:
    """Give all tracks, and what the function perceived in map coordinates, as one table by `source`."""
    parts = [tracks.to_frame().assign(source=source) for source, tracks in result.tracks().items()]
    for source, drive in result.simulated().items():
        parts.append(perceived_frame(drive.perceived).assign(source=f"perceived_{source}"))
    for source, drive in result.perceived().items():  # other traffic is that of rGT
        parts.append(drive.truth.select(own_tracks(drive)).to_frame().assign(source=source))
        parts.append(perceived_frame(drive.perceived).assign(source=f"perceived_{source}"))
    table = pd.concat(parts, ignore_index=True)
    return table[[SOURCE, *(c for c in table.columns if c != SOURCE)]]


def answers_frame(result: Resimulation) -> pd.DataFrame:
    """Give the function's answers, one row each, by `source` rGT, rSD, and rGT+M with its seed.

    acceleration [m/s²] and curvature [1/m] that acted from t on, NaN for an oracle; objects that it perceived.
    """
    parts = []
    for source, drive in result.drives.items():
        t, counts, _ = drive.perceived.columns()
        step = np.clip(np.searchsorted(drive.truth.t, t - TICK), 0, max(len(drive.truth.t) - 1, 0))
        acceleration, curvature = drive.commands[step].T if len(t) else np.empty((2, 0))
        columns = dict(zip(ANSWER_COLUMNS, (t, acceleration, curvature, counts), strict=True))
        parts.append(pd.DataFrame({SOURCE: source, **columns}))
    return pd.concat(parts, ignore_index=True)


def plans_frame(result: Resimulation) -> pd.DataFrame:
    """Give the EGO's plans by `source`: recorded, rGT, rSD, rGT+M with its seed; a row per `t` and `t_plan` [s]."""
    made = plan_frame({source: drive.plans for source, drive in result.drives.items()})
    if result.recording.plan is None:
        return made
    recorded = result.recording.plan[list(PLAN_COLUMNS)].assign(source="recorded")
    return pd.concat([recorded, made], ignore_index=True)[[SOURCE, *PLAN_COLUMNS]]


def plan_frame(plans: Mapping[str, Sequence[tuple[float, Floats]]]) -> pd.DataFrame:
    """Give plans by source as one table: source, and PLAN_COLUMNS."""
    every = [(source, when, plan) for source, made in plans.items() for when, plan in made]
    counts = [len(plan) for _, _, plan in every]
    rows = np.concatenate([np.empty((0, 4)), *(plan for _, _, plan in every)])
    made_at = np.repeat([when for _, when, _ in every], counts)
    columns = dict(zip(PLAN_COLUMNS, (made_at, *rows.T), strict=True))
    return pd.DataFrame(
        {SOURCE: np.repeat([source for source, _, _ in every], counts).astype(str), **columns}
    )


def perceived_frame(perceived: Sequence[Perceived]) -> pd.DataFrame:
    """Give perceived lists as a table in map coordinates, one row per time and object."""
    if not perceived:
        return pd.DataFrame({"t": [], "id": []})
    counts = [len(p.ids) for p in perceived]
    positions = [p.map_positions() for p in perceived]

    def column(name: str) -> np.ndarray[Any, Any]:
        return np.concatenate([getattr(p, name) for p in perceived])

    return pd.DataFrame(
        {
            "t": np.repeat([p.t for p in perceived], counts),
            "id": column("ids"),
            "x": np.concatenate([x for x, _ in positions]),
            "y": np.concatenate([y for _, y in positions]),
            "heading": wrap_angle(
                column("heading_ego") + np.repeat([p.ego.heading for p in perceived], counts)
            ),
            "v": column("v"),
            "length": column("length"),
            "width": column("width"),
            "kind": column("kind"),
        }
    )
