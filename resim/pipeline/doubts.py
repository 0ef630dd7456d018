"""What a recording leaves open: who was where in the time between, and how large."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from resim.assess.unseen import Absence, Doubts, absences, cut_off, renamed
from resim.check import TORN
from resim.check.bodies import SIZE
from resim.core.tracks import Tracks
from resim.ingest import Recording
from resim.ingest.identity import UNMATCHED
from resim.pipeline.result import Basis
from resim.pipeline.told import as_told
from resim.road.opendrive import RoadNetwork
from resim.scenario.misfit import find_misfits
from resim.scenario.scenario import Scenario

FARTHEST = 20.0
"""Distance [m] by which a place is in doubt at most; beyond it nobody knows where the object is."""


def doubts(
    recording: Recording, basis: Basis, tracks: Tracks, scenario: Scenario | None, network: RoadNetwork
) -> Doubts:
    """Give what a measurement leaves open.

    tracks: `measured_tracks` of that basis; scenario: what describes them, by which they are judged and simulated, None
    where nothing is. Where a trace is off its samples, or samples are off their track, nobody knows which is right.
    """
    name = basis.lower()
    given = {i: (float(tracks.length[n]), float(tracks.width[n])) for n, i in enumerate(tracks.ids.tolist())}
    sizes = {
        i: (max(a, length), max(b, width))
        for i, (a, b) in recording.sizes.get(name, {}).items()
        for length, width in [given.get(i, (a, b))]
        if a > length + SIZE or b > width + SIZE
    }
    told = as_told(recording, basis, tracks)
    found = (*absences(told.tracks, told.incomplete, ego=recording.ego), *told.gaps)
    whole = recording.gt if basis == "GT" else recording.sd_by_gt() if recording.senses_ego else None
    found += (
        () if whole is None else tuple(cut_off(as_told(recording, basis, whole).tracks, ego=recording.ego))
    )
    off: dict[str, float] = {}
    for who, by in _torn(recording, basis):
        off[who] = off.get(who, 0.0) + by
    for who, by in _misfits(tracks, scenario, network):
        off[who] = max(off.get(who, 0.0), by)
    lost = [_lost(tracks, who, by) for who, by in off.items() if by > FARTHEST and who in tracks.ids]
    return Doubts(
        (*(replace(a, size=sizes.get(a.object, a.size)) for a in found), *lost),
        sizes,
        {who: by for who, by in off.items() if by <= FARTHEST},
        renamed(told.tracks, ego=recording.ego),
    )


def _lost(tracks: Tracks, name: str, off: float) -> Absence:
    """Somebody whose place is worth nothing."""
    n = tracks.index(name)
    start, end = tracks.t[tracks.valid[n]][[0, -1]].tolist()
    why = f"its trace is {off:.0f} m off its positions, or these off each other"
    size = float(tracks.length[n]), float(tracks.width[n])
    return Absence(name, start, end, np.empty(0), np.empty((0, 5)), size, why)


def _torn(recording: Recording, basis: Basis) -> Iterator[tuple[str, float]]:
    """Who jumps farther than he can, for good, and how far [m]: where he was is wrong before, or after."""
    source, sd = basis.lower(), recording.sd
    names: dict[str, str] = {}
    if basis == "SD" and sd is not None and recording.sd_gt_id is not None:
        names = {
            own: gt or f"{UNMATCHED}{own}"
            for own, gt in zip(sd.ids.tolist(), recording.sd_gt_id.tolist(), strict=True)
        }
    for f in recording.findings:
        if f.source == source and f.code in TORN:
            yield names.get(f.object, f.object), f.value


def _misfits(tracks: Tracks, scenario: Scenario | None, network: RoadNetwork) -> Iterator[tuple[str, float]]:
    """Whose trace is off its samples, and how far [m]."""
    if scenario is not None:
        yield from ((m.object, m.off) for m in find_misfits(scenario, tracks.to_frame(), network))
