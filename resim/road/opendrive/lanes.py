"""The lanes of all roads in one table: centre offset, width and speed limit as piecewise cubics of s."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Floats, sealed
from resim.road.opendrive.arclength import powers
from resim.road.opendrive.limits import limits
from resim.road.opendrive.model import Cubic, Lane, LaneSection, Road
from resim.road.opendrive.reference import Ints, Steps

ZERO = (Cubic(0.0, 0.0, 0.0, 0.0, 0.0),)


def reexpanded(records: Sequence[Cubic], s: Floats) -> Floats:
    """Give the coefficients (K, 4) that the records' polynomial has when written from each s (K,) on.

    Where s lies before the first record, that one is extended backwards; no record is zero.
    """
    table = np.array(records or ZERO, dtype=float)
    row = table[np.clip(np.searchsorted(table[:, 0], s, side="right") - 1, 0, len(table) - 1)]
    ds = s - row[:, 0]
    own = row[:, 1:]
    half, sixth = 0.5 * powers(own, ds, 2), powers(own, ds, 3) / 6.0
    return np.stack([powers(own, ds), powers(own, ds, 1), half, sixth], axis=1)


def on_road(section: LaneSection, records: Sequence[Cubic]) -> list[Cubic]:
    """Give a lane's records with s counted from the road's start, the one place where it is turned so.

    Places are compared with these sums, never (place - start) with a record's own s: in floating point
    (start + s) - start may be less than s.
    """
    return [record._replace(s=section.start + record.s) for record in records]


class Lanes:
    """Rows 0..L-1, one per lane of a lane section (lane 0 among them, with width 0), in order of the file.

    road, section (index within the road), lane, start, end, drivable, forward (driven along s): (L,).
    """

    def __init__(self, roads: Sequence[Road]) -> None:
        pairs = [(r, k, section) for r, road in enumerate(roads) for k, section in enumerate(road.sections)]
        entries = [(r, k, section, lane) for r, k, section in pairs for lane in _with_zero(section)]
        self.road = np.array([e[0] for e in entries], dtype=np.intp)
        self.section = np.array([e[1] for e in entries], dtype=np.intp)
        self.lane = np.array([e[3].id for e in entries], dtype=np.intp)
        self.start = np.array([e[2].start for e in entries])
        self.end = np.array([e[2].end for e in entries])
        self.types = [e[3].type for e in entries]
        self.drivable = np.array([e[3].drivable for e in entries])
        self.forward = np.array([roads[e[0]].along(e[3].id, e[1]) for e in entries])
        self._index_rows(pairs)
        self._fill(roads, pairs)
        sealed(self)

    def _index_rows(self, pairs: list[tuple[int, int, LaneSection]]) -> None:
        """Lay out `row_of` (sections, lanes): the row of a lane id in a section, -1 where there is none."""
        self._sections = Steps(np.array([r for r, _, _ in pairs], dtype=np.intp),
                               np.array([s.start for _, _, s in pairs]), pairs[-1][0] + 1)  # fmt: skip
        self.lowest = int(self.lane.min())
        self.row_of = np.full((len(pairs), int(self.lane.max()) - self.lowest + 1), -1, dtype=np.intp)
        section = (
            np.cumsum(np.concatenate([[1], (np.diff(self.road) != 0) | (np.diff(self.section) != 0)])) - 1
        )
        self.row_of[section, self.lane - self.lowest] = np.arange(len(self.lane))

    def _fill(self, roads: Sequence[Road], pairs: list[tuple[int, int, LaneSection]]) -> None:
        rows, starts, centres, widths, speeds = [], [], [], [], []
        row = 0
        for r, k, section in pairs:
            breaks = _breaks(roads[r], section)
            for centre, width, limit in _profiles(roads[r], k, breaks):
                rows.append(np.full(len(breaks), row))
                starts.append(breaks)
                centres.append(centre)
                widths.append(width)
                speeds.append(limit)
                row += 1
        self.piece_start = np.concatenate(starts)
        self._centre, self._width = np.concatenate(centres), np.concatenate(widths)
        self._limit = np.concatenate(speeds)
        self.pieces = Steps(np.concatenate(rows).astype(np.intp), self.piece_start, row)

    def section_at(self, road: Ints, s: Floats) -> Ints:
        """Give the number (N,), over all roads, of the lane section of road (N,) at s (N,) [m]."""
        return self._sections.find(road, s)

    def find(self, road: Ints, lane: Ints, s: Floats) -> Ints:
        """Give the row (N,) of lane (N,) of road (N,) at s (N,) [m], -1 where there is no such lane."""
        column = lane - self.lowest
        known = (column >= 0) & (column < self.row_of.shape[1])
        found = self.row_of[self.section_at(road, s), np.where(known, column, 0)]
        return np.where(known, found, -1)

    def centre(self, row: Ints, s: Floats) -> Floats:
        """Give t (N,) [m] of the lane centre from the reference line."""
        piece = self.pieces.find(row, s)
        return powers(self._centre[piece], s - self.piece_start[piece])

    def centre_and_width(self, row: Ints, s: Floats) -> tuple[Floats, Floats]:
        """Give t of the lane centre and the lane's width, each (N,) [m]."""
        piece = self.pieces.find(row, s)
        ds = s - self.piece_start[piece]
        return powers(self._centre[piece], ds), powers(self._width[piece], ds)

    def slopes(self, row: Ints, s: Floats) -> tuple[Floats, Floats]:
        """Give the first (1) and second (1/m) derivative by s of the lane centre's t, each (N,)."""
        piece = self.pieces.find(row, s)
        ds = s - self.piece_start[piece]
        return powers(self._centre[piece], ds, 1), powers(self._centre[piece], ds, 2)

    def limit(self, row: Ints, s: Floats) -> Floats:
        """Give the speed limit (N,) [m/s], NaN where there is none."""
        return np.asarray(self._limit[self.pieces.find(row, s)])

    def between(self, start: float, end: float, row: int) -> Floats:
        """Give where, strictly between start and end [m], the row's polynomials change."""
        own = self.piece_start[self.pieces.first[row] : self.pieces.last[row] + 1]
        return own[(own > start) & (own < end)]


def _with_zero(section: LaneSection) -> list[Lane]:
    lanes = [lane for lane in section.lanes.values() if lane.id != 0]
    return sorted([*lanes, section.lanes.get(0, Lane(0, "none"))], key=lambda lane: lane.id)


def _breaks(road: Road, section: LaneSection) -> Floats:
    """Every s in the section at which a polynomial or a speed limit of one of its lanes changes.

    All of them are kept, however close: what is looked up at a break is what begins there, to the last bit.
    """
    at = {section.start, *(c.s for c in road.lane_offsets), *(t.s for t in road.types)}
    at |= {sign.s for sign in road.signs}
    for lane in section.lanes.values():
        at |= {record.s for record in on_road(section, lane.widths or lane.borders)}
        at |= {section.start + s for s, _ in lane.speeds}
    return np.array(sorted(s for s in at if s == section.start or section.start < s < section.end))


def _profiles(road: Road, index: int, breaks: Floats) -> list[tuple[Floats, Floats, Floats]]:
    """Centre and width coefficients (K, 4) and limits (K,) of each lane of a section, by ascending id."""
    section = road.sections[index]
    offset = reexpanded(road.lane_offsets, breaks)
    out = {0: (offset, np.zeros_like(offset), limits(road, index, 0, breaks))}
    for side in (1, -1):
        inner = offset
        for lane in sorted((x for x in section.lanes.values() if x.id * side > 0), key=lambda x: abs(x.id)):
            outer = _outer(section, lane, inner, breaks, side)
            out[lane.id] = (0.5 * (inner + outer), side * (outer - inner),
                            limits(road, index, lane.id, breaks))  # fmt: skip
            inner = outer
    return [out[lane] for lane in sorted(out)]


def _outer(section: LaneSection, lane: Lane, inner: Floats, s: Floats, side: int) -> Floats:
    """The outer border's t: the inner one and the width, or the border record where no width is given."""
    if lane.borders and not lane.widths:
        return reexpanded(on_road(section, lane.borders), s)
    return inner + side * reexpanded(on_road(section, lane.widths), s)
