"""One drive, assessed: every measure, the accident risk, and the verdict of each criterion."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from resim.core.geometry import Floats
from resim.metrics.criteria import Criteria, Outcome, Verdict, judge, overall
from resim.metrics.doubts.doubt import doubted, resized
from resim.metrics.doubts.unseen import WHOLE, Doubts
from resim.metrics.drive import DriveScenes
from resim.metrics.measures import MeasureDefinition, MeasureValues, State
from resim.metrics.measures.definition import Kind
from resim.metrics.measures.inputs import MeasureInputs
from resim.metrics.measures.values import States
from resim.metrics.risk import Risk

REASONS = {
    State.VALUE: "",
    State.NO_CONFLICT: "no conflict",
    State.NOT_DEFINED: "not defined",
    State.NOT_COMPUTED: "not computed",
}
ABSENT = "not there"
NAMED = 5
"""Objects that a note names."""
UNBOUNDED = "unbounded"
"""As of DRAC [m/s²] where no braking avoids contact."""


@dataclass(frozen=True, eq=False)
class Worst:
    """The worst of one measure: value in `unit`, time [s], object ("" for the EGO or the whole scene)."""

    name: str
    kind: Kind
    unit: str
    value: float
    t: float
    object: str


@dataclass(frozen=True, eq=False)
class Assessment:
    """What a drive was like. measures by name, each (S, K), or (S,) of the EGO or the whole scene.

    definitions: of each measure. contacts: when [s] the EGO's box touches whose. verdicts: of each criterion that it
    was judged by. flaw: why the drive cannot pass, whatever the criteria say, or "".
    """

    drive: DriveScenes
    measures: Mapping[str, MeasureValues]
    definitions: Mapping[str, MeasureDefinition]
    risk: Risk
    contacts: tuple[tuple[float, str], ...]
    verdicts: Mapping[str, Verdict]
    flaw: str = ""

    @property
    def kinds(self) -> dict[str, Kind]:
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

    def to_json(self) -> dict[str, Any]:
        """Give arrays over t by measure and object, null where there is no number, with the reasons beside."""
        ids, drive = self.drive.ids, self.drive
        return {
            "t": drive.t.tolist(),
            "path": list(drive.path),
            "prediction": drive.prediction,
            "road_aware": drive.scenes.ways is not None,
            "measures": {
                name: {i: _numbers(value) for i, value, _, _ in self._columns(m)} for name, m in self.measures.items()
            },
            "reasons": {
                name: {i: _reasons(*column) for i, *column in self._columns(m)} for name, m in self.measures.items()
            },
            "units": {name: m.unit for name, m in self.measures.items()},
            "kinds": self.kinds,
            "risk": {
                "r_ind": _numbers(self.risk.r_ind),
                "r_dep": _numbers(self.risk.r_dep),
                "r_to": {i: _numbers(self.risk.r_to[:, k]) for k, i in enumerate(ids)},
                "reasons": {
                    "r_ind": [REASONS[State.NOT_COMPUTED] if np.isnan(r) else "" for r in self.risk.r_ind],
                    "r_to": {
                        i: [
                            "" if np.isfinite(r) else REASONS[State.NOT_COMPUTED] if here else ABSENT
                            for r, here in zip(self.risk.r_to[:, k], drive.present[:, k], strict=True)
                        ]
                        for k, i in enumerate(ids)
                    },
                },
                "outside_fitted_range": {
                    i: (drive.present[:, k] & ~drive.covered[:, k]).tolist() for k, i in enumerate(ids)
                },
            },
            "criteria": {name: _verdict(v) for name, v in self.verdicts.items()},
            "verdict": self.verdict,
            "flaw": self.flaw or None,
            "notes": self.notes(),
        }  # fmt: skip

    def kpis(self) -> Iterator[dict[str, Any]]:
        """Give a row of kpis.parquet for the worst of every measure, and for every criterion."""
        worst = {w.name: w for w in self.worst()}
        for name, measure in self.measures.items():
            w = worst.get(name)
            yield {
                "row": "measure", "name": name, "kind": self.definitions[name].kind, "measure": name,
                "unit": measure.unit, "value": None if w is None else w.value, "t": None if w is None else w.t,
                "object": "" if w is None else w.object, "verdict": "", "limit": None, "weight": None,
                "reason": "" if w is not None else _why_none(measure),
            }  # fmt: skip
        for name, v in self.verdicts.items():
            yield {
                "row": "criterion", "name": name, "kind": self.definitions[v.measure].kind, "measure": v.measure,
                "unit": v.unit, "value": v.value, "t": v.t, "object": v.object, "verdict": v.outcome,
                "limit": v.limit, "weight": v.weight, "reason": v.reason,
            }  # fmt: skip

    def _columns(self, measure: MeasureValues) -> Iterator[tuple[str, Floats, States, Any]]:
        """Each object's value, state and presence (S,), or the EGO's."""
        if measure.value.ndim == 1:
            yield (
                str(self.drive.own.ids[0]),
                measure.value,
                measure.state,
                np.ones(len(measure.value), dtype=bool),
            )
        else:
            for k, i in enumerate(self.drive.ids):
                yield i, measure.value[:, k], measure.state[:, k], self.drive.present[:, k]


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
    every = inputs.definitions
    if only is not None:
        wanted = {*only, *(c.measure for c in (criteria.criteria if criteria is not None else ()))}
        every = tuple(o for o in every if o.name in wanted)
    measures = {o.name: inputs.measure(o.name) for o in every}
    definitions = {o.name: o for o in every}
    verdicts = {}
    for c in criteria.criteria if criteria is not None else ():
        measure, seen = inputs.judged(c.measure, c.side, c.limit)
        verdict = judge(c, measure, drive.t, drive.ids, drive.present)
        if larger is not None:
            again, _ = larger.judged(c.measure, c.side, c.limit)
            with_larger = judge(c, again, drive.t, drive.ids, drive.present)
            verdict = resized(verdict, with_larger, c, definitions[c.measure], inputs, doubts)
        verdict = doubted(verdict, c, definitions[c.measure], measure, inputs, doubts, seen)
        if flaw and verdict.outcome == "PASS" and not inputs.contacts:
            verdict = replace(verdict, outcome="INVALID", reason=flaw)
        verdicts[c.name] = verdict
    found = Assessment(drive, measures, definitions, inputs.risk, inputs.contacts, verdicts, flaw)
    return replace(found, verdicts={name: _with_object(v, found) for name, v in verdicts.items()})


def _with_object(verdict: Verdict, found: Assessment) -> Verdict:
    """A verdict on the whole scene, with the object because of which it is what it is."""
    if verdict.t is None or verdict.object:
        return verdict
    scene = int(np.argmin(np.abs(found.drive.t - verdict.t)))
    return replace(verdict, object=found.whom(verdict.measure, scene))


def _why_none(measure: MeasureValues) -> str:
    """Why a measure has no value anywhere: what it came nearest to."""
    states = set(np.unique(measure.state).tolist())
    order = (State.NO_CONFLICT, State.NOT_DEFINED, State.NOT_COMPUTED)
    return next((REASONS[state] for state in order if state in states), "no object")


def _verdict(verdict: Verdict) -> dict[str, Any]:
    """The verdict as JSON has it: a value without bound is null, its reason says so."""
    fields = {name: value for name, value in asdict(verdict).items() if name != "criterion"}
    fields = {"verdict": fields.pop("outcome"), **fields}
    if verdict.value is not None and not np.isfinite(verdict.value):
        fields["value"] = None
    return fields


def _reasons(value: Floats, state: States, present: Any) -> list[str]:
    """Why there is no number, "" where there is one; unbounded where the value has no bound."""
    return [
        UNBOUNDED if np.isinf(v) else REASONS[State(s)] if here or s != State.NOT_COMPUTED else ABSENT
        for v, s, here in zip(value, state.tolist(), present.tolist(), strict=True)
    ]


def _numbers(values: Floats) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in values]
