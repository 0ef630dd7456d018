"""Times in which a source does not say well enough where an object is, and what else it leaves open.

An object (`core.objects`) is known at its samples, and between two of one id that are at most GAP apart: its trace
is driven on there. So it is from the last sample of an id to the first of the next, where they follow at once and both
have a trace, which takes two samples. It is absent

- between all others;
- before its first or after its last sample, unless it can have come or gone there, at the edge of what is seen
  (`resim.metrics.doubts.edges`);
- where its rows lack a position, heading or speed, and no two samples at most GAP apart stand around them.

A row that lacks no position is a sighting all the same: it bounds where the object can be (`metrics.doubts.reach`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from resim.core.geometry import Bools
from resim.core.objects import GAP, ObjectIds
from resim.core.sightings import SAME, Sightings
from resim.core.spec import ArrayInFile
from resim.core.tracks import Tracks
from resim.metrics.doubts.edges import SightEdges

NEARER = 2.0
"""Distance [m] by which another EGO has to be nearer to somebody who has left than the measured one."""
BETWEEN = 0.2
"""Longest time [s] from one sample of an object to the next that the drive may begin or end in: it goes straight on."""
LEFT = "not seen there by the measured EGO, while this EGO is nearer"


@dataclass(frozen=True, eq=False, kw_only=True)
class Absence:
    """An object that is not known from `start` to `end` [s], but for sightings t (n,) [s].

    state: (n, 5) x, y [m], heading [rad], vx, vy [m/s] of the sightings, heading NaN where unknown. n = 0: nothing is
    known of where it is. size: length, width [m]. why: what is the matter, in words. straight: it goes on as it does at
    its sighting.
    """

    object: str
    start: float
    end: float
    why: str
    straight: bool
    size: tuple[float, float]
    t: ArrayInFile
    state: ArrayInFile

    def __post_init__(self) -> None:
        object.__setattr__(self, "state", self.state.reshape(len(self.t), 5))

    @property
    def is_beyond(self) -> bool:
        """Whether it is before the first or after the last sighting, not between two."""
        return len(self.t) > 0 and (self.t[0] > self.start + SAME or self.t[-1] < self.end - SAME)


def never_sighted(tracks: Tracks, n: int, why: str) -> Absence:
    """Give the absence of the n-th object, which is nowhere sighted while it is there."""
    start, end = tracks.t[tracks.valid[n]][[0, -1]].tolist()
    return Absence(
        object=str(tracks.ids[n]),
        start=start,
        end=end,
        why=why,
        straight=False,
        size=(float(tracks.length[n]), float(tracks.width[n])),
        t=np.empty(0),
        state=np.empty((0, 5)),
    )


@dataclass(frozen=True, eq=False)
class Doubts:
    """What a source leaves open. absences: who is not known when; sizes: of objects whose size or heading is in doubt
    length and width [m] of a box that holds them; off: of those whose place is, how far [m] they can be off along their
    heading, and across; same: ids that can be one object, one after the other. excused: who is not seen as seeing ends
    there, for an EGO that drives as the measured one.
    """

    absences: tuple[Absence, ...]
    sizes: Mapping[str, tuple[float, float]]
    off: Mapping[str, tuple[float, float]]
    same: tuple[tuple[str, ...], ...]
    excused: tuple[Absence, ...]

    def one(self, name: str) -> tuple[str, ...]:
        """Give the ids that can be the same object as this one, it among them."""
        return next((ids for ids in self.same if name in ids), (name,))

    def simulated(self, ego: str) -> Doubts:
        """Give what is left open where this is simulated: where the EGO is, is known while it was measured."""
        absent = tuple(a for a in self.absences if a.object != ego or a.is_beyond)
        return replace(self, absences=absent, off={name: d for name, d in self.off.items() if name != ego})

    def beside(self, own: Tracks, measured: Tracks) -> Doubts:
        """Give what is left open for an EGO that drives as `own`, and not as `measured`, tracks of the EGO alone.

        Who is excused is absent while that EGO is nearer to where it would be, going straight on, by NEARER.
        """
        return replace(self, absences=(*self.absences, *_nearer(self.excused, own, measured)), excused=())


WHOLE = Doubts((), {}, {}, (), ())
"""Of a source that leaves nothing open."""


def absences(whom: ObjectIds) -> tuple[tuple[Absence, ...], tuple[Absence, ...]]:
    """Give who is absent when, by object, then by time; and who is excused, as seeing ends where it is.

    The EGO is where its samples are farther apart than GAP, or where it has rows before its first sample or after its
    last.
    """
    seen = SightEdges.of(whom)
    found = [told for k in whom.others for told in _of_object(k, seen)]
    absent = (*_of_ego(whom.ego, _slack(whom.ego.step)), *(a for a, excused in found if not excused))
    return absent, tuple(a for a, excused in found if excused)


def _nearer(excused: Sequence[Absence], own: Tracks, measured: Tracks) -> Iterator[Absence]:
    """Those, as long as the EGO of `own` is nearer to where they would be than that of `measured`."""
    for a in excused:
        if not len(a.t):
            continue
        last = np.clip(np.searchsorted(a.t, own.t + SAME) - 1, 0, len(a.t) - 1)  # seen last, or else first
        x, y, _, vx, vy = a.state[last].T
        place = np.stack([x, y]) + np.stack([vx, vy]) * (own.t - a.t[last])
        far, as_measured = (np.hypot(place[0] - e.x[0], place[1] - e.y[0]) for e in (own, measured))
        there = (own.t >= a.start - SAME) & (own.t <= a.end + SAME)
        near = there & ~(far >= as_measured - NEARER)
        edges = np.flatnonzero(np.diff([False, *near, False]))
        for first, after in zip(edges[::2], edges[1::2], strict=True):
            yield replace(a, start=float(own.t[first]), end=float(own.t[after - 1]), why=LEFT)


def cut_off(whom: ObjectIds, span: tuple[float, float]) -> Iterator[Absence]:
    """Give when others have rows and the EGO has none yet, or no more, but where it comes or goes at an edge.

    whom: of all rows of a source. span: first and last time [s] of rows of any source, which the drive lasted at least.
    """
    me, others = whom.ego, [np.concatenate([k.t, k.blind]) for k in whom.others]
    if not others or len(me.t) < 2:
        return
    usual = [k.step for k in (me, *whom.others) if k.step > 0.0]
    slack = _slack(min(me.step, float(np.median(usual))))
    first, last = min(float(t.min()) for t in others), max(float(t.max()) for t in others)
    early, late = first < me.t[0] - slack, last > me.t[-1] + slack
    if span[0] < me.t[0] - max(slack, BETWEEN):
        early, first = True, min(first, span[0])
    if span[1] > me.t[-1] + max(slack, BETWEEN):
        late, last = True, max(last, span[1])
    if not early and not late:
        return
    seen = SightEdges.of(whom)
    if early and not seen.at_edge(me, float(me.t[0]), -1):
        yield _absent(me, first, float(me.t[0]))
    if late and not seen.at_edge(me, float(me.t[-1]), 1):
        yield _absent(me, float(me.t[-1]), last)


def _slack(step: float) -> float:
    """Time [s] by which an EGO may end before its last row, or others' rows: two of its steps, or one up to BETWEEN."""
    return max(step, min(2.0 * step, BETWEEN)) + SAME


def _of_ego(k: Sightings, slack: float) -> Iterator[Absence]:
    whole = k.t[k.usable]
    rows = np.concatenate([k.t, k.blind])
    if rows.min() < whole[0] - slack:
        yield _absent(k, float(rows.min()), float(whole[0]))
    for j in np.flatnonzero(np.diff(whole) > GAP + SAME):
        yield _absent(k, float(whole[j]), float(whole[j + 1]))
    if rows.max() > whole[-1] + slack:
        yield _absent(k, float(whole[-1]), float(rows.max()))


def _of_object(k: Sightings, seen: SightEdges) -> Iterator[tuple[Absence, bool]]:
    """When it is absent, and whether it is excused."""
    if not len(k.t):  # nobody knows where it is
        yield _absent(k, float(k.blind.min()), float(k.blind.max())), False
        return
    start, stop = float(k.t[0]), float(k.t[-1])
    between = min(k.step, BETWEEN) + SAME
    if SAME < start - seen.whom.start <= between:
        yield replace(_absent(k, seen.whom.start, start), straight=True), False
    elif start - seen.whom.start > SAME:
        if _comes_or_goes(k, seen, -1):
            yield _absent(k, seen.whom.start, start), True
        else:
            start = seen.whom.start
    if SAME < seen.whom.end - stop <= between:
        yield replace(_absent(k, stop, seen.whom.end), straight=True), False
    elif seen.whom.end - stop > SAME:
        if _comes_or_goes(k, seen, 1):
            yield _absent(k, stop, seen.whom.end), True
        else:
            stop = seen.whom.end
    whole = k.t[k.usable]
    if len(whole) < 2:  # no trace can be driven
        yield _absent(k, start, stop), False
        return
    driven, left = _driven(k, seen)
    for j in np.flatnonzero(left):
        yield _absent(k, float(whole[j]), float(whole[j + 1])), True
    unknown = [start < whole[0] - SAME, *~(driven | left), stop > whole[-1] + SAME]
    t = np.array([start, *whole, stop])
    edges = np.flatnonzero(np.diff([False, *unknown, False]))
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        yield _absent(k, float(t[a]), float(t[b])), False


def _driven(k: Sightings, seen: SightEdges) -> tuple[Bools, Bools]:
    """Between which whole samples (n - 1,) its trace is driven on, and between which it has left and come back."""
    t, part = k.t[k.usable], k.part[k.usable]
    traced = np.bincount(part, minlength=len(k.ids)) > 1
    dt, one = np.diff(t), np.diff(part) == 0
    slack = max(seen.slack, 2.0 * k.step)
    out = np.asarray(np.where(one, dt <= GAP + SAME, (dt <= slack) & traced[part[:-1]] & traced[part[1:]]))
    left = np.zeros(len(out), dtype=bool)
    for j in np.flatnonzero(~out & one):
        left[j] = seen.at_edge(k, float(t[j]), 1) and seen.at_edge(k, float(t[j + 1]), -1)
    return out, left


def _comes_or_goes(k: Sightings, seen: SightEdges, way: int) -> bool:
    """Whether an object has a reason to be seen first (way -1) or last (way 1) where it is."""
    t = float(k.t[0] if way < 0 else k.t[-1])
    if (way * (k.blind - t) > 0.0).any():  # it has rows beyond
        return False
    return seen.at_edge(k, t, way)


def _absent(k: Sightings, start: float, end: float) -> Absence:
    keep = (k.t >= start - SAME) & (k.t <= end + SAME)
    inside = (k.t > start + SAME) & (k.t < end - SAME) & ~k.usable
    lacking = inside.any() or ((k.blind >= start - SAME) & (k.blind <= end + SAME)).any()
    why = f"its rows lack {k.lacks}" if k.lacks and (lacking or not k.usable.any()) else "not seen"
    return Absence(
        object=k.id_at(start),
        start=start,
        end=end,
        why=why,
        straight=False,
        size=k.size,
        t=k.t[keep],
        state=k.state[keep],
    )
