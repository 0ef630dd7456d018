"""One recording as training sees it: the sensors' lists in the EGO's frame, the truth as smooth functions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resim.core.errors import InputError
from resim.core.geometry import Bools, Floats, to_frame, wrap_angle
from resim.core.tracks import Strings, Tracks
from resim.perception.training.truth import TrueMotion
from resim.recordings.recording import Recording

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class TrainingDrive:
    """K lists of M perceived objects beside N true ones.

    t: (K,) s. ego: (5, K) true x, y, heading, v, a of the EGO. own: (4, K) its perceived x, y, heading, v, or None
    where its own sensors recorded nothing. x, y, heading, v: (M, K) of perceived objects in the perceived EGO's frame,
    heading against its heading, speed over ground; NaN where not perceived. gt_id: (M,) the identity that the recording
    gives, "" for none. states: (N, 5, K) of the true objects in the map frame, NaN where they are not.
    gt_kind: (N,) their kinds.
    """

    name: str
    t: Floats
    ego: Floats
    own: Floats | None
    ids: Strings
    gt_id: Strings
    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    length: Floats
    width: Floats
    gt_ids: Strings
    gt_kind: Strings
    truth: tuple[TrueMotion, ...]
    states: Floats
    gt_length: Floats
    gt_width: Floats

    @property
    def seen(self) -> Bools:
        """Which object is in which list, (M, K)."""
        return np.isfinite(self.x)

    def in_frame(self, states: Floats) -> tuple[Floats, Floats, Floats]:
        """Give x, y [m] and heading [rad] of map states (..., >= 3, K) in the true EGO's frame at the lists' times."""
        x, y = to_frame(states[..., 0, :], states[..., 1, :], *self.ego[:3])
        return x, y, wrap_angle(states[..., 2, :] - self.ego[2])


def drive_of(recording: Recording) -> TrainingDrive:
    """Lay a recording out for training. Raises InputError where it has no SD, or no EGO in its GT."""
    sd, gt = recording.sd, recording.gt
    if sd is None or not len(sd):
        remedy = "Train on recordings with GT and SD of the same drive."
        raise InputError(recording.name, "there is no sensor data to train on", remedy)
    if recording.ego not in gt.ids:
        raise InputError(recording.name, f"the EGO {recording.ego!r} is not in the ground truth")
    names = np.full(len(sd), "") if recording.sd_gt_id is None else recording.sd_gt_id
    ego = TrueMotion.of(gt, gt.index(recording.ego))
    here = np.isfinite(ego.states(sd.t)[0])
    rows: Rows = np.flatnonzero((names == recording.ego) & sd.valid.any(axis=1))
    rows = rows if len(rows) or recording.sd_gt_id is not None else _on_top(sd, ego)
    t, column = _lists(sd.t[here], np.flatnonzero(here), gaps_are_empty=not len(rows))
    pose = ego.states(t)
    own = _own(sd, rows, column) if len(rows) else None
    centre = pose[:3] if own is None else own[:3]
    others = np.setdiff1d(np.arange(len(sd)), rows)
    x, y, heading, v = (
        np.where(column >= 0, c[others][:, column], np.nan) for c in (sd.x, sd.y, sd.heading, sd.v)
    )
    x_ego, y_ego = to_frame(x, y, *centre)
    traffic = np.flatnonzero((gt.ids != recording.ego) & gt.valid.any(axis=1))
    truth = tuple(TrueMotion.of(gt, int(row)) for row in traffic)
    states = np.array([k.states(t) for k in truth]).reshape(len(truth), 5, len(t))
    return TrainingDrive(
        recording.name, t, pose, own, sd.ids[others], names[others], x_ego, y_ego, wrap_angle(heading - centre[2]), v,
        sd.length[others], sd.width[others], gt.ids[traffic], gt.kind[traffic], truth, states, gt.length[traffic],
        gt.width[traffic],
    )  # fmt: skip


def _lists(t: Floats, column: Rows, *, gaps_are_empty: bool) -> tuple[Floats, Rows]:
    """Give the times of the lists and their columns in the SD; -1 for lists that stood empty and left no row.

    Where the EGO is in every list there are no such ones.
    """
    if len(t) < 2 or not gaps_are_empty:
        return t, column
    period = float(np.median(np.diff(t)))
    missing = np.maximum(np.round(np.diff(t) / period).astype(int) - 1, 0)
    before = np.repeat(np.arange(len(t) - 1), missing)
    share = np.concatenate([np.arange(1, n + 1) / (n + 1) for n in missing] or [t[:0]])
    filled = t[before] + share * (t[before + 1] - t[before])
    order = np.argsort(every := np.concatenate([t, filled]), kind="stable")
    return every[order], np.concatenate([column, np.full(len(filled), -1)])[order]


def _own(sd: Tracks, rows: Rows, column: Rows) -> Floats:
    """The EGO's perceived x, y, heading, v (4, K), of the row that has it at each time, NaN where none has."""
    row = rows[sd.valid[rows].argmax(axis=0)][column]
    return np.where(column >= 0, np.stack([c[row, column] for c in (sd.x, sd.y, sd.heading, sd.v)]), np.nan)


def _on_top(sd: Tracks, ego: TrueMotion) -> Rows:
    """Rows of SD objects that lie within the EGO all the time: the EGO itself, where the recording names nobody."""
    states = ego.states(sd.t)
    with np.errstate(invalid="ignore"):
        inside = np.hypot(sd.x - states[0], sd.y - states[1]) < 1.0
    common = sd.valid & np.isfinite(states[0])
    return np.flatnonzero(common.any(axis=1) & (inside.sum(axis=1) > 0.9 * common.sum(axis=1)))
