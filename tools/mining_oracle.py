"""What vehicles on a motorway do, told again from exact tracks and the texts: for comparison with mined labels.

Nothing of `resim.mining` or `resim.scenario.maneuvers` is used. Lanes are lines of points, linked where one ends at the
start of another, and each sample is on the lane whose points are nearest; the plain loops of tools/mining_rules.py say
the rest. Lane changes are not found here: they are those of the truth, and are judged where the track shows Kaefer's
two ends.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from lxml import etree
from mining_ground import CLASSES
from mining_rules import CLOSE, Change, Event, Seen, differences, driving, joined, leaders
from mining_signs import DRIVEN
from scipy.spatial import cKDTree

from resim.core.tracks import Tracks
from resim.road.opendrive import load

STEP, LINKED, NEIGHBOURS = 0.5, 0.3, 16
"""m between the points of a lane, m between the end of one and the start of the next, points looked at."""


class Lane(NamedTuple):
    """One lane of one section, in driving direction: points (P,) x + iy, s [m] along them, half width (P,)."""

    road: str
    section: int
    number: int
    kind: str
    points: np.ndarray
    along: np.ndarray
    half: np.ndarray


class Placed(NamedTuple):
    """Samples of all vehicles (N, T): lane (-1: none), chain, m along it, m left of the centre, heading of the lane,
    half its width.
    """

    lane: np.ndarray
    chain: np.ndarray
    station: np.ndarray
    offset: np.ndarray
    heading: np.ndarray
    half: np.ndarray


def read_lanes(road: Path) -> list[Lane]:
    """Give all lanes that are driven."""
    network, out = load(road), []
    for element in etree.parse(str(road)).getroot().iterfind("road"):
        name, length = element.get("id"), float(element.get("length"))
        sections = element.findall("lanes/laneSection")
        starts = [float(one.get("s")) for one in sections]
        ends = [*starts[1:], length]
        for place_of, (section, first, last) in enumerate(zip(sections, starts, ends, strict=True)):
            for lane in section.iterfind(".//lane"):
                number = int(lane.get("id"))
                if number == 0 or lane.get("type") not in DRIVEN:
                    continue
                s = np.linspace(first, last, max(int((last - first) / STEP), 2) + 1)
                inside = np.clip(s, first + 1e-6, last - 1e-6)
                width = _widths(lane, inside - first)
                names, numbers = np.full(len(s), name), np.full(len(s), number)
                x, y = network.to_xy(names, numbers, inside, np.zeros(len(s)))
                turn = slice(None) if number < 0 else slice(None, None, -1)
                points = (np.asarray(x) + 1j * np.asarray(y))[turn]
                along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
                out.append(Lane(name, place_of, number, lane.get("type"), points, along, 0.5 * width[turn]))
    return out


def _widths(lane: etree._Element, ds: np.ndarray) -> np.ndarray:
    told = [(float(w.get("sOffset")), [float(w.get(k)) for k in "dcba"]) for w in lane.findall("width")]
    starts = [offset for offset, _ in told]
    out = np.empty(len(ds))
    for k, x in enumerate(ds.tolist()):
        offset, poly = told[max(bisect.bisect_right(starts, x + 1e-9) - 1, 0)]
        out[k] = np.polyval(poly, x - offset)
    return out


def chains(lanes: Sequence[Lane]) -> tuple[list[int], list[float]]:
    """Give of each lane the chain of lanes that it is in, and where [m] in it it begins."""
    after: dict[int, int] = {}
    for a, one in enumerate(lanes):
        near = [b for b, two in enumerate(lanes) if b != a and abs(one.points[-1] - two.points[0]) < LINKED]
        if len(near) == 1:
            after[a] = near[0]
    entered = set(after.values())
    chain, begin = [-1] * len(lanes), [0.0] * len(lanes)
    for first in range(len(lanes)):
        at, where = first, 0.0
        while first not in entered and at >= 0 and chain[at] < 0:
            chain[at], begin[at] = first, where
            where += float(lanes[at].along[-1])
            at = after.get(at, -1)
    return chain, begin


def place(lanes: Sequence[Lane], tracks: Tracks) -> Placed:
    """Say on which lane each sample's centre is."""
    chain, begin = chains(lanes)
    points = np.concatenate([lane.points for lane in lanes])
    owner = np.concatenate([np.full(len(lane.points), n) for n, lane in enumerate(lanes)])
    at = np.concatenate([np.arange(len(lane.points)) for lane in lanes])
    along = np.concatenate([lane.along for lane in lanes])
    half = np.concatenate([lane.half for lane in lanes])
    direction = np.concatenate([_directions(lane.points) for lane in lanes])
    tree = cKDTree(np.column_stack([points.real, points.imag]))
    shape = tracks.x.shape
    lane = np.full(shape, -1)
    station, offset, heading, wide = (np.full(shape, np.nan) for _ in range(4))
    row, k = np.nonzero(tracks.valid)
    own = tracks.x[row, k] + 1j * tracks.y[row, k]
    _, near = tree.query(np.column_stack([own.real, own.imag]), k=NEIGHBOURS, distance_upper_bound=4.0)
    known = near < len(points)
    near = np.where(known, near, 0)
    away = (own[:, None] - points[near]) * np.conj(direction[near])
    turned = np.cos(np.angle(direction[near]) - tracks.heading[row, k][:, None])
    first, last = (
        at[near] == 0,
        np.isclose(along[near], np.array([ln.along[-1] for ln in lanes])[owner[near]]),
    )
    fits = known & (np.abs(away.imag) <= half[near] + 1e-9) & (turned > 0.0)
    fits &= ~(first & (away.real < -0.01)) & ~(last & (away.real > 0.01))
    cost = np.where(fits, np.abs(away.real), np.inf)
    best = cost.argmin(axis=1)
    pick = np.arange(len(best)), best
    on = np.isfinite(cost[pick])
    chosen = near[pick]
    lane[row[on], k[on]] = owner[chosen][on]
    station[row[on], k[on]] = (np.array(begin)[owner[chosen]] + along[chosen] + away.real[pick])[on]
    offset[row[on], k[on]] = away.imag[pick][on]
    heading[row[on], k[on]] = np.angle(direction[chosen])[on]
    wide[row[on], k[on]] = half[chosen][on]
    return Placed(lane, np.where(lane >= 0, np.array(chain)[lane], -1), station, offset, heading, wide)


def _directions(points: np.ndarray) -> np.ndarray:
    step = np.gradient(points)
    return step / np.maximum(np.abs(step), 1e-12)


def seen(lanes: Sequence[Lane], placed: Placed, tracks: Tracks) -> Seen:
    """Give everybody in lanes; a lane as it goes on is told by its chain."""
    by_name = {(one.road, one.section, one.number): n for n, one in enumerate(lanes)}
    sides = []
    for step in (1, -1):  # towards the road's line is left, whichever way the lane is driven
        to = [(one.road, one.section, one.number + (step if one.number < 0 else -step)) for one in lanes]
        sides.append([by_name.get(name, -1) for name in to])
    nowhere, never = np.full(tracks.x.shape, np.nan), np.zeros(tracks.x.shape, dtype=bool)
    a = differences(tracks.t, tracks.v, tracks.valid) if tracks.a is None else tracks.a
    return Seen(
        tracks.ids.tolist(), tracks.kind.tolist(), tracks.length, tracks.width, tracks.t, tracks.valid, tracks.x,
        tracks.y, tracks.heading, tracks.v, a, placed.lane, placed.chain, placed.station, placed.offset,
        aside(placed, tracks), tracks.heading - placed.heading, placed.chain, *sides,
        [CLASSES.get(one.kind, "main") for one in lanes], nowhere, never, never,
    )  # fmt: skip


def aside(placed: Placed, tracks: Tracks) -> np.ndarray:
    """Metres (N, T) to the left of where each vehicle's first lane goes on: offsets, and half widths at each border."""
    out = np.full(placed.offset.shape, np.nan)
    for row in range(len(out)):
        k = np.flatnonzero(tracks.valid[row])
        jump = np.diff(placed.offset[row, k], prepend=placed.offset[row, k[:1]])
        width = placed.half[row, k] + np.r_[placed.half[row, k[:1]], placed.half[row, k[:-1]]]
        crossed = np.diff(placed.chain[row, k], prepend=placed.chain[row, k[:1]]) != 0
        step = np.where(crossed & (np.abs(jump) > CLOSE), -np.sign(jump) * width, 0.0)
        out[row, k] = placed.offset[row, k] + np.cumsum(np.nan_to_num(step))
    return out


def events(road: Path, tracks: Tracks, truth: pd.DataFrame) -> list[Event]:
    """Give everything that happens in a recording of a motorway, by what its truth says of lane changes."""
    lanes = read_lanes(road)
    placed = place(lanes, tracks)
    one = seen(lanes, placed, tracks)
    led = leaders(one)
    out: list[Event] = []
    for row, name in enumerate(tracks.ids.tolist()):
        own = truth[truth["object"].astype(str) == name]
        out += driving(one, row, [*_changes(one, row, own)], led, limits=False)
        fast = own[own["label"] == "speeding"]
        out += joined(name, "speeding", fast[["start", "end"]].itertuples(index=False, name=None), 1.0)
    return out


def _changes(one: Seen, row: int, own: pd.DataFrame) -> Iterator[Change]:
    """Lane changes of the truth, judged where both of Kaefer's ends are seen."""
    t, off, steps = one.t, np.abs(one.offset[row]), one.steps(row)
    for told in own[own["label"].str.startswith("lane_change")].itertuples():
        after = next((k for k in steps if t[k] >= told.t - 1e-9 and off[k] < CLOSE), None)
        before = next((k for k in reversed(steps) if t[k] < told.t - 1e-9 and off[k] < CLOSE), None)
        if after is None or before is None:
            yield Change(max(told.start, float(t[steps[0]])), told.t, min(told.end, float(t[steps[-1]])))
        else:
            lanes = 1 if told.label.endswith("left") else -1
            yield Change(told.start, told.t, told.end, before, after, lanes)
