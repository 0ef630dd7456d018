"""What vehicles on a motorway do, told again from exact tracks and the texts: for comparison with mined labels.

Nothing of `resim.mining` or `resim.scenario.maneuvers` is used. Lanes are lines of points, linked where one ends at the
start of another, and each sample is on the lane whose points are nearest; plain loops over samples say the rest.
Kaefer 2022, 4.5.6.2 to 4.5.6.9 and Table 4.3, with the readings that the labels name. Lane changes are not found here:
they are those of the truth, and are judged where the track shows Kaefer's two ends.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from lxml import etree
from scipy.spatial import cKDTree

from resim.core.tracks import Tracks
from resim.road.opendrive import load

STEP, LINKED, NEIGHBOURS = 0.5, 0.3, 16
"""m between the points of a lane, m between the end of one and the start of the next, points looked at."""
DRIVEN = ("driving", "entry", "exit", "onRamp", "offRamp")
CLASSES = {"entry": "on", "onRamp": "on", "exit": "off", "offRamp": "off", "driving": "main"}
TTC, CLOSE = 2.0, 1.0
Event = tuple[str, str, float, float]
"""Object, label, start and end [s]."""


class Lane(NamedTuple):
    """One lane of one section, in driving direction: points (P,) x + iy, s [m] along them, half width (P,)."""

    road: str
    number: int
    kind: str
    points: np.ndarray
    along: np.ndarray
    half: np.ndarray


class Placed(NamedTuple):
    """Samples of all vehicles (N, T): lane (-1: none), chain, m along it, m left of the centre."""

    lane: np.ndarray
    chain: np.ndarray
    station: np.ndarray
    offset: np.ndarray


def read_lanes(road: Path) -> list[Lane]:
    """Give all lanes that are driven."""
    network, out = load(road), []
    for element in etree.parse(str(road)).getroot().iterfind("road"):
        name, length = element.get("id"), float(element.get("length"))
        sections = element.findall("lanes/laneSection")
        starts = [float(one.get("s")) for one in sections]
        for section, first, last in zip(sections, starts, [*starts[1:], length], strict=True):
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
                out.append(Lane(name, number, lane.get("type"), points, along, 0.5 * width[turn]))
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
    station, offset = np.full(shape, np.nan), np.full(shape, np.nan)
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
    return Placed(lane, np.where(lane >= 0, np.array(chain)[lane], -1), station, offset)


def _directions(points: np.ndarray) -> np.ndarray:
    step = np.gradient(points)
    return step / np.maximum(np.abs(step), 1e-12)


def leaders(placed: Placed, lanes: Sequence[Lane]) -> tuple[np.ndarray, np.ndarray]:
    """Give of each sample who is ahead in its chain, -1 for nobody, and how far [m], centre to centre."""
    leader = np.full(placed.lane.shape, -1)
    distance = np.full(placed.lane.shape, np.inf)
    for k in range(placed.lane.shape[1]):
        on = np.flatnonzero(placed.lane[:, k] >= 0)
        order = on[np.lexsort((placed.station[on, k], placed.chain[on, k]))]
        for one, two in zip(order[:-1].tolist(), order[1:].tolist(), strict=True):
            if placed.chain[one, k] == placed.chain[two, k]:
                leader[one, k], distance[one, k] = two, placed.station[two, k] - placed.station[one, k]
    return leader, distance


def events(road: Path, tracks: Tracks, truth: pd.DataFrame) -> list[Event]:
    """Give everything that happens in a recording of a motorway, by what its truth says of lane changes."""
    lanes = read_lanes(road)
    placed = place(lanes, tracks)
    leader, distance = leaders(placed, lanes)
    out = []
    for row, name in enumerate(tracks.ids.tolist()):
        steps = np.flatnonzero(tracks.valid[row]).tolist()
        own = truth[truth["object"].astype(str) == name]
        out += _changes(name, row, steps, own, tracks, placed, (leader, distance))
        out += _tailgating(name, row, steps, tracks, placed, (leader, distance))
        out += _ramps(name, row, steps, tracks, placed, lanes)
        out += _runs(name, "standing", [abs(tracks.v[row, k]) <= 0.1 for k in steps], steps, tracks.t, 1.0)
        if tracks.a is not None:
            a = tracks.a[row]
            out += _runs(name, "strong_braking", [a[k] < -3.5 for k in steps], steps, tracks.t, 0.5, 0.3)
            out += _runs(name, "strong_acceleration", [a[k] > 2.5 for k in steps], steps, tracks.t, 0.5, 0.3)
        fast = own[own["label"] == "speeding"]
        out += _joined(name, "speeding", fast[["start", "end"]].itertuples(index=False, name=None), 1.0)
    return out


def _changes(
    name: str, row: int, steps: list[int], own: pd.DataFrame, tracks: Tracks, placed: Placed,
    led: tuple[np.ndarray, np.ndarray],
) -> Iterator[Event]:  # fmt: skip
    """Lane changes, where both of Kaefer's ends are seen, and the cut-ins and cut-outs among them."""
    t, v, off = tracks.t, tracks.v, np.abs(placed.offset[row])
    leader, distance = led
    for one in own[own["label"].str.startswith("lane_change")].itertuples():
        after = [k for k in steps if t[k] >= one.t - 1e-9]
        before = [k for k in steps if t[k] < one.t - 1e-9]
        end = next((k for k in after if off[k] < CLOSE), None)
        start = next((k for k in reversed(before) if off[k] < CLOSE), None)
        if end is None or start is None:
            yield name, "lane_change_not_judged", max(one.start, t[steps[0]]), min(one.end, t[steps[-1]])
            continue
        side = one.label.rpartition("_")[2]
        yield name, one.label, one.start, one.end
        crossed = after[0]
        closing = False
        for k in range(crossed, end + 1):
            behind = np.flatnonzero(leader[:, k] == row)
            for n in behind.tolist():
                closing |= 0.0 < distance[n, k] < TTC * (v[n, k] - v[row, k])
        if closing:
            yield name, f"cut_in_{side}", t[start], t[end]
        closing = False
        for k in range(start, crossed):
            n = leader[row, k]
            closing |= n >= 0 and bool(0.0 < distance[row, k] < TTC * (v[row, k] - v[n, k]))
        if closing:
            yield name, f"cut_out_{side}", t[start], t[end]


def severity(distance: float, v: float) -> int:
    """Table 4.3 on the open road: 0 none, 1 minor, 2 moderate, 3 severe; v in m/s."""
    kmh = 3.6 * v
    required = 0.5 * kmh
    if not distance < required:
        return 0
    if kmh < 80.0 or distance >= 0.5 * required:
        return 1
    return 3 if distance < 0.3 * required and kmh > 100.0 else 2


def _tailgating(
    name: str, row: int, steps: list[int], tracks: Tracks, placed: Placed, led: tuple[np.ndarray, np.ndarray]
) -> Iterator[Event]:
    """Table 4.3, with three seconds (one above 160 km/h) to restore the distance to who entered ahead."""
    names = ("", "tailgating_minor", "tailgating_moderate", "tailgating_severe")
    t, v, (leader, distance) = tracks.t, tracks.v[row], led
    last, until, now = -2, -math.inf, (0, -1)
    begin = 0.0
    previous = None
    for k in steps:
        ahead = int(leader[row, k])
        if ahead != last and previous is not None:
            entered = (
                ahead >= 0
                and placed.chain[row, previous] == placed.chain[row, k]
                and tracks.valid[ahead, previous]
                and placed.chain[ahead, previous] != placed.chain[ahead, k]
            )
            until = t[k] + (1.0 if 3.6 * v[k] > 160.0 else 3.0) if entered else -math.inf
        code = severity(float(distance[row, k]), float(v[k])) if ahead >= 0 else 0
        if ahead >= 0 and code == 0:
            until = -math.inf  # restored
        if t[k] < until - 1e-9:
            code = 0
        state = (code, ahead if code else -1)
        if state != now:
            if now[0]:
                yield name, names[now[0]], begin, float(t[previous])
            begin, now = float(t[k]), state
        last, previous = ahead, k
    if now[0]:
        yield name, names[now[0]], begin, float(t[steps[-1]])


def _ramps(
    name: str, row: int, steps: list[int], tracks: Tracks, placed: Placed, lanes: Sequence[Lane]
) -> Iterator[Event]:
    last, begun = "", 0.0
    for k in steps:
        if placed.lane[row, k] < 0:
            continue
        kind, now = CLASSES[lanes[placed.lane[row, k]].kind], float(tracks.t[k])
        if kind != last:
            if (last, kind) == ("on", "main"):
                yield name, "enter_highway", begun, now
            if (last, kind) == ("main", "off"):
                yield name, "exit_highway", now, now
            last, begun = kind, now


def _runs(
    name: str, label: str, holds: list[bool], steps: list[int], t: np.ndarray, join: float, least: float = 0.0
) -> Iterator[Event]:
    spans: list[tuple[float, float]] = []
    open_at: int | None = None
    for n, (k, held) in enumerate(zip(steps, holds, strict=True)):
        if held and open_at is None:
            open_at = k
        if open_at is not None and (not held or n == len(steps) - 1):
            spans.append((float(t[open_at]), float(t[k] if held else t[steps[n - 1]])))
            open_at = None
    yield from _joined(name, label, spans, join, least)


def _joined(
    name: str, label: str, spans: Iterable[tuple[float, float]], join: float, least: float = 0.0
) -> Iterator[Event]:
    """Spans as events: less than `join` [s] apart they are one, and those shorter than `least` [s] are none."""
    out: list[list[float]] = []
    for start, end in sorted(spans):
        if out and start - out[-1][1] <= join + 1e-9:
            out[-1][1] = max(out[-1][1], end)
        else:
            out.append([start, end])
    for start, end in out:
        if end - start >= least - 1e-9:
            yield name, label, start, end
