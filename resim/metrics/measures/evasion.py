"""What the EGO could still do: TTB, TTK, TTS, TTR, and the braking it needs (DRAC)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from resim.core.geometry import Bools, Floats, to_frame
from resim.metrics.measures import motion
from resim.metrics.measures.contact import Rows, first_contact
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.horizon import fastest, for_time, later, later_braked, speed
from resim.metrics.measures.pairs import CompletePairs, Pairs
from resim.metrics.measures.times import planned_contact
from resim.metrics.measures.values import MeasureValues, StateArray, stated
from resim.metrics.risk import DEFAULTS, RiskParameters

HALVINGS = 12
COARSE, MOST = 1.0, 20.0  # m/s²; DRAC is looked for in steps of COARSE up to MOST, then bisected

Evasion = Callable[[CompletePairs, Floats, Floats], Floats]
"""The EGO's motion (P, N, 4) at times (P, N) after the evasion began, at `start` (P,) [s]."""


TTB = MeasureDefinition(
    name="TTB",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Hillenbrand 2006; Wagner 2021, 3.2.3.1",
    meaning="time to brake: latest start of full braking that still avoids the collision",
    of=lambda inputs: ttb(inputs.pairs, inputs.parameters),
    by_scene=True,
    open_beyond=later_braked,
    unseen=lambda absent: absent.contact(0.0),
)


def ttb(pairs: Pairs, limits: RiskParameters = DEFAULTS) -> MeasureValues:
    """Give the time to brake (S, K) [s]: the latest start of full braking along the plan's path that still avoids.

    Wagner 2021, 3.2.3.1, after Hillenbrand 2006; one behind the other TTB = (d - v_rel² / (2 b)) / v_rel. The plan's
    contact with the expected motion of the object is what is avoided; an evasion is followed for a full horizon from
    its start. limits: how hard the EGO evades, as in the accident risk. 0 where not even braking now avoids it;
    NO_CONFLICT where the plan touches nobody within the horizon.
    """
    return pairs.measured(TTB, partial(_latest, [_along_path(-limits.braking)]))


TTK = MeasureDefinition(
    name="TTK",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Hillenbrand 2006; Wagner 2021, 3.2.3.1",
    meaning="time to kickdown: the same for full acceleration",
    of=lambda inputs: ttk(inputs.pairs, inputs.parameters),
    by_scene=True,
    open_beyond=later,
    unseen=lambda absent: absent.contact(0.0),
)


def ttk(pairs: Pairs, limits: RiskParameters = DEFAULTS) -> MeasureValues:
    """Give the time to kickdown (S, K) [s]: as `ttb`, for full acceleration (Wagner 2021, 3.2.3.1)."""
    return pairs.measured(TTK, partial(_latest, [_along_path(limits.forward)]))


TTS = MeasureDefinition(
    name="TTS",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Hillenbrand 2006; Wagner 2021, 3.2.3.1",
    meaning="time to steer: the same for full steering to the better side",
    of=lambda inputs: tts(inputs.pairs, inputs.parameters),
    by_scene=True,
    open_beyond=later,
    unseen=lambda absent: absent.contact(0.0),
)


def tts(pairs: Pairs, limits: RiskParameters = DEFAULTS) -> MeasureValues:
    """Give the time to steer (S, K) [s]: as `ttb`, for full steering to the better side (Wagner 2021, 3.2.3.1).

    A circle at constant speed v with yaw rate min(lateral / v, curvature v), as in the risk metric.
    """
    return pairs.measured(TTS, partial(_latest, [_turning(limits, 1.0), _turning(limits, -1.0)]))


TTR = MeasureDefinition(
    name="TTR",
    unit="s",
    worst="low",
    kind="quantitative",
    source="Wagner 2021, Eq. 3.6",
    meaning="time to react: the largest of TTB, TTK and TTS",
    of=lambda inputs: longest(*map(inputs.measure, ("TTB", "TTK", "TTS"))),
    made_of=("TTB", "TTK", "TTS"),
    by_scene=True,
    open_beyond=later_braked,
    unseen=lambda absent: absent.contact(0.0),
)


def ttr(pairs: Pairs, limits: RiskParameters = DEFAULTS) -> MeasureValues:
    """Give the time to react (S, K) [s]: max(TTB, TTK, TTS) (Wagner 2021, Eq. 3.6). States as in `ttb`."""
    return longest(ttb(pairs, limits), ttk(pairs, limits), tts(pairs, limits))


def longest(ttb: MeasureValues, ttk: MeasureValues, tts: MeasureValues) -> MeasureValues:
    """Give `ttr` of what was computed."""
    return TTR.values(np.maximum(np.maximum(ttb.value, ttk.value), tts.value), ttb.state)


def _along_path(a: float) -> Evasion:
    def go(p: CompletePairs, start: Floats, t: Floats) -> Floats:
        s = motion.way_at(p.plan, p.step, np.minimum(start, _end(p))[:, None])
        v = np.abs(p.planned(start[:, None])[..., 3])
        s = s + np.maximum(start - _end(p), 0.0)[:, None] * v
        ds, pace = motion.paced(v, np.full((1, 1), a), t)
        return motion.along(p.plan, s + ds, pace)

    return go


def _end(p: CompletePairs) -> float:
    return float((p.plan.shape[1] - 1) * p.step)


def _turning(limits: RiskParameters, side: float) -> Evasion:
    def go(p: CompletePairs, start: Floats, t: Floats) -> Floats:
        state = np.zeros((len(t), 6))
        state[:, :4] = p.planned(start[:, None])[:, 0]
        v = np.abs(state[:, 3])
        state[:, 5] = side * np.minimum(limits.lateral / np.maximum(v, 1e-9), limits.curvature * v)
        return motion.ctra(state, t)

    return go


def _avoids(p: CompletePairs, evasion: Evasion, start: Floats) -> Bools:
    return np.isinf(
        first_contact(evasion(p, start, p.t), p.expected(start[:, None] + p.t), p.h, p.ego_size, p.size)
    )


def _latest(evasions: list[Evasion], p: CompletePairs) -> tuple[Floats, StateArray]:
    """The latest start over all evasions: last success on the grid (Algorithm 4.2), then bisected."""
    contact = planned_contact(p)
    conflict = np.isfinite(contact)
    q, value = p.rows(np.flatnonzero(conflict)), np.zeros(len(contact))
    if conflict.any():
        of_each = [_latest_of(q, evasion, contact[conflict]) for evasion in evasions]
        value[conflict] = np.max(of_each, axis=0)
    return stated(value, conflict=conflict)


def _latest_of(p: CompletePairs, evasion: Evasion, contact: Floats) -> Floats:
    h = p.h[0]
    grid = np.floor(contact / h).astype(int)
    low, high = np.full(len(contact), -1.0), contact.copy()
    for back in range(int(grid.max()) + 1):
        rows = np.flatnonzero((low < 0.0) & (grid >= back))
        if not len(rows):
            break
        start = (grid[rows] - back) * h
        good = _avoids(p.rows(rows), evasion, start)
        low[rows[good]], high[rows[~good]] = start[good], start[~good]
    found = np.flatnonzero(low >= 0.0)
    q, one, two = p.rows(found), low[found], high[found]
    for _ in range(HALVINGS if len(found) else 0):
        middle = 0.5 * (one + two)
        good = _avoids(q, evasion, middle)
        one, two = np.where(good, middle, one), np.where(good, two, middle)
    low[found] = one
    return np.asarray(np.maximum(low, 0.0))


DRAC = MeasureDefinition(
    name="DRAC",
    unit="m/s²",
    worst="high",
    kind="quantitative",
    source="Cooper and Ferguson 1976",
    meaning="least constant deceleration of the EGO that avoids a crash",
    of=lambda inputs: drac(inputs.pairs),
    by_scene=True,
    needs=lambda inputs, limit: for_time(inputs, 0.5 * fastest(inputs) / limit if limit > 0.0 else np.inf),
    open_beyond=lambda inputs: 0.5 * speed(inputs) / inputs.seen.horizon,
    unseen=lambda absent: absent.at_worst(np.inf, np.isfinite(absent.touches("goes on", steady=True))),
)


def drac(pairs: Pairs) -> MeasureValues:
    """Give the deceleration rate to avoid a crash (S, K) [m/s²]: the least constant one of the EGO that avoids.

    DRAC = (v_follow - v_lead)² / (2 d) (Cooper and Ferguson 1976) where one follows the other. In general: the EGO
    brakes from now along its plan's path, the object goes straight on at its present velocity; followed for two
    horizons, as a contact at d / v_rel is put off by braking to at most twice that. inf where no deceleration up to
    20 m/s² avoids (oncoming, boxes that touch). 0 for who comes from behind the EGO's box: the EGO does not close in on
    him, and needs not brake. NO_CONFLICT where TTC has none: nothing is needed.
    """
    return pairs.measured(DRAC, _drac, columns=4)


def _drac(p: CompletePairs) -> tuple[Floats, StateArray]:
    def avoids(rows: Rows, braking: Floats) -> Bools:
        q = p.rows(rows)
        t = np.arange(2 * q.steps + 1) * q.h[:, None]
        way, pace = motion.paced(np.abs(q.plan[:, 0, 3, None]), -braking[:, None], t)
        ego = motion.along(q.plan, way, pace)
        return np.isinf(first_contact(ego, motion.straight(q.state, t), q.h, q.ego_size, q.size))

    at = first_contact(p.steady, motion.straight(p.state, p.t), p.h, p.ego_size, p.size)
    conflict = np.isfinite(at)
    need = np.full(len(at), np.inf)
    for braking in np.arange(COARSE, MOST + 0.5 * COARSE, COARSE):
        rows = np.flatnonzero(conflict & np.isinf(need))
        good = avoids(rows, np.full(len(rows), braking))
        need[rows[good]] = braking
    rows = np.flatnonzero(conflict & np.isfinite(need))
    high, low = need[rows], need[rows] - COARSE
    for _ in range(HALVINGS + 2):
        middle = 0.5 * (low + high)
        good = avoids(rows, middle)
        low, high = np.where(good, low, middle), np.where(good, middle, high)
    need[rows] = high
    return stated(np.where(np.isinf(need) & _behind(p), 0.0, need), conflict=conflict)


def _behind(p: CompletePairs) -> Bools:
    """Whether the object's box (P,) lies wholly behind the EGO's, as it drives."""
    ahead, _ = to_frame(p.state[:, 0], p.state[:, 1], p.plan[:, 0, 0], p.plan[:, 0, 1], p.plan[:, 0, 2])
    turn = p.state[:, 2] - p.plan[:, 0, 2]
    half = 0.5 * (np.abs(np.cos(turn)) * p.size[:, 0] + np.abs(np.sin(turn)) * p.size[:, 1])
    way = np.where(p.plan[:, 0, 3] < 0.0, -1.0, 1.0)
    return np.asarray(way * ahead + half < -0.5 * p.ego_size[:, 0])
