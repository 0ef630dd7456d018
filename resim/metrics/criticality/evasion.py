"""What the EGO could still do: TTB, TTK, TTS, TTR, and the braking it needs (DRAC)."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from resim.core.geometry import Bools, Floats, to_frame
from resim.metrics.criticality import motion
from resim.metrics.criticality.contact import Rows, first_contact
from resim.metrics.criticality.measure import Measure, States, stated
from resim.metrics.criticality.pairs import CompletePairs, Pairs
from resim.metrics.criticality.times import planned_contact
from resim.metrics.risk import DEFAULTS, Parameters

HALVINGS = 12
COARSE, MOST = 1.0, 20.0  # m/s²; DRAC is looked for in steps of COARSE up to MOST, then bisected

Evasion = Callable[[CompletePairs, Floats, Floats], Floats]
"""The EGO's motion (P, N, 4) at times (P, N) after the evasion began, at `start` (P,) [s]."""


def ttb(pairs: Pairs, limits: Parameters = DEFAULTS) -> Measure:
    """Give the time to brake (S, K) [s]: the latest start of full braking along the plan's path that still avoids.

    Wagner 2021, 3.2.3.1, after Hillenbrand 2006; one behind the other TTB = (d - v_rel² / (2 b)) / v_rel. The plan's
    contact with the expected motion of the object is what is avoided; an evasion is followed for a full horizon from
    its start. limits: how hard the EGO evades, as in the accident risk. 0 where not even braking now avoids it;
    NO_CONFLICT where the plan touches nobody within the horizon.
    """
    return pairs.measured("TTB", "s", "low", partial(_latest, [_along_path(-limits.braking)]))


def ttk(pairs: Pairs, limits: Parameters = DEFAULTS) -> Measure:
    """Give the time to kickdown (S, K) [s]: as `ttb`, for full acceleration (Wagner 2021, 3.2.3.1)."""
    return pairs.measured("TTK", "s", "low", partial(_latest, [_along_path(limits.forward)]))


def tts(pairs: Pairs, limits: Parameters = DEFAULTS) -> Measure:
    """Give the time to steer (S, K) [s]: as `ttb`, for full steering to the better side (Wagner 2021, 3.2.3.1).

    A circle at constant speed v with yaw rate min(lateral / v, curvature v), as in the risk metric.
    """
    return pairs.measured(
        "TTS", "s", "low", partial(_latest, [_turning(limits, 1.0), _turning(limits, -1.0)])
    )


def ttr(pairs: Pairs, limits: Parameters = DEFAULTS) -> Measure:
    """Give the time to react (S, K) [s]: max(TTB, TTK, TTS) (Wagner 2021, Eq. 3.6). States as in `ttb`."""
    return longest(ttb(pairs, limits), ttk(pairs, limits), tts(pairs, limits))


def longest(ttb: Measure, ttk: Measure, tts: Measure) -> Measure:
    """Give `ttr` of what was computed."""
    return Measure("TTR", "s", np.maximum(np.maximum(ttb.value, ttk.value), tts.value), ttb.state, "low")


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


def _turning(limits: Parameters, side: float) -> Evasion:
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


def _latest(evasions: list[Evasion], p: CompletePairs) -> tuple[Floats, States]:
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


def drac(pairs: Pairs) -> Measure:
    """Give the deceleration rate to avoid a crash (S, K) [m/s²]: the least constant one of the EGO that avoids.

    DRAC = (v_follow - v_lead)² / (2 d) (Cooper and Ferguson 1976) where one follows the other. In general: the EGO
    brakes from now along its plan's path, the object goes straight on at its present velocity; followed for two
    horizons, as a contact at d / v_rel is put off by braking to at most twice that. inf where no deceleration up to
    20 m/s² avoids (oncoming, boxes that touch). 0 for who comes from behind the EGO's box: the EGO does not close in on
    him, and needs not brake. NO_CONFLICT where TTC has none: nothing is needed.
    """
    return pairs.measured("DRAC", "m/s²", "high", _drac, columns=4)


def _drac(p: CompletePairs) -> tuple[Floats, States]:
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
    """Whether the object's box (P,) lies wholly behind the EGO's."""
    ahead, _ = to_frame(p.state[:, 0], p.state[:, 1], p.plan[:, 0, 0], p.plan[:, 0, 1], p.plan[:, 0, 2])
    turn = p.state[:, 2] - p.plan[:, 0, 2]
    half = 0.5 * (np.abs(np.cos(turn)) * p.size[:, 0] + np.abs(np.sin(turn)) * p.size[:, 1])
    return np.asarray(ahead + half < -0.5 * p.ego_size[:, 0])
