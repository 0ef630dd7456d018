"""What a recording leaves open: who was where in the time between, and how large."""

from __future__ import annotations

from dataclasses import replace

from resim.assess.unseen import Doubts, absences
from resim.check.bodies import SIZE
from resim.core.tracks import Tracks
from resim.ingest import Recording
from resim.pipeline.result import Basis


def doubts(recording: Recording, basis: Basis, tracks: Tracks) -> Doubts:
    """Give what a measurement leaves open. tracks: `measured_tracks` of that basis."""
    name = basis.lower()
    given = {i: (float(tracks.length[n]), float(tracks.width[n])) for n, i in enumerate(tracks.ids.tolist())}
    sizes = {
        i: (max(a, length), max(b, width))
        for i, (a, b) in recording.sizes.get(name, {}).items()
        for length, width in [given.get(i, (a, b))]
        if a > length + SIZE or b > width + SIZE
    }
    found = absences(tracks, recording.incomplete.get(name), ego=recording.ego)
    return Doubts(tuple(replace(a, size=sizes.get(a.object, a.size)) for a in found), sizes)
