"""Lane changes and extraction as the texts say them, in plain loops over samples of a road with one curvature.

Nothing of resim is used. Wagner 2021, 6.2.1.1 to 6.2.1.3; Kaefer 2022, 4.5.6.2; readings as in the issue's notes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

WIDTH = 3.5


class Sample(NamedTuple):
    step: int
    s: float
    lane: int  # 1 is the leftmost, 0 beside the road
    offset: float  # from the lane's centre, left positive
    across: float  # m/s to the left
    stretch: float  # m of its lane's centre to a metre of s


class Change(NamedTuple):
    who: int
    start: int
    end: int
    gained: int


class Window(NamedTuple):
    ego: int
    start: int
    end: int
    members: tuple[int, ...]


def drives(
    t: list[float], x: list[list[float]], y: list[list[float]], lanes: int, bend: float = 0.0
) -> list[list[Sample]]:
    """Samples of each object, without those that are NaN: x along the road's line, y to the left of it [m].

    bend: 1/m to the left.
    """
    out = []
    for xs, ys in zip(x, y, strict=True):
        known = [k for k in range(len(t)) if xs[k] == xs[k]]
        own = []
        for n, k in enumerate(known):
            lane = int(-ys[k] // WIDTH) + 1
            if -ys[k] == WIDTH * (lane - 1) and lane > 1:
                lane -= 1
            if not 1 <= lane <= lanes:
                lane = 0
            before, after = known[max(n - 1, 0)], known[min(n + 1, len(known) - 1)]
            across = (ys[after] - ys[before]) / (t[after] - t[before])
            centre = -WIDTH * (lane - 0.5)
            offset = ys[k] - centre if lane else math.inf
            own.append(Sample(k, xs[k], lane, offset, across, 1.0 - bend * centre))
        out.append(own)
    return out


def lane_changes(who: int, own: list[Sample]) -> list[Change]:
    found: list[tuple[int, Change]] = []
    pairs = set()
    for k in range(1, len(own)):
        if own[k].lane == own[k - 1].lane or 0 in (own[k].lane, own[k - 1].lane):
            continue
        a = next((j for j in range(k - 1, -1, -1) if abs(own[j].offset) < 1.0), None)
        b = next((j for j in range(k, len(own)) if abs(own[j].offset) < 1.0), None)
        if a is None or b is None or own[a].lane == own[b].lane:
            continue
        gained = own[a].lane - own[b].lane
        step = own[k - 1].lane - own[k].lane
        if step * gained < 0:
            continue
        side = 1 if gained > 0 else -1
        start = k
        while start > 0 and (start == k or side * own[start].across >= 0.03):
            start -= 1
        end = k
        while end < len(own) - 1 and side * own[end].across >= 0.03:
            end += 1
        if (a, b) in pairs:  # a border crossed more than once between the same two places
            at, before = found[-1]
            found[-1] = (
                at,
                Change(
                    who, min(before.start, own[start].step), max(before.end, own[end].step), before.gained
                ),
            )
            continue
        pairs.add((a, b))
        if found and found[-1][1].gained * gained > 0 and found[-1][1].end >= own[k].step:
            at, before = found[-1]
            found[-1] = at, Change(who, before.start, max(before.end, own[end].step), before.gained + gained)
        else:
            found.append((k, Change(who, own[start].step, own[end].step, gained)))
    return [change for _, change in found]


def slot_holders(ego: Sample, others: dict[int, Sample]) -> set[int]:
    """Who holds one of the eight slots."""
    best: dict[tuple[int, int], tuple[float, int]] = {}
    for who, other in others.items():
        side, ahead = other.lane - ego.lane, (other.s - ego.s) * ego.stretch
        if other.lane == 0 or ego.lane == 0 or abs(side) > 1 or ahead > 100.0 or ahead < -50.0:
            continue
        zone = 0 if abs(ahead) <= 5.0 else 1 if ahead > 0.0 else -1
        if side == 0 and zone == 0:
            continue
        rank = abs(ahead), who
        if (side, zone) not in best or rank < best[side, zone]:
            best[side, zone] = rank
    return {who for _, who in best.values()}


def windows(objects: list[list[Sample]]) -> list[Window]:
    changes = [change for who, own in enumerate(objects) for change in lane_changes(who, own)]
    at: dict[int, dict[int, Sample]] = {}
    for who, own in enumerate(objects):
        for sample in own:
            at.setdefault(sample.step, {})[who] = sample
    out = []
    for ego, own in enumerate(objects):
        around = {}
        for sample in own:
            others = {who: other for who, other in at[sample.step].items() if who != ego}
            around[sample.step] = slot_holders(sample, others)
        seen = [c for c in changes if c.who != ego
                and any(c.who in around.get(step, ()) for step in range(c.start, c.end + 1))]  # fmt: skip
        spans: list[list[int]] = []
        for change in sorted(seen, key=lambda c: (c.start, c.end)):
            if spans and change.start <= spans[-1][1]:
                spans[-1][1] = max(spans[-1][1], change.end)
            else:
                spans.append([change.start, change.end])
        for start, end in spans:
            members = {who for step in range(start, end + 1) for who in around.get(step, ())}
            out.append(Window(ego, start, end, tuple(sorted(members))))
    return out
