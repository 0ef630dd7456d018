"""The scenario: what a JSCEN file says, and its making from measured tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from resim.core.errors import ResimError
from resim.core.geometry import Floats, wrap_angle
from resim.core.objects import GAP
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario.fit import fit_trace
from resim.scenario.trace import Trace

SIZES: Mapping[str, tuple[float, float]] = {
    "car": (4.7, 1.9), "van": (5.4, 2.0), "truck": (12.0, 2.55), "bus": (12.0, 2.55), "trailer": (8.0, 2.5),
    "motorcycle": (2.2, 0.8), "bicycle": (1.8, 0.6), "pedestrian": (0.5, 0.6), "unknown": (4.7, 1.9),
}  # fmt: skip
"""Length and width [m] of objects whose file, as published, does not say them."""

_EXACT = 1e-6
"""m; how exactly an object that is told where to be is there."""

KNOTS = 0.5
"""Time [s] between the points of an object's height."""

_KEPT = 100_000
"""Samples up to which the states of traffic objects are kept for the next run."""


@dataclass(frozen=True)
class RoadPosition:
    """A point on the road: OpenDRIVE road and lane, s [m] along the road, t [m] left of the lane's centre."""

    road: str
    lane: int
    s: float
    t: float


@dataclass(frozen=True, eq=False)
class ScenarioObject:
    """One object: where it starts, and cubic splines of v [m/s] and heading [rad] over time [s].

    z: the height [m] of the road under it over time [s], in straight pieces, while it is known; None where it never is.
    """

    id: str
    kind: str
    length: float
    width: float
    start: RoadPosition
    v: PPoly
    heading: PPoly
    color: str = "#000000"
    description: str = ""
    z: PPoly | None = None

    @property
    def spawn_time(self) -> float:
        """When it appears [s]."""
        return float(self.v.x[0])


@dataclass(frozen=True, eq=False)
class Scenario:
    """A test case: the road, the environment, the EGO's start and trace, the traces of the traffic objects.

    `map` is the OpenDRIVE file's name beside the JSCEN file; `duration` [s] counts from the EGO's start on.
    The EGO's trace serves assessment only: it never steers the EGO.
    """

    map: str
    duration: float
    ego: ScenarioObject
    objects: tuple[ScenarioObject, ...]
    description: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)

    def traces(self, network: RoadNetwork) -> tuple[Trace, ...]:
        """Give the traces of EGO and objects, in this order, in the map frame."""
        return _traces((self.ego, *self.objects), network)

    def tracks(self, network: RoadNetwork, t: ArrayLike) -> Tracks:
        """Give EGO and objects, in this order, at times t (T,) [s] as the splines have them."""
        t, everyone = np.asarray(t, dtype=float), (self.ego, *self.objects)
        own = _states((self.ego,), network, t)
        few = len(self.objects) * len(t) <= _KEPT
        others = (
            _kept_states(self.objects, network, t.tobytes()) if few else _states(self.objects, network, t)
        )
        x, y, heading, v, a, yaw_rate = np.concatenate([own, others], axis=1)
        return Tracks(
            t=t,
            ids=np.array([member.id for member in everyone], dtype=str),
            kind=np.array([member.kind for member in everyone], dtype=str),
            x=x,
            y=y,
            heading=wrap_angle(heading),
            v=v,
            length=np.array([member.length for member in everyone]),
            width=np.array([member.width for member in everyone]),
            valid=np.isfinite(x),
            yaw_rate=yaw_rate,
            a=a,
            z=heights_of(everyone, t),
        )


def heights_of(members: Sequence[ScenarioObject], t: Floats) -> Floats | None:
    """Give heights (N, T) [m] at times t (T,) [s], NaN where one is not known; None where none ever is."""
    if all(member.z is None for member in members):
        return None
    out = np.full((len(members), len(t)), np.nan)
    for n, member in enumerate(members):
        if member.z is not None:
            inside = (t >= member.z.x[0] - _EXACT) & (t <= member.z.x[-1] + _EXACT)
            out[n, inside] = member.z(np.clip(t[inside], member.z.x[0], member.z.x[-1]))
    return out


def _traces(members: Sequence[ScenarioObject], network: RoadNetwork) -> tuple[Trace, ...]:
    places = zip(*_starts(tuple(m.start for m in members), network), members, strict=True)
    return tuple(Trace(x0, y0, member.v, member.heading) for x0, y0, member in places)


@lru_cache(maxsize=64)
def _starts(starts: tuple[RoadPosition, ...], network: RoadNetwork) -> tuple[list[float], list[float]]:
    """Where places are in the map, x and y [m]; kept, as drives are looked at several times."""
    x, y = network.to_xy(
        np.array([p.road for p in starts]), np.array([p.lane for p in starts]),
        np.array([p.s for p in starts]), np.array([p.t for p in starts]),
    )  # fmt: skip
    return x.tolist(), y.tolist()


def _states(members: Sequence[ScenarioObject], network: RoadNetwork, t: Floats) -> Floats:
    """States (6, N, T) of members at times t (T,): x, y, heading, v, a, yaw rate."""
    out = np.empty((6, len(members), len(t)))
    for n, trace in enumerate(_traces(members, network) if members else ()):
        s = trace.states(t)
        out[:, n] = s.x, s.y, s.heading, s.v, s.a, s.yaw_rate
    return out


@lru_cache(maxsize=16)
def _kept_states(members: tuple[ScenarioObject, ...], network: RoadNetwork, t: bytes) -> Floats:
    """`_states` of traffic objects at times (T,) as bytes: every run of a sweep asks for the same."""
    states = _states(members, network, np.frombuffer(t))
    states.setflags(write=False)
    return states


def describe(
    tracks: Tracks,
    network: RoadNetwork,
    *,
    ego: str,
    map_name: str,
    description: str = "",
    environment: Mapping[str, str] | None = None,
    driven: Scenario | None = None,
) -> Scenario:
    """Fit every object of the tracks and give the scenario.

    driven: the scenario that the tracks are a simulation of. Who kept to it is described by it: a new fit could only
    be worse. Objects seen fewer than twice have no trace and are left out; an EGO that is not there from the first time
    on raises ResimError.
    """
    row = tracks.index(ego)
    if not tracks.valid[row, :1].all() or tracks.valid[row].sum() < 2:
        raise ResimError(
            f"EGO {ego!r} is not there at the first time, t = {tracks.t[0]:g} s; cut the recording to it"
        )
    seen = np.flatnonzero(tracks.valid.sum(axis=1) >= 2)
    kept = {} if driven is None else _kept(tracks, driven, network)
    members = {n: kept.get(str(tracks.ids[n])) or _fit_object(tracks, n, network) for n in seen.tolist()}
    return Scenario(
        map=map_name,
        duration=float(tracks.span()[1][row] - tracks.t[0]),
        ego=members.pop(row),
        objects=tuple(members.values()),
        description=description,
        environment=dict(environment or {}),
    )


def _kept(tracks: Tracks, driven: Scenario, network: RoadNetwork) -> dict[str, ScenarioObject]:
    """Give whom the tracks show all along their traces in a scenario, to a simulation's step at the ends."""
    step = float(np.diff(tracks.t).max())
    told = driven.tracks(network, tracks.t)
    out = {}
    for row, member in enumerate((driven.ego, *driven.objects)):
        if member.id not in tracks.ids or not (own := tracks.valid[n := tracks.index(member.id)]).any():
            continue
        first, last = tracks.t[own][[0, -1]].tolist()
        whole = first - member.v.x[0] < step and member.v.x[-1] - last < step
        away = np.hypot(tracks.x[n] - told.x[row], tracks.y[n] - told.y[row])[own]
        if whole and (away <= _EXACT).all():
            out[member.id] = member
    return out


def _fit_object(tracks: Tracks, n: int, network: RoadNetwork) -> ScenarioObject:
    own = tracks.valid[n]
    trace = fit_trace(
        tracks.t[own], tracks.x[n, own], tracks.y[n, own], tracks.heading[n, own], tracks.v[n, own]
    ).trace
    height = None if tracks.z is None else fit_height(tracks, n)
    z0 = height(height.x[:1]) if height is not None and height.x[0] <= trace.start + KNOTS else None
    at = network.to_road(
        np.array([trace.x0]),
        np.array([trace.y0]),
        heading=np.array([float(trace.heading(trace.start))]),
        z=z0,
    )
    return ScenarioObject(
        id=str(tracks.ids[n]),
        kind=str(tracks.kind[n]),
        length=float(tracks.length[n]),
        width=float(tracks.width[n]),
        start=RoadPosition(str(at.road[0]), int(at.lane[0]), float(at.s[0]), float(at.t[0])),
        v=trace.v,
        heading=trace.heading,
        z=height,
    )


def fit_height(tracks: Tracks, n: int) -> PPoly | None:
    """Give the height of object n over time, in straight pieces of KNOTS [s], of the longest time in which it is known.

    It is known between samples with a height that are at most GAP [s] apart. None where there are not two of them.
    """
    assert tracks.z is not None
    own = np.flatnonzero(tracks.valid[n])
    t, z = tracks.t[own], tracks.z[n, own]
    known = np.flatnonzero(np.isfinite(z))
    parts = np.split(known, np.flatnonzero(np.diff(t[known]) > GAP) + 1)
    part = max(parts, key=lambda k: t[k[-1]] - t[k[0]] if len(k) else -1.0)
    if len(part) < 2:
        return None
    first, last = float(t[part[0]]), float(t[part[-1]])
    knots = np.linspace(first, last, max(int(np.ceil((last - first) / KNOTS)), 1) + 1)
    height = np.interp(knots, t[part], z[part])
    slope = np.diff(height) / np.diff(knots)
    return PPoly(np.stack([slope, height[:-1]]), knots)
