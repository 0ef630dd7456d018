"""What assessment.json and kpis.parquet say of one drive, as dataclasses: their fields are those of the files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.metrics.assessment import Assessment
from resim.metrics.criteria import Outcome, Verdict
from resim.metrics.drive import PathSource
from resim.metrics.kinds import MeasureKind
from resim.metrics.measures import MeasureValues, State
from resim.metrics.measures.values import StateArray

REASONS = {
    State.VALUE: "",
    State.NO_CONFLICT: "no conflict",
    State.NOT_DEFINED: "not defined",
    State.NOT_COMPUTED: "not computed",
}
ABSENT = "not there"
UNBOUNDED = "unbounded"
"""As of DRAC [m/s²] where no braking avoids contact."""

_TEXTS = np.array([REASONS[state] for state in State], dtype=object)

OverTime = tuple[float | None, ...]
"""Numbers over the times of the scenes, None where there is none."""
Reasons = tuple[str, ...]
"""Why there is no number, in the same order; "" where there is one."""


@dataclass(frozen=True)
class RiskReasons:
    """Why there is no accident risk: of the scenes, and by object."""

    r_ind: Reasons
    r_to: Mapping[str, Reasons]


@dataclass(frozen=True)
class RiskOverTime:
    """The accident risk, 0 to 1: of the scenes, and by object.

    outside_fitted_range: by object, whether its state lies outside the range that the prediction was fitted to.
    """

    r_ind: OverTime
    r_dep: OverTime
    r_to: Mapping[str, OverTime]
    reasons: RiskReasons
    outside_fitted_range: Mapping[str, tuple[bool, ...]]


@dataclass(frozen=True)
class VerdictEntry:
    """The verdict of one criterion; value: None where nothing was measured, or without bound, as the reason says."""

    verdict: Outcome
    measure: str
    value: float | None
    limit: float
    unit: str
    t: float | None
    object: str
    weight: float
    reason: str


@dataclass(frozen=True)
class DriveAssessment:
    """What one drive was like at the times t [s] of its scenes.

    path: where the EGO's path of each scene comes from. prediction, road_aware: how objects were predicted. measures,
    reasons: by measure and object. units, kinds: by measure. criteria: by name. verdict: over all criteria, None where
    there are none. flaw: why the drive says nothing about the rest of its scenario. notes: what to know before
    comparing.
    """

    t: tuple[float, ...]
    path: tuple[PathSource, ...]
    prediction: str
    road_aware: bool
    measures: Mapping[str, Mapping[str, OverTime]]
    reasons: Mapping[str, Mapping[str, Reasons]]
    units: Mapping[str, str]
    kinds: Mapping[str, MeasureKind]
    risk: RiskOverTime
    criteria: Mapping[str, VerdictEntry]
    verdict: Outcome | None
    flaw: str | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class KpiRow:
    """A row of kpis.parquet: the worst of a measure, or a criterion; value and limit in `unit`, t in s."""

    source: str
    row: str
    name: str
    kind: MeasureKind
    measure: str
    unit: str
    value: float | None
    t: float | None
    object: str
    verdict: str
    limit: float | None
    weight: float | None
    reason: str


def drive_assessment(found: Assessment) -> DriveAssessment:
    """Give what assessment.json says of a drive."""
    drive = found.drive
    return DriveAssessment(
        t=tuple(drive.t.tolist()),
        path=drive.path,
        prediction=drive.prediction,
        road_aware=drive.scenes.ways is not None,
        measures={
            name: {i: _numbers(value) for i, value, _, _ in _columns(found, m)}
            for name, m in found.measures.items()
        },
        reasons={
            name: {i: _reasons(value, state, there) for i, value, state, there in _columns(found, m)}
            for name, m in found.measures.items()
        },
        units={name: m.unit for name, m in found.measures.items()},
        kinds=found.kinds,
        risk=_risk(found),
        criteria={name: _verdict(v) for name, v in found.verdicts.items()},
        verdict=found.verdict,
        flaw=found.flaw or None,
        notes=tuple(found.notes()),
    )


def kpi_rows(found: Assessment, source: str) -> Iterator[KpiRow]:
    """Give a row for the worst of every measure, and one for every criterion."""
    worst = {w.name: w for w in found.worst()}
    for name, measure in found.measures.items():
        w = worst.get(name)
        yield KpiRow(
            source, "measure", name, found.definitions[name].kind, name, measure.unit,
            None if w is None else w.value, None if w is None else w.t, "" if w is None else w.object,
            verdict="", limit=None, weight=None, reason="" if w is not None else _why_none(measure),
        )  # fmt: skip
    for name, v in found.verdicts.items():
        yield KpiRow(
            source, "criterion", name, found.definitions[v.measure].kind, v.measure, v.unit,
            v.value, v.t, v.object,
            verdict=v.outcome, limit=v.limit, weight=v.weight, reason=v.reason,
        )  # fmt: skip


def _columns(found: Assessment, measure: MeasureValues) -> Iterator[tuple[str, Floats, StateArray, Bools]]:
    """Each object's value, state and presence (S,), or the EGO's."""
    drive = found.drive
    if measure.value.ndim == 1:
        yield str(drive.own.ids[0]), measure.value, measure.state, np.ones(len(measure.value), dtype=bool)
        return
    for k, i in enumerate(drive.ids):
        yield i, measure.value[:, k], measure.state[:, k], drive.present[:, k]


def _risk(found: Assessment) -> RiskOverTime:
    drive, risk = found.drive, found.risk
    not_computed = REASONS[State.NOT_COMPUTED]
    return RiskOverTime(
        r_ind=_numbers(risk.r_ind),
        r_dep=_numbers(risk.r_dep),
        r_to={i: _numbers(risk.r_to[:, k]) for k, i in enumerate(drive.ids)},
        reasons=RiskReasons(
            r_ind=tuple(not_computed if np.isnan(r) else "" for r in risk.r_ind),
            r_to={
                i: tuple(
                    "" if np.isfinite(r) else not_computed if here else ABSENT
                    for r, here in zip(risk.r_to[:, k], drive.present[:, k], strict=True)
                )
                for k, i in enumerate(drive.ids)
            },
        ),
        outside_fitted_range={
            i: tuple((drive.present[:, k] & ~drive.covered[:, k]).tolist()) for k, i in enumerate(drive.ids)
        },
    )


def _verdict(v: Verdict) -> VerdictEntry:
    value = v.value if v.value is not None and np.isfinite(v.value) else None
    return VerdictEntry(v.outcome, v.measure, value, v.limit, v.unit, v.t, v.object, v.weight, v.reason)


def _why_none(measure: MeasureValues) -> str:
    """Why a measure has no value anywhere: what it came nearest to."""
    states = set(np.unique(measure.state).tolist())
    order = (State.NO_CONFLICT, State.NOT_DEFINED, State.NOT_COMPUTED)
    return next((REASONS[state] for state in order if state in states), "no object")


def _reasons(value: Floats, state: StateArray, present: Bools) -> Reasons:
    """Why there is no number, "" where there is one; unbounded where the value has no bound."""
    out = _TEXTS[state]
    out[(state == State.NOT_COMPUTED) & ~present] = ABSENT
    out[np.isinf(value)] = UNBOUNDED
    return tuple(out.tolist())


def _numbers(values: Floats) -> OverTime:
    out = np.asarray(values, dtype=float).astype(object)
    out[~np.isfinite(values)] = None
    return tuple(out.tolist())
