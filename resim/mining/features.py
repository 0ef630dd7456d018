"""What there is to know of every sample from exact road coordinates, on any OpenDRIVE map (Kaefer 2022, 4.5.5).

Lane, offset from its centre, who is ahead and behind on its way, and the speed across it. Readings taken: the lane is
that of the box's centre; distances are metres along the lane, centre to centre (4.5.5.3); -1 for nobody, NaN for no
distance (Kaefer writes -1, which is a distance as well).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.core.tracks import Tracks
from resim.mining.lane_map import MinedLanes, Rows, lane_map
from resim.mining.samples import VEHICLES, Ints, Samples, samples_of
from resim.mining.smoothing import slope
from resim.mining.surroundings import (
    PUBLISHED_REACH,
    EightVehicles,
    LaneFlow,
    LaneOrder,
    SlotReach,
    eight_vehicles,
    lane_flow,
)
from resim.road.opendrive import LanePlaces, RoadNetwork

CHUNK = 200_000
"""Samples that are looked up at once."""
LEVEL = 2.5
"""m of height up to which a sample with a height is on a lane, where another lane is nearer in height."""
OFF_HEADING, OFF_CENTRE = 2.0, 0.2
"""What a lane costs that a sample may be on: by radian against its direction, by metre off its centre."""
FORAY, BESIDE = 0.2, 0.25
"""s for which, and m up to which, a sample may be beyond the border of its lane if it comes back: noise, no lane change
(our choice). Longer or further beyond it is on the lane that it is in."""
LEAST_WEIGHT, MOST_WEIGHT = 0.02, 1.0
"""m: a sample's costs count by the way since the one before, at least and at most so much."""
CONTINUES, CROSSES, BREAKS = 0, 1, 2
"""As in the kernel: how a sample follows the one before."""
ACROSS_PRECISION, ALONG_PRECISION = 0.01, 0.2
"""m/s and m/s²: standard deviations to which speeds across and accelerations are smoothed: a third of the least that
counts across (0.03 m/s), and less than a tenth of strong braking."""


@dataclass(frozen=True, eq=False)
class Features:
    """What is known of each of K samples. Who does not drive (pedestrians) is on lanes as well, in nobody's way.

    Attributes:
        samples: The samples.
        lanes: The lanes of the map.
        row: (K,) lane as a row of the map's lane table, -1 for none; one id as long as a lane goes on is `strand`.
        s: (K,) m along the road, NaN without a lane.
        offset: (K,) m left of the lane's centre, in driving direction of the lane.
        u: (K,) m along the lane's centre from where it is entered.
        with_lane: (K,) whether it is headed as the lane is driven.
        lane_heading: (K,) rad, direction in which the lane is driven.
        kind: (K,) how the sample follows the one before on a lane: CONTINUES its way, CROSSES a border, BREAKS.
        passed: (K,) lanes that it entered to the driver's left since then; to the right negative.
        strand: (K,) what stays one while an object follows its lane, over sections, junctions and merges, and changes
            by the lanes passed; counts from 0 after each break.
        stretch: (K,) what counts the breaks: strands of two stretches cannot be compared.
        aside: (K,) m to the driver's left of where the stretch began, along with the lane; borders leave no step in it.
        v_across: (K,) m/s to the driver's left against the lane, smoothed; NaN without a lane.
        a: (K,) m/s², as recorded, else of the speed, smoothed.
        reach: How far the slots of the eight-vehicle model reach.
    """

    samples: Samples
    lanes: MinedLanes
    row: Rows
    s: Floats
    offset: Floats
    u: Floats
    with_lane: Bools
    lane_heading: Floats
    kind: NDArray[np.int8]
    passed: NDArray[np.int16]
    strand: NDArray[np.int32]
    stretch: NDArray[np.int32]
    aside: Floats
    v_across: Floats
    a: Floats
    reach: SlotReach = PUBLISHED_REACH

    @cached_property
    def flow(self) -> LaneFlow:
        """Who is ahead and behind on the lane's way."""
        return lane_flow(self.order, self.samples, self.lanes)

    @cached_property
    def around(self) -> EightVehicles:
        """Who holds the slots of the eight-vehicle model around each sample."""
        return eight_vehicles(self.order, self.samples, self.lanes, self.reach)

    @cached_property
    def order(self) -> LaneOrder:
        """The vehicles on lanes, in the order in which they drive there."""
        on = (self.row >= 0) & self.samples.kinds(VEHICLES)
        return LaneOrder(np.where(on, self.row, -1), self.s, self.u, self.with_lane, self.kind)

    @cached_property
    def limit(self) -> Floats:
        """The speed limit (K,) [m/s], NaN where there is none or no lane."""
        out = np.full(len(self.samples), np.nan)
        on = self.row >= 0
        out[on] = self.lanes.network.lane_table.limit(self.row[on].astype(np.intp), self.s[on])
        return out

    @cached_property
    def junction(self) -> Rows:
        """The number (K,) of the junction that the sample is in, -1 for none."""
        return np.where(self.row >= 0, self.lanes.junction[self.row], -1).astype(np.int32)

    def grid(self, name: str) -> NDArray[np.generic]:
        """Give a feature by its name as (N, T); NaN, -1 or False where there is no sample."""
        values = getattr(self, name)
        none = {"f": np.nan, "i": -1, "b": False}[values.dtype.kind]
        return self.samples.spread(values, none)

    def lane_names(self, samples: Ints) -> list[str]:
        """Give lanes by their names `road/lane` at samples, "" for none."""
        table = self.lanes.network.lane_table
        names = list(self.lanes.network.roads)
        rows = self.row[samples].tolist()
        return ["" if r < 0 else f"{names[table.road[r]]}/{table.lane[r]}" for r in rows]


FEATURES = tuple(field.name for field in fields(Features) if field.name not in ("samples", "lanes", "reach"))


def features(tracks: Tracks, network: RoadNetwork, reach: SlotReach = PUBLISHED_REACH) -> Features:
    """Give the features of all samples of tracks on a map. reach: of the slots around each."""
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    samples, lanes = samples_of(tracks), lane_map(network)
    places, first = _places(samples, lanes)
    table = network.lane_table
    heading = lane_headings(lanes, places)
    own = samples.heading[places.point]
    off = np.abs(wrap_angle(heading - own))
    with_lane = off <= 0.5 * np.pi
    weights = _weights(samples)
    graph = kernel.LaneGraph(
        *lanes.after, *lanes.before, lanes.stations.length, table.forward, lanes.left, lanes.right
    )
    sign = np.where(table.forward[places.row], 1.0, -1.0)
    t = places.t * sign
    candidates = kernel.LaneCandidates(
        first, places.row, with_lane, heading, t,
        OFF_HEADING * off + OFF_CENTRE * np.abs(t) + _beside(samples, places, weights),
    )  # fmt: skip
    followed = kernel.FollowedLanes(np.zeros(len(samples), np.int8), np.zeros(len(samples), np.int16))
    driven = kernel.DrivenSamples(samples.x, samples.y, weights, samples.piece)
    chosen = kernel.choose(graph, candidates, driven, followed)
    found = _assemble(
        samples, lanes, places, chosen, (with_lane, heading, t), (followed.kind, followed.count)
    )
    return replace(found, reach=reach)


def _places(samples: Samples, lanes: MinedLanes) -> tuple[LanePlaces, Ints]:
    """Driven lanes at every sample, and where (K + 1,) those of each begin."""
    network, z = lanes.network, samples.tracks.z
    heights = None if z is None else z[samples.owner, samples.step]
    parts = []
    for low in range(0, len(samples), CHUNK):
        of = slice(low, low + CHUNK)
        found = network.lanes_at(samples.x[of], samples.y[of], beyond=BESIDE)
        table = network.lane_table
        keep = table.drivable[found.row] & (table.lane[found.row] != 0)
        if heights is not None:
            keep &= _at_height(network, found, heights[of])
        held = np.zeros(len(samples.x[of]), dtype=bool)
        held[found.point[keep & (found.beyond == 0.0)]] = True
        keep &= held[found.point]  # who is on no lane is not on one beside
        columns = (found.point + low, found.row, found.s, found.t, found.beyond)
        parts.append(tuple(column[keep] for column in columns))
    empty = np.zeros(0, np.intp), np.zeros(0, np.intp), np.zeros(0), np.zeros(0), np.zeros(0)
    point, row, s, t, beyond = (np.concatenate(column) for column in zip(*(parts or [empty]), strict=True))
    places = LanePlaces(point, row.astype(np.int32), s, t, beyond)
    return places, np.searchsorted(point, np.arange(len(samples) + 1))


def _at_height(network: RoadNetwork, found: LanePlaces, z: Floats) -> Bools:
    """Which lanes (M,) may be meant by samples with heights (K,) [m]: those near in height, if there are any."""
    if not len(found.row) or not network.has_heights:
        return np.ones(len(found.row), dtype=bool)
    table = network.lane_table
    names = np.array(list(network.roads))[table.road[found.row]]
    off = np.abs(network.z(names, found.s, found.t, lane=table.lane[found.row]) - z[found.point])
    near = off <= LEVEL
    some = np.zeros(len(z), dtype=bool)
    some[found.point[near]] = True
    return np.asarray(near | ~some[found.point])


def lane_headings(lanes: MinedLanes, places: LanePlaces) -> Floats:
    """Give the driving direction (M,) [rad] of the lanes' centres at places (M,)."""
    network = lanes.network
    table = network.lane_table
    names = np.array(list(network.roads) or [""])
    out = np.empty(len(places.row))
    for low in range(0, len(out), CHUNK):
        of = slice(low, low + CHUNK)
        row = places.row[of]
        whole = np.minimum(np.maximum(places.s[of], table.start[row]), table.end[row] - 1e-9)
        out[of] = network.lane_heading(names[table.road[row]], table.lane[row], whole)
    return out


def _beside(samples: Samples, places: LanePlaces, weights: Floats) -> Floats:
    """What lanes (M,) cost a metre whose border a sample is beyond: in FORAY as much as going over it and back.

    Within FORAY of where a track begins or ends nobody knows whether it comes back.
    """
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    t, begin, end = samples.t, samples.piece[:-1], samples.piece[1:] - 1
    inside = (t >= t[begin][samples.piece_of] + FORAY) & (t <= t[end][samples.piece_of] - FORAY)
    cost = np.where(inside, 2.0 * kernel.CROSSING / FORAY * np.diff(t, prepend=-np.inf), np.inf)
    return np.where(places.beyond > 0.0, (cost / weights)[places.point], 0.0)


def _weights(samples: Samples) -> Floats:
    """By how many metres (K,) being off a lane's centre or direction counts."""
    way = np.hypot(np.diff(samples.x, prepend=samples.x[:1]), np.diff(samples.y, prepend=samples.y[:1]))
    return np.clip(way, LEAST_WEIGHT, MOST_WEIGHT)


def _assemble(
    samples: Samples, lanes: MinedLanes, places: LanePlaces, chosen: Ints, of: tuple[Bools, Floats, Floats],
    followed: tuple[NDArray[np.int8], NDArray[np.int16]],
) -> Features:  # fmt: skip
    """The features of chosen places (K,), -1 for none. of: with_lane, lane heading and offset of places (M,)."""
    count, on = len(samples), np.flatnonzero(chosen >= 0)
    pick = chosen[on]
    row = np.full(count, -1, np.int32)
    row[on] = places.row[pick]
    s, u, offset, lane_heading = (np.full(count, np.nan) for _ in range(4))
    with_lane = np.zeros(count, dtype=bool)
    s[on], u[on] = places.s[pick], lanes.station(places.row[pick], places.s[pick])
    with_lane[on], lane_heading[on], offset[on] = (column[pick] for column in of)
    kind, passed = followed
    breaks = kind == BREAKS
    stretch = np.cumsum(breaks).astype(np.int32)
    strand = _since(np.cumsum(passed), breaks).astype(np.int32)
    aside = _aside(samples, on, (row, offset, with_lane, lane_heading), breaks)
    v_across = np.full(count, np.nan)
    v_across[on] = slope(samples.t[on], aside[on], stretch[on], ACROSS_PRECISION)
    a = samples.tracks.a
    if a is not None:
        acceleration = a[samples.owner, samples.step]
    else:
        acceleration = slope(samples.t, samples.v, samples.piece_of, ALONG_PRECISION)
    return Features(
        samples, lanes, row, s, offset, u, with_lane, lane_heading, kind, passed, strand, stretch, aside, v_across,
        acceleration,
    )  # fmt: skip


def _since(total: NDArray[np.generic], breaks: Bools) -> NDArray[np.generic]:
    """Sums (K,) from the last break on: of the break itself 0."""
    at = np.maximum.accumulate(np.where(breaks, np.arange(len(breaks)), 0))
    return total - total[at] if len(total) else total  # type: ignore[operator]


def _aside(samples: Samples, on: Ints, placed: tuple[Rows, Floats, Bools, Floats], breaks: Bools) -> Floats:
    """Metres (K,) to the driver's left since the stretch began: sums of steps across the lane.

    Within a row a step is the change of the offset; from row to row, where centres may differ, that of the place across
    the mean of both lanes' directions, which is exact on arcs. placed: row, offset, with_lane, lane heading (K,).
    """
    row, offset, with_lane, heading = placed
    out = np.full(len(samples), np.nan)
    if not len(on):
        return out
    own = np.where(with_lane, heading, heading + np.pi)[on]
    left = np.where(with_lane, offset, -offset)[on]
    mean = own[:-1] + 0.5 * wrap_angle(np.diff(own))
    dx, dy = np.diff(samples.x[on]), np.diff(samples.y[on])
    same = (row[on][1:] == row[on][:-1]) & (with_lane[on][1:] == with_lane[on][:-1])
    step = np.where(same, np.diff(left), dy * np.cos(mean) - dx * np.sin(mean))
    step[breaks[on][1:]] = 0.0
    out[on] = _since(np.concatenate([[0.0], np.cumsum(step)]), breaks[on])
    return out
