"""A route by lanes as a curve: the centre lines of lanes, and from one to another in a smooth step.

The step is `smooth_step` over the length of the change, without lateral speed and acceleration at either end. Between
two lanes a place is (1 - f) a + f b, a and b their places at the same s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from resim.core.errors import ResimError
from resim.core.geometry import Floats, smooth_step
from resim.road.driven_route import Route
from resim.road.lane_following import RouteStretch
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.curve import RouteCurve
from resim.scenario.generation.lanes import LanePlace, beside, stretches

APART = 0.01
"""Distance [m] by which lanes that follow each other may miss each other."""
TURNED = 0.01
"""Angle [rad] by which they may bend where they meet."""


class Shift(NamedTuple):
    """A lane change, or a shift within the lane: from a way [m] on, over a length [m].

    lanes: how many to the left, below 0 to the right. offset: m left of the new lane's centre at its end. number: which
    of the file's changes it is. least: to which length [m] it may shrink where its lanes end before; None: it may not.
    """

    way: float
    length: float
    lanes: int
    offset: float
    number: int
    least: float | None = None


@dataclass(frozen=True)
class LanePiece:
    """A stretch of the route: from one lane to another (mostly the same), offsets [m] left of their centres by s.

    begun, extent: where the change began on the parameter, counted from this piece's start, and over how much [m].
    """

    network: RoadNetwork
    road: str
    section: int
    lane: int
    to_lane: int
    s: float
    up: bool
    length: float
    offset: float
    to_offset: float
    begun: float = 0.0
    extent: float = 0.0

    def at(self, q: Floats) -> Floats:
        """Give x, y and their first and second derivatives (6, K) at q (K,) [m] along the reference line."""
        return _derivatives(self.network, _table([self]), q)

    def beyond(self, q: float) -> float:
        """Give how far [m] the place at q is beyond the border of the lane that it comes from."""
        s = self.s + (q if self.up else -q)
        x, y, *_ = self.at(np.array([q]))[:, 0]
        ax, ay, *_ = self.network.lane_curve(self.road, self.lane, s, 0.0)
        return float(np.hypot(x - ax, y - ay) - 0.5 * self.network.lane_width(self.road, self.lane, s))


def _table(pieces: Sequence[LanePiece]) -> NDArray[np.void]:
    """Pieces (N,) as rows, up: 1 where s grows, else -1."""
    numbers = ("s", "up", "length", "offset", "to_offset", "begun", "extent")
    kinds = [("road", f"U{max(len(one.road) for one in pieces)}"), ("lane", int), ("to_lane", int)]
    return np.array(
        [(one.road, one.lane, one.to_lane, one.s, 1.0 if one.up else -1.0, one.length, one.offset, one.to_offset,
          one.begun, one.extent) for one in pieces],
        dtype=[*kinds, *((name, float) for name in numbers)],
    )  # fmt: skip


def _derivatives(network: RoadNetwork, of: NDArray[np.void], q: Floats) -> Floats:
    """Give x, y and their first and second derivatives (6, K) at q (K,) [m] of pieces (K,), or of one (1,)."""
    s = of["s"] + of["up"] * np.clip(q, 0.0, of["length"])
    one = network.lane_curve(of["road"], of["lane"], s, of["offset"])
    one[2:4] *= of["up"]
    rows = np.flatnonzero(np.broadcast_to(of["extent"] > 0.0, q.shape))
    if not len(rows):
        return one
    to = np.broadcast_to(of, q.shape)[rows]
    two = network.lane_curve(to["road"], to["to_lane"], s[rows], to["to_offset"])
    two[2:4] *= to["up"]
    f, df, ddf = smooth_step((q[rows] - to["begun"]) / to["extent"])
    df, ddf, off = df / to["extent"], ddf / to["extent"] ** 2, two - one[:, rows]
    one[:, rows] += f * off
    one[2:4, rows] += df * off[0:2]
    one[4:6, rows] += 2.0 * df * off[2:4] + ddf * off[0:2]
    return one


@lru_cache(maxsize=20_000)
def _ends(piece: LanePiece) -> Floats:
    """Where a piece begins and ends, as `LanePiece.at` (6, 2); kept, as lanes are shared."""
    return piece.at(np.array([0.0, piece.length]))


class LaneCurve(RouteCurve):
    """Stretches of lanes one after the other, all asked at once."""

    def __init__(self, pieces: Sequence[LanePiece]) -> None:
        super().__init__(pieces)
        self._network, self._table = pieces[0].network, _table(pieces)

    def derivatives(self, q: Floats) -> Floats:
        """Give x, y and their first and second derivatives (6, K) at parameters q (K,), counted over all pieces."""
        own, inside = self.inside(q)
        return _derivatives(self._network, self._table[own], inside)


class _Builder:
    """Pieces so far, and where the next begins."""

    def __init__(self, network: RoadNetwork, start: LanePlace, offset: float, route: Route) -> None:
        self.network, self.route, self.offset = network, route, offset
        self.pieces: list[LanePiece] = []
        self.changed: list[tuple[int, int, int]] = []  # number, first and last piece
        self.way = 0.0
        self.ahead = stretches(network, start, route)
        self.rest: RouteStretch | None = next(self.ahead, None)

    def go(self, until: float) -> None:
        """Keep the lane until a way [m], or until the road ends."""
        while self.rest is not None and self.way < until - 1e-9:
            piece = self._piece(self.rest, self.rest.lane, self.offset)
            whole = RouteCurve([piece]).length
            if self.way + whole > until:
                piece = replace(
                    piece, length=float(RouteCurve([piece]).parameter(np.array([until - self.way]))[0])
                )
                self.rest = self._cut(self.rest, piece.length)
                whole = until - self.way
            else:
                self.rest = next(self.ahead, None)
            self._add(piece, whole)

    def change(self, shift: Shift) -> None:
        """Make the change, which begins where the pieces end. Raises ResimError where the lanes do not allow it."""
        if self.rest is None:
            raise ResimError(f"begins {shift.way:.1f} m along the route, which ends after {self.way:.1f} m")
        here = self.rest
        up = here.s_to > here.s_from
        place = LanePlace(here.road, here.lane, here.s_from, up)
        lane = beside(self.network, place, shift.lanes) if shift.lanes else here.lane
        own = self._chain(here, self.ahead)
        other_stretches = stretches(self.network, place._replace(lane=lane), self.route)
        pairs = [*self._pairs(own, other_stretches if shift.lanes else None, shift.length)]
        to = shift.offset
        extent = self._extent(pairs, to, shift)
        first = len(self.pieces)
        done = 0.0
        for one, other in pairs:
            length = min(one.length, extent - done)
            if length <= 1e-9:
                break
            piece = self._piece(one, other.lane, to, begun=-done, extent=extent)
            piece = replace(piece, length=length)
            self._add(piece, RouteCurve([piece]).length)
            done += length
        last_one, last_other = pairs[len(self.pieces) - first - 1]
        self.changed.append((shift.number, first, len(self.pieces) - 1))
        self.offset = to
        end = last_one.s_from + (self.pieces[-1].length if up else -self.pieces[-1].length)
        start = LanePlace(last_other.road, last_other.lane, end, up)
        self.ahead = stretches(self.network, start, self.route)
        self.rest = next(self.ahead, None)

    def _extent(self, pairs: Sequence[tuple[RouteStretch, RouteStretch]], to: float, shift: Shift) -> float:
        """Over how much of the reference line the change goes, by its own length [m]."""
        length = shift.length

        def too_long(extent: float) -> float:
            done, pieces = 0.0, list[LanePiece]()
            for one, other in pairs:
                part = min(one.length, extent - done)
                if part > 1e-9:
                    piece = self._piece(one, other.lane, to, begun=-done, extent=extent)
                    pieces.append(replace(piece, length=part))
                done += part
            return RouteCurve(pieces).length - length

        most = sum(one.length for one, _ in pairs)
        if most > 1e-6 and shift.least is not None and shift.least - length <= too_long(most) < 0.0:
            return most
        if most < 1e-6 or too_long(most) < 0.0:
            raise ResimError(
                f"takes {length:.1f} m, but after {most:.1f} m its two lanes no longer lead along each other "
                f"(road {pairs[0][0].road})" if pairs else "its lane ends there"
            )  # fmt: skip
        least = 1e-3 * min(length, most)
        return (
            float(brentq(too_long, least, most, xtol=1e-12, rtol=1e-14)) if too_long(least) < 0.0 else least
        )

    def _pairs(
        self, own: Iterator[RouteStretch], other: Iterator[RouteStretch] | None, length: float
    ) -> Iterator[tuple[RouteStretch, RouteStretch]]:
        """The stretches of both lanes, as long as they lie beside each other, for somewhat more than a length [m]."""
        far = 0.0
        for one in own:
            two = one if other is None else next(other, None)
            if two is None or (one.road, one.section) != (two.road, two.section):
                return
            yield one, two
            far += one.length
            if far > 1.5 * length + 50.0:
                return

    def _chain(self, here: RouteStretch, ahead: Iterator[RouteStretch]) -> Iterator[RouteStretch]:
        yield here
        yield from ahead

    def _piece(
        self, one: RouteStretch, to_lane: int, to_offset: float, *, begun: float = 0.0, extent: float = 0.0
    ) -> LanePiece:
        up = one.s_to > one.s_from
        left = 1.0 if up else -1.0
        return LanePiece(
            self.network, one.road, one.section, one.lane, to_lane, one.s_from, up, one.length,
            left * self.offset, left * to_offset, begun, extent,
        )  # fmt: skip

    def _cut(self, one: RouteStretch, length: float) -> RouteStretch | None:
        s = one.s_from + (length if one.s_to > one.s_from else -length)
        return replace(one, s_from=s) if abs(one.s_to - s) > 1e-9 else next(self.ahead, None)

    def _add(self, piece: LanePiece, way: float) -> None:
        if self.pieces:
            self._refuse_gap(self.pieces[-1], piece)
        self.pieces.append(piece)
        self.way += way

    def _refuse_gap(self, last: LanePiece, piece: LanePiece) -> None:
        """Lanes that follow each other have to meet."""
        one, two = _ends(last)[:, 1], _ends(piece)[:, 0]
        apart = float(np.hypot(*(two[:2] - one[:2])))
        turned = abs(float(np.angle((two[2] + 1j * two[3]) / (one[2] + 1j * one[3]))))
        if apart > APART or turned > TURNED:
            raise ResimError(
                f"from road {last.road} lane {last.lane} to road {piece.road} lane {piece.lane} the map leaves a gap "
                f"of {apart:.3f} m and a bend of {turned:.3f} rad; choose other roads, or a route by points"
            )


def lane_curve(
    network: RoadNetwork,
    start: LanePlace,
    offset: float,
    shifts: Sequence[Shift],
    route: Route,
    length: float,
) -> tuple[RouteCurve, tuple[LanePiece, ...], dict[int, tuple[int, int]]]:
    """Give the curve of a route by lanes from a place on, at most `length` [m] long, or until the road ends.

    offset: m left of the lane's centre, as one goes there. Gives also the pieces, and of each change (by its number)
    the first and last piece. Raises ResimError.
    """
    road = network.roads[start.road]
    there = road.sections[road.section_index(start.s)].lanes
    if start.lane not in there or start.lane == 0 or not 0.0 <= start.s <= road.length:
        has = ", ".join(str(lane) for lane in sorted(there, reverse=True) if lane)
        raise ResimError(
            f"route: road {start.road} (0 to {road.length:.1f} m) has no lane {start.lane} at s = {start.s:g} m; "
            f"it has {has}"
        )
    made = _Builder(network, start, offset, route)
    for shift in sorted(shifts, key=lambda one: one.way):
        if shift.way < made.way - 1e-6:
            raise ResimError(f"change.{shift.number}: begins before the change ahead of it is done")
        made.go(shift.way)
        try:
            made.change(shift)
        except ResimError as e:
            raise ResimError(f"change.{shift.number}: {e}") from e
    made.go(length)
    if not made.pieces:
        raise ResimError(f"route: road {start.road} ends where the route begins")
    return LaneCurve(made.pieces), tuple(made.pieces), {n: (first, last) for n, first, last in made.changed}
