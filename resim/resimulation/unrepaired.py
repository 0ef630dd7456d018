"""What a repaired recording was told: without what the repair filled in, with the gaps that it closed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from resim.core.geometry import Bools
from resim.core.objects import GAP
from resim.core.schema import OPTIONAL_COLUMNS, REPAIRED
from resim.core.tracks import Tracks
from resim.metrics.doubts.unseen import Absence, never_sighted
from resim.recordings import Recording
from resim.recordings.tables import JOINED, PARTED, VALUES
from resim.resimulation.result import Basis

SLACK = 2.0
"""Usual steps from one sample to the next up to which nothing is between them."""
ASIDE = 1e-3
"""Time [s] after the end of a track, or before its start, at which a repair says that it goes on no more."""
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class UnrepairedTracks:
    """tracks: as given, without samples that a repair made. incomplete: as in `Recording`, with these samples, and
    where a repair ends a track or begins one, a row beyond it. gaps: which a repair joined over.
    """

    tracks: Tracks
    incomplete: pd.DataFrame | None
    gaps: tuple[Absence, ...] = ()


def without_repairs(recording: Recording, basis: Basis, tracks: Tracks) -> UnrepairedTracks:
    """Give what was told of the tracks, which are samples of that basis under the names of `sd_by_gt`.

    An EGO of whom less than two samples are left stays, and is absent all the time: all else is seen from where it is.
    """
    incomplete, rows = (every.get(basis.lower()) for every in (recording.incomplete, recording.repairs))
    if rows is None or rows.empty:
        return UnrepairedTracks(tracks, incomplete)
    rows = rows[rows["id"].isin(tracks.ids) & rows["t"].isin(tracks.t)]
    if rows.empty:
        return UnrepairedTracks(tracks, incomplete)
    filled = _cells(tracks, rows[rows["filled"]]) & tracks.valid
    me = tracks.index(recording.ego)
    lost: tuple[Absence, ...] = ()
    if (tracks.valid[me] & ~filled[me]).sum() < 2:
        filled[me] = False
        lost = (never_sighted(tracks, me, "its samples were repaired"),)
    beyond = rows[rows["filled"] & ~((rows["id"] == recording.ego) & bool(lost))]
    more = [] if incomplete is None else [incomplete]
    more += [frame.assign(**dict.fromkeys(VALUES, np.nan)) for frame in (beyond, _seams(rows))]
    seen = _without(tracks, filled)
    joined = _cells(tracks, rows[rows[REPAIRED].str.split().map(lambda codes: JOINED in codes)])
    gaps = tuple(_gaps(seen, joined))
    return UnrepairedTracks(seen, pd.concat([m for m in more if len(m)] or more[:1]), (*lost, *gaps))


def _cells(tracks: Tracks, rows: pd.DataFrame) -> Bools:
    """Which samples (N, T) these rows are."""
    out = np.zeros(tracks.valid.shape, dtype=bool)
    number = {name: n for n, name in enumerate(tracks.ids.tolist())}
    out[rows["id"].map(number).to_numpy(int), np.searchsorted(tracks.t, rows["t"].to_numpy(float))] = True
    return out


def _without(tracks: Tracks, gone: Bools) -> Tracks:
    """The tracks without these samples (N, T)."""
    names = (*VALUES, *(c for c in OPTIONAL_COLUMNS if getattr(tracks, c) is not None))
    values = {c: np.where(gone, np.nan, getattr(tracks, c)) for c in names}
    return replace(tracks, valid=tracks.valid & ~gone, **values)


def _seams(rows: pd.DataFrame) -> pd.DataFrame:
    """Rows just after, or before, the track of whom a repair took for two: where it ends, only the repair says."""
    own = rows[rows[REPAIRED].str.split().map(lambda codes: PARTED in codes)]
    by_id = own.groupby("id", sort=False)["t"]
    first, last = own[own["t"] == by_id.transform("min")], own[own["t"] == by_id.transform("max")]
    return pd.concat([first.assign(t=first["t"] - ASIDE), last.assign(t=last["t"] + ASIDE)])


def _gaps(seen: Tracks, joined: Bools) -> Iterator[Absence]:
    """Holes before samples (N, T) that a repair joined on, up to GAP: longer ones are none of its doing."""
    for n in np.flatnonzero(joined.any(axis=1)).tolist():
        at = np.flatnonzero(seen.valid[n])
        step = np.diff(seen.t[at])
        slack = SLACK * float(np.median(step)) + _SAME if len(step) else np.inf
        for j in np.flatnonzero((step > slack) & (step <= GAP + _SAME) & joined[n, at[1:]]).tolist():
            both = at[j : j + 2]
            heading, v = seen.heading[n, both], seen.v[n, both]
            state = np.column_stack(
                [seen.x[n, both], seen.y[n, both], heading, v * np.cos(heading), v * np.sin(heading)]
            )
            size = float(seen.length[n]), float(seen.width[n])
            start, end = seen.t[both].tolist()
            yield Absence(
                object=str(seen.ids[n]),
                start=start,
                end=end,
                why="not seen",
                straight=False,
                size=size,
                t=seen.t[both],
                state=state,
            )
