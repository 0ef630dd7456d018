"""One drive, assessed: every measure, the accident risk, and the verdict of each criterion."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from resim.metrics.criteria import Criteria, Outcome, Verdict, judge, overall
from resim.metrics.criteria_file import Criterion
from resim.metrics.doubts.doubt import doubted, resized
from resim.metrics.doubts.unseen import WHOLE, Doubts
from resim.metrics.drive import DriveScenes
from resim.metrics.kinds import MeasureKind
from resim.metrics.measures import MeasureDefinition, MeasureValues
from resim.metrics.measures.inputs import MeasureInputs
from resim.metrics.risk import Risk

NAMED = 5
"""Objects that a note names."""


NO_COLLISION = Criterion(name="no collision", measure="collision", above=0.0)
"""What is asked of every drive, whether criteria do or not."""


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst of one measure: value in `unit`, time [s], object ("" for the EGO or the whole scene)."""

    name: str
    kind: MeasureKind
    unit: str
    value: float
    t: float
    object: str


@dataclass(frozen=True, eq=False)
class Assessment:
    """What a drive was like. measures by name, each (S, K), or (S,) of the EGO or the whole scene.

    definitions: of each measure. contacts: when [s] the EGO's box touches whose. verdicts: of each criterion that it
    was judged by. flaw: why the drive cannot pass, whatever the criteria say, or "". clear: whether it is shown that
    the EGO collides with nobody, to the end.
    """

    drive: DriveScenes
    measures: Mapping[str, MeasureValues]
    definitions: Mapping[str, MeasureDefinition]
    risk: Risk
    contacts: tuple[tuple[float, str], ...]
    verdicts: Mapping[str, Verdict]
    flaw: str = ""
    clear: bool = False

    @property
    def kinds(self) -> dict[str, MeasureKind]:
        """The kind of each measure."""
        return {name: measure.kind for name, measure in self.definitions.items()}

    @property
    def verdict(self) -> Outcome | None:
        """The verdict over all criteria, None where there are none; INVALID at best where the drive has a flaw."""
        if not self.verdicts:
            return None
        found = overall(self.verdicts)
        return "INVALID" if self.flaw and found == "PASS" else found

    def worst(self) -> list[Worst]:
        """Give the worst of each measure that has a value."""
        ids, t = self.drive.ids, self.drive.t
        out = []
        for name, measure in self.measures.items():
            if (found := measure.worst_value()) is None:
                continue
            value, (scene, *k) = found
            whom = ids[k[0]] if k else self.whom(name, scene)
            out.append(Worst(name, self.definitions[name].kind, measure.unit, value, float(t[scene]), whom))
        return out

    def whom(self, name: str, scene: int) -> str:
        """Give because of which object a measure of the whole scene is what it is, "" for none."""
        of = self.definitions[name].whom
        return "" if of is None else of(self, scene)

    def notes(self) -> list[str]:
        """Give what one has to know to believe measures and risk, such as objects that prediction was not fitted to."""
        drive = self.drive
        flaw = [self.flaw] if self.flaw else []
        flaw += [measure.note for measure in self.measures.values() if measure.note]
        outside = drive.present & ~drive.covered
        if not outside.any():
            return flaw
        ids = [drive.ids[k] for k in np.flatnonzero(outside.any(axis=0))]
        who = ", ".join(ids[:NAMED]) + (f" and {len(ids) - NAMED} more" if len(ids) > NAMED else "")
        return [
            *flaw,
            f"{int(outside.sum())} of {int(drive.present.sum())} states of objects lie outside the range that the "
            f"prediction {drive.prediction!r} was fitted to (objects {who}): their risk is extrapolated",
        ]


def assess(
    inputs: MeasureInputs,
    criteria: Criteria | None = None,
    flaw: str = "",
    only: Collection[str] | None = None,
    doubts: Doubts = WHOLE,
    larger: MeasureInputs | None = None,
) -> Assessment:
    """Compute every measure and the risk of a drive, and judge it by criteria if there are any.

    flaw: why it cannot pass, whatever the criteria say, or "": what is kept until then is INVALID, but up to a
    collision, which ends a drive for good. only: measures to compute besides those that criteria ask for, None
    for all. doubts: what the drive's source leaves open; larger: the drive with boxes that hold all that objects may
    fill, where sizes or places are in doubt: what could fail by either does not pass.
    """
    drive = inputs.drive
    every = asked(inputs, criteria, only)
    measures = {o.name: inputs.measure(o.name) for o in every}
    definitions = {o.name: o for o in every}
    named = criteria.criteria if criteria is not None else ()
    verdicts = {c.name: _judged(c, inputs, flaw, doubts, larger) for c in named}
    clear = _judged(NO_COLLISION, inputs, flaw, doubts, larger).outcome == "PASS"
    found = Assessment(drive, measures, definitions, inputs.risk, inputs.contacts, verdicts, flaw, clear)
    return replace(found, verdicts={name: _with_object(v, found) for name, v in verdicts.items()})


def _judged(
    criterion: Criterion, inputs: MeasureInputs, flaw: str, doubts: Doubts, larger: MeasureInputs | None
) -> Verdict:
    """The verdict of one criterion; arguments as those of `assess`."""
    drive, name = inputs.drive, criterion.measure
    definition = next(o for o in inputs.definitions if o.name == name)
    measure, seen = inputs.judged(name, criterion.side, criterion.limit)
    verdict = judge(criterion, measure, drive.t, drive.ids, drive.present)
    if larger is not None:
        again, _ = larger.judged(name, criterion.side, criterion.limit)
        with_larger = judge(criterion, again, drive.t, drive.ids, drive.present)
        verdict = resized(verdict, with_larger, criterion, definition, inputs, doubts)
    verdict = doubted(verdict, criterion, definition, (measure, seen), inputs, doubts)
    if flaw and verdict.outcome == "PASS" and not inputs.contacts:
        verdict = replace(verdict, outcome="INVALID", reason=flaw)
    return verdict


def asked(
    inputs: MeasureInputs, criteria: Criteria | None, only: Collection[str] | None
) -> tuple[MeasureDefinition, ...]:
    """Give the measures to compute: all, or `only` these and those that criteria ask for."""
    if only is None:
        return inputs.definitions
    wanted = {*only, *(c.measure for c in (criteria.criteria if criteria is not None else ()))}
    return tuple(o for o in inputs.definitions if o.name in wanted)


def _with_object(verdict: Verdict, found: Assessment) -> Verdict:
    """A verdict on the whole scene, with the object because of which it is what it is."""
    if verdict.t is None or verdict.object:
        return verdict
    scene = int(np.argmin(np.abs(found.drive.t - verdict.t)))
    return replace(verdict, object=found.whom(verdict.measure, scene))
