"""Scenarios as recordings and JSCEN files: what is mined goes straight into `resim run`, a suite, a sweep."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.errors import ResimError
from resim.core.geometry import Bools
from resim.core.schema import GT_ID
from resim.core.tracks import Tracks
from resim.mining.extraction import ExtractedScenario
from resim.recordings import Recording, RecordingTables
from resim.recordings.folder import write_tables
from resim.recordings.tables import VALUES
from resim.road.opendrive import RoadNetwork
from resim.scenario.jscen import write_jscen
from resim.scenario.scenario import describe

LEAST = 2
"""Samples of the EGO that a recording needs."""
NEAR, AROUND = 30.0, 150.0
"""m from the EGO's centre within which everybody is in its recording, beside the members: of scenarios that are
extracted, and of moments of a test drive, which are judged as the drive is."""


class TimedRows:
    """The rows of a table by time: a window is found without a look at all of them."""

    def __init__(self, frame: pd.DataFrame) -> None:
        t = frame["t"].to_numpy(float)
        self._frame, self._order = frame, np.argsort(t, kind="stable")
        self._t = t[self._order]

    def between(self, start: float, end: float) -> pd.DataFrame:
        """Give the rows from start to end [s], as they are ordered in the table."""
        first, last = (
            np.searchsorted(self._t, start - TICK),
            np.searchsorted(self._t, end + TICK, side="right"),
        )
        return self._frame.iloc[np.sort(self._order[first:last])]


@dataclass(frozen=True, eq=False)
class CutSource:
    """What scenarios are cut out of.

    Attributes:
        recording: The recording.
        tables: Its tables, as they are written.
        tracks: Hash by which copies of it under other names are known (`tracks_hash`).
        reach: Distance [m] from the EGO within which everybody is in a scenario's recording.
    """

    recording: Recording
    tables: RecordingTables
    tracks: str
    reach: float = NEAR

    @cached_property
    def gt(self) -> TimedRows:
        """The rows of ground truth."""
        return TimedRows(self.tables.gt)

    @cached_property
    def plan(self) -> TimedRows | None:
        """The rows of plans, None where there are none."""
        return None if self.tables.plan is None else TimedRows(self.tables.plan)

    @cached_property
    def sd(self) -> TimedRows | None:
        """The rows of sensor data with their GT ids, None where there are none."""
        table, sd, names = self.tables.sd, self.recording.sd, self.recording.sd_gt_id
        if table is None or sd is None or names is None:
            return None
        if GT_ID in table:
            return TimedRows(table)
        of = dict(zip(sd.ids.tolist(), names.tolist(), strict=True))
        return TimedRows(table.assign(**{GT_ID: table["id"].map(lambda name: of.get(name, ""))}))


def cut(source: CutSource, one: ExtractedScenario, name: str, about: str) -> RecordingTables:
    """Give a scenario as a recording: the window of GT with EGO and members, and of SD and plans where there are any.

    Rows are taken as they are written, repeated ones, those without values, and their marks too: what is doubtful of a
    drive is doubtful of its parts. Who comes within reach is in it, and whoever has a row without values. A recording
    needs its EGO at all times: it is the part of the window in which it is there. Times begin at 0.
    about: for its provenance. Raises ResimError where the EGO has fewer than two samples there.
    """
    recording, tables = source.recording, source.tables
    gt = recording.gt
    steps = np.arange(one.ego_start, one.ego_end + 1)
    steps = steps[gt.valid[one.ego, steps]]
    if len(steps) < LEAST:
        raise ResimError("the EGO has fewer than two samples in it")
    start, end, ego = float(gt.t[steps[0]]), float(gt.t[steps[-1]]), str(gt.ids[one.ego])
    rows = source.gt.between(start, end)
    lacking = rows["id"][~np.isfinite(rows[list(VALUES)].to_numpy(float)).all(axis=1)]
    kept = {ego, *gt.ids[_near(gt, one, steps, source.reach)].tolist(), *lacking.tolist()}
    t = rows["t"].to_numpy(float)
    own = np.sort(t[(rows["id"] == ego).to_numpy()])
    at = own[np.clip(np.searchsorted(own, t - TICK), 0, len(own) - 1)]
    rows = rows[rows["id"].isin(kept) & (np.abs(at - t) <= TICK)]
    sd, own_drive = _sensed(source, kept, (start, end)), ego == recording.ego
    plan = None
    if own_drive and source.plan is not None:
        plan = source.plan.between(start, end)
        plan = plan.assign(t=plan["t"] - start, t_plan=plan["t_plan"] - start).reset_index(drop=True)
    told = {
        "mined_from": recording.name, "mined_from_tracks": source.tracks, "mined": about,
        "original_start_s": f"{start:.9g}",
    }  # fmt: skip
    settings = tables.settings.model_copy(update={
        "name": name, "ego": ego, "provenance": {**recording.provenance, **told},
        "sd_rate": tables.settings.sd_rate if sd is not None else None,
        "build": recording.build if own_drive else None, "build_hash": recording.build_hash if own_drive else None,
    })  # fmt: skip
    return replace(
        tables, settings=settings, gt=_shifted(rows, start), sd=None if sd is None else _shifted(sd, start),
        plan=plan if plan is not None and len(plan) else None,
    )  # fmt: skip


def _near(gt: Tracks, one: ExtractedScenario, steps: np.ndarray, reach: float) -> Bools:
    """Which objects (N,) are members, or come within `reach` [m] of the EGO."""
    x, y = gt.x[:, steps], gt.y[:, steps]
    away = np.hypot(x - x[one.ego], y - y[one.ego])
    out: Bools = np.any(np.where(gt.valid[:, steps], away, np.inf) <= reach, axis=1)
    out[list(one.members)] |= gt.valid[list(one.members)][:, steps].any(axis=1)
    return out


def _shifted(frame: pd.DataFrame, start: float) -> pd.DataFrame:
    out = frame.assign(t=np.round(frame["t"] - start, 9))
    out.index = pd.RangeIndex(2, len(out) + 2)
    return out


def _sensed(source: CutSource, kept: set[str], window: tuple[float, float]) -> pd.DataFrame | None:
    """SD of those kept and of nobody in a window [s], with their GT ids; None where there is none."""
    if source.sd is None:
        return None
    rows = source.sd.between(*window)
    rows = rows[rows[GT_ID].isin({*kept, ""})]
    return rows if len(rows) else None


def write_cut(scenario: RecordingTables, folder: Path, road: Path) -> None:
    """Write a scenario's recording as a new folder that refers to the map at `road`."""
    write_tables(scenario, folder, map_reference=os.path.relpath(road, folder))


def write_described(scenario: Recording, network: RoadNetwork, file: Path) -> None:
    """Fit a scenario and write it as JSCEN beside its map. Raises ResimError."""
    found = describe(
        scenario.gt, network, ego=scenario.ego, map_name=scenario.map.name,
        description=scenario.provenance["mined"], environment=scenario.environment,
    )  # fmt: skip
    beside = file.with_name(f".{file.name}.{os.getpid()}.new")
    write_jscen(replace(found, map=scenario.map.name), beside)
    beside.replace(file)
