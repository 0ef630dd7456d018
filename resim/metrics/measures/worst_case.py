"""The worst case: WTTC over all that physics allows, WTTR over what traffic does.

WTTC. Both boxes may do anything a vehicle can do: the centre accelerates by at most a in any direction (Kamm's
circle; who stands may reverse), the box turns at a rate of at most min(a / v, curvature v), in either sense.

- After t the centre lies within ½ a t² of where constant velocity takes it: exactly the reachable disc.
- The heading lies within phi(t) of the present one, phi = ∫ max over reachable v of min(a / v, curvature v).
- So the box lies within the disc plus the convex hull of all boxes turned by at most phi. Its support in direction n is
  h(n) = r cos(max(0, |angle from n to the nearest corner| - phi)), r half the diagonal.
- Boxes can touch at t only if for every n: n · (c2 - c1)(t) <= h1(n) + h2(-n) + ½ (a1 + a2) t², and the circles around
  them, |c2 - c1|(t) <= r1 + r2 + ½ (a1 + a2) t².

The earliest t for which that holds is never later than the earliest contact of any drivable motions: position and
heading are let free of each other. Finitely many n keep that true.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from resim.core.geometry import Floats
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.horizon import for_time, later, later_braked
from resim.metrics.measures.pairs import CompletePairs, Pairs
from resim.metrics.measures.values import MeasureValues, State, StateArray, stated
from resim.metrics.risk import Risk, RiskParameters, Scenes

FRICTION, GRAVITY = 0.9, 9.81
DIRECTIONS = 64
NEAR = 1e-4  # m
ROUNDS = 500


WTTC = MeasureDefinition(
    name="WTTC",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Wachenfeld et al. 2016, Eq. 5; Wagner 2021, 3.2.3.1",
    meaning="worst time to collision: earliest contact of any drivable motions of both",
    of=lambda inputs: wttc(inputs.pairs),
    by_scene=True,
    needs=for_time,
    open_beyond=later,
    unseen=lambda absent: absent.time("anything", strays=2.0 * FRICTION * GRAVITY),
)


def wttc(pairs: Pairs, *, most: float = FRICTION * GRAVITY, curvature: float = 0.2) -> MeasureValues:
    """Give the worst time to collision (S, K) [s]: the earliest contact of any drivable motions of both boxes.

    |c2 - c1 + (v2 - v1) t| = r1 + r2 + ½ (a1 + a2) t² with circles of radius r around the boxes (Wachenfeld et al.
    2016, Eq. 5; Wagner 2021, 3.2.3.1); here with the boxes themselves, turned as far as can be (see the module): later
    than with circles, and still no later than the truth. 64 directions cost 0.5 ms on average, at most 10. most: m/s²
    of both, curvature: 1/m. 0 where the boxes touch; NO_CONFLICT where they cannot touch within the horizon.
    """
    return pairs.measured(WTTC, partial(_wttc, most, curvature), columns=4)


WTTR = MeasureDefinition(
    name="WTTR",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Wagner 2021, 4.2.1",
    meaning="worst TTR over the samples of the risk's prediction",
    of=lambda inputs: wttr(inputs.drive.scenes, inputs.risk, inputs.parameters),
    by_scene=True,
    open_beyond=lambda inputs: np.maximum(later_braked(inputs) - inputs.parameters.step, 0.0),
    unseen=lambda absent: absent.contact(0.0),
)


def wttr(scenes: Scenes, risk: Risk, parameters: RiskParameters) -> MeasureValues:
    """Give the worst time to react (S, K) [s]: the least TTR over the samples of the accident risk's prediction.

    risk: of the scenes, with these parameters. Wagner 2021, 4.2.1: the worst of what traffic naturally does (Eq. 4.2,
    3 sigma), not of all that is drivable, of which next to nothing within 70 m could be evaded for 4 s. Rounded down to
    the step of the prediction. 0 where it is too late; NO_CONFLICT where no sample touches; NOT_COMPUTED where NaN or a
    size of 0 stands in the input.
    """
    known = Pairs.of(scenes, parameters.step).complete() & np.isfinite(scenes.inputs).all(axis=2)
    state = np.where(
        known, np.where(np.isfinite(risk.ttr), State.VALUE, State.NO_CONFLICT), State.NOT_COMPUTED
    )
    value = np.where(state == State.VALUE, risk.ttr, np.nan)
    return WTTR.values(value, state.astype(np.uint8))


def turned(v: Floats, t: Floats, most: float, curvature: float) -> Floats:
    """Give phi [rad], the most a heading can have turned after t [s] from pace v >= 0 [m/s]; arrays of one shape.

    The rate is greatest, sqrt(a k), at the pace sqrt(a / k): brake towards it from above, accelerate from below.
    """
    top, best = np.sqrt(most * curvature), np.sqrt(most / curvature)
    until = np.minimum(t, np.abs(v - best) / most)
    fast = -np.log1p(-np.where(v > best, most * until, 0.0) / np.maximum(v, best))
    slow = curvature * (v * until + 0.5 * most * until**2)
    return np.asarray(np.where(v > best, fast, slow) + top * (t - until))


def _wttc(most: float, curvature: float, p: CompletePairs) -> tuple[Floats, StateArray]:
    a, b = p.plan[:, 0], p.state
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    vx = b[:, 3] * np.cos(b[:, 2]) - a[:, 3] * np.cos(a[:, 2])
    vy = b[:, 3] * np.sin(b[:, 2]) - a[:, 3] * np.sin(a[:, 2])
    n = _directions(a[:, 2], b[:, 2])
    along, rate = (
        np.cos(n) * dx[:, None] + np.sin(n) * dy[:, None],
        np.cos(n) * vx[:, None] + np.sin(n) * vy[:, None],
    )
    r = [0.5 * np.hypot(*size.T) for size in (p.ego_size, p.size)]
    off = [from_corner(n - h[:, None], size) for h, size in ((a[:, 2], p.ego_size), (b[:, 2], p.size))]
    pace, spin = np.hypot(vx, vy), np.sqrt(most * curvature) * (r[0] + r[1])
    t, at = np.zeros(len(a)), np.full(len(a), np.inf)
    live = np.arange(len(a))
    for _ in range(ROUNDS):
        now = t[live]
        gap = along[live] + rate[live] * now[:, None] - most * now[:, None] ** 2
        for box, v, corner in ((0, a[live, 3], off[0]), (1, b[live, 3], off[1])):
            phi = turned(np.abs(v), now, most, curvature)
            gap -= r[box][live, None] * np.cos(np.maximum(corner[live] - phi[:, None], 0.0))
        x, y = dx[live] + vx[live] * now, dy[live] + vy[live] * now
        circles = np.hypot(x, y) - r[0][live] - r[1][live] - most * now**2
        g = np.maximum(gap.max(axis=1), circles)
        at[live[g <= NEAR]] = now[g <= NEAR]
        # the gap cannot close before this: conservative advancement
        closing = pace[live] + 2.0 * most * now + spin[live]
        t[live] = now + (np.sqrt(closing**2 + 4.0 * most * np.maximum(g, 0.0)) - closing) / (2.0 * most)
        live = live[(g > NEAR) & (t[live] <= p.horizon)]
        if not len(live):
            break
    at[live] = t[live]  # what has not settled is a bound all the same
    return stated(at, conflict=np.isfinite(at))


def _directions(heading_a: Floats, heading_b: Floats) -> Floats:
    """Directions (P, n) [rad]: all around, and the axes of both boxes."""
    around = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)  # holds the axes of a
    axes = np.arange(4) * 0.5 * np.pi
    return np.concatenate([heading_a[:, None] + around, heading_b[:, None] + axes], axis=1)


def from_corner(angle: Floats, size: Floats) -> Floats:
    """Give the angle (P, n) in [0, pi/2] between directions, seen from the box, and its nearest corner."""
    folded = np.abs(np.mod(angle + 0.5 * np.pi, np.pi) - 0.5 * np.pi)
    return np.asarray(np.abs(folded - np.arctan2(size[:, 1], size[:, 0])[:, None]))
