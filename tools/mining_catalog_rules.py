"""What objects do by the rows of Kaefer's catalogs (2022, Appendix 1), told by plain loops over samples.

As tools/mining_rules.py: nothing of `resim.mining` is used; readings are those of docs/guides/mine.md, numbers those of
scenarios/mining/labels.toml.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from mining_rules import Event, Seen, collisions, differences, joined, runs, spans

STILL = 0.2
"""m/s up to which nobody moves."""
RUNNING, STAYING, STAYING_RADIUS, CROWD, CROWD_RADIUS = 2.5, 5.0, 3.0, 5, 10.0
STARTING, STARTING_WITHIN = 2.0, 5.0
SLIP, SLIP_SPEED = 0.26, 8.0
STOP_SPEED, STOP_BEFORE, NEAR = 0.5, 20.0, 50.0
LATELY, ALONG, ACROSS, STRAIGHT_ON = 3.0, 0.52, 0.79, 0.52
EIGHTH = 0.25 * math.pi
"""rad: who comes from a side, or from ahead, comes within so much of it."""


@dataclass(frozen=True, eq=False)
class Through:
    """How somebody passes a junction: its name, where it begins and ends along its line, and places (T,) by time [m].

    heading: rad of the line where it begins; turn: rad that it turns; headings are in the map's frame.
    """

    junction: str
    begin: float
    end: float
    heading: float
    turn: float
    way: np.ndarray


def wrapped(angle: float) -> float:
    """Give an angle [rad] between -pi and pi."""
    return math.remainder(angle, 2.0 * math.pi)


def on_foot(seen: Seen, row: int) -> Iterator[Event]:
    """Who runs across the road or stays on it, and cyclists along it."""
    steps, kind, name = seen.steps(row), seen.kinds[row], seen.names[row]
    slanted = [abs(math.sin(seen.rel[row, k])) > math.sqrt(0.5) for k in steps]
    moves = [bool(seen.lane[row, k] >= 0 and abs(seen.v[row, k]) > STILL) for k in steps]
    if kind == "bicycle":
        holds = [one and not two for one, two in zip(moves, slanted, strict=True)]
        yield from runs(name, "cycling_on_road", holds, steps, seen.t, 1.0, 0.5)
    if kind != "pedestrian":
        return
    holds = [one and two for one, two in zip(moves, slanted, strict=True)]
    for _, _, start, end in runs(name, "", holds, steps, seen.t, 1.0, 0.5):
        if max(abs(seen.v[row, k]) for k in steps if start <= seen.t[k] <= end) >= RUNNING:
            yield name, "running_onto_road", start, end
    told = []
    for n, k in enumerate(steps):
        later = next((j for j in steps[n:] if seen.t[j] - seen.t[k] >= STAYING - 1e-9), None)
        if later is None:
            break
        way = math.hypot(seen.x[row, later] - seen.x[row, k], seen.y[row, later] - seen.y[row, k])
        if way <= STAYING_RADIUS and all(seen.lane[row, j] >= 0 for j in steps[n : steps.index(later) + 1]):
            told.append((float(seen.t[k]), float(seen.t[later])))
    yield from joined(name, "staying_on_road", told, 1.0)


def crowd(seen: Seen, row: int) -> Iterator[Event]:
    """Driving with five pedestrians or more around."""
    steps, walks = seen.steps(row), [n for n, kind in enumerate(seen.kinds) if kind == "pedestrian"]
    holds = []
    for k in steps:
        away = [
            math.hypot(seen.x[n, k] - seen.x[row, k], seen.y[n, k] - seen.y[row, k])
            for n in walks if seen.valid[n, k]
        ]  # fmt: skip
        holds.append(abs(seen.v[row, k]) > STILL and sum(one <= CROWD_RADIUS for one in away) >= CROWD)
    yield from runs(seen.names[row], "through_crowd", holds, steps, seen.t, 1.0, 0.5)


def starting(seen: Seen, row: int) -> Iterator[Event]:
    """Driving off on a lane: from the last sample of standing until 2 m/s, reached within five seconds."""
    steps = seen.steps(row)
    still = [abs(seen.v[row, k]) <= 0.1 for k in steps]
    for _, _, _, end in runs(seen.names[row], "", still, steps, seen.t, 1.0):
        last = next(k for k in steps if seen.t[k] >= end - 1e-9)
        after = [k for k in steps if seen.t[k] >= end - 1e-9 and seen.t[k] <= end + STARTING_WITHIN]
        fast = next((k for k in after if seen.v[row, k] >= STARTING), None)
        if seen.lane[row, last] >= 0 and fast is not None:
            yield seen.names[row], "starting", end, float(seen.t[fast])


def skidding(seen: Seen) -> Iterator[Event]:
    """Moving across the own heading by 15 degrees or more, faster than 8 m/s."""
    speeds = [differences(seen.t, values, seen.valid) for values in (seen.x, seen.y)]
    for row, name in enumerate(seen.names):
        if not seen.motor(row):
            continue
        holds = []
        for k in seen.steps(row):
            vx, vy = float(speeds[0][row, k]), float(speeds[1][row, k])
            slip = abs(wrapped(math.atan2(vy, vx) - seen.heading[row, k])) if math.isfinite(vx) else 0.0
            slip = min(slip, math.pi - slip)
            holds.append(math.hypot(vx, vy) > SLIP_SPEED and slip >= SLIP)
        yield from runs(name, "skidding", holds, seen.steps(row), seen.t, 0.5, 0.3)


def edges(seen: Seen, row: int, kinds: tuple[str, str], left: float) -> Iterator[Event]:
    """Leaving the driven lanes at their side, and parking beside them.

    kinds: types of what lies to the left and right of them; left: m aside of their left edge.
    """
    steps, name, t = seen.steps(row), seen.names[row], seen.t
    for start, end in spans([seen.lane[row, k] < 0 for k in steps]):
        moving = [n for n in range(start, end + 1) if abs(seen.v[row, steps[n]]) > STILL]
        at = [kinds[0] if seen.aside[row, steps[n]] > left else kinds[1] for n in (start, end)]
        if start > 0 and at[0] == "parking":
            yield name, "enter_parking", float(t[steps[start - 1]]), float(t[steps[(moving or [start])[-1]]])
        elif start > 0 and abs(math.sin(seen.rel[row, steps[start - 1]])) <= math.sqrt(0.5):
            yield name, "leave_road", float(t[steps[start - 1]]), float(t[steps[end]])
        if end + 1 < len(steps) and at[1] == "parking":
            yield name, "leave_parking", float(t[steps[(moving or [end])[0]]]), float(t[steps[end + 1]])


def lanes_change(
    seen: Seen, row: int, way: np.ndarray, counts: Sequence[tuple[float, int]]
) -> Iterator[Event]:
    """Driving over places (m along the line, lanes more) where the road gets lanes or loses some; way (T,) [m]."""
    steps = seen.steps(row)
    for last, k in pairwise(steps):
        for at, change in counts:
            on = seen.lane[row, last] >= 0 and seen.lane[row, k] >= 0 and not seen.against(row, k)
            if on and way[last] < at <= way[k]:
                label = "road_widens" if change > 0 else "lane_ends"
                yield seen.names[row], label, float(seen.t[last]), float(seen.t[k])


def backing(
    seen: Seen, row: int, way: np.ndarray, crossings: Sequence[tuple[float, float]]
) -> Iterator[Event]:
    """Backing up in a crossing, or up to 20 m before or behind one: from the first to the last such sample."""
    steps = seen.steps(row)
    holds = [bool(seen.v[row, k] < -STILL) for k in steps]
    for _, _, start, end in runs(seen.names[row], "", holds, steps, seen.t, 1.0, 0.5):
        own = [k for k in steps if start <= seen.t[k] <= end and seen.lane[row, k] >= 0]
        near = [
            k for k in own
            if any(low - STOP_BEFORE <= way[k] <= high + STOP_BEFORE for low, high in crossings)
        ]  # fmt: skip
        if near:
            yield seen.names[row], "reversing_at_junction", float(seen.t[near[0]]), float(seen.t[near[-1]])


def stop_sign(seen: Seen, row: int, way: np.ndarray, begin: float, end: float) -> Iterator[Event]:
    """Not stopping in the last 20 m before a junction from `begin` to `end` [m] that is passed."""
    steps = seen.steps(row)
    inside = [k for k in steps if begin <= way[k] <= end]
    if not inside or way[steps[0]] >= begin or way[steps[-1]] <= end:
        return
    near = [k for k in steps if begin - STOP_BEFORE <= way[k] < begin]
    if near and min(seen.v[row, k] for k in near) > STOP_SPEED:
        yield seen.names[row], "run_stop_sign", float(seen.t[near[0]]), float(seen.t[inside[0]])


def crashes(seen: Seen, ways: Sequence[Through | None]) -> Iterator[Event]:
    """How collisions of vehicles came about; told of both."""
    told = list(collisions(seen))
    for (one, _, start, end), (two, _, _, _) in zip(told[::2], told[1::2], strict=True):
        n, m = list(seen.names).index(one), list(seen.names).index(two)
        if not (seen.motor(n) and seen.motor(m)):
            continue
        k = int(np.argmin(np.abs(seen.t - start)))
        for own, other in ((n, m), (m, n)):
            label = crash(seen, ways, own, other, k)
            if label:
                yield seen.names[own], label, start, end


def crash(seen: Seen, ways: Sequence[Through | None], own: int, other: int, k: int) -> str:
    """Give the label of how two collide at sample k, told of the first; "" for none."""
    passes = [_lately(seen, ways[row], row, k) for row in (own, other)]
    if passes[0] and passes[1] and passes[0].junction == passes[1].junction:
        off = abs(wrapped(float(seen.heading[own, k] - seen.heading[other, k])))
        return crossing_paths(passes[0], passes[1], off)
    off = abs(wrapped(float(seen.heading[other, k] - seen.heading[own, k])))
    turn = np.exp(-1j * seen.heading[own, k])
    apart = complex(seen.x[other, k] - seen.x[own, k], seen.y[other, k] - seen.y[own, k]) * turn
    along = 0.5 * (seen.length[own] + seen.length[other]) - abs(apart.real)
    across = 0.5 * (seen.width[own] + seen.width[other]) - abs(apart.imag)
    return "sideswipe" if off <= ALONG and along > across else ""


def crossing_paths(own: Through, other: Through, off: float) -> str:
    """Give how the paths of two cross, told of the first one; off [rad]: between their headings as they touch."""
    side = math.degrees(wrapped(other.heading - own.heading))
    turns = [
        "straight" if abs(one.turn) <= STRAIGHT_ON else "left" if one.turn > 0.0 else "right"
        for one in (own, other)
    ]
    ahead, same = abs(side) > 135.0, abs(side) < 45.0
    from_left, from_right = -135.0 <= side <= -45.0, 45.0 <= side <= 135.0
    if same and (turns[0] == "straight") == (turns[1] == "straight"):
        return ""  # both came from one direction
    if turns[0] == "straight":
        if turns[1] != "straight":
            return ""  # told of who turns
        return "crash_straight_crossing" if from_left or from_right else "crash_other_crossing"
    if turns[1] == "straight" and turns[0] == "left":
        if ahead:
            return "crash_left_across_opposite"
        if from_left:
            return "crash_left_across_lateral"
        if from_right:
            return "crash_left_into_path"
    if turns[1] == "straight" and turns[0] == "right" and from_left:
        return "crash_right_across_lateral" if off >= ACROSS else "crash_right_into_path"
    return "crash_other_crossing"


def _lately(seen: Seen, way: Through | None, row: int, k: int) -> Through | None:
    """The way, if somebody was inside of the junction in the last three seconds."""
    if way is None:
        return None
    there = [j for j in seen.steps(row) if j <= k and seen.t[j] >= seen.t[k] - LATELY]
    return way if any(way.begin <= way.way[j] <= way.end for j in there) else None


def held_back(seen: Seen, other: int, way: Through, span: tuple[float, float]) -> bool:
    """Whether another one stands all the while, up to 50 m before a junction that its way crosses somebody's in."""
    steps = [k for k in range(len(seen.t)) if span[0] - 1e-9 <= seen.t[k] <= span[1] + 1e-9]
    return all(
        seen.valid[other, k] and abs(seen.v[other, k]) <= 0.1 and 0.0 < way.begin - way.way[k] <= NEAR
        for k in steps
    )
