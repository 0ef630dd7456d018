"""What is planted of the rows of Kaefer's catalogs: a scene for each kind of label, as in tools/mining_scenes.py.

In one of four it nearly is so, and must not be found. On two ways through a junction, two meet or one waits.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mining_ground import Ground, free_beside, same_way
from mining_plants import Drive, Plant, Profile, driven, quintic, stepped
from mining_scenes import ALONG, MARGIN, Scene, constant, draw_speed, in_lane

NEARLY = 0.25
"""Share of the plants that are nearly one, but none."""
MEET = (0.5, 1.8)
"""m between places on two lines at which two meet: where these cross, or shortly before they join."""
TRUCK = {"kind": "truck", "length": 10.0, "width": 2.5}
WALKER = {"kind": "pedestrian", "length": 0.5, "width": 0.6}
CYCLIST = {"kind": "bicycle", "length": 1.8, "width": 0.6}


def running(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """On foot across all lanes, at a run or nearly at one."""
    nearly = rng.random() < NEARLY
    v = float(rng.uniform(1.9, 2.4) if nearly else rng.uniform(2.6, 5.0))
    right, left = ground.lanes[-1].right - 0.8, ground.lanes[0].left + 0.8
    seconds, where = (left - right) / v, float(rng.uniform(0.3, 0.7)) * ground.length
    if left - right > 40.0 or seconds < 1.2 or not all(free_beside(ground, side) for side in (0, 1)):
        return None
    begin, way = (right, 1.0) if rng.random() < 0.5 else (left, -1.0)
    drive = Drive("a", driven(where, 0.0), lambda t: begin + way * v * t, seconds, **WALKER)
    return Plant(
        ground, [drive], [] if nearly else [("a", "running_onto_road", 0.4 * seconds, 0.6 * seconds)]
    )


def staying(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """On foot along a lane, staying for a while, long enough or nearly so, and on."""
    nearly = rng.random() < NEARLY
    v, lasts = float(rng.uniform(1.0, 1.6)), float(rng.uniform(1.0, 2.0) if nearly else rng.uniform(6.0, 9.0))
    if ground.length < 40.0:
        return None
    way = driven(0.4 * ground.length, v, (2.0, 0.8, -v), (2.8 + lasts, 0.8, v))
    lane = int(rng.choice(same_way(ground)))
    drive = Drive("a", way, constant(in_lane(ground, lane, rng)), 6.0 + lasts, **WALKER)
    told = [] if nearly else [("a", "staying_on_road", 3.5, 2.0 + lasts)]
    return Plant(ground, [drive], told)


def crowd(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Slowly past five who stand beside the lanes, or past four."""
    nearly, v, seconds = rng.random() < NEARLY, float(rng.uniform(2.0, 6.0)), 9.0
    if ground.length < v * seconds + MARGIN:
        return None
    lane, where = ground.own, 0.5 * v * seconds
    sides = [k for k, at in enumerate((0, len(ground.lanes) - 1)) if at == lane and free_beside(ground, k)]
    if not sides:
        return None
    side = 1.0 if sides[0] == 0 else -1.0
    edge = ground.lanes[lane].left if side > 0.0 else ground.lanes[lane].right
    drives = [Drive("a", driven(0.0, v), constant(in_lane(ground, lane, rng)), seconds)]
    for k in range(4 if nearly else 5):
        aside = constant(edge + side * float(rng.uniform(1.0, 2.0)))
        at = where + float(rng.uniform(-2.5, 2.5))
        drives.append(Drive("bcdef"[k], driven(at, 0.0), aside, seconds, **WALKER))
    told = [] if nearly else [("a", "through_crowd", 0.49 * seconds, 0.51 * seconds)]
    return Plant(ground, drives, told)


def cycling(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """By bicycle along a lane; or standing beside it."""
    nearly, v, seconds = rng.random() < NEARLY, float(rng.uniform(3.0, 7.0)), 7.0
    if ground.length < v * seconds + MARGIN:
        return None
    aside = constant(in_lane(ground, int(rng.choice(same_way(ground))), rng))
    drive = Drive("a", driven(2.0, 0.15 if nearly else v), aside, seconds, **CYCLIST)
    return Plant(ground, [drive], [] if nearly else [("a", "cycling_on_road", 0.5, seconds - 0.5)])


def starting(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Driving off; or too slowly, or not far enough up."""
    nearly, stands = rng.random() < NEARLY, float(rng.uniform(1.0, 3.0))
    v, lasts = float(rng.uniform(3.0, 10.0)), float(rng.uniform(3.0, 5.0))
    if nearly:
        v, lasts = (float(rng.uniform(1.0, 1.9)), lasts) if rng.random() < 0.5 else (v, 3.6 * (5.0 + v))
    seconds = stands + lasts + 1.0
    way = driven(1.0, 0.0, (stands, lasts, v))
    if way(np.array([seconds]))[0] > ground.length - MARGIN:
        return None
    drive = Drive("a", way, constant(in_lane(ground, ground.own, rng)), seconds)
    return Plant(ground, [drive], [] if nearly else [("a", "starting", stands + 0.1, stands + 0.5 * lasts)])


def skidding(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Across the own heading for a while; or by less than 15 degrees."""
    nearly, lasts = rng.random() < NEARLY, float(rng.uniform(1.5, 3.0))
    v = draw_speed(ground, rng, 7.0, least=9.0)
    if v is None:
        return None
    size = float(rng.uniform(0.17, 0.24) if nearly else rng.uniform(0.32, 0.6)) * float(rng.choice([-1, 1]))

    def yaw(t: np.ndarray) -> np.ndarray:
        return quintic(t, 2.0, 0.5 * lasts, size) - quintic(t, 2.0 + 0.5 * lasts, 0.5 * lasts, size)

    drive = Drive("a", driven(0.0, v), constant(in_lane(ground, ground.own, rng)), 7.0, yaw=yaw)
    middle = 2.0 + 0.5 * lasts
    return Plant(ground, [drive], [] if nearly else [("a", "skidding", middle - 0.05, middle + 0.05)])


def sideswipe(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Drifting to somebody beside in the next lane until the sides touch, or nearly so, and away again."""
    nearly, side, seconds = rng.random() < NEARLY, int(rng.choice([-1, 1])), 7.0
    pairs = [(one, one - side) for one in same_way(ground) if one - side in same_way(ground)]
    v = draw_speed(ground, rng, seconds, ahead=10.0)
    if not pairs or v is None:
        return None
    one, two = pairs[int(rng.integers(len(pairs)))]
    a, b = ground.lanes[one].centre, ground.lanes[two].centre
    gap = abs(b - a) - 1.9
    each = (
        0.5 * (gap - float(rng.uniform(0.1, 0.3))) if nearly else 0.5 * (gap + float(rng.uniform(0.06, 0.2)))
    )
    size = side * each
    asides = [
        stepped(start, (1.5, 2.0, sign * size), (4.0, 2.0, -sign * size))
        for start, sign in ((a, 1.0), (b, -1.0))
    ]
    drives = [
        Drive("a", driven(0.0, v), asides[0], seconds),
        Drive("b", driven(float(rng.uniform(-1.5, 1.5)) + 2.0, v), asides[1], seconds),
    ]
    told = [(who, "sideswipe", 3.4, 4.1) for who in "ab"]
    return Plant(ground, drives, [] if nearly else told)


def _beyond(ground: Ground, rng: np.random.Generator, parks: bool) -> tuple[int, float] | None:
    """A lane at an edge of the driven ones, and metres aside of what lies beyond; None for none such."""
    sides = [k for k in (0, 1) if (ground.edges[k] == "parking") == parks and ground.edges[k] != "?"]
    if not sides:
        return None
    side = sides[int(rng.integers(len(sides)))]
    lane = 0 if side == 0 else len(ground.lanes) - 1
    one = ground.lanes[lane]
    aside = one.left + float(rng.uniform(0.8, 1.3)) if side == 0 else one.right - float(rng.uniform(0.8, 1.3))
    return (lane, aside) if one.same and free_beside(ground, side) else None


def leave_road(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Beyond the edge of the road, and back or not; or up to the edge only."""
    where, v, nearly = _beyond(ground, rng, parks=False), draw_speed(ground, rng, 9.0), rng.random() < NEARLY
    if where is None or v is None:
        return None
    lane, aside = where
    start = in_lane(ground, lane, rng)
    edge = ground.lanes[lane].left if aside > start else ground.lanes[lane].right
    aside = edge - float(np.sign(aside - start)) * float(rng.uniform(0.1, 0.3)) if nearly else aside
    steps = [(2.0, 2.5, aside - start)]
    if rng.random() < 0.5:
        steps.append((5.0, 2.5, start - aside))
    told = [] if nearly else [("a", "leave_road", 4.4, 4.6)]
    return Plant(ground, [Drive("a", driven(0.0, v), stepped(start, *steps), 9.0)], told)


def parking(label: str) -> Scene:
    """From the lane onto the parking lane and to a stop, or from there into traffic; or beside it only."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        where, v, nearly = (
            _beyond(ground, rng, parks=True),
            float(rng.uniform(3.0, 6.0)),
            rng.random() < NEARLY,
        )
        if where is None or ground.length < 9.0 * v + MARGIN:
            return None
        lane, aside = where
        start = in_lane(ground, lane, rng)
        edge = ground.lanes[lane].left if aside > start else ground.lanes[lane].right
        aside = edge - float(np.sign(aside - start)) * float(rng.uniform(0.1, 0.3)) if nearly else aside
        if label == "enter_parking":
            way, steps = driven(0.0, v, (3.0, 3.0, -v)), (1.0, 3.5, aside - start)
            drive = Drive("a", way, stepped(start, steps), 9.0)
            told = ("a", label, 4.0, 5.0)
        else:
            way, steps = driven(1.0, 0.0, (1.5, 3.0, v)), (2.0, 4.0, start - aside)
            drive = Drive("a", way, stepped(aside, steps), 9.0)
            told = ("a", label, 2.5, 3.0)
        return Plant(ground, [drive], [] if nearly else [told])

    return scene


def over_change(label: str) -> Scene:
    """One lane over a place where the road gets or loses lanes beside it, or up to shortly before."""

    def scene(ground: Ground, rng: np.random.Generator) -> Plant | None:
        places = [at for at, change in ground.counts if (change > 0) == (label == "road_widens")]
        if not places:
            return None
        at, nearly = places[0], rng.random() < NEARLY
        v = float(rng.uniform(0.5, 1.0)) * min(15.0, np.sqrt(ALONG / max(ground.bend, 1e-6)))
        end = (at - float(rng.uniform(0.3, 1.0))) / v if nearly else (ground.length - 1.0) / v
        drive = Drive("a", driven(0.0, v), constant(float(rng.uniform(-0.2, 0.2))), end)
        return Plant(ground, [drive], [] if nearly else [("a", label, at / v, at / v)])

    return scene


def backing(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Backing up in a crossing or shortly before it; or more than 20 m before."""
    if not ground.turns or ground.turns[0][0] < 16.0:
        return None
    begin, end, _ = ground.turns[0]
    v, seconds, nearly = float(rng.uniform(0.8, 2.0)), float(rng.uniform(2.0, 4.0)), rng.random() < NEARLY
    if nearly and begin < 21.0 + v * seconds + 2.0:
        return None
    start = begin - 20.5 if nearly else float(rng.uniform(max(begin - 17.0, v * seconds), end))
    drive = Drive("a", driven(start, -v), constant(float(rng.uniform(-0.2, 0.2))), seconds, backwards=True)
    return Plant(ground, [drive], [] if nearly else [("a", "reversing_at_junction", 0.1, 0.5)])


def unprotected(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """Through a junction without lights; or with lights that hold back nobody seen, or on a map that says nothing."""
    if not ground.turns:
        return None
    nearly = ground.signs.lit or not ground.signs.told
    v = float(rng.uniform(0.5, 1.0)) * _top(ground)
    seconds, at = (ground.length - 2.0) / v, ground.turns[0][0] / v
    drive = Drive("a", driven(0.0, v), constant(float(rng.uniform(-0.2, 0.2))), seconds)
    return Plant(ground, [drive], [] if nearly else [("a", "unprotected_way", at + 0.1, at + 0.1)])


def run_stop(ground: Ground, rng: np.random.Generator) -> Plant | None:
    """On past a stop sign, slowly or not; or with a stop before it."""
    if not ground.signs.stop or ground.turns[0][0] < 25.0:
        return None
    begin, nearly, v = ground.turns[0][0], rng.random() < NEARLY, float(rng.uniform(0.5, 1.0)) * _top(ground)
    v = min(v, 8.0)
    low = float(rng.uniform(0.1, 0.4)) if nearly else float(rng.uniform(0.7, 0.9 * v))
    # it slows down in the last metres, and is at its slowest somewhere in them
    lasts = 2.0 * float(rng.uniform(5.0, 9.0)) / (v + low)
    slow = begin - float(rng.uniform(1.0, 8.0))
    at = (slow - 0.5 * lasts * (v + low)) / v
    if at < 0.2:
        return None
    way = driven(0.0, v, (at, lasts, low - v), (at + lasts, lasts, v - low))
    fine = np.arange(0.0, 120.0, 0.04)
    seconds = float(fine[np.searchsorted(way(fine), ground.length - 2.0) - 1])
    told = [] if nearly else [("a", "run_stop_sign", at + lasts, at + lasts)]
    return Plant(ground, [Drive("a", way, constant(0.0), seconds)], told)


def _top(ground: Ground) -> float:
    return float(min(np.sqrt(ALONG / max(ground.bend, 1e-6)), 12.0))


def meeting(one: Ground, two: Ground, rng: np.random.Generator, *, late: bool) -> Plant | None:
    """Two on two ways through a junction meet where these cross or join; or the second is there seconds later."""
    places = _meet(one, two, float(rng.choice(MEET)))
    if places is None:
        return None
    at = places[int(rng.integers(len(places)))]
    speeds = [float(rng.uniform(0.6, 1.0)) * _top(ground) for ground in (one, two)]
    times = [at[k] / speeds[k] for k in range(2)]
    wait = times[0] - times[1] + (float(rng.uniform(3.0, 4.0)) if late else 0.0)
    starts = [max(-wait, 0.0), max(wait, 0.0)]
    drives = []
    for name, ground, v, start in zip("ab", (one, two), speeds, starts, strict=True):
        way: Profile = lambda t, v=v, start=start: v * (t - start)  # noqa: E731
        size = TRUCK if rng.random() < 0.5 else {}
        drives.append(Drive(name, way, constant(0.0), start + (ground.length - 2.0) / v, start, **size))
    return Plant(one, [drives[0]], [], (two, drives[1]))


def _meet(one: Ground, two: Ground, apart: float) -> list[tuple[float, float]] | None:
    """Places [m] along two lines, inside of the junction or shortly behind it, that are less than `apart` [m] apart."""
    grids = [
        np.arange(g.turns[0][0] + 0.5, min(g.turns[0][1] + 6.0, g.length - 4.0), 0.5) for g in (one, two)
    ]
    points = []
    for ground, s in zip((one, two), grids, strict=True):
        x, y = ground.path.xy(s, np.zeros(len(s)))
        points.append(np.asarray(x) + 1j * np.asarray(y))
    if not len(points[0]) or not len(points[1]):
        return None
    away = np.abs(points[0][:, None] - points[1][None, :])
    near = np.flatnonzero(away.min(axis=1) < apart)
    return [(float(grids[0][k]), float(grids[1][away[k].argmin()])) for k in near] or None


def waiting(one: Ground, two: Ground, rng: np.random.Generator) -> Plant | None:
    """One passes lights while another waits at those of a way that crosses its own; or that one creeps."""
    if not one.signs.lit or _meet(one, two, MEET[0]) is None:
        return None
    v, nearly = float(rng.uniform(0.6, 1.0)) * _top(one), rng.random() < NEARLY
    seconds, begin = (one.length - 2.0) / v, one.turns[0][0] / v
    place = two.turns[0][0] - float(rng.uniform(7.0, 11.0))
    creeps = float(rng.uniform(0.15, 0.3)) if nearly else 0.0
    drives = [
        Drive("a", driven(0.0, v), constant(0.0), seconds),
        Drive("b", driven(place, creeps), constant(0.0), seconds),
    ]
    told = [] if nearly else [("a", "protected_way", begin + 0.1, begin + 0.1)]
    return Plant(one, [drives[0]], told, (two, drives[1]))


CATALOG_SCENES: dict[str, Sequence[Scene]] = {
    "running_onto_road": (running,),
    "staying_on_road": (staying,),
    "through_crowd": (crowd,),
    "cycling_on_road": (cycling,),
    "starting": (starting,),
    "skidding": (skidding,),
    "sideswipe": (sideswipe,),
    "leave_road": (leave_road,),
    "enter_parking": (parking("enter_parking"),),
    "leave_parking": (parking("leave_parking"),),
    "road_widens": (over_change("road_widens"),),
    "lane_ends": (over_change("lane_ends"),),
    "reversing_at_junction": (backing,),
    "unprotected_way": (unprotected,),
    "run_stop_sign": (run_stop,),
}
CRASHING = (
    "crash_left_across_lateral", "crash_left_across_opposite", "crash_left_into_path", "crash_right_across_lateral",
    "crash_right_into_path", "crash_straight_crossing", "crash_other_crossing",
)  # fmt: skip
"""Planted by `meeting`, on two ways through a junction."""
PASSING = ("reversing_at_junction", "unprotected_way", "run_stop_sign")
"""Planted on ways through junctions; "protected_way" on two, by `waiting`."""
CHANGING = ("road_widens", "lane_ends")
"""Planted where roads get or lose lanes."""
CATALOG_KINDS = (*CATALOG_SCENES, *CRASHING, "protected_way")
