"""Centre lines of lanes as polylines that hold the exact curve within a millimetre."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely

from resim.core.geometry import Floats
from resim.road.links import LaneKey
from resim.road.opendrive import Road, RoadNetwork

STEP = 0.1
TOLERANCE = 5e-4
INSIDE = 1e-9
CHUNK = 500_000
SPECK, FAR_LANE = 1.0, 25.0
"""On elements shorter than SPECK [m] a lane FAR_LANE [m] from the line may swing through more than it has length."""


class LaneStretch(NamedTuple):
    """A lane of a lane section from s = start to end [m], start < end; forward: driven along s."""

    road: str
    section: int
    lane: int
    start: float
    end: float
    forward: bool

    @property
    def key(self) -> LaneKey:
        """Road, section and lane."""
        return LaneKey(self.road, self.section, self.lane)


class SampledStretches(NamedTuple):
    """Stretches sampled in driving direction: first (N + 1,) index of each, s (K,), xy (K, 2), width (K,) [m]."""

    first: np.ndarray[tuple[int], np.dtype[np.intp]]
    s: Floats
    xy: Floats
    width: Floats


def sample(network: RoadNetwork, stretches: Sequence[LaneStretch], step: float = STEP) -> SampledStretches:
    """Give the lane centres at places at most step [m] apart, at their ends, and where the map's records change.

    There, and at the end of a section, both sides are taken: the line may have a kink or a gap.
    """
    breaks = {road: _breaks(network.roads[road]) for road in dict.fromkeys(each.road for each in stretches)}
    parts = [_places(each, breaks[each.road], step) for each in stretches]
    counts = np.array([len(part) for part in parts], dtype=np.intp)
    first = np.concatenate([[0], np.cumsum(counts)])
    s = np.concatenate(parts)
    number = np.repeat(np.arange(len(counts)), counts)
    road = np.array([each.road for each in stretches], dtype=str)
    lane = np.array([each.lane for each in stretches], dtype=np.intp)
    xy, width = np.empty((len(s), 2)), np.empty(len(s))
    for low in range(0, len(s), CHUNK):
        own = slice(low, low + CHUNK)
        at = road[number[own]], lane[number[own]], s[own]
        xy[own] = np.stack(network.to_xy(*at, 0.0), axis=1)
        width[own] = network.lane_width(*at)
    return SampledStretches(first, s, xy, width)


def _places(stretch: LaneStretch, breaks: Floats, step: float) -> Floats:
    """The s (K,) [m] of one stretch in driving direction."""
    start, end = stretch.start, stretch.end
    step = step if end - start > SPECK else 0.1 * step  # widths may change by metres there
    count = max(int(np.ceil((end - start) / step)), 1) + 1
    even = np.linspace(start, end - INSIDE, count)
    within = breaks[(breaks > start + INSIDE) & (breaks < end - INSIDE)]
    s = np.sort(np.concatenate([even, within - INSIDE, within])) if len(within) else even
    return s if stretch.forward else s[::-1]


def _breaks(road: Road) -> Floats:
    """Every s [m] at which a record of the road or of one of its lanes begins, and some in specks of sharp bends."""
    at = {g.s for g in road.geometries} | {record.s for record in road.lane_offsets}
    for g in road.geometries:
        turn = max(abs(g.curvature_start), abs(g.curvature_end)) * g.length
        if g.length < SPECK and turn * FAR_LANE > STEP:
            at |= set(np.linspace(g.s, g.s + g.length, int(min(turn * FAR_LANE / STEP, 100.0)) + 2).tolist())
    for section in road.sections:
        for lane in section.lanes.values():
            at |= {section.start + record.s for record in (*lane.widths, *lane.borders)}
    return np.array(sorted(at))


def polylines(samples: SampledStretches) -> list[Floats]:
    """Give each stretch as the fewest points (K, 2) [m] that stay within TOLERANCE of its samples."""
    number = np.repeat(np.arange(len(samples.first) - 1), np.diff(samples.first))
    lines = shapely.simplify(
        shapely.linestrings(samples.xy, indices=number), TOLERANCE, preserve_topology=False
    )
    xy, of = shapely.get_coordinates(lines, return_index=True)
    return np.split(xy, np.searchsorted(of, np.arange(1, len(lines))))


def mean_widths(samples: SampledStretches) -> Floats:
    """Give the mean width (N,) [m] of each stretch."""
    return np.asarray(np.add.reduceat(samples.width, samples.first[:-1]) / np.diff(samples.first))


def length(line: Floats) -> float:
    """Give the length [m] of a polyline (K, 2)."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())
