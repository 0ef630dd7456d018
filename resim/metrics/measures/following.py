"""Rules between vehicles: half the speedometer, its time to restore, overtaking on the right."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats, to_frame, wrap_angle
from resim.metrics.measures import motion
from resim.metrics.measures.contact import first_contact
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.horizon import FARTHEST, RANGE, fastest, for_way, speed
from resim.metrics.measures.pairs import CompletePairs, Pairs
from resim.metrics.measures.values import MeasureValues, State, StateArray, stated

if TYPE_CHECKING:
    from resim.metrics.doubts.absent import AbsentObject

SAME_WAY = 0.25 * np.pi  # rad; who heads less than this off the EGO's path drives the same way
STANDS = 0.5  # m/s; who is no faster stands, and heads nowhere
FAST = 160.0 / 3.6  # m/s
KMH = 3.6
BESIDE = 5.5  # m; up to which somebody is overtaken on the right


GAP_AHEAD = MeasureDefinition(
    name="gap ahead",
    unit="m",
    worst="low",
    kind="quantitative",
    source="the distance d of TTC and THW (Wagner 2021, Eq. 3.2 and 3.5)",
    meaning="gap along the EGO's path to the object's box",
    of=lambda inputs: gap_ahead(inputs.pairs, reach=inputs.seen.reach),
    by_scene=True,
    needs=for_way,
    open_beyond=lambda inputs: inputs.seen.reach + 0.0 * speed(inputs),
    unseen=lambda absent: np.where(np.isfinite(gap := absent.gap()), gap, np.nan),
)


def gap_ahead(pairs: Pairs, *, reach: float = RANGE) -> MeasureValues:
    """Give the gap (S, K) [m] along the EGO's path to the object's box as it is now; the d of TTC and THW.

    Measured by driving the EGO's box along the path of its plan, then straight on, until it touches, whichever way who
    is there heads. NO_CONFLICT where it touches nothing within `reach` [m]; NOT_DEFINED where the EGO reverses; 0 where
    the boxes touch.
    """
    return pairs.measured(GAP_AHEAD, partial(_gap, reach, between_vehicles=False), columns=4)


def _gap(reach: float, p: CompletePairs, *, between_vehicles: bool) -> tuple[Floats, StateArray]:
    """The gap; between_vehicles: whether to who goes another way it is not defined, which a standing one cannot."""
    n = max(2, int(np.ceil(reach / 2.0)))
    scenes, of = np.unique(p.scene, return_inverse=True)
    s = np.broadcast_to(np.linspace(0.0, reach, n + 1), (len(scenes), n + 1))
    ego = motion.along(p.every.plan[scenes], s, np.ones_like(s))[of]  # 1 m/s: metres are seconds
    s = s[of]
    there = p.state.copy()
    there[:, 3] = 0.0
    gap = first_contact(ego, motion.straight(there, s), np.full(len(s), reach / n), p.ego_size, p.size)
    defined = p.plan[:, 0, 3] >= 0.0
    if between_vehicles:
        found = np.flatnonzero(np.isfinite(gap) & (np.abs(p.state[:, 3]) > STANDS))
        heading = motion.along(p.plan[found], gap[found, None], np.ones((len(found), 1)))[:, 0, 2]
        defined[found] &= np.abs(wrap_angle(p.state[found, 2] - heading)) < SAME_WAY
    return stated(gap, conflict=np.isfinite(gap), defined=defined)


HALF_SPEEDOMETER = MeasureDefinition(
    name="half speedometer",
    unit="m",
    worst="low",
    kind="legal",
    source="Kaefer 2022, Eq. 4.1; case law to section 4 of the German road traffic act",
    meaning="gap beyond the least distance (half the speedometer reading); negative is too near",
    of=lambda inputs: half_speedometer(inputs.pairs, reach=inputs.seen.reach),
    by_scene=True,
    needs=lambda inputs, limit: for_way(inputs, limit + 0.5 * KMH * fastest(inputs)),
    open_beyond=lambda inputs: inputs.seen.reach - 0.5 * KMH * speed(inputs),
    unseen=lambda absent: _spare(absent),
)


def _spare(absent: AbsentObject) -> Floats:
    """The least that the gap (P,) [m] to somebody unseen can be above the least distance, NaN for no gap."""
    gap = absent.gap()
    return np.where(np.isfinite(gap), gap - 0.5 * KMH * np.maximum(absent.v, 0.0), np.nan)


def half_speedometer(pairs: Pairs, *, urban: bool = False, reach: float = RANGE) -> MeasureValues:
    """Give how many metres (S, K) the gap is above the least distance; negative is too near.

    Least distance v / 2 in metres with v in km/h, in urban areas v / 3.6, the way of one second (Kaefer, Eq. 4.1).
    States as in `gap_ahead`: NO_CONFLICT where nobody is ahead within `reach` [m] or the least distance; NOT_DEFINED to
    who moves another way, to whom no distance is to be kept.
    """
    v = np.maximum(pairs.plan[:, 0, 3], 0.0)
    least = v if urban else 0.5 * KMH * v
    gap = pairs.measured(HALF_SPEEDOMETER, partial(_gap, reach, between_vehicles=True), columns=4)
    if (fast := np.flatnonzero(least > reach)).size:
        far = partial(_gap, max(reach, FARTHEST), between_vehicles=True)
        farther = pairs.scenes(fast).measured(HALF_SPEEDOMETER, far, columns=4)
        gap.value[fast], gap.state[fast] = farther.value, farther.state
    return HALF_SPEEDOMETER.values(gap.value - least[:, None], gap.state)


TAILGATING = MeasureDefinition(
    name="tailgating",
    unit="s",
    worst="high",
    kind="legal",
    source="Kaefer 2022, 4.5.6.4",
    meaning="how long the gap has been too short, beyond the time allowed to restore it",
    of=lambda inputs: tailgating(
        inputs.drive.t, inputs.drive.scenes.plan[:, 0, 3], inputs.measure("half speedometer")
    ),
    made_of=("half speedometer",),
    unseen=lambda absent: absent.at_worst(np.inf, _spare(absent) < 0.0),
)


def tailgating(t: Floats, v: Floats, spare: MeasureValues) -> MeasureValues:
    """Give for how long (S, K) [s] the gap has been too short beyond the time to restore it; negative within it.

    t: (S,) s, times of successive scenes; v: (S,) m/s of the EGO; spare: (S, K), of `half_speedometer`. Somebody who
    was not ahead in the scene before and comes in nearer than allowed leaves the EGO 3 s, above 160 km/h 1 s, to
    restore the gap; else there is none (Kaefer, 4.5.6.4). Counted from the first scene of the violation; a column is
    one and the same object throughout.
    NO_CONFLICT where the gap is kept or nobody ahead, NOT_DEFINED as of `half_speedometer`.
    Raises ResimError for times that do not increase.
    """
    if len(t) > 1 and not np.all(np.diff(t) > 0.0):
        raise ResimError("tailgating: expected times that increase from scene to scene")
    near = (spare.state == State.VALUE) & (np.nan_to_num(spare.value) < 0.0)
    begins, came = near.copy(), np.zeros_like(near)
    begins[1:] &= ~near[:-1]
    came[1:] = np.isin(spare.state[:-1], (State.NO_CONFLICT, State.NOT_DEFINED))
    since = np.maximum.accumulate(np.where(begins, np.arange(len(t))[:, None], 0), axis=0)
    grace = np.where(came, np.where(v > FAST, 1.0, 3.0)[:, None], 0.0)
    value = np.where(near, t[:, None] - t[since] - np.take_along_axis(grace, since, axis=0), np.nan)
    state = np.where(near, State.VALUE, np.where(spare.state == State.VALUE, State.NO_CONFLICT, spare.state))
    return TAILGATING.values(value, state.astype(np.uint8))


OVERTAKING_RIGHT = MeasureDefinition(
    name="overtaking on the right",
    unit="m/s",
    worst="high",
    kind="legal",
    source="German road traffic act, section 5 (1)",
    meaning="how much faster the EGO passes an object on the right",
    of=lambda inputs: overtaking_right(inputs.pairs),
    by_scene=True,
    unseen=lambda absent: absent.at_worst(np.inf, absent.now() <= BESIDE),
)


def overtaking_right(pairs: Pairs, *, beside: float = BESIDE) -> MeasureValues:
    """Give by how much (S, K) [m/s] the EGO is faster than an object that it passes on the right.

    The object's box is beside the EGO's (they overlap along the EGO's axis), to its left by up to `beside` [m] between
    centres, and drives the same way. Negative: it is the one who passes, on the left. NO_CONFLICT elsewhere. German
    road traffic act, section 5 (1); what it allows (queues, built-up areas) is not known here.
    """
    return pairs.measured(OVERTAKING_RIGHT, partial(_right, beside), columns=4)


def _right(beside: float, p: CompletePairs) -> tuple[Floats, StateArray]:
    ego, other = p.plan[:, 0], p.state
    along, left = to_frame(other[:, 0], other[:, 1], ego[:, 0], ego[:, 1], ego[:, 2])
    turn = wrap_angle(other[:, 2] - ego[:, 2])
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    length = 0.5 * (p.ego_size[:, 0] + c * p.size[:, 0] + s * p.size[:, 1])
    width = 0.5 * (p.ego_size[:, 1] + s * p.size[:, 0] + c * p.size[:, 1])
    there = (np.abs(along) <= length) & (left > width) & (left <= beside) & (np.abs(turn) < SAME_WAY)
    return stated(ego[:, 3] - np.cos(turn) * other[:, 3], conflict=there)
