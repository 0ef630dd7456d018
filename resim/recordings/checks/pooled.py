"""Delay and drift of SD against GT by all its objects together, where none of them alone is sure of it.

Offsets along each object's heading are e = point L/2 + bias - v (delay + drift (t - middle) / lasts): a delay
grows with the speed, another reference point with the length, a sensor's bias with neither. The bias is that of
the EGO's own localisation, or one that all sensed objects share, and a little of each object's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from resim.core.geometry import Floats
from resim.recordings.checks.matching import MatchedTrack
from resim.recordings.checks.tracks import PEDESTRIAN, Track

BIN = 1.0
"""Time [s] over which offsets are taken in the median."""
NOISE = 0.5
"""Slowly varying position error of a sensor [m], one standard deviation over a bin."""
LOCALISED, SHARED, OWN = 0.5, 1.5, 0.3
"""Constant offset [m] of the EGO, of all sensed objects, and of one object beside these, one standard deviation."""
USUAL = 0.3
"""Delay [s] that sensors have; objects that are later show it each by itself."""
DELAY, DRIFT = 0.3, 1.0
"""Delay and its growth over the recording [s], one standard deviation."""
DRIFTED = 0.12
"""Growth of the delay [s] over the recording that no sensor has: 3 m at 25 m/s."""
SURE = 3.0
"""Standard deviations by which a delay or a drift differs from none."""
CLEAR = 2.0
"""Difference of log likelihoods from which on one explanation is better than the other."""
FAR = 2.5
"""Offset [m] that is left of a bin, beyond which it counts less: an object misnamed, or astray."""
SIDE, SIDE_NEAR = 0.6, 0.35
"""Offset across the box [m] from which on an object may be off by a corner, and how near to the half width that is."""
MOST_ASTRAY = 0.1
"""Share of the bins that may be left so far off by what all objects have in common."""

Explained = Literal["delay", "drift", "either", ""]


@dataclass(frozen=True)
class Pooled:
    """What explains the offsets of all objects: a delay [s], its growth over the recording [s], or, as well as a
    delay, a point that is `point` [m] off."""

    what: Explained
    delay: float = 0.0
    drift: float = 0.0
    span: tuple[float, float] = (0.0, 0.0)
    point: float = 0.0


@dataclass(frozen=True, eq=False)
class _PooledFit:
    value: Floats
    spread: Floats
    cost: float
    astray: float


def pooled(known: list[MatchedTrack], ego: str, *, sensed: bool = False) -> Pooled:
    """Tell a common delay and a common drift of SD from another reference point; sensed: of all but the EGO."""
    pairs = [p for p in known if p.gt.kind != PEDESTRIAN and not (sensed and p.gt.id == ego)]
    if not pairs:
        return Pooled("")
    bins = _Bins.of(pairs, ego, max((p.gt for p in known if p.gt.id == ego), key=len, default=None))
    plain, delayed, drifted = (bins.fit(n) for n in (0, 1, 2))
    delay, drift = float(delayed.value[0]), float(drifted.value[1])
    span = (float(min(p.t[0] for p in pairs)), float(max(p.t[-1] for p in pairs)))
    grows = abs(drift) > max(DRIFTED, SURE * drifted.spread[1]) and drifted.astray <= MOST_ASTRAY
    if grows and drifted.cost < delayed.cost - 0.5 * SURE**2:
        return Pooled("drift", float(drifted.value[0]), drift, span)
    late = SURE * delayed.spread[0] < abs(delay) <= USUAL and delayed.astray <= MOST_ASTRAY
    if not late or delayed.cost > plain.cost - 0.5 * SURE**2:
        return Pooled("")
    if any(_at_side(p) for p in pairs):
        return Pooled("")  # no delay moves an object sideways
    sign = -1.0 if delay > 0.0 else 1.0
    # of all, of the EGO alone, and of the side that a sensor on the EGO sees
    points = sign * np.ones(len(bins.e)), sign * bins.biases[:, 0], bins.seen
    turned = min(bins.fit(0, point).cost for point in points)
    if turned < delayed.cost - (CLEAR if delay > 0.0 else -CLEAR):  # no sensor is early
        return Pooled("")
    point = sign * 0.5 * float(np.median([p.gt.length for p in pairs]))
    if turned > delayed.cost + CLEAR:
        return Pooled("delay", delay, 0.0, span)
    return Pooled("either", delay, 0.0, span, point)


def _at_side(pair: MatchedTrack) -> bool:
    """Whether the object is off by half its width to a side: a corner."""
    across = abs(float(np.median(pair.across)))
    return across > SIDE and abs(across - 0.5 * pair.gt.width) < SIDE_NEAR


def _side(pair: MatchedTrack, seer: Track) -> Floats:
    """Whether the EGO is ahead of the object (1) or behind it (-1), at each time; 0 for itself."""
    to = np.interp(pair.t, seer.t, seer.p) - np.interp(pair.t, pair.gt.t, pair.gt.p)
    ahead = to * np.exp(-1j * np.interp(pair.t, pair.gt.t, pair.gt.heading))
    return np.asarray(np.sign(ahead.real))


@dataclass(frozen=True, eq=False)
class _Bins:
    """Offset ahead e [m], speed v [m/s], time from -0.5 to 0.5 and half length [m] of every bin; columns of the
    biases, and the standard deviation of each. seen: 1 where the EGO is ahead, -1 behind, 0 where it is itself."""

    e: Floats
    v: Floats
    u: Floats
    half: Floats
    seen: Floats
    biases: Floats
    prior: Floats

    @classmethod
    def of(cls, pairs: list[MatchedTrack], ego: str, seer: Track | None) -> _Bins:
        rows = []
        for n, pair in enumerate(pairs):
            side = np.zeros(len(pair.t)) if seer is None else _side(pair, seer)
            number = np.floor((pair.t - pair.t[0]) / BIN).astype(int)
            for k in range(number[-1] + 1):
                if (own := number == k).any():
                    place = (float(np.median(values[own])) for values in (pair.along, pair.v, pair.t, side))
                    rows.append((*place, 0.5 * pair.gt.length, n))
        e, v, t, seen, half, n = np.array(rows).T
        lasts = max(float(np.ptp(t)), BIN)
        is_ego = np.array([p.gt.id == ego for p in pairs])[n.astype(int)]
        biases = np.zeros((len(e), len(pairs) + 2))
        biases[:, 0], biases[:, 1] = is_ego, ~is_ego
        biases[np.arange(len(e)), n.astype(int) + 2] = 1.0
        prior = np.r_[LOCALISED, SHARED, np.full(len(pairs), OWN)]
        return cls(e, v, (t - t.min()) / lasts - 0.5, half, seen, biases, prior)

    def fit(self, terms: int, point: float | Floats = 0.0) -> _PooledFit:
        """The most likely delay (terms 1) and drift (2), given that the point is so many half lengths off (K,)."""
        clocks = np.stack([-self.v, -self.v * self.u], axis=1)[:, :terms]
        design = np.concatenate([clocks, self.biases], axis=1)
        weight = np.r_[np.array([DELAY, DRIFT])[:terms], self.prior] ** -2.0
        e, each = self.e - point * self.half, np.full(len(self.e), NOISE**-2.0)
        for _ in range(8):
            covariance = np.linalg.inv(design.T @ (each[:, None] * design) + np.diag(weight))
            value = covariance @ (design.T @ (each * e))
            off = np.abs(e - design @ value)
            each = NOISE**-2.0 * np.minimum(1.0, FAR / np.maximum(off, 1e-9))
        loss = np.where(off < FAR, 0.5 * off**2, FAR * (off - 0.5 * FAR)) / NOISE**2
        cost = float(loss.sum() + 0.5 * (weight * value**2).sum())
        usual = np.r_[value[:terms], np.clip(value[terms:], -SURE * self.prior, SURE * self.prior)]
        astray = float(np.mean(np.abs(e - design @ usual) > FAR))
        return _PooledFit(value, np.sqrt(np.diag(covariance)), cost, astray)
