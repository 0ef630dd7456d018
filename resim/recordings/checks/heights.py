"""Heights that the map does not bear out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import CheckedTable
from resim.road.measured_heights import HeightTrack, MeasuredHeights, measured_heights
from resim.road.opendrive import RoadNetwork
from resim.road.opendrive.index import LEVEL


def heights(table: CheckedTable, network: RoadNetwork | None) -> tuple[CheckedTable, list[RankedFinding]]:
    """Give the table with the heights that are believed, and what is said of the others."""
    if not any(k.z is not None and np.isfinite(k.z).any() for k in table.tracks):
        return table, []
    if network is None:
        return table.shaped(z=lambda k: None), []
    told = [
        HeightTrack(k.id, k.t, k.p.real, k.p.imag, np.full(len(k), np.nan) if k.z is None else k.z)
        for k in table.tracks
    ]
    judged = measured_heights(told, network)
    tracks = [replace(k, z=z) for k, z in zip(table.tracks, judged.z, strict=True)]
    return table.replaced(tracks), list(_findings(table, judged))


def _findings(table: CheckedTable, judged: MeasuredHeights) -> Iterator[RankedFinding]:
    if judged.why:
        text = f"heights z are not used: {judged.why}"
        yield found("HEIGHT", table.source, "", table.span, LEVEL, "m", text, limit=LEVEL, severity="note")
        return
    if judged.offset:
        text = f"all heights z are {judged.offset:.1f} m above the map's, and are corrected by this offset"
        yield found(
            "HEIGHT", table.source, "", table.span, judged.offset, "m", text, limit=LEVEL, severity="note"
        )
    for n, why in judged.doubted.items():
        own = table.tracks[n]
        span = (float(own.t[0]), float(own.t[-1]))
        text = f"its height z is not used: {why}"
        yield found("HEIGHT", table.source, own.id, span, LEVEL, "m", text, limit=LEVEL)
