"""A varied maneuver put back into the drive that it is of, without a step in position, speed or heading.

In the source the varied maneuver is concatenated with the object's others. What a varied maneuver changes at its ends
is its speed, along and across, and at its second end its place and its time. So

* the maneuver takes the original's place at each share of its duration, moved by the variation: what the kernel's
  components do not hold of the original stays in it, and no variation is the original itself;
* a difference of speed at its beginning is faded in over BLEND, one at its end is faded out over BLEND, by a cubic, so
  that speeds along and across, and with them the heading, have no step;
* all that follows keeps its own motion, as much later, further along and further across as the maneuver ends.

The object is there as long as the original: what would come later is left out; who is early keeps its last speed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from resim.core.geometry import Floats
from resim.variations.features import POINTS, SAME, parts
from resim.variations.lane_motion import LaneMotion

BLEND = 2.0
"""s over which a difference of speed is faded in or out; half of the maneuver's duration where that is less."""
LEAST = 0.2
"""Share of its duration that a varied maneuver lasts at least."""


@dataclass(frozen=True, eq=False)
class ManeuverChange:
    """What a variation does to one maneuver.

    Attributes:
        start: First moment of the maneuver [s].
        end: Its last [s].
        moved: (3 points,) what is added to its features: t [s], along and across [m]; 0 at the first point.
    """

    start: float
    end: float
    moved: Floats


def joined_motion(motion: LaneMotion, change: ManeuverChange) -> LaneMotion:
    """Give the motion with one of its maneuvers varied, at the same times. Raises ValueError where time turns back."""
    dt, ds, dd = parts(change.moved)
    last = change.end - change.start
    until = last + float(dt[-1])
    if until < LEAST * last:
        raise ValueError("the maneuver would take no time")
    share = np.linspace(0.0, 1.0, len(dt))
    pace = until / last
    own = [CubicSpline(motion.t, values) for values in (motion.s, motion.d)]
    extra = [CubicSpline(share, values - values[0]) for values in (ds, dd)]
    before, within, after = _split(motion.t, change, until)
    blend = min(BLEND, 0.5 * until)
    out = []
    for one, more in zip(own, extra, strict=True):
        phase = (within - change.start) / until
        begun = one(change.start + phase * last) + more(phase)
        first = (one(change.start, 1) + more(0.0, 1) / last) / pace - one(change.start, 1)
        final = (one(change.end, 1) + more(1.0, 1) / last) / pace - one(change.end, 1)
        faded_in = 0.0 if change.start <= motion.t[0] + SAME else float(first)
        begun = begun - _faded(within - change.start, faded_in, blend)
        shift = float(more(1.0)) - float(_faded(np.array([until]), faded_in, blend)[0])
        rest = _continued(one, motion.t, after - until + last) + shift
        out.append(
            np.concatenate(
                [one(before), begun, rest + _faded(after - change.start - until, float(final), blend)]
            )
        )
    return replace(motion, s=out[0], d=out[1])


def _split(t: Floats, change: ManeuverChange, until: float) -> tuple[Floats, Floats, Floats]:
    """The times before, in and after the varied maneuver."""
    begin, end = np.searchsorted(t, [change.start, change.start + until + SAME])
    return t[:begin], t[begin:end], t[end:]


def _faded(since: Floats, speed: float, blend: float) -> Floats:
    """Way (K,) [m] of a speed [m/s] that fades to nothing over `blend` [s], with no step in it at either end."""
    u = np.clip(since / blend, 0.0, 1.0)
    return np.asarray(speed * blend * (u - u**3 + 0.5 * u**4))


def _continued(spline: CubicSpline, t: Floats, at: Floats) -> Floats:
    """Values (K,) at times; beyond the last one with the speed that it has there."""
    inside = np.minimum(at, t[-1])
    return np.asarray(spline(inside) + (at - inside) * spline(t[-1], 1))


def no_change(points: int = POINTS) -> Floats:
    """Give the features that move nothing."""
    return np.zeros(3 * points)
