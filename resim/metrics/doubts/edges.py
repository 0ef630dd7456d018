"""Where seeing ends: the edge of the area that is seen, and the sensor's range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats, to_frame
from resim.core.objects import MISS, ObjectIds, reaches
from resim.core.sightings import MOVES, SAME, Sightings

CORRIDOR = 10.0
"""Distance [m] to either side of a way in which somebody seen farther on shows that it does not end there."""
ACROSS = 40.0
"""How far [m] aside those may come or go who show that there is an edge."""
RANGE, FAR = 50.0, 0.9
"""Least range of a sensor [m], and the share of the largest distance seen from which on an object is at the range."""
OFTEN = 0.2
"""Time [s] between the samples of an object that show where somebody is seen; its first and last do as well."""


@dataclass(frozen=True, eq=False)
class SightEdges:
    """What shows where seeing ends. whom: who is there; place: (m, 2) m, of everybody, the EGO too; step: s, usual one.

    t: (T,) s, own: (T, 5) the EGO's state, its heading unwrapped.
    farthest: (2, N) m at which each object is seen before the EGO, and behind it. turns: (e, 6) where objects are seen
    first or last amid the drive: number of the object, t [s], x, y [m], and the velocity [m/s] out of what is seen.
    """

    whom: ObjectIds
    place: Floats
    step: float
    t: Floats
    own: Floats
    farthest: Floats
    turns: Floats

    @property
    def slack(self) -> float:
        """Time [s] by which the first and last samples of objects may differ."""
        return 2.0 * self.step + SAME

    @classmethod
    def of(cls, whom: ObjectIds) -> SightEdges:
        """Give what the objects show."""
        step, whole = whom.ego.step, whom.ego.usable
        t, own = whom.ego.t[whole], whom.ego.state[whole]
        own[:, 2] = np.unwrap(own[:, 2])
        farthest = np.array([_farthest(k, t, own) for k in whom.others]).reshape(-1, 2).T
        place = np.concatenate([_places(k) for k in (whom.ego, *whom.others)])
        return cls(whom, place, step, t, own, farthest, _turns(whom, 2.0 * step + SAME))

    def at_edge(self, k: Sightings, t: float, way: int) -> bool:
        """Whether seeing ends where the object is at t [s], in the direction in which it goes (way 1) or came (-1).

        That it is lost there itself is no evidence: the EGO may be about to hit it. The area: nobody is ever seen
        farther on along its heading, within CORRIDOR of it, and two others come or go at the same line. Or the sensor's
        range: it is RANGE or more from the EGO and moves away, and two others are seen about as far, and nobody much
        farther, ahead or behind as it is.
        """
        x, y, _, vx, vy = k.state[int(np.searchsorted(k.t, t - SAME))]
        speed = float(np.hypot(vx, vy))
        if speed >= MOVES:
            along, across = to_frame(self.place[:, 0], self.place[:, 1], x, y, np.arctan2(way * vy, way * vx))
            farther = (along > 2.0 * self.step * speed) & (np.abs(across) < CORRIDOR)
            if not farther.any() and self._passed(k, t, x, y, way * vx, way * vy):
                return True
        own = [np.interp(t, self.t, column) for column in self.own.T]
        dx, dy = x - own[0], y - own[1]
        apart = float(np.hypot(dx, dy))
        ahead = dx * np.cos(own[2]) + dy * np.sin(own[2]) >= 0.0
        if apart < RANGE or way * (dx * (vx - own[3]) + dy * (vy - own[4])) <= 0.0:
            return False
        far = self.farthest[int(not ahead)]
        others = [(m, d) for m, d in zip(self.whom.others, far.tolist(), strict=True) if m is not k]
        if apart < FAR * max((d for _, d in others), default=0.0):
            return False
        return self.whom.two([m for m, d in others if d >= FAR * apart], k)

    def _passed(self, k: Sightings, t: float, x: float, y: float, vx: float, vy: float) -> bool:
        """Whether two others come or go, at another time than t [s], at the line across (vx, vy) in x, y, over it."""
        who, when, px, py, out_x, out_y = self.turns.T
        along, across = to_frame(px, py, x, y, np.arctan2(vy, vx))
        near = MISS + self.step * (np.hypot(vx, vy) + np.hypot(out_x, out_y))
        over = (np.abs(along) <= near) & (np.abs(across) <= ACROSS) & (out_x * vx + out_y * vy > 0.0)
        over &= np.abs(when - t) > self.slack
        return self.whom.two([self.whom.others[int(n)] for n in np.unique(who[over])], k)


def _farthest(k: Sightings, t: Floats, own: Floats) -> tuple[float, float]:
    """How far [m] it is seen before the EGO, and behind it."""
    x, y, heading = (np.interp(k.t, t, column) for column in own.T[:3])
    ahead, left = to_frame(k.state[:, 0], k.state[:, 1], x, y, heading)
    far = np.hypot(ahead, left)
    return float(far[ahead >= 0.0].max(initial=0.0)), float(far[ahead < 0.0].max(initial=0.0))


def _places(k: Sightings) -> Floats:
    """Where (m, 2) it is seen, about every OFTEN, first and last."""
    if not len(k.t):
        return np.empty((0, 2))
    last = len(k.t) - 1
    some = np.searchsorted(
        k.t, np.arange(k.t[0], k.t[-1], OFTEN) - SAME
    )  # beyond the last where clocks are large
    ends = np.flatnonzero(np.diff(k.part))
    return np.asarray(k.state[np.unique([*np.minimum(some, last), *ends, *(ends + 1), last]), :2])


def _turns(whom: ObjectIds, slack: float) -> Floats:
    """Where objects are seen first or last, as in `SightEdges`, but for the first and last moments of all.

    Who can be somebody else that is seen before, or goes on as somebody else, shows no edge.
    """
    placed = [(n, k) for n, k in enumerate(whom.others) if len(k.t)]
    ends = {way: np.array([k.t[i] for _, k in placed]) for way, i in ((1.0, 0), (-1.0, -1))}
    state = {
        way: np.array([k.state[i] for _, k in placed]).reshape(-1, 5) for way, i in ((1.0, 0), (-1.0, -1))
    }
    rows = []
    for n, k in placed:
        for i, way, edge in ((0, 1.0, whom.start), (-1, -1.0, whom.end)):
            played = np.array([1.0, 1.0, 1.0, -way, -way])  # backwards, who comes goes
            dt = way * (k.t[i] - ends[-way])
            on = reaches(k.state[i] * played, state[-way] * played, dt)
            if abs(k.t[i] - edge) > slack and not on.any():
                rows.append((n, k.t[i], *k.state[i, :2], *(-way * k.state[i, 3:])))
    return np.array(rows).reshape(-1, 6)
