"""Where somebody can have been while nobody saw him, and whether boxes can have touched.

Who is last seen at p0 with velocity v0, and seen again T later at p1 with v1, accelerates by at most a in between.
After tau, with sigma = T - tau left, his centre lies in three discs:

- forwards: about p0 + v0 tau, of radius ½ a tau²;
- backwards: about p1 - v1 sigma, of radius ½ a sigma²;
- between, as he has to come from the one and get to the other. With W = v1 - v0 and D = p1 - p0 - v0 T his
  acceleration u has ∫ u ds = W and ∫ (T - s) u ds = D, so that for any A, B

      x(tau) = p0 + v0 tau + A W + B D + ∫ [f(s) - A - B (T - s)] u ds,  f(s) = max(tau - s, 0).

  The line through f at T/4 and 3T/4 makes the last integral least (L1 approximation of a convex f): at most
  a |2 F(T/4) - 2 F(3T/4) + F(T)|, F the integral of f; in the middle a T² / 16.

Who is not seen again, or was not seen before, has the first disc alone, or the second. Who was not seen before strays
for LOST at most: without that bound whoever comes out from behind a truck could have been anywhere before. His box
turns by no more than WTTC lets it (`worst_case.turned`). Boxes touch only if no direction parts them, for none of the
discs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from resim.core.geometry import Floats
from resim.metrics.doubts.unseen import Absence
from resim.metrics.measures.contact import Rows
from resim.metrics.measures.worst_case import FRICTION, GRAVITY, from_corner, turned

MOST, CURVATURE = FRICTION * GRAVITY, 0.2
"""Acceleration [m/s²] and curvature [1/m] that nobody exceeds, as for WTTC."""
LOST = 2.0
"""Time [s] for which who was not seen before strays from the velocity that he is first seen with."""
MISSED = 0.2
"""Distance [m] by which sighted positions may miss."""
DIRECTIONS = 32
CHUNK = 4096
"""Pairs of boxes looked at together: bounds memory."""

Then = Literal["stays", "goes on", "anything"]
"""What he does after the scene: stays where he is (THW), keeps his velocity (TTC), whatever he can (risk)."""
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Reach:
    """Where an absent object can be in P scenes.

    centre [m], velocity [m/s]: (P, 3, 2) of the discs; radius [m], spread [m/s]: (P, 3), how far off place and velocity
    can be, radius inf for a disc that says nothing. heading, phi: (P,) rad, and how far off that can be. size: length,
    width [m].
    """

    centre: Floats
    velocity: Floats
    radius: Floats
    spread: Floats
    heading: Floats
    phi: Floats
    size: tuple[float, float]

    @classmethod
    def of(cls, absence: Absence, t: Floats) -> Reach:
        """Give where the object can be at t (P,) [s]."""
        n, p = len(absence.t), len(t)
        if not n:
            nowhere, anywhere = np.zeros((p, 3, 2)), np.full((p, 3), np.inf)
            still = np.zeros((p, 3))  # inf times 0 s ahead would be no number
            return cls(nowhere, nowhere, anywhere, still, np.zeros(p), np.full(p, np.pi), absence.size)
        after = np.searchsorted(absence.t, t + _SAME)
        before, later = after > 0, after < n
        i, j = np.maximum(after - 1, 0), np.minimum(after, n - 1)
        one, two = absence.state[i], absence.state[j]
        tau, sigma = np.maximum(t - absence.t[i], 0.0), np.maximum(absence.t[j] - t, 0.0)
        centre = np.stack([
            one[:, :2] + one[:, 3:] * tau[:, None], two[:, :2] - two[:, 3:] * sigma[:, None], np.zeros((p, 2))
        ], axis=1)  # fmt: skip
        strays = [tau, np.where(before, sigma, np.minimum(sigma, LOST))]
        most, missed = (0.0, 0.0) if absence.straight else (MOST, MISSED)
        off = [
            np.where(known, 0.5 * most * x**2, np.inf)
            for known, x in zip((before, later), strays, strict=True)
        ]
        centre[:, 2], between = _between(one, two, tau, sigma)
        radius = np.stack([*off, np.where(before & later, between, np.inf)], axis=1) + missed
        forwards = before & (~later | (tau <= sigma))
        near, since = np.where(forwards[:, None], one, two), np.where(forwards, tau, sigma)
        velocity = np.stack([one[:, 3:], two[:, 3:], near[:, 3:]], axis=1)
        spread = most * np.stack([*strays, np.where(forwards, *strays)], axis=1)
        turns = 0.0 if absence.straight else 1.0
        phi = turns * turned(np.hypot(*near[:, 3:].T), since, MOST, CURVATURE)
        known = np.isfinite(near[:, 2])
        return cls(
            centre, velocity, radius, spread, np.where(known, near[:, 2], 0.0), np.where(known, phi, np.pi),
            absence.size,
        )  # fmt: skip

    def clearance(self, way: Floats, ahead: Floats, size: Floats, then: Then, strays: float = 0.0) -> Floats:
        """Give how far (P, N) [m] the boxes are apart at least, 0 or less where they can touch.

        way: (P, N, >= 3) x, y, heading of the EGO's box, size (P, 2), at `ahead` (N,) [s] after the scene. strays:
        acceleration [m/s²] with which the EGO may leave it. What both move between two of the times is taken off.
        """
        s = ahead if then != "stays" else np.zeros_like(ahead)
        any_more = 0.5 * (MOST * (then == "anything") + strays) * s**2
        centre = self.centre[:, None] + self.velocity[:, None] * s[:, None, None]
        apart = centre - way[:, :, None, :2]
        moved = np.hypot(*np.moveaxis(np.diff(apart, axis=1), 3, 0)) * 0.5
        edges = np.zeros((len(way), 1, 3))
        between = np.maximum(np.concatenate([edges, moved], axis=1), np.concatenate([moved, edges], axis=1))
        off = self.radius[:, None] + self.spread[:, None] * s[:, None] + any_more[:, None] + between
        r, own = 0.5 * np.hypot(*self.size), 0.5 * np.hypot(*size.T)
        out = (np.hypot(apart[..., 0], apart[..., 1]) - off).max(axis=2) - r - own[:, None]
        turn = self.phi[:, None] + (then == "anything") * np.sqrt(MOST * CURVATURE) * s
        row, col = np.nonzero((out <= 0.0) & np.isfinite(off).any(axis=2))
        for begin in range(0, len(row), CHUNK):
            i, k = row[begin : begin + CHUNK], col[begin : begin + CHUNK]
            clearance = self._clearance(i, apart[i, k], off[i, k], way[i, k, 2], size[i], turn[i, k])
            out[i, k] = np.maximum(out[i, k], clearance)
        return np.asarray(out)

    def _clearance(
        self, i: Rows, apart: Floats, off: Floats, heading: Floats, size: Floats, turn: Floats
    ) -> Floats:
        """The largest gap [m] between the boxes in any direction."""
        n = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False) + heading[:, None]
        r, own = 0.5 * np.hypot(*self.size), 0.5 * np.hypot(*size.T)
        mine = own[:, None] * np.cos(from_corner(n - heading[:, None], size))
        sizes = np.broadcast_to(self.size, (len(i), 2))
        corner = from_corner(n - self.heading[i, None], sizes)
        his = r * np.cos(np.maximum(corner - turn[:, None], 0.0))
        along = np.cos(n)[:, None] * apart[..., :1] + np.sin(n)[:, None] * apart[..., 1:]
        gap = along - off[..., None] - (mine + his)[:, None]
        return np.asarray(gap.max(axis=(1, 2)))


def _between(one: Floats, two: Floats, tau: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Centre (P, 2) and radius (P,) of the disc in between."""
    whole = np.maximum(tau + sigma, 1e-9)

    def f(s: Floats) -> Floats:
        return np.maximum(tau - s, 0.0)

    def area(s: Floats) -> Floats:
        return 0.5 * (tau**2 - f(s) ** 2)

    low, high = 0.25 * whole, 0.75 * whole
    b = (f(low) - f(high)) / (high - low)
    a = f(high) - b * low
    w, d = two[:, 3:] - one[:, 3:], two[:, :2] - one[:, :2] - one[:, 3:] * whole[:, None]
    centre = one[:, :2] + one[:, 3:] * tau[:, None] + a[:, None] * w + b[:, None] * d
    return centre, MOST * np.abs(2.0 * area(low) - 2.0 * area(high) + area(whole))
