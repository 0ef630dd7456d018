"""What a verdict leaves open: criteria that somebody can have broken whom nobody saw, or whose size is in doubt."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.core.tracks import whole_id
from resim.metrics.criteria import Criterion, Verdict, amount, longest
from resim.metrics.criticality import Measure, Pairs, motion
from resim.metrics.criticality.contact import Rows
from resim.metrics.criticality.following import KMH
from resim.metrics.doubts.reach import MOST, Reach, Then
from resim.metrics.doubts.unseen import Absence, Doubts
from resim.metrics.functional import RANGE as DETECTED
from resim.metrics.horizon import LookAhead
from resim.metrics.objectifications import MeasureInputs, Objectification

BESIDE = 5.5
"""Distance [m] up to which somebody is overtaken on the right (`following.overtaking_right`)."""
METRES = 2.0
"""Steps [m] in which the way ahead is looked along."""
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class _Unseen:
    """An absent object beside the EGO in the P scenes `at` of a drive, looked for as far as `seen`."""

    subject: MeasureInputs
    at: Rows
    reach: Reach
    seen: LookAhead

    @cached_property
    def pairs(self) -> Pairs:
        """The EGO, as far ahead as is looked."""
        usual = self.subject.pairs
        return usual if self.seen.horizon == usual.span else self.subject.farther(self.seen.horizon)

    @property
    def v(self) -> Floats:
        """The EGO's speed (P,) [m/s]."""
        return np.asarray(self.subject.drive.scenes.plan[self.at, 0, 3])

    def touches(self, then: Then, *, steady: bool = False, strays: float = 0.0) -> Floats:
        """Give when (P,) [s] the boxes can touch first, along the EGO's plan or steadily; inf for not at all."""
        pairs = self.pairs
        way = (pairs.steady if steady else pairs.going)[self.at]
        ahead = np.linspace(0.0, pairs.span, way.shape[1])
        gap = self.reach.clearance(way, ahead, pairs.ego_size[self.at], then, strays)
        return _first(gap <= 0.0, ahead)

    def apart(self) -> Floats:
        """Give how far (P,) [m] the boxes are apart at least over the horizon, whatever he does."""
        pairs = self.subject.pairs
        ahead = np.linspace(0.0, pairs.span, pairs.plan.shape[1])
        gap = self.reach.clearance(pairs.plan[self.at], ahead, pairs.ego_size[self.at], "anything")
        return np.asarray(np.maximum(gap.min(axis=1), 0.0))

    def now(self) -> Floats:
        """Give how far (P,) [m] the boxes are apart at least in the scene."""
        pairs = self.subject.pairs
        way = pairs.plan[self.at, :1]
        return np.asarray(self.reach.clearance(way, np.zeros(1), pairs.ego_size[self.at], "stays")[:, 0])

    def gap(self) -> Floats:
        """Give the least way (P,) [m] along the EGO's path to his box, inf for none as far as is looked."""
        pairs, s = self.subject.pairs, np.arange(0.0, self.seen.reach + METRES, METRES)
        ways = np.broadcast_to(s, (len(self.at), len(s)))
        way = motion.along(pairs.plan[self.at], ways, np.ones(ways.shape))
        return _first(self.reach.clearance(way, s, pairs.ego_size[self.at], "stays") <= 0.0, s)


def _first(can: Bools, at: Floats) -> Floats:
    """The first of `at` (N,) less half a step where it can (P, N), inf where it cannot."""
    half = 0.5 * float(at[1] - at[0])
    return np.where(can.any(axis=1), np.maximum(at[can.argmax(axis=1)] - half, 0.0), np.inf)


def _if(value: float, can: Bools) -> Floats:
    return np.where(can, value, np.nan)


def _contact(value: float) -> Callable[[_Unseen], Floats]:
    """The worst value of measures that nothing sharper is known of: where boxes can touch within the horizon."""
    return lambda u: _if(value, np.isfinite(u.touches("anything")))


def _time(then: Then, *, steady: bool = False, strays: float = 0.0) -> Callable[[_Unseen], Floats]:
    def of(u: _Unseen) -> Floats:
        at = u.touches(then, steady=steady, strays=strays)
        return np.where(np.isfinite(at), at, np.nan)

    return of


def _collision(u: _Unseen) -> Floats:
    t = u.subject.drive.t
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    return _if(1.0, u.touches("anything") <= step)


def _spare(u: _Unseen) -> Floats:
    gap = u.gap()
    return np.where(np.isfinite(gap), gap - 0.5 * KMH * np.maximum(u.v, 0.0), np.nan)


WORST: Mapping[str, Callable[[_Unseen], Floats]] = {
    "collision": _collision,
    "TTC": _time("goes on", steady=True),
    "THW": lambda u: np.where(u.v > 0.0, _time("stays", steady=True)(u), np.nan),
    "ETTC": _time("anything"),
    "WTTC": _time("anything", strays=2.0 * MOST),
    "DRAC": lambda u: _if(np.inf, np.isfinite(u.touches("goes on", steady=True))),
    "PMD": _Unseen.apart,
    "gap ahead": lambda u: np.where(np.isfinite(gap := u.gap()), gap, np.nan),
    "half speedometer": _spare,
    "tailgating": lambda u: _if(np.inf, _spare(u) < 0.0),
    "overtaking on the right": lambda u: _if(np.inf, u.now() <= BESIDE),
    "detection": lambda u: _if(0.0, u.now() <= DETECTED),
    "detection rate": lambda u: _if(0.0, u.now() <= DETECTED),
    "risk": _contact(1.0),
    **dict.fromkeys(("TTB", "TTK", "TTS", "TTR", "WTTR", "TPMD"), _contact(0.0)),
}
"""How bad a measure can be in P scenes in which an object is absent, NaN where it says nothing of it.

PET and measures of the user's own: as bad as can be where boxes can touch within the horizon.
"""


def doubted(
    verdict: Verdict,
    criterion: Criterion,
    asked: Objectification,
    measure: Measure,
    subject: MeasureInputs,
    doubts: Doubts,
    seen: LookAhead,
) -> Verdict:
    """Give a verdict, INVALID in place of PASS where somebody can have broken the criterion.

    It can be broken where an object, under whatever ids, is beyond the limit, or can be at worst where it is absent, in
    scenes that last together as long as the criterion says.
    """
    drive = subject.drive
    if verdict.outcome != "PASS":
        return verdict
    within = criterion.within(drive.t)
    alone = measure.value.ndim == 1
    can: dict[tuple[str, ...], list[tuple[Absence, Bools]]] = (
        {} if alone else {ids: [] for ids in doubts.same}
    )
    for absence in doubts.absences:
        if absence.object == str(drive.own.ids[0]):
            if _overlaps(absence, criterion, drive.t):
                return _invalid(verdict, measure, criterion, absence)
        elif not asked.alone:
            whose = () if alone else doubts.one(absence.object)
            possible = within & _possible(absence, criterion, asked.name, measure, subject, seen)
            can.setdefault(whose, []).append((absence, possible))
    for whose, found in can.items():
        broken = within & _broken(whose, criterion, measure, subject)
        lasted = longest(_lasting(broken, whose, subject), drive.t)
        if len(whose) > 1 and criterion.lasts(np.array([lasted]), drive.t).any():
            limit = f"{criterion.side} {amount(criterion.limit, measure.unit)}"
            who = f"objects {', '.join(whose[:5])} can be one, seen under one id after the other"
            return replace(verdict, outcome="INVALID", reason=f"{who}: {limit} for {lasted:.1f} s")
        possible = np.any([broken, *(p for _, p in found)], axis=0)
        lasted = longest(_lasting(possible, whose, subject), drive.t)
        first = next((a for a, p in found if p.any()), None)
        if first is not None and criterion.lasts(np.array([lasted]), drive.t).any():
            return _invalid(verdict, measure, criterion, first)
    return verdict


def _overlaps(absence: Absence, criterion: Criterion, t: Floats) -> bool:
    """Whether the part of the drive that counts has the absence in it, or begins or ends with it."""
    end = np.inf if criterion.end is None else t[0] + criterion.end
    return absence.end >= t[0] + criterion.start and absence.start < end


def _possible(
    absence: Absence,
    criterion: Criterion,
    name: str,
    measure: Measure,
    subject: MeasureInputs,
    seen: LookAhead,
) -> Bools:
    """In which scenes (S,) the limit can have been broken by the absent."""
    t = subject.drive.t
    half = 0.5 * float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    at = np.flatnonzero((t >= absence.start - half) & (t <= absence.end + half))
    out = np.zeros(len(t), dtype=bool)
    if len(at):
        u = _Unseen(subject, at, Reach.of(absence, t[at]), seen)
        worse = {"low": "below", "high": "above", "both": "beyond"}[measure.bad]
        if name in WORST and criterion.side == worse:
            out[at] = criterion.badness(WORST[name](u)) > 0.0
        else:
            out[at] = np.isfinite(u.touches("anything"))
        if measure.beyond is not None:
            out[at] |= criterion.badness(measure.beyond[at, 0]) > _SAME
    return out


def _own(whose: tuple[str, ...], subject: MeasureInputs) -> Bools:
    """Which ids (N,) of the drive are an object's, or its parts'."""
    return np.array([whole_id(name, set(whose)) in whose for name in subject.drive.ids], dtype=bool)


def _broken(whose: tuple[str, ...], criterion: Criterion, measure: Measure, subject: MeasureInputs) -> Bools:
    """In which scenes (S,) the limit is broken: by an object under any of its ids, or in the whole scene (())."""
    bad = criterion.badness(measure.value) > 0.0
    return bad if bad.ndim == 1 else np.asarray(bad[:, _own(whose, subject)].any(axis=1))


def _lasting(bad: Bools, whose: tuple[str, ...], subject: MeasureInputs) -> Bools:
    """The scenes (S,) that are bad, and those between two that are, in which an object has none of its ids."""
    there = np.flatnonzero(subject.drive.present[:, _own(whose, subject)].any(axis=1))
    if len(whose) < 2 or not len(there):
        return bad
    at = np.searchsorted(there, np.arange(len(bad)))
    between = (at > 0) & (at < len(there))
    before, after = there[np.maximum(at - 1, 0)], there[np.minimum(at, len(there) - 1)]
    return bad | (between & bad[before] & bad[after])


def _invalid(verdict: Verdict, measure: Measure, criterion: Criterion, absence: Absence) -> Verdict:
    limit = f"{criterion.side} {amount(criterion.limit, measure.unit)}"
    reason = f"{told(absence)}; it can have broken the limit, {limit}"
    return replace(verdict, outcome="INVALID", reason=reason)


def told(absence: Absence) -> str:
    """Give an absence in words."""
    return f"object {absence.object} from {absence.start:.2f} to {absence.end:.2f} s: {absence.why}"


def resized(verdict: Verdict, larger: Verdict, doubts: Doubts) -> Verdict:
    """Give a verdict, INVALID in place of PASS where it does not pass with boxes that hold all that they may fill."""
    if verdict.outcome != "PASS" or larger.outcome == "PASS":
        return verdict
    why = []
    if doubts.sizes:
        sizes = (f"{name} (up to {a:.2f} x {b:.2f} m)" for name, (a, b) in list(doubts.sizes.items())[:5])
        why.append(f"size in doubt: {', '.join(sizes)}")
    if doubts.off:
        worst = sorted(((who, max(d)) for who, d in doubts.off.items()), key=lambda found: -found[1])[:5]
        why.append(f"place in doubt: {', '.join(f'{name} (by {d:.2f} m)' for name, d in worst)}")
    reason = f"{'; '.join(why)}; with boxes as large as that: {larger.outcome}, {larger.reason}"
    return replace(verdict, outcome="INVALID", reason=reason)
