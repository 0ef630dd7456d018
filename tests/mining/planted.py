"""Drives whose maneuvers are known: places along a lane's path by time, and what they are by construction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from resim.core.tracks import Tracks
from resim.road.driven_route import NO_ROUTE, Route
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path as LanePath
from resim.road.path import lane_path

RATE = 25.0
FINE = 1e-3

Profile = Callable[[np.ndarray], np.ndarray]


def smooth(t: np.ndarray, begin: float, lasts: float, size: float) -> np.ndarray:
    """A quintic step of a size."""
    u = np.clip((t - begin) / lasts, 0.0, 1.0)
    return size * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)


def steady(v: float) -> Profile:
    return lambda t: v * t


def braking(v: float, a: float, begin: float, lasts: float) -> Profile:
    """Ways driven at v, then with a for some time, then steadily."""

    def way(t: np.ndarray) -> np.ndarray:
        on = np.clip(t - begin, 0.0, lasts)
        return v * t + 0.5 * a * on**2 + a * lasts * np.clip(t - begin - lasts, 0.0, None)

    return way


@dataclass(frozen=True)
class Drive:
    """Somebody on a path: way along it by time, metres to the left by time, and when it is there."""

    name: str
    way: Profile
    aside: Profile = lambda t: np.zeros_like(t)
    start: float = 0.0
    end: float = 20.0
    kind: str = "car"
    length: float = 4.7
    width: float = 1.9
    backwards: bool = False


def path_of(
    network: RoadNetwork, road: str, lane: int, s: float, length: float, route: Route = NO_ROUTE
) -> LanePath:
    return lane_path(network, road, lane, s, length, behind=0.0, step=0.25, route=route)


def tracks_of(
    path: LanePath, drives: Sequence[Drive], *, rate: float = RATE, noise: float = 0.0, seed: int = 0
) -> Tracks:
    """Give the tracks of drives on one path, at common times."""
    last = max(d.end for d in drives)
    t = np.arange(round(last * rate) + 1) / rate
    shape = len(drives), len(t)
    x, y, heading, v = (np.full(shape, np.nan) for _ in range(4))
    for n, drive in enumerate(drives):
        there = (t >= drive.start - 1e-9) & (t <= drive.end + 1e-9)
        x[n, there], y[n, there], heading[n, there], v[n, there] = _states(path, drive, t[there])
    if noise:
        rng = np.random.default_rng(seed)
        x, y = x + noise * rng.standard_normal(shape), y + noise * rng.standard_normal(shape)
    return Tracks(
        t=t, ids=np.array([d.name for d in drives], dtype=str), kind=np.array([d.kind for d in drives], dtype=str),
        x=x, y=y, heading=heading, v=v, length=np.array([d.length for d in drives]),
        width=np.array([d.width for d in drives]), valid=np.isfinite(x),
    )  # fmt: skip


def _states(path: LanePath, drive: Drive, t: np.ndarray) -> tuple[np.ndarray, ...]:
    places = [path.xy(drive.way(at), drive.aside(at)) for at in (t - FINE, t, t + FINE)]
    (x0, y0), (x, y), (x1, y1) = places
    vx, vy = (x1 - x0) / (2.0 * FINE), (y1 - y0) / (2.0 * FINE)
    v = np.hypot(vx, vy)
    s = drive.way(t)
    along = np.interp(s, path.s, path.heading)
    heading = np.where(v > 1e-6, np.arctan2(vy, vx), along)
    if drive.backwards:
        return x, y, np.angle(np.exp(1j * (heading + np.pi))), -v
    return x, y, np.angle(np.exp(1j * heading)), v


def crossed(t: np.ndarray, aside: np.ndarray, border: float) -> float:
    """The first time at which somebody is beyond a border to the left (or, where it is negative, to the right)."""
    beyond = aside > border if border > 0.0 else aside < border
    return float(t[np.argmax(beyond)])


MAPS = Path(__file__).parent
SECTION = '<laneSection s="{s}">{left}<center><lane id="0" type="none"/></center><right>{right}</right></laneSection>'
LANE = (
    '<lane id="{id}" type="{type}"><link>{link}</link><width sOffset="0" a="{a}" b="{b}" c="0" d="0"/></lane>'
)


def lane(number: int, kind: str = "driving", a: float = 3.5, b: float = 0.0, links: str = "ps") -> str:
    link = f'<predecessor id="{number}"/>' * ("p" in links) + f'<successor id="{number}"/>' * ("s" in links)
    return LANE.format(id=number, type=kind, link=link, a=a, b=b)


def write_motorway(file: Path) -> Path:
    """A motorway of one road in a bend of 600 m radius: 2 lanes, an entry lane from 300 to 500 m, a third lane from 500
    to 900 m, an exit lane from 900 to 1100 m; no types of roads but of lanes, a limit of 33 m/s, and one oncoming lane.
    """
    sections = []
    for s, right in (
        (0.0, [lane(-1), lane(-2)]),
        (300.0, [lane(-1), lane(-2), lane(-3, "entry", links="")]),
        (500.0, [lane(-1), lane(-2)]),
        (900.0, [lane(-1), lane(-2), lane(-3, "exit", links="")]),
        (1100.0, [lane(-1), lane(-2)]),
    ):
        sections.append(SECTION.format(s=s, left=f"<left>{lane(1)}</left>", right="".join(right)))
    file.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="motorway"/>'
        '<road id="7" length="1600" junction="-1"><type s="0" type="motorway"><speed max="33" unit="m/s"/></type>'
        '<planView><geometry s="0" x="0" y="0" hdg="0.3" length="200"><line/></geometry>'
        '<geometry s="200" x="191.0672978" y="59.1040413" hdg="0.3" length="1400">'
        '<arc curvature="0.0016666667"/></geometry>'
        f"</planView><lanes>{''.join(sections)}</lanes></road></OpenDRIVE>",
        encoding="utf-8",
    )
    return file


def write_straight(file: Path, lanes: int = 3, length: float = 800.0) -> Path:
    """A straight road along x with lanes of 3.5 m, the leftmost at y from 0 down to -3.5 m."""
    right = "".join(lane(-n) for n in range(1, lanes + 1))
    file.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="straight"/>'
        f'<road id="1" length="{length}" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="{length}">'
        f"<line/></geometry></planView><lanes>{SECTION.format(s=0.0, left='', right=right)}</lanes></road></OpenDRIVE>",
        encoding="utf-8",
    )
    return file


def write_bend(
    file: Path, bend: float, rng: np.random.Generator, lanes: int = 3, length: float = 800.0
) -> Path:
    """The lanes of `write_straight` in a bend [1/m], on three roads one after the other, with sections at any s."""
    right = "".join(lane(-n) for n in range(1, lanes + 1))
    cuts = [0.0, *np.sort(rng.uniform(100.0, length - 100.0, 2)).tolist(), length]
    roads = []
    for k, (first, last) in enumerate(pairwise(cuts)):
        x, y = (one.tolist() for one in on_bend(np.array([first]), np.zeros(1), bend))
        starts = [0.0, *np.sort((last - first) * rng.uniform(0.1, 0.9, 2)).tolist()]
        links = f'<predecessor elementType="road" elementId="{k}" contactPoint="end"/>' * (k > 0)
        links += f'<successor elementType="road" elementId="{k + 2}" contactPoint="start"/>' * (k < 2)
        roads.append(
            f'<road id="{k + 1}" length="{last - first!r}" junction="-1"><link>{links}</link><planView><geometry s="0" '
            f'x="{x[0]!r}" y="{y[0]!r}" hdg="{bend * first!r}" length="{last - first!r}"><arc curvature="{bend!r}"/>'
            f"</geometry></planView><lanes>{''.join(SECTION.format(s=repr(s), left='', right=right) for s in starts)}"
            "</lanes></road>"
        )
    head = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="bend"/>'
    file.write_text(f"{head}{''.join(roads)}</OpenDRIVE>", encoding="utf-8")
    return file


def on_bend(s: np.ndarray, t: np.ndarray, bend: float) -> tuple[np.ndarray, np.ndarray]:
    """Places [m] at s along an arc from the origin along x, t to the left of it."""
    return np.sin(bend * s) * (1.0 / bend - t), 1.0 / bend - np.cos(bend * s) * (1.0 / bend - t)


def bent(tracks: Tracks, bend: float) -> Tracks:
    """Traffic of a straight road along x in a bend: x along the road's line, y to the left of it."""
    x, y = on_bend(tracks.x, tracks.y, bend)
    heading, v = tracks.heading.copy(), tracks.v.copy()
    for n in range(len(tracks)):
        k = np.flatnonzero(tracks.valid[n])
        vx, vy = np.gradient(x[n, k], tracks.t[k]), np.gradient(y[n, k], tracks.t[k])
        v[n, k] = np.hypot(vx, vy)
        heading[n, k] = np.where(v[n, k] > 0.1, np.arctan2(vy, vx), bend * tracks.x[n, k])
    return replace(tracks, x=x, y=y, heading=np.angle(np.exp(1j * heading)), v=v)


def random_traffic(
    rng: np.random.Generator, vehicles: int, seconds: float, rate: float, lanes: int = 3
) -> Tracks:
    """Traffic on that road: who drives where and when is drawn, and nobody minds anybody; some change lane, once or
    twice, over one lane or two, sway over a border, stand, or come and go.
    """
    t = np.arange(round(seconds * rate) + 1) / rate
    shape = vehicles, len(t)
    x, y = np.full(shape, np.nan), np.full(shape, np.nan)
    for n in range(vehicles):
        first = int(rng.integers(0, len(t) // 2))
        last = int(rng.integers(first + 2, len(t)))
        own = t[first : last + 1]
        at, v = int(rng.integers(1, lanes + 1)), rng.choice([0.0, 11.0, 13.0, 15.0], p=[0.05, 0.3, 0.35, 0.3])
        aside = np.full(len(own), 1.75 - 3.5 * at)
        begin = own[0] + rng.uniform(-2.0, 4.0)
        for _ in range(int(rng.integers(0, 3)) if v else 0):
            to = int(rng.integers(1, lanes + 1))
            size = 3.5 * (at - to) if rng.random() < 0.85 else rng.uniform(-2.2, 2.2)
            lasts = rng.uniform(3.5, 6.0) * max(1.0, abs(size) / 3.5)
            aside = aside + smooth(own, begin, lasts, size)
            begin, at = begin + lasts + rng.uniform(-0.3, 3.0), to
        x[n, first : last + 1] = rng.uniform(50.0, 350.0) + (v + rng.normal(0.0, 1.0) * (v > 0)) * own
        y[n, first : last + 1] = aside
    heading, v = np.zeros(shape), np.full(shape, np.nan)
    for n in range(vehicles):
        known = np.flatnonzero(np.isfinite(x[n]))
        vx, vy = np.gradient(x[n, known], t[known]), np.gradient(y[n, known], t[known])
        heading[n, known], v[n, known] = (
            np.where(np.hypot(vx, vy) > 0.1, np.arctan2(vy, vx), 0.0),
            np.hypot(vx, vy),
        )
    valid = np.isfinite(x)
    return Tracks(
        t=t, ids=np.array([str(n) for n in range(vehicles)], dtype=str), kind=np.array(["car"] * vehicles, dtype=str),
        x=x, y=y, heading=np.where(valid, heading, np.nan), v=v, length=np.full(vehicles, 4.5),
        width=np.full(vehicles, 1.8), valid=valid,
    )  # fmt: skip
