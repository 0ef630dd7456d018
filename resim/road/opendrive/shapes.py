"""Lanes as polylines, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.road.opendrive.lanes import Lanes
from resim.road.opendrive.model import Road
from resim.road.opendrive.reference import ReferenceLines


@dataclass(frozen=True, eq=False)
class LaneShape:
    """One lane of one section: centre, left and right border (K, 2) [m] in the direction of s.

    mark: type of the road mark on the outer border (lane 0: the centre line) where the section begins.
    """

    road: str
    section: int
    lane: int
    type: str
    centre: Floats
    left: Floats
    right: Floats
    mark: str


def lane_shapes(roads: Sequence[Road], lines: ReferenceLines, lanes: Lanes, step: float) -> list[LaneShape]:
    """Give every lane (lane 0 with both borders on the centre line), points at most step [m] apart."""
    ends = np.maximum(np.minimum(lanes.end, lines.length[lanes.road]), lanes.start)
    counts = np.maximum(np.ceil((ends - lanes.start) / step), 1).astype(int) + 1
    first = np.cumsum(counts) - counts
    row = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(counts.sum()) - first[row]) / (counts - 1)[row]
    s = lanes.start[row] + share * (ends - lanes.start)[row]
    # the section's end is evaluated just before it, where the line is still the section's own
    frame = lines.evaluate(lanes.road[row], s - np.where(share == 1.0, 1e-9, 0.0))
    centre, width = lanes.centre_and_width(row, s)
    half = 0.5 * np.maximum(width, 0.0)
    sin, cos = np.sin(frame.heading), np.cos(frame.heading)

    def line(t: Floats) -> list[Floats]:
        return np.split(np.stack([frame.x - t * sin, frame.y + t * cos], axis=1), first[1:])

    middle, left, right = line(centre), line(centre + half), line(centre - half)
    shapes = []
    for i, number in enumerate(lanes.road):
        road, section, lane = roads[number], int(lanes.section[i]), int(lanes.lane[i])
        shapes.append(LaneShape(road.id, section, lane, lanes.types[i], middle[i], left[i], right[i],
                                _mark(road, section, lane)))  # fmt: skip
    return shapes


def _mark(road: Road, section: int, lane: int) -> str:
    found = road.sections[section].lanes.get(lane)
    return found.marks[0].type if found and found.marks else "none"
