"""Who is around each sample: leader and follower along the lane, and the slots of the eight-vehicle model.

Leader: the next vehicle on the way that the object takes, as far as its track shows it; beyond, on any way that the map
has. Follower: the nearest vehicle whose leader it is. Both over lane sections, junctions and merges.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.mining.lane_map import MinedLanes, Rows
from resim.mining.samples import Ints, Samples

LOOK = 250.0
"""m along the lane up to which somebody is leader (our choice): half the speedometer reading at 500 km/h."""
SLOTS = ("I", "II", "III", "IV", "V", "VI", "VII", "VIII")
"""Left rear, beside and front; own lane rear and front; right rear, beside and front (Wagner 2021, Fig. 6.11)."""
CONTINUES = 0


class SlotReach(NamedTuple):
    """m: half the zone in which somebody is beside, and how far slots reach ahead and behind (Wagner 2021, 6.2.1.2)."""

    beside: float = 5.0
    ahead: float = 100.0
    behind: float = 50.0


PUBLISHED_REACH = SlotReach()


class LaneOrder(NamedTuple):
    """Samples (K,) that are in the way of others: row (-1 for not), s, u [m], with_lane, kind, as in `Features`."""

    row: Rows
    s: Floats
    u: Floats
    with_lane: Bools
    kind: NDArray[np.int8]


class LaneFlow(NamedTuple):
    """Of each sample (K,): that of leader and follower, -1 for none, metres along the lane from centre to centre, and
    between bumpers (below 0 where they overlap); NaN for none.
    """

    leader: Rows
    distance: Floats
    gap: Floats
    follower: Rows
    distance_behind: Floats
    gap_behind: Floats


class EightVehicles(NamedTuple):
    """Of each sample (K, 8): which samples hold its slots, -1 for nobody, and metres ahead along its lane."""

    held: Rows
    offset: NDArray[np.float32]


def lane_flow(order: LaneOrder, samples: Samples, lanes: MinedLanes) -> LaneFlow:
    """Give leaders and followers."""
    # compiled: numba is imported where it is used only
    from resim.mining.surroundings import kernel

    count = len(samples)
    leader = np.full(count, -1, np.int32)
    distance = kernel.leaders(*_prepared(kernel, order, samples, lanes), LOOK, leader)
    half = 0.5 * samples.tracks.length[samples.owner]
    gap = distance - half - half[leader]
    follower, behind, gap_behind = (
        np.full(count, -1, np.int32),
        np.full(count, np.nan),
        np.full(count, np.nan),
    )
    led = np.flatnonzero(leader >= 0)
    led = led[np.lexsort((led, -distance[led]))]  # of several the nearest has the last word
    follower[leader[led]], behind[leader[led]], gap_behind[leader[led]] = led, distance[led], gap[led]
    return LaneFlow(leader, distance, np.where(leader >= 0, gap, np.nan), follower, behind, gap_behind)


def eight_vehicles(
    order: LaneOrder, samples: Samples, lanes: MinedLanes, reach: SlotReach = PUBLISHED_REACH
) -> EightVehicles:
    """Give who holds the slots of the eight-vehicle model (Wagner 2021, 6.2.1.2).

    Readings: exactly at a border is inside; in the own lane within `beside` nobody holds a slot; of two the nearest by
    centres holds it, then the lower id; a slot's lane is the lane index next to the EGO's, driven the same way, of the
    lane of its centre.
    """
    # compiled: numba is imported where it is used only
    from resim.mining.surroundings import kernel

    held = np.full((len(samples), 8), -1, np.int32)
    offset = np.full((len(samples), 8), np.nan, np.float32)
    borders = kernel.SlotBorders(*reach)
    kernel.hold(*_prepared(kernel, order, samples, lanes), borders, kernel.HeldSlots(held, offset))
    return EightVehicles(held, offset)


class BetweenSamples(NamedTuple):
    """Vehicles (P,) at moments between samples: number of the moment, in order; the sample before; s, u [m] there."""

    moment: Ints
    sample: Ints
    s: Floats
    u: Floats


def eight_vehicles_between(
    between: BetweenSamples, order: LaneOrder, samples: Samples, lanes: MinedLanes, reach: SlotReach
) -> EightVehicles:
    """Give who holds the slots at moments between samples (P, 8), each vehicle on the lane of the sample before."""
    # compiled: numba is imported where it is used only
    from resim.mining.surroundings import kernel

    k = between.sample
    on = np.flatnonzero(order.row >= 0)
    run, runs = _runs(kernel, order, samples, on)
    by = np.lexsort((k, between.u, order.row[k], between.moment))
    first = np.searchsorted(between.moment[by], np.arange(int(between.moment.max(initial=-1)) + 2))
    rank = samples.rank[samples.owner[k]]
    placed = kernel.LaneSamples(order.row[k], between.s, between.u, order.with_lane[k], run[k], rank)
    held, offset = np.full((len(k), 8), -1, np.int32), np.full((len(k), 8), np.nan, np.float32)
    steps, borders = kernel.SamplesByStep(first, by), kernel.SlotBorders(*reach)
    kernel.hold(steps, placed, runs, _lane_ways(kernel, lanes), borders, kernel.HeldSlots(held, offset))
    return EightVehicles(held, offset)


def _prepared(kernel: Any, order: LaneOrder, samples: Samples, lanes: MinedLanes) -> tuple[Any, ...]:
    """Samples by step, on lanes, by stretches of one row, and the lanes, as the kernel takes them."""
    on = np.flatnonzero(order.row >= 0)
    by = on[np.lexsort((on, order.u[on], order.row[on], samples.step[on]))]
    first = np.searchsorted(samples.step[by], np.arange(len(samples.tracks.t) + 1))
    run, runs = _runs(kernel, order, samples, on)
    rank = samples.rank[samples.owner]
    placed = kernel.LaneSamples(order.row, order.s, order.u, order.with_lane, run, rank)
    return kernel.SamplesByStep(first, by), placed, runs, _lane_ways(kernel, lanes)


def _lane_ways(kernel: Any, lanes: MinedLanes) -> Any:
    return kernel.LaneWays(
        *lanes.after, *lanes.before, lanes.beside_left, lanes.beside_right, *lanes.stations
    )


def _runs(kernel: Any, order: LaneOrder, samples: Samples, on: Ints) -> tuple[Ints, Any]:
    """The stretch (K,) of the track on one row that each sample is of, and the stretches."""
    row, piece = order.row[on], samples.piece_of[on]
    new = np.ones(len(on), dtype=bool)
    new[1:] = (np.diff(row) != 0) | (np.diff(piece) != 0)
    run = np.zeros(len(samples), dtype=np.intp)
    run[on] = np.cumsum(new) - 1
    start = np.flatnonzero(new)
    joined = (order.kind[on][start] == CONTINUES) & (start > 0)
    joined[1:] &= np.diff(piece[start]) == 0
    number = np.arange(len(start))
    before = np.where(joined, number - 1, -1)
    after = np.where(np.append(joined[1:], False)[: len(start)], number + 1, -1)
    return run, kernel.LaneRuns(row[start], after, before)
