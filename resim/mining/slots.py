"""Scenarios as the slots around their EGO over time: what scenarios are compared by (Wagner 2021, 6.2.3).

Readings taken: samples at 0, 0.2, ... s from the scenario's own start, up to and with its last moment; between recorded
samples the way along the lane is linear, and the lane is the last known one. A scenario is the part of its window with
the EGO; where the EGO is on no lane, or not there, all of its slots are empty and its lane is -1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from resim.core.files import file_hash
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.mining.extraction import ExtractedScenario
from resim.mining.features import CONTINUES, Features
from resim.mining.lane_map import Rows
from resim.mining.samples import Ints
from resim.mining.surroundings import SLOTS, BetweenSamples, eight_vehicles_between

RATE = 5.0
"""Samples a second [Hz] (Wagner 2021, 6.2.3.3)."""
NEAR = 1e-6
"""s that make no difference between a moment and a recorded sample."""
BEND = 0.5
"""m to each side over which the bend of a lane is measured."""
SLOT_COLUMNS = ("scenario", "t", *SLOTS, *(f"v_{slot}" for slot in SLOTS), "lane", "bend")
"""Of slots.parquet: t [s] from the scenario's start; of each slot the metres ahead of the EGO along its lane, NaN where
nobody holds it, and the speed [m/s] above the EGO's; lane: how many lanes that are driven the same way lie to the
right, -1 without a lane; bend: curvature [1/m] of the EGO's lane, to the left positive."""


@dataclass(frozen=True, eq=False)
class SlotTrace:
    """The slots around an EGO at M moments.

    Attributes:
        offset: (M, 8) m ahead of the EGO along its lane, NaN where nobody holds the slot.
        speed: (M, 8) m/s above the EGO's speed, NaN likewise.
        lane: (M,) lanes to its right, -1 without a lane.
        bend: (M,) 1/m, curvature of its lane, to the left positive; NaN without a lane.
    """

    offset: Floats
    speed: Floats
    lane: Rows
    bend: Floats


class _Placed(NamedTuple):
    """Vehicles at moments (P,): number of the moment, sample before, share of the way to the next sample."""

    moment: Ints
    sample: Ints
    share: Floats


def slot_traces(features: Features, scenarios: Sequence[ExtractedScenario]) -> list[SlotTrace]:
    """Give the slots of scenarios over time, at RATE."""
    if not scenarios:
        return []
    t = features.samples.tracks.t
    own = [_moments(float(t[one.ego_start]), float(t[one.ego_end])) for one in scenarios]
    count = np.array([len(moments) for moments in own])
    ego = np.repeat([one.ego for one in scenarios], count)
    sample, at_sample = _samples_at(features, ego, np.concatenate(own))
    found = _on_samples(features, sample)
    if (between := np.flatnonzero((sample >= 0) & ~at_sample)).size:
        times = np.concatenate(own)[between]
        for column, values in zip(found, _between(features, sample[between], times), strict=True):
            column[between] = values
    ends = np.cumsum(count)[:-1]
    return [SlotTrace(*parts) for parts in zip(*(np.split(column, ends) for column in found), strict=True)]


def slot_frame(names: Sequence[str], traces: Sequence[SlotTrace]) -> pd.DataFrame:
    """Give a row per scenario and moment, with SLOT_COLUMNS."""
    count = [len(one.lane) for one in traces]
    empty = [SlotTrace(np.zeros((0, 8)), np.zeros((0, 8)), np.zeros(0, np.int32), np.zeros(0))]
    offset, speed, lane, bend = (
        np.concatenate([getattr(one, name) for one in traces or empty])
        for name in ("offset", "speed", "lane", "bend")
    )
    t = np.concatenate([np.arange(n) / RATE for n in count] or [np.zeros(0)])
    columns = {"scenario": np.repeat(np.array(names, dtype=object), count), "t": t}
    columns |= {slot: offset[:, k] for k, slot in enumerate(SLOTS)}
    columns |= {f"v_{slot}": speed[:, k] for k, slot in enumerate(SLOTS)}
    frame = pd.DataFrame({**columns, "lane": lane, "bend": bend})
    return frame.astype({"scenario": "string", "lane": "int64"})


def map_folder(road: Path) -> str:
    """Give the name that tells a map from others: its own, and the beginning of its hash."""
    return f"{road.stem}-{file_hash(road)[:8]}"


def _moments(start: float, end: float) -> Floats:
    """From the start of a scenario to its last moment [s]."""
    return start + np.arange(int(np.floor((end - start) * RATE + NEAR)) + 1) / RATE


def _samples_at(features: Features, ego: Ints, times: Floats) -> tuple[Ints, Bools]:
    """The last samples (M,) of EGOs up to times (M,) [s], -1 where it is not there, and whether they are at these."""
    samples = features.samples
    out = np.full(len(times), -1, dtype=np.intp)
    for row in np.unique(ego).tolist():
        mine = np.flatnonzero(ego == row)
        low, high = int(samples.first[row]), int(samples.first[row + 1])
        place = np.searchsorted(samples.t[low:high], times[mine] + NEAR, side="right") - 1
        out[mine] = np.where(place >= 0, low + place, -1)
    at_sample = (out >= 0) & (np.abs(samples.t[out] - times) <= NEAR)
    last = np.append(np.diff(samples.piece_of) != 0, True)
    return np.where(at_sample | ~last[out], out, -1), at_sample


def _on_samples(features: Features, sample: Ints) -> tuple[Floats, Floats, Rows, Floats]:
    """offset, speed, lane and bend as recorded at samples (M,), those of -1 without a lane."""
    samples, around = features.samples, features.around
    k = np.maximum(sample, 0)
    there = (sample >= 0) & (features.row[k] >= 0)
    held = np.where(there[:, None], around.held[k], -1)
    offset = np.where(held >= 0, around.offset[k].astype(float), np.nan)
    speed = np.where(held >= 0, samples.v[held] - samples.v[k][:, None], np.nan)
    lane, bend = np.full(len(k), -1, np.int32), np.full(len(k), np.nan)
    lane[there], bend[there] = _lane(features, k[there])
    return offset, speed, lane, bend


def _lane(features: Features, k: Ints) -> tuple[Rows, Floats]:
    """How many lanes lie to the right of samples (K,), all on lanes, and the bend of their lanes [1/m]."""
    lanes, row = features.lanes, features.row[k]
    count = np.zeros(len(k), np.int32)
    beside = lanes.beside_right[row]
    while (beside >= 0).any():
        count += beside >= 0
        beside = np.where(beside >= 0, lanes.beside_right[beside], -1)
    table = lanes.network.lane_table
    start, end = table.start[row], table.end[row] - 1e-9
    low, high = (np.clip(features.s[k] + way, start, end) for way in (-BEND, BEND))
    names = np.array(list(lanes.network.roads))[table.road[row]]
    turned = wrap_angle(
        lanes.network.lane_heading(names, table.lane[row], high)
        - lanes.network.lane_heading(names, table.lane[row], low)
    )
    sign = np.where(table.forward[row], 1.0, -1.0)
    return count, sign * turned / np.maximum(high - low, 1e-9)


def _between(features: Features, sample: Ints, times: Floats) -> tuple[Floats, Floats, Rows, Floats]:
    """offset, speed, lane and bend at times (M,) [s] after samples (M,) of EGOs, before their next ones."""
    unique, number = np.unique(times, return_inverse=True)
    placed = _placed(features, unique)
    k, share = placed.sample, placed.share
    s, u = _along(features, k, share)
    between = BetweenSamples(placed.moment, k, s, u)
    found = eight_vehicles_between(between, features.order, features.samples, features.lanes, features.reach)
    key = number * len(features.samples) + sample
    keys = placed.moment * len(features.samples) + k
    order = np.argsort(keys)
    at = order[np.minimum(np.searchsorted(keys[order], key), len(order) - 1)] if len(order) else number * 0
    known = keys[at] == key if len(order) else np.zeros(len(key), dtype=bool)
    held = np.where(known[:, None], found.held[at], -1) if len(order) else np.full((len(key), 8), -1)
    v = features.samples.v[k] + share * (features.samples.v[_next(features, k)] - features.samples.v[k])
    offset, speed = np.full(held.shape, np.nan), np.full(held.shape, np.nan)
    row, slot = np.nonzero(held >= 0)
    offset[row, slot] = found.offset[at[row], slot]
    speed[row, slot] = v[held[row, slot]] - v[at[row]]
    _, _, lane, bend = _on_samples(features, sample)
    return offset, speed, lane, bend


def _placed(features: Features, times: Floats) -> _Placed:
    """Every vehicle on a lane at times (U,) [s], which lie between its samples of one piece."""
    samples = features.samples
    here = np.flatnonzero((features.order.row >= 0) & (np.append(np.diff(samples.piece_of) == 0, False)))
    first = np.searchsorted(times, samples.t[here] - NEAR, side="left")
    last = np.searchsorted(times, samples.t[here + 1] - NEAR, side="left")
    count = last - first
    k = np.repeat(here, count)
    moment = np.repeat(first - np.cumsum(count) + count, count) + np.arange(count.sum())
    share = (times[moment] - samples.t[k]) / (samples.t[k + 1] - samples.t[k])
    return _Placed(moment, k, np.clip(share, 0.0, 1.0))


def _next(features: Features, k: Ints) -> Ints:
    return np.minimum(k + 1, len(features.samples) - 1)


def _along(features: Features, k: Ints, share: Floats) -> tuple[Floats, Floats]:
    """s of the road and u along the lane (P,) [m] at a share of the way from samples (P,) to the next ones.

    Linear within a lane; where the next sample is on another, by the way in the direction of the lane.
    """
    samples, after = features.samples, k + 1
    heading = features.lane_heading[k]
    way = (samples.x[after] - samples.x[k]) * np.cos(heading) + (samples.y[after] - samples.y[k]) * np.sin(
        heading
    )
    same = (features.row[k] == features.row[after]) & (features.kind[after] == CONTINUES)
    step = np.where(same, features.u[after] - features.u[k], way)
    table = features.lanes.network.lane_table
    forward = np.where(table.forward[features.row[k]], 1.0, -1.0)
    along = np.where(same, features.s[after] - features.s[k], forward * way)
    return features.s[k] + share * along, features.u[k] + share * step
