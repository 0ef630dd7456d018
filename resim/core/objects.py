"""Who is whom: ids are joined to objects, one after the other or two at one time, before anything is asked of one.

An id can go on as another that begins within GAP where it was going. Which ones do is decided only where it is clear:
where ends and beginnings pair off, each with the one that is nearest in time, then in place, and nobody is left over.
Else one of them was lost, or came from nowhere, and nobody knows which: none is joined. Nor are those that differ in
class or size. All that can be one object count as one where that is the worse (`ObjectIds.same`), and none of them
speaks for another (`ObjectIds.two`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from resim.core.geometry import Bools, Floats, to_frame
from resim.core.levels import over
from resim.core.sightings import SAME, Sightings, joined, of_ids
from resim.core.tracks import Tracks

GAP = 1.0
"""Time [s] for which a trace is driven on where nothing is seen."""
MISS, FASTER, HARDEST = 1.0, 2.0, 10.0
"""m, m/s by which a track may miss the one that it goes on from; m/s² by which that may grow, but for sideways."""
DOUBLE = 1.0
"""Gap [m] between their boxes up to which two ids that are seen at one time can be one object, seen twice."""
ALIKE, UNKNOWN = 1.5, ("", "unknown")
"""Factor by which lengths and widths of one object differ at most, and kinds that say nothing."""

_Pairs = list[tuple[float, float, int, int]]
"""dt [s], miss [m] of candidates, and which id goes on as which."""


@dataclass(frozen=True, eq=False)
class ObjectIds:
    """Who is there from `start` to `end` [s]: the EGO, and the other objects, each under one id or several.

    same: ids that can be one object, by components of two and more.
    """

    start: float
    end: float
    ego: Sightings
    others: tuple[Sightings, ...]
    same: tuple[tuple[str, ...], ...]
    _apart: dict[tuple[int, int], bool] = field(default_factory=dict)

    @classmethod
    def of(
        cls, tracks: Tracks, incomplete: pd.DataFrame | None = None, *, ego: str, beyond: bool = False
    ) -> ObjectIds:
        """Find the objects of a source. tracks: samples while the EGO is there, parts of an object joined.

        incomplete: rows t, id, x, y, heading, v, length, width of the same source that lack one of x, y, heading, v;
        beyond: those before and after all samples count, too.
        """
        start, end = float(tracks.t[0]), float(tracks.t[-1])
        if beyond and incomplete is not None and len(incomplete):
            start, end = min(start, float(incomplete["t"].min())), max(end, float(incomplete["t"].max()))
        known = of_ids(tracks, incomplete)
        me = next(k for k in known if k.ids == (ego,))
        others = [k.within(start, end) for k in known if k is not me]
        others = [k for k in others if len(k.t) or len(k.blind)]
        pairs = _candidates(others)
        after = dict(_decided(pairs, others))
        firsts = [n for n in range(len(others)) if n not in set(after.values())]
        objects = tuple(joined([others[n] for n in _chain(n, after)]) for n in firsts)
        names = [k.ids[0] for k in others]
        groups = linked([n for *_, n, _ in pairs], [m for *_, m in pairs], len(others))
        same = tuple(tuple(names[n] for n in group) for group in groups if len(group) > 1)
        return cls(start, end, me, objects, same)

    def apart(self, one: Sightings, two: Sightings) -> bool:
        """Whether two are surely two objects: seen at one time in two places, or out of each other's reach."""
        key = (min(id(one), id(two)), max(id(one), id(two)))
        if key not in self._apart:
            self._apart[key] = one is not two and (_beside(one, two) or _out_of_reach(one, two))
        return self._apart[key]

    def two(self, some: Sequence[Sightings], but: Sightings) -> bool:
        """Whether two of these are surely two objects, and neither of them the one."""
        rest = [k for k in some if self.apart(k, but)]
        return any(self.apart(k, m) for n, k in enumerate(rest) for m in rest[:n])


def successions(tracks: Tracks) -> list[tuple[str, str]]:
    """Give which id goes on as which; tracks: without the EGO."""
    ids = of_ids(tracks, None)
    return [(ids[n].ids[0], ids[m].ids[0]) for n, m in _decided(_candidates(ids), ids)]


def reaches(one: Floats, two: Floats, dt: Floats) -> Bools:
    """Say who can be in state two (m, 5) at dt (m,) [s] after state one, x, y, heading, vx, vy, at HARDEST.

    With W the change of velocity and D the miss of going straight on, |D - W dt/2| = |∫ (dt/2 - s) u ds| <= a dt² / 4.
    """
    change, off = two[:, 3:] - one[3:], two[:, :2] - one[:2] - dt[:, None] * one[3:]
    swerve = np.hypot(*(off - 0.5 * dt[:, None] * change).T)
    return np.asarray(
        (dt > 0.0)
        & (swerve <= MISS + 0.25 * HARDEST * dt**2)
        & (np.hypot(*change.T) <= FASTER + HARDEST * dt)
    )


def _candidates(ids: Sequence[Sightings]) -> _Pairs:
    """Who can go on as somebody else that is seen first within GAP where he was going."""
    placed = np.array([n for n, k in enumerate(ids) if len(k.t)], dtype=int)
    first_t = np.array([ids[n].t[0] for n in placed])
    first = np.array([ids[n].state[0] for n in placed]).reshape(-1, 5)
    found: _Pairs = []
    for n in placed.tolist():
        dt, last = first_t - ids[n].t[-1], ids[n].state[-1]
        off = (first[:, :2] - last[:2] - dt[:, None] * last[3:]).T
        along, across = to_frame(off[0], off[1], 0.0, 0.0, np.arctan2(last[4], last[3]))
        changed = np.hypot(*(first[:, 3:] - last[3:]).T)
        near = (dt > 0.0) & (dt <= GAP + SAME) & (changed <= FASTER + HARDEST * dt)
        near &= (np.abs(along) <= MISS + 0.5 * HARDEST * dt * dt) & (np.abs(across) <= MISS)
        found += [
            (round(float(dt[m]), 6), float(np.hypot(*off[:, m])), n, int(placed[m]))
            for m in np.flatnonzero(near).tolist()
        ]
    return sorted(found)


def _decided(pairs: _Pairs, ids: Sequence[Sightings]) -> list[tuple[int, int]]:
    """Who goes on as whom: of the ends and beginnings that can belong together those that pair off, and are alike."""
    out, count = [], len(ids)
    for group in linked([n for *_, n, _ in pairs], [count + m for *_, m in pairs], 2 * count):
        taken: dict[int, int] = {}
        for *_, n, m in pairs:
            if n in group and n not in taken and m not in taken.values():
                taken[n] = m
        if 2 * len(taken) == len(group) and all(_alike(ids[n], ids[m]) for n, m in taken.items()):
            out += list(taken.items())
    return out


def _alike(one: Sightings, two: Sightings) -> bool:
    """Whether two have the kind and the size of one object."""
    small, large = np.minimum(one.size, two.size), np.maximum(one.size, two.size)
    same_kind = one.kind == two.kind or one.kind in UNKNOWN or two.kind in UNKNOWN
    return same_kind and bool((large <= ALIKE * small).all())


def linked(one: Sequence[int], two: Sequence[int], count: int) -> list[list[int]]:
    """Give which of `count` hang together by links from one to two, in groups of two and more."""
    root = list(range(count))

    def of(n: int) -> int:
        while root[n] != n:
            root[n] = n = root[root[n]]
        return n

    for a, b in zip(one, two, strict=True):
        root[max(of(a), of(b))] = min(of(a), of(b))
    groups: dict[int, list[int]] = {}
    for n in sorted({*one, *two}):
        groups.setdefault(of(n), []).append(n)
    return list(groups.values())


def _chain(n: int, after: dict[int, int]) -> list[int]:
    chain = [n]
    while chain[-1] in after:
        chain.append(after[chain[-1]])
    return chain


def _beside(one: Sightings, two: Sightings) -> bool:
    """Whether both are seen at one time, with a gap of more than DOUBLE between their boxes, or on two levels."""
    if not len(one.t) or not len(two.t):
        return False
    j = np.clip(np.searchsorted(two.t, one.t - SAME), 1, max(len(two.t) - 1, 1))
    late = np.minimum(j, len(two.t) - 1)
    both = (one.t >= two.t[0] - SAME) & (one.t <= two.t[-1] + SAME)
    both &= two.t[late] - two.t[j - 1] <= GAP + SAME
    off = [np.interp(one.t[both], two.t, two.state[:, c]) - one.state[both, c] for c in (0, 1)]
    headings = one.state[both, 2], two.state[late[both], 2]
    gap = np.full(len(off[0]), -np.inf)
    for axis in (headings[0], headings[0] + 0.5 * np.pi, headings[1], headings[1] + 0.5 * np.pi):
        axis = np.where(np.isfinite(axis), axis, np.arctan2(off[1], off[0]))
        halves = [_half(k.size, axis - heading) for k, heading in zip((one, two), headings, strict=True)]
        gap = np.maximum(gap, np.abs(off[0] * np.cos(axis) + off[1] * np.sin(axis)) - halves[0] - halves[1])
    return bool((gap > DOUBLE).any()) or _above(one, two, both)


def _above(one: Sightings, two: Sightings, both: Bools) -> bool:
    """Whether one is on another level at one of its times (n,) at which both are seen."""
    if one.z is None or two.z is None:
        return False
    return bool(over(np.interp(one.t[both], two.t, two.z), one.z[both]).any())


def _half(size: tuple[float, float], turned: Floats) -> Floats:
    """Half the extent [m] of a box along an axis that is turned [rad] from its heading; NaN: whatever its heading."""
    half = 0.5 * (size[0] * np.abs(np.cos(turned)) + size[1] * np.abs(np.sin(turned)))
    return np.where(np.isfinite(turned), half, 0.5 * np.hypot(*size))


def _out_of_reach(one: Sightings, two: Sightings) -> bool:
    """Whether he would have to be faster than he can where one is seen after the other, and not both at a time."""
    t, state = np.concatenate([one.t, two.t]), np.concatenate([one.state, two.state])
    who = np.repeat([0, 1], [len(one.t), len(two.t)])
    order = np.argsort(t, kind="stable")
    turn = np.flatnonzero(np.diff(who[order]))
    a, b = order[turn], order[turn + 1]
    at_once = [_seen_at(k, np.where(who[a] == n, t[b], t[a])) for n, k in enumerate((one, two))]
    after = (t[b] - t[a] > SAME) & ~at_once[0] & ~at_once[1]
    return any(
        not reaches(state[i], state[j : j + 1], t[j : j + 1] - t[i])[0]
        for i, j in zip(a[after].tolist(), b[after].tolist(), strict=True)
    )


def _seen_at(k: Sightings, t: Floats) -> Bools:
    """Whether he is seen at t (n,) [s], or before and after it by at most GAP."""
    j = np.searchsorted(k.t, t - SAME)
    late, early = np.append(k.t, np.inf)[j], np.append(-np.inf, k.t)[j]
    return np.asarray((np.abs(late - t) <= SAME) | (late - early <= GAP + SAME))
