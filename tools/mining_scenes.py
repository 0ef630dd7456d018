"""What is planted: a scene for each kind of label, drawn for the ground that it is planted on.

A scene is a function of a ground and a generator that gives a plant, or None where the ground has no room for it: no
lane beside, no limit, no such speed in its bends or on its length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from mining_ground import CLASSES, Ground, free_beside, same_way
from mining_plants import Drive, Plant, Profile, driven, quintic, stepped

Scene = Callable[[Ground, np.random.Generator], Plant | None]
ALONG, SLOWEST = 2.5, 4.0
"""m/s²: most that a bend asks of a drive; m/s: slowest that scenes of traffic are."""
MARGIN = 15.0
"""m of a ground that are kept free at its end."""
KMH = 3.6


def draw_speed(
    ground: Ground, rng: np.random.Generator, seconds: float, least: float = SLOWEST, most: float = 38.0,
    ahead: float = 0.0,
) -> float | None:  # fmt: skip
    """Draw a speed [m/s] that the ground has room for, below its limit; None for none. ahead: m needed besides."""
    top = min(most, (ground.length - MARGIN - ahead) / seconds, np.sqrt(ALONG / max(ground.bend, 1e-6)))
    if np.isfinite(ground.limit):
        top = min(top, 0.97 * ground.limit)
    return float(rng.uniform(max(least, 0.5 * top), top)) if top > least else None


def in_lane(ground: Ground, lane: int, rng: np.random.Generator) -> float:
    """Metres aside of a lane's centre, about its middle."""
    return ground.lanes[lane].centre + float(rng.uniform(-0.25, 0.25))


def constant(value: float) -> Profile:
    return lambda t: np.full_like(t, value)


def _pair(ground: Ground, rng: np.random.Generator, side: int, lanes: int = 1) -> tuple[int, int] | None:
    """Two lanes driven the same way, the second so many to the left (side 1) or right (-1) of the first."""
    own = same_way(ground)
    pairs = [(one, one - side * lanes) for one in own if one - side * lanes in own]
    return pairs[int(rng.integers(len(pairs)))] if pairs else None


def _change(
    ground: Ground, pair: tuple[int, int], begin: float, lasts: float, rng: np.random.Generator
) -> tuple[Profile, float]:
    """Aside by time of a lane change, and when [s] it crosses the border."""
    start = in_lane(ground, pair[0], rng)
    size = ground.lanes[pair[1]].centre + float(rng.uniform(-0.2, 0.2)) - start
    aside = stepped(start, (begin, lasts, size))
    fine = np.arange(begin, begin + lasts, 1e-3)
    lane = ground.lanes[pair[0]]
    beyond = aside(fine) > lane.left if size > 0.0 else aside(fine) < lane.right
    return aside, float(fine[int(np.argmax(beyond))])


def lane_change(side: int, lanes: int = 1) -> Scene:
    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        pair = _pair(ground, rng, side, lanes)
        lasts = float(rng.uniform(3.5, 6.0)) * lanes**0.5
        v = draw_speed(ground, rng, lasts + 6.0)
        if pair is None or v is None:
            return None
        begin = float(rng.uniform(2.0, 3.5))
        aside, at = _change(ground, pair, begin, lasts, rng)
        name = f"lane_change_{'left' if side > 0 else 'right'}"
        return Plant(ground, [Drive("a", driven(0.0, v), aside, lasts + 6.0)], [("a", name, at, at)])

    return scene


def not_judged(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """The track ends, or begins, in the middle of a lane change."""
    side = int(rng.choice([-1, 1]))
    pair, v = _pair(ground, rng, side), draw_speed(ground, rng, 10.0)
    if pair is None or v is None:
        return None
    aside, at = _change(ground, pair, 4.0, 5.0, rng)
    drive = Drive("a", driven(0.0, v), aside, 10.0)
    shift = float(rng.uniform(0.05, 0.25))
    late = rng.random() < 0.5
    drive = replace(drive, end=at + shift) if late else replace(drive, start=at - shift)
    return Plant(ground, [drive], [("a", "lane_change_not_judged", at, at)])


def cut_in(side: int) -> Scene:
    """Somebody changes lane in front of a faster one, who is less than two seconds away; both mind it then."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        pair = _pair(ground, rng, side)
        faster, seconds = float(rng.uniform(5.0, 9.0)), 10.0
        away = faster * float(rng.uniform(1.75, 1.95))
        v = draw_speed(ground, rng, seconds + 2.0, ahead=faster * 4.0 + 10.0)
        if pair is None or v is None:
            return None
        lasts = float(rng.uniform(3.0, 4.5))
        aside, at = _change(ground, pair, 2.0, lasts, rng)
        share, until = float(rng.uniform(0.4, 0.7)), 1.9 * (away - 7.0) / faster
        start = faster * at  # the follower is at 0 at first
        changer = driven(start + away, v, (at, until, (1.0 - share) * faster))
        follower = driven(0.0, v + faster, (at, until, -share * faster))
        drives = [
            Drive("a", changer, aside, seconds),
            Drive("b", follower, constant(in_lane(ground, pair[1], rng)), seconds),
        ]
        return Plant(ground, drives, [("a", f"cut_in_{'left' if side > 0 else 'right'}", at, at)])

    return scene


def cut_out(side: int) -> Scene:
    """Somebody leaves the lane of a slower one, less than two seconds before it would be reached."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        pair, faster, seconds = _pair(ground, rng, side), float(rng.uniform(6.0, 9.0)), 8.0
        v = draw_speed(ground, rng, seconds + 1.0, least=faster + 3.0)
        if pair is None or v is None:
            return None
        aside, at = _change(ground, pair, 2.0, float(rng.uniform(2.5, 3.2)), rng)
        away = faster * float(rng.uniform(1.45, 1.85))
        slow = driven(faster * at + away, v - faster)
        drives = [
            Drive("a", driven(0.0, v), aside, seconds),
            Drive("b", slow, constant(in_lane(ground, pair[0], rng)), seconds),
        ]
        told = [("a", f"cut_out_{'left' if side > 0 else 'right'}", at - 0.04, at - 0.04)]
        return Plant(ground, drives, told)

    return scene


def tailgating(grade: str) -> Scene:
    """Two in one lane, the second nearer than Table 4.3 asks; it keeps its distance, or comes near and falls back."""
    limits = {"minor": (6.0, 38.0), "moderate": (81.0 / KMH, 38.0), "severe": (101.0 / KMH, 40.0)}
    shares = {"minor": (0.55, 0.95), "moderate": (0.32, 0.48), "severe": (0.2, 0.28)}

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        lane, seconds = ground.own, 6.0
        top = min((ground.length - 75.0) / seconds, np.sqrt(ALONG / max(ground.bend, 1e-6)), limits[grade][1])
        if top <= limits[grade][0]:
            return None
        v = float(rng.uniform(limits[grade][0], top))
        town = ground.road_at(0.0).startswith("town") or (
            ground.road_at(0.0) in ("", "unknown") and ground.limit <= 50.0 / KMH
        )
        required = v if town else 0.5 * KMH * v
        away = required * float(rng.uniform(*shares[grade]))
        if away < 6.0:
            return None
        steps: tuple[tuple[float, float, float], ...] = ()
        if rng.random() < 0.5:  # it falls back from 3 s on
            steps = ((3.0, 1.5, -0.15 * v),)
        aside = [constant(in_lane(ground, lane, rng)) for _ in range(2)]
        drives = [
            Drive("a", driven(0.0, v, *steps), aside[0], seconds),
            Drive("b", driven(away, v), aside[1], seconds),
        ]
        return Plant(ground, drives, [("a", f"tailgating_{grade}", 0.0, 2.0)])

    return scene


def entered_ahead(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Somebody enters ahead, too near: tailgating begins three seconds later."""
    side, seconds = int(rng.choice([-1, 1])), 11.0
    pair, v = _pair(ground, rng, side), draw_speed(ground, rng, seconds + 1.0, least=8.0)
    if pair is None or v is None:
        return None
    aside, at = _change(ground, pair, 1.5, float(rng.uniform(3.0, 4.5)), rng)
    away = max(v * float(rng.uniform(0.5, 0.9)), 7.0)
    drives = [
        Drive("a", driven(away, v), aside, seconds),
        Drive("b", driven(0.0, v), constant(in_lane(ground, pair[1], rng)), seconds),
    ]
    return Plant(ground, drives, [("b", "tailgating_minor", at + 3.1, seconds)] if v * KMH < 80.0 else [])


def speeding(ground: Ground, rng: np.random.Generator) -> Plant | None:
    seconds, over = 7.0, float(rng.uniform(1.03, 1.3))
    top = (ground.length - MARGIN) / seconds
    if not np.isfinite(ground.limit) or over * ground.limit > min(
        top, np.sqrt(2.0 * ALONG / max(ground.bend, 1e-6))
    ):
        return None
    v = ground.limit * over
    if rng.random() < 0.5:
        way, told = driven(0.0, v), (0.0, seconds)
    else:
        way = driven(0.0, 0.95 * ground.limit, (1.0, 2.0, v - 0.95 * ground.limit))
        told = (3.0, seconds)
    lane = ground.own
    return Plant(
        ground, [Drive("a", way, constant(in_lane(ground, lane, rng)), seconds)], [("a", "speeding", *told)]
    )


def standing(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """It brakes to a stop, stands, and drives on; or creeps, which is no standing."""
    v = draw_speed(ground, rng, 8.0, most=14.0)
    if v is None:
        return None
    lasts = v * float(rng.uniform(0.6, 1.0))
    stands, creeps = float(rng.uniform(1.5, 4.0)), rng.random() < 0.25
    down = v - (float(rng.uniform(0.2, 0.6)) if creeps else 0.0)
    begin = float(rng.uniform(0.5, 1.5))
    until = begin + lasts + stands
    way = driven(0.0, v, (begin, lasts, -down), (until, lasts, down))
    end = until + min(lasts, 3.0)
    if way(np.array([end]))[0] > ground.length - MARGIN:
        return None
    lane = ground.own
    told = [] if creeps else [("a", "standing", begin + lasts, until)]
    return Plant(ground, [Drive("a", way, constant(in_lane(ground, lane, rng)), end)], told)


def strong(label: str) -> Scene:
    """Its speed falls or rises within a second by more than the limit; in one of four, only just not."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        sign = -1.0 if label == "strong_braking" else 1.0
        gentle = rng.random() < 0.25
        least = (3.0, 3.4, 3.7, 5.0) if sign < 0.0 else (2.0, 2.4, 2.6, 3.2)
        within = float(rng.uniform(*(least[:2] if gentle else least[2:])))
        lasts = float(rng.uniform(1.4, 2.6))
        second = np.array([-0.5, 0.5]) + 0.5 * lasts  # the steepest one
        change = within / float(np.diff(quintic(second, 0.0, lasts, 1.0))[0])
        v = draw_speed(ground, rng, 7.0, least=change + 1.0 if sign < 0.0 else 2.0)
        if v is None:
            return None
        v = v if sign < 0.0 else max(v - change, 1.0)
        begin = float(rng.uniform(1.0, 2.5))
        way = driven(0.0, v, (begin, lasts, sign * change))
        lane = ground.own
        drive = Drive("a", way, constant(in_lane(ground, lane, rng)), 7.0)
        told = [] if gentle else [("a", label, begin + 0.45 * lasts, begin + 0.55 * lasts)]
        return Plant(ground, [drive], told)

    return scene


def passing(label: str) -> Scene:
    """One goes by another on the next lane: passes it on the left, or overtakes it on the right."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        pair = _pair(ground, rng, 1 if label == "pass" else -1)
        faster, seconds = float(rng.uniform(3.0, 8.0)), 8.0
        v = draw_speed(ground, rng, seconds, least=faster + 2.0)
        if pair is None or v is None:
            return None
        at = float(rng.uniform(2.5, 5.5))
        slow = driven(faster * at, v - faster)
        drives = [
            Drive("a", driven(0.0, v), constant(in_lane(ground, pair[1], rng)), seconds),
            Drive("b", slow, constant(in_lane(ground, pair[0], rng)), seconds),
        ]
        return Plant(ground, drives, [("a", label, at, at + 0.04)])

    return scene


def wrong_way(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Against the lane: on a lane of the oncoming traffic, or back along one's own."""
    seconds = float(rng.uniform(5.0, 9.0))
    v = draw_speed(ground, rng, seconds)
    if v is None:
        return None
    oncoming = [k for k, lane in enumerate(ground.lanes) if not lane.same]
    if oncoming and rng.random() < 0.5:
        way, lane = driven(0.0, v), int(rng.choice(oncoming))
    else:
        way, lane = driven(v * seconds, -v), int(rng.choice(same_way(ground)))
    drive = Drive("a", way, constant(in_lane(ground, lane, rng)), seconds)
    return Plant(ground, [drive], [("a", "wrong_way", 0.0, seconds)])


def swerving(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """From side to side within the lane; in one of four, less than a metre."""
    lane, seconds = ground.own, 12.0
    v = draw_speed(ground, rng, seconds)
    one = ground.lanes[lane]
    widest = min(0.5 * (one.left - one.right) - 0.35, 1.1)
    if v is None or widest < 0.6:
        return None
    little = rng.random() < 0.25
    size = float(rng.uniform(0.3, 0.45) if little else rng.uniform(0.55, widest))
    period, phase = float(rng.uniform(3.0, 6.0)), float(rng.uniform(0.0, 2.0 * np.pi))
    centre = one.centre

    def aside(t: np.ndarray) -> np.ndarray:
        return centre + size * np.sin(2.0 * np.pi * t / period + phase) * quintic(t, 0.0, 1.0, 1.0)

    told = [] if little else [("a", "swerving", 0.5 * period, 1.5 * period)]
    return Plant(ground, [Drive("a", driven(0.0, v), aside, seconds)], told)


def through(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """One drives through a junction, and another behind it."""
    if not ground.turns:
        return None
    label = ground.turns[0][2]
    top = min(np.sqrt(ALONG / max(ground.bend, 1e-6)), 12.0)
    v = float(rng.uniform(0.6, 1.0)) * top
    seconds = (ground.length - 2.0) / v
    begin = ground.turns[0][0] / v
    drives = [Drive("a", driven(0.0, v), constant(float(rng.uniform(-0.2, 0.2))), seconds)]
    if rng.random() < 0.5:
        drives.append(Drive("b", driven(-3.0 * v, v), constant(0.0), seconds, start=3.0))
    return Plant(ground, drives, [("a", label, begin + 0.1, begin + 0.1)])


def ramp(label: str) -> Scene:
    """From the lane of a ramp onto the motorway, or off it."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        kind, side = ("on", 1) if label == "enter_highway" else ("off", -1)
        own = same_way(ground)
        pairs = [
            (one, two) for one, two in ((k, k - side) for k in own) if two in own
            and CLASSES.get(ground.lanes[one if side > 0 else two].kind) == kind
            and ground.lanes[two if side > 0 else one].kind == "driving"
        ]  # fmt: skip
        lasts = float(rng.uniform(3.0, 5.0))
        v = draw_speed(ground, rng, lasts + 4.0)
        if not pairs or v is None:
            return None
        aside, at = _change(ground, pairs[0], float(rng.uniform(1.0, 2.5)), lasts, rng)
        return Plant(ground, [Drive("a", driven(0.0, v), aside, lasts + 4.0)], [("a", label, at, at + 0.04)])

    return scene


def crossing(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """On foot, or by bicycle, across all lanes."""
    bicycle = rng.random() < 0.4
    v = float(rng.uniform(2.0, 4.0) if bicycle else rng.uniform(0.8, 2.0))
    right, left = ground.lanes[-1].right - 0.8, ground.lanes[0].left + 0.8
    if left - right > 40.0 or not all(free_beside(ground, side) for side in (0, 1)):
        return None
    seconds, where = (left - right) / v, float(rng.uniform(0.2, 0.8)) * ground.length
    slant = float(rng.uniform(-0.5, 0.5)) * v
    begin, way = (right, 1.0) if rng.random() < 0.5 else (left, -1.0)
    drive = Drive(
        "a", driven(where, slant), lambda t: begin + way * v * t, seconds, kind="bicycle" if bicycle else "pedestrian",
        length=1.8 if bicycle else 0.5, width=0.6,
    )  # fmt: skip
    return Plant(ground, [drive], [("a", "crossing_road", 0.4 * seconds, 0.6 * seconds)])


def walking(ground: Ground, rng: np.random.Generator) -> Plant | None:
    lane, seconds = int(rng.choice(same_way(ground))), 8.0
    v = float(rng.uniform(0.8, 2.0)) * (1.0 if ground.turns else float(rng.choice([-1.0, 1.0])))
    if ground.length < 40.0:
        return None
    drive = Drive("a", driven(0.5 * ground.length, v), constant(in_lane(ground, lane, rng)), seconds,
                  kind="pedestrian", length=0.5, width=0.6)  # fmt: skip
    return Plant(ground, [drive], [("a", "walking_on_road", 0.5, seconds - 0.5)])


def reversing(ground: Ground, rng: np.random.Generator) -> Plant | None:
    lane, v, seconds = (
        int(rng.choice(same_way(ground))),
        float(rng.uniform(0.8, 3.0)),
        float(rng.uniform(3.0, 8.0)),
    )
    if ground.length < 2.0 * v * seconds:
        return None
    drive = Drive(
        "a", driven(0.8 * ground.length, -v), constant(in_lane(ground, lane, rng)), seconds, backwards=True
    )
    return Plant(ground, [drive], [("a", "reversing", 0.5, seconds - 0.5)])


def collision(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """A rear-end collision: the follower goes on into who stands."""
    lane, v = ground.own, float(rng.uniform(3.0, 8.0))
    begin, at = float(rng.uniform(2.5, 4.0)) * v, 0.0
    if begin + 40.0 > ground.length:
        return None
    at = (begin - 4.7) / v
    aside = [constant(in_lane(ground, lane, rng)) for _ in range(2)]
    drives = [
        Drive("a", driven(0.0, v, (at, 1.0, -v)), aside[0], at + 2.0),
        Drive("b", driven(begin, 0.0), aside[1], at + 2.0),
    ]
    told = [(who, "collision", at + 0.1, at + 0.5) for who in "ab"]
    return Plant(ground, drives, [*told, ("a", "critical_ttc", at - 0.5, at)])


def critical(label: str) -> Scene:
    """One comes nearer than 1.5 s to collision, or than 0.5 s of headway, and falls back."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        lane, seconds = ground.own, 7.0
        v = draw_speed(ground, rng, seconds, least=12.0, ahead=40.0)
        if v is None:
            return None
        if label == "critical_ttc":
            faster = float(rng.uniform(4.0, 7.0))
            lasts = float(rng.uniform(1.6, 2.0))
            gap = 0.5 * faster * lasts + 3.0  # where it begins to brake
            away, steps = faster * 1.5 + gap + 4.7, ((1.5, lasts, -1.15 * faster),)
            told = ("a", label, 1.45, 1.55) if gap / faster < 1.45 else None
            way, ahead = driven(0.0, v, *steps), driven(away, v - faster)
        else:
            away = 4.7 + v * float(rng.uniform(0.3, 0.45))
            way, ahead = driven(0.0, v, (3.5, 1.5, -0.2 * v)), driven(away, v)
            told = ("a", label, 0.0, 3.0)
        aside = [constant(in_lane(ground, lane, rng)) for _ in range(2)]
        drives = [Drive("a", way, aside[0], seconds), Drive("b", ahead, aside[1], seconds)]
        return Plant(ground, drives, [told] if told else [])

    return scene


SCENES: dict[str, Sequence[Scene]] = {
    "lane_change_left": (lane_change(1), lane_change(1, 2)),
    "lane_change_right": (lane_change(-1), lane_change(-1, 2)),
    "lane_change_not_judged": (not_judged,),
    "cut_in_left": (cut_in(1),),
    "cut_in_right": (cut_in(-1),),
    "cut_out_left": (cut_out(1),),
    "cut_out_right": (cut_out(-1),),
    "tailgating_minor": (tailgating("minor"), entered_ahead),
    "tailgating_moderate": (tailgating("moderate"),),
    "tailgating_severe": (tailgating("severe"),),
    "speeding": (speeding,),
    "standing": (standing,),
    "strong_acceleration": (strong("strong_acceleration"),),
    "strong_braking": (strong("strong_braking"),),
    "enter_highway": (ramp("enter_highway"),),
    "exit_highway": (ramp("exit_highway"),),
    "pass": (passing("pass"),),
    "overtaking_right": (passing("overtaking_right"),),
    "wrong_way": (wrong_way,),
    "swerving": (swerving,),
    "crossing_road": (crossing,),
    "walking_on_road": (walking,),
    "reversing": (reversing,),
    "collision": (collision,),
    "critical_ttc": (critical("critical_ttc"),),
    "critical_thw": (critical("critical_thw"),),
}
"""Scenes by the label that they are planted for, on strips; those of one lane fit ways through junctions as well."""
WAYS = ("turn_left", "turn_right", "straight", "u_turn")
"""Planted by `through`, on the ways that turn so."""
LABELS = (*SCENES, *WAYS, "follow_lane")
