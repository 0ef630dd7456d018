"""What objects do, told from their places in lanes by plain loops over samples, from the texts that the labels name.

Nothing of `resim.mining` or `resim.scenario.maneuvers` is used. Kaefer 2022, 4.5.6.2 to 4.5.6.9, Table 4.3 and Appendix
1; Wagner 2021, 6.2.1.1; readings and numbers as in scenarios/mining/labels.toml. Which lane each sample is on is given:
tools/mining_oracle.py knows it of traffic by lanes of points, tools/mining_plants.py by how drives were planted.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import shapely

CLOSE, ACROSS, TTC = 1.0, 0.03, 2.0
LOOK, NEAR = 250.0, 12.0
"""m up to which somebody is ahead, and at which somebody may be passed."""
Event = tuple[str, str, float, float]
"""Object, label, start and end [s]."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Objects (N) at times t (T,) [s], in their lanes.

    valid, x, y, heading, v, a (N, T): as in Tracks; a by differences where it was not recorded. lane: -1 for none.
    chain, station: what goes on from lane to lane, and m along it. offset, aside: m to the left of the lane's centre,
    and of the first lane's, as it goes on. rel: rad that it is headed to the left of the lane. side: how many lanes to
    the right of the leftmost it is on. left, right: by lane, that next to it, driven the same way. kind: by lane, class
    of its road ("on", "off", "main", "other" or ""). limit [m/s], town, inside (of a junction): (N, T).
    """

    names: Sequence[str]
    kinds: Sequence[str]
    length: np.ndarray
    width: np.ndarray
    t: np.ndarray
    valid: np.ndarray
    x: np.ndarray
    y: np.ndarray
    heading: np.ndarray
    v: np.ndarray
    a: np.ndarray
    lane: np.ndarray
    chain: np.ndarray
    station: np.ndarray
    offset: np.ndarray
    aside: np.ndarray
    rel: np.ndarray
    side: np.ndarray
    left: Sequence[int]
    right: Sequence[int]
    kind: Sequence[str]
    limit: np.ndarray
    town: np.ndarray
    inside: np.ndarray

    def steps(self, row: int) -> list[int]:
        """Give when an object is there."""
        return np.flatnonzero(self.valid[row]).tolist()

    def motor(self, row: int) -> bool:
        """Say whether an object is of a kind that maneuvers are found of."""
        return self.kinds[row] not in ("pedestrian", "bicycle", "animal", "obstacle")

    def against(self, row: int, k: int) -> bool:
        """Say whether an object is headed against its lane."""
        return math.cos(self.rel[row, k]) < 0.0


@dataclass(frozen=True)
class Change:
    """A lane change: when it begins, crosses, ends [s]; Kaefer's samples; lanes to the left, None if not judged."""

    start: float
    at: float
    end: float
    before: int | None = None
    after: int | None = None
    lanes: int | None = None

    @property
    def label(self) -> str:
        """As mined labels are named."""
        if self.lanes is None:
            return "lane_change_not_judged"
        return f"lane_change_{'left' if self.lanes > 0 else 'right'}"


def differences(t: np.ndarray, values: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Give the slopes (N, T) of values (N, T) from the sample before to the one after."""
    out = np.full(values.shape, np.nan)
    for row in range(len(values)):
        k = np.flatnonzero(valid[row])
        if len(k) > 1:
            low, high = np.r_[k[:1], k[:-1]], np.r_[k[1:], k[-1:]]
            out[row, k] = (values[row, high] - values[row, low]) / (t[high] - t[low])
    return out


def leaders(seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    """Give of each sample (N, T) who is ahead in its chain, -1 for nobody, and how far [m], centre to centre."""
    leader, distance = np.full(seen.lane.shape, -1), np.full(seen.lane.shape, np.inf)
    drives = np.array([kind not in ("pedestrian", "animal", "obstacle") for kind in seen.kinds])
    for k in range(len(seen.t)):
        on = np.flatnonzero((seen.lane[:, k] >= 0) & drives)
        order = on[np.lexsort((seen.station[on, k], seen.chain[on, k]))]
        for one, two in zip(order[:-1].tolist(), order[1:].tolist(), strict=True):
            far = seen.station[two, k] - seen.station[one, k]
            if seen.chain[one, k] == seen.chain[two, k] and far <= LOOK and not seen.against(one, k):
                leader[one, k], distance[one, k] = two, far
    return leader, distance


def driving(
    seen: Seen,
    row: int,
    changes: Sequence[Change],
    led: tuple[np.ndarray, np.ndarray],
    *,
    limits: bool = True,
) -> Iterator[Event]:
    """Give what a vehicle does that changes lanes so, by `leaders`; limits: whether the limits of the map are known."""
    for change in changes:
        yield seen.names[row], change.label, change.start, change.end
        yield from cuts(seen, row, change, led)
    for rule in (tailgating, critical):
        yield from rule(seen, row, led)
    for rule in (ramps, passes, wrong_way, swerving):
        yield from rule(seen, row)
    yield from speeds(seen, row, limits)
    yield from follow_lane(seen, row, changes)


def lane_changes(seen: Seen, row: int, across: np.ndarray) -> list[Change]:
    """Give the lane changes of one object, from its lanes, offsets and speed across (K,) [m/s] alone."""
    steps, side, off = seen.steps(row), seen.side[row], np.abs(seen.offset[row])
    out: list[Change] = []
    ends: list[tuple[int | None, int | None]] = []
    for n in range(1, len(steps)):
        k, last = steps[n], steps[n - 1]
        if side[k] == side[last] or seen.lane[row, k] < 0 or seen.lane[row, last] < 0:
            continue
        before = next((j for j in reversed(steps[:n]) if off[j] < CLOSE), None)
        after = next((j for j in steps[n:] if off[j] < CLOSE), None)
        way = 1.0 if side[k] < side[last] else -1.0
        low = high = n
        while low > 0 and (low == n or way * across[steps[low]] >= ACROSS):
            low -= 1
        while high < len(steps) - 1 and way * across[steps[high]] >= ACROSS:
            high += 1
        start, end, at = (float(seen.t[steps[j]]) for j in (low, high, n))
        lanes = None
        if before is not None and after is not None:
            lanes = int(side[before] - side[after])
            if lanes * way <= 0.0:  # swaying over the border and back, or away from the new lane
                continue
        if out and ends[-1] == (before, after):
            out[-1] = Change(
                min(out[-1].start, start), out[-1].at, max(out[-1].end, end), before, after, lanes
            )
        elif out and lanes and out[-1].lanes and out[-1].lanes * lanes > 0 and out[-1].end >= at:
            one = out[-1]
            out[-1] = Change(one.start, one.at, max(one.end, end), one.before, after, one.lanes + lanes)
            ends[-1] = before, after
        else:
            out.append(Change(start, at, end, before, after, lanes))
            ends.append((before, after))
    return out


def cuts(seen: Seen, row: int, change: Change, led: tuple[np.ndarray, np.ndarray]) -> Iterator[Event]:
    """The cut-in and the cut-out of a lane change, where somebody closes in by less than two seconds."""
    if change.lanes is None or change.before is None or change.after is None:
        return
    leader, distance = led
    t, v, side = seen.t, seen.v, change.label.rpartition("_")[2]
    begin, end = min(change.start, float(t[change.before])), max(change.end, float(t[change.after]))
    crossed = next(k for k in seen.steps(row) if t[k] >= change.at - 1e-9)
    closing = False
    for k in range(crossed, change.after + 1):
        for n in np.flatnonzero(leader[:, k] == row).tolist():
            closing |= 0.0 < distance[n, k] < TTC * (v[n, k] - v[row, k])
    if closing:
        yield seen.names[row], f"cut_in_{side}", begin, end
    closing = False
    for k in range(change.before, crossed):
        n = leader[row, k]
        closing |= n >= 0 and bool(0.0 < distance[row, k] < TTC * (v[row, k] - v[n, k]))
    if closing:
        yield seen.names[row], f"cut_out_{side}", begin, end


def severity(distance: float, v: float, town: bool = False) -> int:
    """Table 4.3: 0 none, 1 minor, 2 moderate, 3 severe; v in m/s."""
    kmh = 3.6 * v
    required = v if town else 0.5 * kmh
    if not distance < required:
        return 0
    if kmh < 80.0 or distance >= 0.5 * required:
        return 1
    return 3 if distance < 0.3 * required and kmh > 100.0 else 2


def tailgating(seen: Seen, row: int, led: tuple[np.ndarray, np.ndarray]) -> Iterator[Event]:
    """Table 4.3, with three seconds (one above 160 km/h) to restore the distance to who entered ahead."""
    names = ("", "tailgating_minor", "tailgating_moderate", "tailgating_severe")
    t, v, (leader, distance) = seen.t, seen.v[row], led
    last, until, now = -2, -math.inf, (0, -1)
    begin, previous, steps = 0.0, None, seen.steps(row)
    for k in steps:
        ahead = int(leader[row, k])
        if ahead != last and previous is not None:
            entered = ahead >= 0 and _entered(seen, leader, row, ahead, last, previous, k)
            until = t[k] + (1.0 if 3.6 * v[k] > 160.0 else 3.0) if entered else -math.inf
        counts = ahead >= 0 and not seen.against(ahead, k)
        code = severity(float(distance[row, k]), float(v[k]), bool(seen.town[row, k])) if counts else 0
        if counts and code == 0:
            until = -math.inf  # restored
        if t[k] < until - 1e-9:
            code = 0
        state = (code, ahead if code else -1)
        if state != now:
            if now[0]:
                yield seen.names[row], names[now[0]], begin, float(t[previous])
            begin, now = float(t[k]), state
        last, previous = ahead, k
    if now[0]:
        yield seen.names[row], names[now[0]], begin, float(t[steps[-1]])


def _entered(seen: Seen, leader: np.ndarray, row: int, ahead: int, last: int, previous: int, k: int) -> bool:
    """Whether who is newly ahead came there from another lane, or squeezed in, and was there before."""
    chain = seen.chain
    if chain[row, previous] != chain[row, k] or not seen.valid[ahead, previous]:
        return False
    return bool(chain[ahead, previous] != chain[ahead, k] or (last >= 0 and leader[ahead, k] == last))


def critical(seen: Seen, row: int, led: tuple[np.ndarray, np.ndarray]) -> Iterator[Event]:
    """Less than 1.5 s to collision, or 0.5 s of headway, from bumper to bumper; to each leader on its own."""
    leader, distance = led
    steps = seen.steps(row)
    for label in ("critical_ttc", "critical_thw"):
        for ahead in sorted({int(leader[row, k]) for k in steps} - {-1}):
            holds = []
            for k in steps:
                gap = max(distance[row, k] - 0.5 * (seen.length[row] + seen.length[ahead]), 0.0)
                closing = seen.v[row, k] - seen.v[ahead, k] if label == "critical_ttc" else seen.v[row, k]
                limit = 1.5 if label == "critical_ttc" else 0.5
                holds.append(bool(leader[row, k] == ahead and closing > 0.0 and gap / closing < limit))
            yield from runs(seen.names[row], label, holds, steps, seen.t, 0.5)


def ramps(seen: Seen, row: int) -> Iterator[Event]:
    """From a ramp, or a road of another type, onto a motorway, and off it."""
    last, begun = "", 0.0
    for k in seen.steps(row):
        lane = seen.lane[row, k]
        if lane < 0 or not seen.kind[lane]:
            continue
        kind, now = seen.kind[lane], float(seen.t[k])
        if kind != last:
            if (last, kind) in (("on", "main"), ("other", "main")):
                yield seen.names[row], "enter_highway", begun if last == "on" else now, now
            if (last, kind) in (("main", "off"), ("main", "other")):
                yield seen.names[row], "exit_highway", now, now
            last, begun = kind, now


def passes(seen: Seen, row: int) -> Iterator[Event]:
    """Going by somebody on the next lane: who was ahead of its middle, and is so no more. A plain loop over others."""
    t, v = seen.t, seen.v
    for last, k in zip(seen.steps(row)[:-1], seen.steps(row)[1:], strict=True):
        own = seen.lane[row, last], seen.lane[row, k]
        if min(own) < 0 or v[row, k] < 1.0 or seen.against(row, k) or seen.against(row, last):
            continue
        near = (np.abs(seen.x[:, k] - seen.x[row, k]) <= NEAR) & (
            np.abs(seen.y[:, k] - seen.y[row, k]) <= NEAR
        )
        for other in np.flatnonzero(near & seen.valid[:, last]).tolist():
            if other == row:
                continue
            if seen.kinds[other] == "pedestrian" or not _ahead(seen, row, other, last) > 0.0 >= _ahead(
                seen, row, other, k
            ):
                continue
            if not v[other, k] < v[row, k] or seen.against(other, k):
                continue
            theirs = int(seen.lane[other, last]), int(seen.lane[other, k])
            if _beside(seen.right, own, theirs):
                yield seen.names[row], "pass", float(t[k]), float(t[k])
            elif _beside(seen.left, own, theirs) and v[other, k] >= 1.0:
                yield seen.names[row], "overtaking_right", float(t[k]), float(t[k])


def _ahead(seen: Seen, row: int, other: int, k: int) -> float:
    """How far [m] another one's middle is ahead, along the lane's direction at one's own; NaN far away."""
    dx, dy = seen.x[other, k] - seen.x[row, k], seen.y[other, k] - seen.y[row, k]
    if abs(dx) > NEAR or abs(dy) > NEAR:
        return math.nan
    lane = seen.heading[row, k] - seen.rel[row, k]
    return float(dx * math.cos(lane) + dy * math.sin(lane))


def _beside(table: Sequence[int], own: tuple[int, int], theirs: tuple[int, int]) -> bool:
    return all(theirs[n] >= 0 and table[own[n]] == theirs[n] for n in range(2))


def follow_lane(seen: Seen, row: int, changes: Sequence[Change]) -> Iterator[Event]:
    """Two seconds or more in one lane, as it goes on, faster than 0.1 m/s, between lane changes."""
    steps = seen.steps(row)
    spans = [(one.start, one.end) for one in changes]
    begin: int | None = None
    for n, k in enumerate(steps):
        holds = seen.lane[row, k] >= 0 and seen.v[row, k] > 0.1
        holds = holds and not any(a - 1e-9 <= seen.t[k] <= b + 1e-9 for a, b in spans)
        same = begin is not None and holds and seen.side[row, k] == seen.side[row, steps[n - 1]]
        if begin is not None and not same:
            if seen.t[steps[n - 1]] - seen.t[steps[begin]] >= 2.0 - 1e-9:
                yield seen.names[row], "follow_lane", float(seen.t[steps[begin]]), float(seen.t[steps[n - 1]])
            begin = None
        if holds and begin is None:
            begin = n
    if begin is not None and seen.t[steps[-1]] - seen.t[steps[begin]] >= 2.0 - 1e-9:
        yield seen.names[row], "follow_lane", float(seen.t[steps[begin]]), float(seen.t[steps[-1]])


def wrong_way(seen: Seen, row: int) -> Iterator[Event]:
    """Forward against a lane's direction outside of junctions for a second or longer, but for overtaking."""
    steps, t = seen.steps(row), seen.t
    holds = [
        bool(
            seen.lane[row, k] >= 0
            and seen.against(row, k)
            and seen.v[row, k] > 1.0
            and not seen.inside[row, k]
        )
        for k in steps
    ]
    for start, end in spans(holds):
        lasts = float(t[steps[end]] - t[steps[start]])
        over = start > 0 and end + 1 < len(steps)
        over = over and seen.side[row, steps[start - 1]] != seen.side[row, steps[start]]
        over = over and seen.side[row, steps[end + 1]] != seen.side[row, steps[end]]
        over = over and not seen.against(row, steps[end + 1])
        if lasts >= 1.0 and not (over and lasts <= 20.0):
            yield seen.names[row], "wrong_way", float(t[steps[start]]), float(t[steps[end]])


def swerving(seen: Seen, row: int) -> Iterator[Event]:
    """Three ways or more of a metre across the lane, to and fro, within 10 s but for 0.3 of the first and the last."""
    steps, aside = seen.steps(row), seen.aside[row]
    ways = swings([float(aside[k]) for k in steps], 1.0)
    many: list[tuple[float, float]] = []
    for n in range(len(ways) - 2):
        start, end = float(seen.t[steps[ways[n][0]]]), float(seen.t[steps[ways[n + 2][1]]])
        if end - start <= 10.0 + 1e-9:
            if many and start < many[-1][1]:
                many[-1] = many[-1][0], end
            else:
                many.append((start, end))
    yield from ((seen.names[row], "swerving", start, end) for start, end in many)


def swings(values: Sequence[float], least: float) -> list[tuple[int, int]]:
    """Give where each way of `least` or more, up or down as far as it goes, is done to 0.3, and to 0.7."""
    kept: list[int] = []  # places between which values go up and down in turn, by `least` or more
    low = high = 0
    for n, value in enumerate(values):
        if len(kept) < 2:
            low, high = (n if value < values[low] else low), (n if value > values[high] else high)
            far = max(low, high, key=lambda m: abs(value - values[m]))
            kept = [far, n] if abs(value - values[far]) >= least else []
            continue
        up = values[kept[-1]] > values[kept[-2]]
        if (value > values[kept[-1]]) if up else (value < values[kept[-1]]):
            kept[-1] = n
        elif abs(value - values[kept[-1]]) >= least:
            kept.append(n)
    out = []
    for one, other in pairwise(kept):
        done = [(values[k] - values[one]) / (values[other] - values[one]) for k in range(one, other + 1)]
        part = [next(k for k, share in enumerate(done) if share >= least_done) for least_done in (0.3, 0.7)]
        out.append((one + part[0], one + part[1]))
    return out


def on_foot(seen: Seen, row: int) -> Iterator[Event]:
    """Pedestrians and cyclists across driven lanes, pedestrians along them, and vehicles that back up."""
    steps, kind = seen.steps(row), seen.kinds[row]
    slanted = [abs(math.sin(seen.rel[row, k])) > math.sqrt(0.5) for k in steps]
    moves = [bool(seen.lane[row, k] >= 0 and abs(seen.v[row, k]) > 0.2) for k in steps]
    if kind in ("pedestrian", "bicycle"):
        holds = [one and two for one, two in zip(moves, slanted, strict=True)]
        yield from runs(seen.names[row], "crossing_road", holds, steps, seen.t, 1.0, 0.5)
    if kind == "pedestrian":
        holds = [one and not two for one, two in zip(moves, slanted, strict=True)]
        yield from runs(seen.names[row], "walking_on_road", holds, steps, seen.t, 1.0, 0.5)
    if seen.motor(row):
        holds = [bool(seen.v[row, k] < -0.2) for k in steps]
        yield from runs(seen.names[row], "reversing", holds, steps, seen.t, 1.0, 0.5)


def collisions(seen: Seen) -> Iterator[Event]:
    """Boxes that overlap or touch, told of both; pairs that never come near are passed over."""
    for n, m in combinations(range(len(seen.names)), 2):
        both = np.flatnonzero(seen.valid[n] & seen.valid[m])
        reach = 0.5 * (math.hypot(seen.length[n], seen.width[n]) + math.hypot(seen.length[m], seen.width[m]))
        away = np.hypot(seen.x[n, both] - seen.x[m, both], seen.y[n, both] - seen.y[m, both])
        near = both[away <= reach]
        holds = [bool(_box(seen, n, k).intersects(_box(seen, m, k))) for k in near.tolist()]
        for start, end in spans(holds):
            for who in (n, m):
                yield seen.names[who], "collision", float(seen.t[near[start]]), float(seen.t[near[end]])


def _box(seen: Seen, row: int, k: int) -> shapely.Polygon:
    turn = np.exp(1j * seen.heading[row, k])
    half = 0.5 * seen.length[row], 0.5 * seen.width[row]
    corners = [complex(a * half[0], b * half[1]) * turn for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return shapely.Polygon([(c.real + seen.x[row, k], c.imag + seen.y[row, k]) for c in corners])


def speeds(seen: Seen, row: int, limits: bool = True) -> Iterator[Event]:
    """Speeding, standing, and what changes the speed by more than 3.5 m/s, or 2.5 m/s, within a second."""
    steps, name, t = seen.steps(row), seen.names[row], seen.t
    a = differences(t, seen.v[row : row + 1], seen.valid[row : row + 1])[0]
    if limits:
        fast = [bool(seen.v[row, k] > seen.limit[row, k]) for k in steps]
        yield from runs(name, "speeding", fast, steps, t, 1.0)
    yield from runs(name, "standing", [abs(seen.v[row, k]) <= 0.1 for k in steps], steps, t, 1.0)
    for label, sign, limit in (("strong_braking", -1.0, 3.5), ("strong_acceleration", 1.0, 2.5)):
        within = [False] * len(steps)
        for one, k in enumerate(steps):
            for other in range(one + 1, len(steps)):
                if t[steps[other]] - t[k] > 1.0 + 1e-9:
                    break
                if sign * (seen.v[row, steps[other]] - seen.v[row, k]) > limit:
                    within[one : other + 1] = [True] * (other + 1 - one)
        for start, end in spans(within):
            inside = steps[start : end + 1]
            beyond = [k for k in inside if sign * a[k] > limit] or inside
            yield name, label, float(t[beyond[0]]), float(t[beyond[-1]])


def spans(holds: Sequence[bool]) -> list[tuple[int, int]]:
    """Give the first and the last of each stretch that holds."""
    out: list[tuple[int, int]] = []
    for n, held in enumerate(holds):
        if held and n and holds[n - 1]:
            out[-1] = out[-1][0], n
        elif held:
            out.append((n, n))
    return out


def runs(
    name: str, label: str, holds: Sequence[bool], steps: Sequence[int], t: np.ndarray, join: float,
    least: float = 0.0,
) -> Iterator[Event]:  # fmt: skip
    """Stretches that hold as events."""
    told = [(float(t[steps[a]]), float(t[steps[b]])) for a, b in spans(holds)]
    yield from joined(name, label, told, join, least)


def joined(
    name: str, label: str, told: Iterable[tuple[float, float]], join: float, least: float = 0.0
) -> Iterator[Event]:
    """Spans as events: less than `join` [s] apart they are one, and those shorter than `least` [s] are none."""
    out: list[list[float]] = []
    for start, end in sorted(told):
        if out and start - out[-1][1] <= join + 1e-9:
            out[-1][1] = max(out[-1][1], end)
        else:
            out.append([start, end])
    for start, end in out:
        if end - start >= least - 1e-9:
            yield name, label, start, end
