"""Who was where nobody knows: times in which a source does not say well enough where an object is.

An object is known at its samples, and between two of them that are at most GAP apart: its trace is driven on there. It
is absent

- between two samples that are farther apart;
- before its first or after its last sample, unless it can have come or gone there, at the edge of what is seen
  (`_Seen.at_edge`), or goes on under another id within GAP: then it is absent in between;
- where its rows lack a position, heading or speed, and no two samples at most GAP apart stand around them.

A row that lacks no position is a sighting all the same: it bounds where the object can be (`resim.assess.reach`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from resim.core.geometry import Bools, Floats, to_frame
from resim.core.tracks import Strings, Tracks

GAP = 1.0
"""Time [s] for which a trace is driven on where nothing is seen."""
CORRIDOR = 10.0
"""Distance [m] to either side of a way in which somebody seen farther on shows that it does not end there."""
OTHERS, ACROSS = 2, 40.0
"""How many others have to come or go at a line, or be seen as far, for an edge; how far [m] aside they may do so."""
RANGE, FAR = 50.0, 0.9
"""Least range of a sensor [m], and the share of the largest distance seen from which on an object is at the range."""
MOVES = 1.0
"""Speed [m/s] from which on an object leaves an area."""
OFTEN = 0.2
"""Time [s] between the samples of an object that show where somebody is seen; its first and last do as well."""
WINDOW = 0.25
"""Time [s] to either side over which positions tell a speed."""
MISS, FASTER, HARDEST = 1.0, 2.0, 10.0
"""m, m/s by which a track may miss the one that it goes on from; m/s² by which that may grow, but for sideways."""

_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Absence:
    """An object that is not known from `start` to `end` [s], but for sightings t (n,) [s].

    state: (n, 5) x, y [m], heading [rad], vx, vy [m/s] of the sightings, heading NaN where unknown. n = 0: nobody knows
    where it is. size: length, width [m]. why: what is the matter, in words.
    """

    object: str
    start: float
    end: float
    t: Floats
    state: Floats
    size: tuple[float, float]
    why: str

    def to_json(self) -> dict[str, Any]:
        """Give what report.json holds of it: NaN is null."""
        state = [[None if np.isnan(x) else float(x) for x in row] for row in self.state]
        fields = {"object": self.object, "start": self.start, "end": self.end, "why": self.why}
        return {**fields, "size": list(self.size), "t": self.t.tolist(), "state": state}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Absence:
        """Inverse of `to_json`. Raises KeyError, TypeError or ValueError for what is none."""
        t = np.array(data["t"], dtype=float)
        length, width = map(float, data["size"])
        return cls(
            str(data["object"]), float(data["start"]), float(data["end"]), t,
            np.array(data["state"], dtype=float).reshape(len(t), 5), (length, width), str(data["why"]),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Doubts:
    """What a source leaves open: absences; of objects that it gives in several sizes the largest length, width [m]; of
    objects whose places are in doubt how far they can be off [m]; ids that can be one object, one after the other.
    """

    absences: tuple[Absence, ...] = ()
    sizes: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    off: Mapping[str, float] = field(default_factory=dict)
    same: tuple[tuple[str, ...], ...] = ()

    def simulated(self, ego: str) -> Doubts:
        """Give what is left open where this is simulated: where the EGO is, is known there."""
        absent = tuple(a for a in self.absences if a.object != ego)
        return Doubts(absent, self.sizes, {name: d for name, d in self.off.items() if name != ego}, self.same)

    def to_json(self) -> dict[str, Any]:
        """Give what report.json holds of it."""
        sizes = {name: list(size) for name, size in self.sizes.items()}
        same = [list(ids) for ids in self.same]
        return {
            "absences": [a.to_json() for a in self.absences],
            "sizes": sizes,
            "off": dict(self.off),
            "same": same,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Doubts:
        """Inverse of `to_json`. Raises KeyError, TypeError or ValueError for what is none."""
        sizes = {str(name): (float(a), float(b)) for name, (a, b) in data["sizes"].items()}
        off = {str(name): float(d) for name, d in data["off"].items()}
        same = tuple(tuple(map(str, ids)) for ids in data["same"])
        return cls(tuple(map(Absence.from_json, data["absences"])), sizes, off, same)


WHOLE = Doubts()
"""Of a source that leaves nothing open."""


@dataclass(frozen=True, eq=False)
class _Sightings:
    """What is known of one object: t, state as in `Absence`; usable: (n,) which rows are whole; blind: (b,) s, times
    of rows without a position; lacks: what rows lack.
    """

    object: str
    t: Floats
    state: Floats
    usable: Bools
    blind: Floats
    lacks: str
    size: tuple[float, float]


_Joined = tuple[Mapping[str, _Sightings], Mapping[str, _Sightings]]
"""As whom an object goes on under another id, and as whom it was before."""


def absences(tracks: Tracks, incomplete: pd.DataFrame | None, *, ego: str) -> tuple[Absence, ...]:
    """Give who is absent when, by object, then by time.

    tracks: samples while the EGO is there, parts of an object joined. incomplete: rows t, id, x, y, heading, v, length,
    width of the same source that lack one of x, y, heading, v; None for none. The EGO is absent where its samples are
    farther apart than GAP, or where it has rows before its first sample or after its last.
    """
    every = (
        []
        if incomplete is None
        else [(str(name), rows) for name, rows in incomplete.groupby("id", sort=False)]
    )
    rows, begin, end = dict(every), float(tracks.t[0]), float(tracks.t[-1])
    known = [
        _sightings(tracks, name, rows.get(name)) for name in dict.fromkeys([*tracks.ids.tolist(), *rows])
    ]
    others = [_within(k, begin, end) for k in known if k.object != ego]
    others = [k for k in others if len(k.t) or len(k.blind)]
    placed = [k for k in others if len(k.t)]
    seen = _Seen.of(tracks, ego, placed)
    return (
        *(a for k in known if k.object == ego for a in _of_ego(k, seen.slack)),
        *(a for k in others for a in _of_object(k, seen, begin, end)),
    )


def renamed(tracks: Tracks, *, ego: str) -> tuple[tuple[str, ...], ...]:
    """Give ids that can be one object, which is seen under one after the other. tracks: as for `absences`."""
    others = [_sightings(tracks, name, None) for name in tracks.ids[tracks.ids != ego].tolist()]
    return _chains(_joined([k for k in others if len(k.t)]))


def _chains(joined: _Joined) -> tuple[tuple[str, ...], ...]:
    """Ids of those who go on as somebody else, one after the other."""
    later, before = joined
    out = []
    for name in later:
        if name not in before:
            chain = [name]
            while chain[-1] in later:
                chain.append(later[chain[-1]].object)
            out.append(tuple(chain))
    return tuple(out)


def cut_off(tracks: Tracks, *, ego: str) -> Iterator[Absence]:
    """Give when others are seen and the EGO is not yet, or no more, but where it comes or goes at an edge.

    tracks: all samples of a source.
    """
    me, *others = (_sightings(tracks, name, None) for name in (ego, *tracks.ids[tracks.ids != ego].tolist()))
    others = [k for k in others if len(k.t)]
    if not others or len(me.t) < 2:
        return
    seen = _Seen.of(tracks, ego, others)
    steps = [float(np.median(np.diff(k.t))) for k in (me, *others) if len(k.t) > 1]
    slack = 2.0 * min(seen.step, float(np.median(steps))) + _SAME
    first, last = min(float(k.t[0]) for k in others), max(float(k.t[-1]) for k in others)
    if first < me.t[0] - slack and not seen.at_edge(me, float(me.t[0]), -1):
        yield _absent(me, first, float(me.t[0]))
    if last > me.t[-1] + slack and not seen.at_edge(me, float(me.t[-1]), 1):
        yield _absent(me, float(me.t[-1]), last)


def _sightings(tracks: Tracks, name: str, incomplete: pd.DataFrame | None) -> _Sightings:
    t, state, size = np.empty(0), np.empty((0, 5)), (np.nan, np.nan)
    if name in tracks.ids:
        n = tracks.index(name)
        own = tracks.valid[n] & ~_repeated(tracks, n)
        t, heading, v = tracks.t[own], tracks.heading[n, own], tracks.v[n, own]
        state = np.column_stack(
            [tracks.x[n, own], tracks.y[n, own], heading, v * np.cos(heading), v * np.sin(heading)]
        )
        size = float(tracks.length[n]), float(tracks.width[n])
    if incomplete is None:
        return _Sightings(name, t, state, np.ones(len(t), dtype=bool), np.empty(0), "", size)
    rows = incomplete.drop_duplicates("t")
    rows = rows[~np.isin(rows["t"], t)]
    placed = np.isfinite(rows[["x", "y"]].to_numpy(float)).all(axis=1)
    placed &= len(t) + placed.sum() > 1  # a place alone tells no speed
    size = size if np.isfinite(size[0]) else (float(rows["length"].median()), float(rows["width"].median()))
    lacks = ", ".join(c for c in ("x", "y", "heading", "v") if not np.isfinite(rows[c]).all())
    return _Sightings(
        name, *_with_places(t, state, rows[placed]), rows["t"].to_numpy(float)[~placed], lacks, size
    )


def _repeated(tracks: Tracks, n: int) -> Bools:
    """Which samples (T,) of an object repeat the place of the one before, while its speed says that it moves."""
    out = np.zeros(len(tracks.t), dtype=bool)
    at = np.flatnonzero(tracks.valid[n])
    same = (np.diff(tracks.x[n, at]) == 0.0) & (np.diff(tracks.y[n, at]) == 0.0)
    out[at[1:]] = same & (np.abs(tracks.v[n, at[1:]]) >= MOVES)
    return out


def _with_places(t: Floats, state: Floats, placed: pd.DataFrame) -> tuple[Floats, Floats, Bools]:
    """Sightings with rows that hold a position and not all else; their velocity is that of the positions around."""
    more = placed["t"].to_numpy(float)
    every, usable = np.concatenate([t, more]), np.repeat([True, False], [len(t), len(more)])
    order = np.argsort(every, kind="stable")
    if not len(more):
        return t, state, usable
    place = np.concatenate([state[:, :2], placed[["x", "y"]].to_numpy(float)])[order]
    late, early = (np.clip(more + sign * WINDOW, every.min(), every.max()) for sign in (1.0, -1.0))
    velocity = np.column_stack([
        (np.interp(late, every[order], p) - np.interp(early, every[order], p)) / np.maximum(late - early, _SAME)
        for p in place.T
    ])  # fmt: skip
    moves = np.hypot(*velocity.T) > MOVES
    heading = np.where(moves, np.arctan2(velocity[:, 1], velocity[:, 0]), np.nan)
    heading = np.where(np.isfinite(placed["heading"]), placed["heading"], heading)
    added = np.column_stack([placed[["x", "y"]].to_numpy(float), heading, velocity])
    return every[order], np.concatenate([state, added])[order], usable[order]


def _within(k: _Sightings, begin: float, end: float) -> _Sightings:
    """What is known from `begin` to `end` [s]."""
    keep = (k.t >= begin - _SAME) & (k.t <= end + _SAME)
    blind = k.blind[(k.blind >= begin - _SAME) & (k.blind <= end + _SAME)]
    return _Sightings(k.object, k.t[keep], k.state[keep], k.usable[keep], blind, k.lacks, k.size)


def _of_ego(k: _Sightings, slack: float) -> Iterator[Absence]:
    whole = k.t[k.usable]
    rows = np.concatenate([k.t, k.blind])
    if rows.min() < whole[0] - slack:
        yield _absent(k, float(rows.min()), float(whole[0]))
    for j in np.flatnonzero(np.diff(whole) > GAP + _SAME):
        yield _absent(k, float(whole[j]), float(whole[j + 1]))
    if rows.max() > whole[-1] + slack:
        yield _absent(k, float(whole[-1]), float(rows.max()))


def _of_object(k: _Sightings, seen: _Seen, begin: float, end: float) -> Iterator[Absence]:
    if not len(k.t):  # nobody knows where it is
        yield _absent(k, float(k.blind.min()), float(k.blind.max()))
        return
    whole = k.t[k.usable]
    start, stop = float(k.t[0]), float(k.t[-1])
    later, before = (found.get(k.object) for found in seen.joined)
    slack = max(seen.slack, 2.0 * float(np.median(np.diff(k.t)))) if len(k.t) > 1 else seen.slack
    if start - begin > _SAME and before is None and not _comes_or_goes(k, seen, -1):
        start = begin
    if later is not None and later.t[0] - stop > slack:
        t, state = np.array([k.t[-1], later.t[0]]), np.stack([k.state[-1], later.state[0]])
        yield Absence(k.object, stop, float(later.t[0]), t, state, k.size, "not seen")
    if end - stop > _SAME and later is None and not _comes_or_goes(k, seen, 1):
        stop = end
    if len(whole) < 2:  # no trace can be driven
        yield _absent(k, start, stop)
        return
    first, last = float(whole[0]), float(whole[-1])
    if start < first - _SAME:
        yield _absent(k, start, first)
    for j in np.flatnonzero(np.diff(whole) > GAP + _SAME):
        if not (seen.at_edge(k, float(whole[j]), 1) and seen.at_edge(k, float(whole[j + 1]), -1)):
            yield _absent(k, float(whole[j]), float(whole[j + 1]))
    if last < stop - _SAME:
        yield _absent(k, last, stop)


def _comes_or_goes(k: _Sightings, seen: _Seen, way: int) -> bool:
    """Whether an object has a reason to be seen first (way -1) or last (way 1) where it is."""
    t = float(k.t[0] if way < 0 else k.t[-1])
    if (way * (k.blind - t) > 0.0).any():  # it has rows beyond
        return False
    return seen.at_edge(k, t, way)


def _joined(placed: Sequence[_Sightings]) -> _Joined:
    """Find who goes on as somebody else that is seen first within GAP where he was going, one as one: the nearest in
    time, then in place.
    """
    first_t = np.array([k.t[0] for k in placed])
    first = np.array([k.state[0] for k in placed]).reshape(-1, 5)
    found: list[tuple[float, float, int, int]] = []
    for n, k in enumerate(placed):
        dt, last = first_t - k.t[-1], k.state[-1]
        off = (first[:, :2] - last[:2] - dt[:, None] * last[3:]).T
        along, across = to_frame(off[0], off[1], 0.0, 0.0, np.arctan2(last[4], last[3]))
        changed = np.hypot(*(first[:, 3:] - last[3:]).T)
        near = (dt > 0.0) & (dt <= GAP + _SAME) & (changed <= FASTER + HARDEST * dt)
        near &= (np.abs(along) <= MISS + 0.5 * HARDEST * dt * dt) & (np.abs(across) <= MISS)
        found += [
            (round(float(dt[m]), 6), float(np.hypot(*off[:, m])), n, m) for m in np.flatnonzero(near).tolist()
        ]
    later: dict[str, _Sightings] = {}
    before: dict[str, _Sightings] = {}
    for _, _, n, m in sorted(found):
        old, new = placed[n], placed[m]
        if old.object not in later and new.object not in before:
            later[old.object], before[new.object] = new, old
    return later, before


@dataclass(frozen=True, eq=False)
class _Seen:
    """All places seen; what tells where seeing ends. place: (m, 2) m, of everybody, the EGO too; step: s, usual one.

    t: (T,) s, own: (T, 5) the EGO's state. ids: (N,) of objects; farthest: (2, N) m at which each is seen before the
    EGO, and behind it. turns: (e, 6) where others are seen first or last amid the drive: number of the object, t [s],
    x, y [m], and the velocity [m/s] out of what is seen. joined: who goes on as whom.
    """

    place: Floats
    step: float
    t: Floats
    own: Floats
    ids: Strings
    farthest: Floats
    turns: Floats
    joined: _Joined

    @property
    def slack(self) -> float:
        """Time [s] by which the first and last samples of objects may differ."""
        return 2.0 * self.step + _SAME

    @classmethod
    def of(cls, tracks: Tracks, ego: str, others: Sequence[_Sightings]) -> _Seen:
        me = _sightings(tracks, ego, None)
        me.state[:, 2] = np.unwrap(me.state[:, 2])
        x, y, heading = (np.interp(tracks.t, me.t, c) for c in me.state.T[:3])
        ahead, left = to_frame(tracks.x, tracks.y, x, y, heading)
        far = np.where(tracks.valid, np.hypot(ahead, left), 0.0)
        farthest = np.stack([
            np.max(far, where=ahead >= 0.0, initial=0.0, axis=1),
            np.max(far, where=ahead < 0.0, initial=0.0, axis=1),
        ])  # fmt: skip
        first, last = tracks.span()
        some = np.zeros(len(tracks.t), dtype=bool)
        count = int((tracks.t[-1] - tracks.t[0]) / OFTEN) + 1
        often = tracks.t[0] + OFTEN * np.arange(count)
        some[np.minimum(np.searchsorted(tracks.t, often), len(tracks.t) - 1)] = True
        shown = tracks.valid & (some | (tracks.t == first[:, None]) | (tracks.t == last[:, None]))
        place = np.column_stack([tracks.x[shown], tracks.y[shown]])
        step = float(np.median(np.diff(me.t)))
        turns = _turns(others, tracks.t, 2.0 * step + _SAME)
        return cls(place, step, me.t, me.state, tracks.ids, farthest, turns, _joined(others))

    def at_edge(self, k: _Sightings, t: float, way: int) -> bool:
        """Whether seeing ends where the object is at t [s], in the direction in which it goes (way 1) or came (-1).

        That it is lost there itself is no evidence: the EGO may be about to hit it. The area: nobody is ever seen
        farther on along its heading, within CORRIDOR of it, and OTHERS come or go at the same line. Or the sensor's
        range: it is RANGE or more from the EGO and moves away, and OTHERS are seen about as far, and nobody much
        farther, ahead or behind as it is.
        """
        x, y, _, vx, vy = k.state[int(np.searchsorted(k.t, t - _SAME))]
        speed = float(np.hypot(vx, vy))
        if speed >= MOVES:
            along, across = to_frame(self.place[:, 0], self.place[:, 1], x, y, np.arctan2(way * vy, way * vx))
            farther = (along > 2.0 * self.step * speed) & (np.abs(across) < CORRIDOR)
            if not farther.any() and self._passed(t, x, y, way * vx, way * vy) >= OTHERS:
                return True
        own = [np.interp(t, self.t, column) for column in self.own.T]
        dx, dy = x - own[0], y - own[1]
        apart = float(np.hypot(dx, dy))
        ahead = dx * np.cos(own[2]) + dy * np.sin(own[2]) >= 0.0
        away = way * (dx * (vx - own[3]) + dy * (vy - own[4])) > 0.0
        himself = next((ids for ids in _chains(self.joined) if k.object in ids), (k.object,))
        others = self.farthest[int(not ahead), ~np.isin(self.ids, himself)]
        as_far = int((others >= FAR * apart).sum())
        return bool(away and apart >= max(RANGE, FAR * others.max(initial=0.0)) and as_far >= OTHERS)

    def _passed(self, t: float, x: float, y: float, vx: float, vy: float) -> int:
        """How many objects come or go, at another time than t [s], at the line across (vx, vy) in x, y, over it."""
        who, when, px, py, out_x, out_y = self.turns.T
        along, across = to_frame(px, py, x, y, np.arctan2(vy, vx))
        near = MISS + self.step * (np.hypot(vx, vy) + np.hypot(out_x, out_y))
        over = (np.abs(along) <= near) & (np.abs(across) <= ACROSS) & (out_x * vx + out_y * vy > 0.0)
        return len(np.unique(who[over & (np.abs(when - t) > self.slack)]))


def _turns(others: Sequence[_Sightings], t: Floats, slack: float) -> Floats:
    """Where others are seen first or last, as in `_Seen`, but at the first or last of the times t (T,) [s]."""
    rows = [
        (n, k.t[i], *k.state[i, :2], *(-way * k.state[i, 3:]))
        for n, k in enumerate(others)
        for i, way, edge in ((0, 1.0, t[0]), (-1, -1.0, t[-1]))
        if abs(k.t[i] - edge) > slack
    ]
    return np.array(rows).reshape(-1, 6)


def _absent(k: _Sightings, start: float, end: float) -> Absence:
    keep = (k.t >= start - _SAME) & (k.t <= end + _SAME)
    inside = (k.t > start + _SAME) & (k.t < end - _SAME) & ~k.usable
    lacking = inside.any() or ((k.blind >= start - _SAME) & (k.blind <= end + _SAME)).any()
    why = f"its rows lack {k.lacks}" if lacking or not k.usable.any() else "not seen"
    return Absence(k.object, start, end, k.t[keep], k.state[keep], k.size, why)
