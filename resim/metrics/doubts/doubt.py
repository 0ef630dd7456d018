"""What a verdict leaves open: criteria that somebody can have broken whom nobody saw, or whose size is in doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.core.tracks import whole_id
from resim.metrics.criteria import Verdict, amount, longest
from resim.metrics.criteria_file import Criterion
from resim.metrics.doubts.absent import AbsentObject
from resim.metrics.doubts.reach import Reach
from resim.metrics.doubts.unseen import Absence, Doubts
from resim.metrics.measures import MeasureDefinition, MeasureValues
from resim.metrics.measures.horizon import LookAhead
from resim.metrics.measures.inputs import MeasureInputs

_SAME = 1e-9


def doubted(
    verdict: Verdict,
    criterion: Criterion,
    asked: MeasureDefinition,
    judged: tuple[MeasureValues, LookAhead],
    inputs: MeasureInputs,
    doubts: Doubts,
) -> Verdict:
    """Give a verdict, INVALID in place of PASS where somebody can have broken the criterion.

    It can be broken where an object, under whatever ids, is beyond the limit, or can be at worst where it is absent, in
    scenes that last together as long as the criterion says. judged: of `MeasureInputs.judged`.
    """
    measure, seen = judged
    drive = inputs.drive
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
            possible = within & _possible(absence, criterion, asked, measure, inputs, seen)
            can.setdefault(whose, []).append((absence, possible))
    for whose, found in can.items():
        broken = within & _broken(whose, criterion, measure, inputs)
        lasted = longest(_lasting(broken, whose, inputs), drive.t)
        if len(whose) > 1 and criterion.lasts(np.array([lasted]), drive.t).any():
            limit = f"{criterion.side} {amount(criterion.limit, measure.unit)}"
            who = f"objects {', '.join(whose[:5])} can be one object under successive ids"
            return replace(verdict, outcome="INVALID", reason=f"{who}: {limit} for {lasted:.1f} s")
        possible = np.any([broken, *(p for _, p in found)], axis=0)
        lasted = longest(_lasting(possible, whose, inputs), drive.t)
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
    asked: MeasureDefinition,
    measure: MeasureValues,
    inputs: MeasureInputs,
    seen: LookAhead,
) -> Bools:
    """In which scenes (S,) the limit can have been broken by the absent."""
    t = inputs.drive.t
    half = 0.5 * float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    at = np.flatnonzero((t >= absence.start - half) & (t <= absence.end + half))
    out = np.zeros(len(t), dtype=bool)
    if len(at):
        absent = AbsentObject(inputs, at, Reach.of(absence, t[at]), seen)
        if not criterion.worsens(measure.worst):
            out[at] = True
        elif asked.unseen is not None:
            out[at] = criterion.badness(asked.unseen(absent)) > 0.0
        else:
            out[at] = np.isfinite(absent.touches("anything"))
        if measure.beyond is not None:
            out[at] |= criterion.badness(measure.beyond[at, 0]) > _SAME
    return out


def _own(whose: tuple[str, ...], inputs: MeasureInputs) -> Bools:
    """Which ids (N,) of the drive are an object's, or its parts'."""
    return np.array([whole_id(name, set(whose)) in whose for name in inputs.drive.ids], dtype=bool)


def _broken(
    whose: tuple[str, ...], criterion: Criterion, measure: MeasureValues, inputs: MeasureInputs
) -> Bools:
    """In which scenes (S,) the limit is broken: by an object under any of its ids, or in the whole scene (())."""
    bad = criterion.badness(measure.value) > 0.0
    return bad if bad.ndim == 1 else np.asarray(bad[:, _own(whose, inputs)].any(axis=1))


def _lasting(bad: Bools, whose: tuple[str, ...], inputs: MeasureInputs) -> Bools:
    """The scenes (S,) that are bad, and those between two that are, in which an object has none of its ids."""
    there = np.flatnonzero(inputs.drive.present[:, _own(whose, inputs)].any(axis=1))
    if len(whose) < 2 or not len(there):
        return bad
    at = np.searchsorted(there, np.arange(len(bad)))
    between = (at > 0) & (at < len(there))
    before, after = there[np.maximum(at - 1, 0)], there[np.minimum(at, len(there) - 1)]
    return bad | (between & bad[before] & bad[after])


def _invalid(verdict: Verdict, measure: MeasureValues, criterion: Criterion, absence: Absence) -> Verdict:
    limit = f"{criterion.side} {amount(criterion.limit, measure.unit)}"
    reason = f"{absence_text(absence)}; it may have exceeded the limit, {limit}"
    return replace(verdict, outcome="INVALID", reason=reason)


def absence_text(absence: Absence) -> str:
    """Give an absence in words."""
    return f"object {absence.object} from {absence.start:.2f} to {absence.end:.2f} s: {absence.why}"


def resized(
    verdict: Verdict,
    larger: Verdict,
    criterion: Criterion,
    asked: MeasureDefinition,
    inputs: MeasureInputs,
    doubts: Doubts,
) -> Verdict:
    """Give a verdict, INVALID in place of PASS where it does not pass with boxes that hold all that they may fill.

    Larger boxes are the worst that can be of resim's own measures, towards their worse end. Where a limit is towards
    the better one, or a measure of the user's may ask for places alone, nothing passes with a place in doubt.
    """
    who = {str(inputs.drive.own.ids[0])} if asked.alone else {*doubts.sizes, *doubts.off}
    worst_known = criterion.worsens(asked.worst) and not (asked in inputs.own and who & doubts.off.keys())
    known = worst_known or not who & {*doubts.sizes, *doubts.off}
    if verdict.outcome != "PASS" or (larger.outcome == "PASS" and known):
        return verdict
    why = []
    if doubts.sizes:
        sizes = (f"{name} (up to {a:.2f} x {b:.2f} m)" for name, (a, b) in list(doubts.sizes.items())[:5])
        why.append(f"size in doubt: {', '.join(sizes)}")
    if doubts.off:
        worst = sorted(((who, max(d)) for who, d in doubts.off.items()), key=lambda found: -found[1])[:5]
        why.append(f"place in doubt: {', '.join(f'{name} (by {d:.2f} m)' for name, d in worst)}")
    so = "it may have exceeded the limit"
    if larger.outcome != "PASS":
        so = f"with boxes that large: {larger.outcome}, {larger.reason}"
    return replace(verdict, outcome="INVALID", reason=f"{'; '.join(why)}; {so}")
