"""What a sweep found, as numbers: what report.json holds and the page draws."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pandas as pd
from pydantic import MISSING

from resim.core.geometry import Bools, Floats
from resim.core.intervals import CONFIDENCE, GroupMean, means, shares
from resim.core.schema import VARIED_TRUST, SweepReportSchema
from resim.sweeps.boundary import boundary
from resim.sweeps.engines import is_repeated
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.points import SweepOutcome, SweepPoints, equal, failed, label, points_of, unit_of
from resim.sweeps.report import (
    ConstantOutcome,
    Influence,
    MapEntry,
    NumberRows,
    Numbers,
    RequirementEntry,
    ResponseCurve,
    RunCounts,
    SobolIndex,
    SobolIndices,
    SweepReport,
    SweepSection,
    SweptParameter,
    VaryingOutcome,
    WorstRun,
)
from resim.sweeps.result import SweepResult, limits
from resim.sweeps.statistics.boundary import MESH, Crossing, crossings, grid_map, smooth_map
from resim.sweeps.statistics.indices import Sensitivity
from resim.sweeps.statistics.requirement import Requirement, Side, requirement
from resim.sweeps.statistics.response import Levels, levels
from resim.sweeps.statistics.sensitivity import ranges, ranking, sensitivity
from resim.sweeps.varied import NUMBER

SCHEMA: SweepReportSchema = "resim-sweep-report-1"
DEMANDED = 0.95
"""Share of the runs that a requirement asks for."""
BOUNDARIES = (0.5, DEMANDED)
BINS, FINE = 20, 50
"""Bins of what was drawn: for responses, and for requirements."""
LACKING = 0.05
"""Share of the points that may have no value of an outcome whose sensitivity is told."""
WORST = 10


def analyse(swept: SweepResult, place: str) -> SweepReport:
    """Give what report.json says. place: the folder of the results, from where commands are to run."""
    rows = swept.rows
    place = f"./{place}" if place.startswith("-") else place  # it is no option
    groups, grown = rows.groupby(["recording", "build"], sort=False), swept.file.planned.grows
    return SweepReport(
        schema=SCHEMA,
        name=swept.file.name,
        plan=swept.file.plan,
        versions=swept.manifest.versions,
        inputs=swept.inputs,
        confidence=MISSING if grown else CONFIDENCE,
        demanded=MISSING if grown else DEMANDED,
        runs=len(rows),
        failed=int(failed(rows).sum()),
        repeated_in_sumo=_repeated(swept) if swept.file.engine == "direct" else MISSING,
        unpinned=tuple(sorted(rows["unpinned"].dropna().unique().tolist())) if "unpinned" in rows else (),
        handed_over=int((rows["handed_over"].fillna(0) > 0).sum()) if "handed_over" in rows else MISSING,
        variations=_counts(rows[VARIED_TRUST].dropna().value_counts()) if VARIED_TRUST in rows else MISSING,
        parameters=tuple(_parameter(p) for p in swept.parameters),
        sections=tuple(_section(swept, part, place) for _, part in groups),
    )


def _repeated(swept: SweepResult) -> int:
    """How many runs were repeated in SUMO."""
    known = swept.rows.reindex(columns=["run", "case"]).dropna()
    cases = zip(known["case"].tolist(), known["run"].tolist(), strict=True)
    return sum(is_repeated(case, run, swept.file.repeated_in_sumo) for case, run in cases)


def _parameter(p: SweepParameter) -> SweptParameter:
    low, high = (min(p.values), max(p.values)) if p.values else (p.low or 0.0, p.high or 0.0)
    return SweptParameter(p.name, label(p.name), unit_of(p.name), low, high)


def _section(swept: SweepResult, rows: pd.DataFrame, place: str) -> SweepSection:
    """What was found for one recording and build; where points lie by what came of others, its boundary."""
    points, outcomes = points_of(swept, rows)
    grows = swept.file.planned.grows
    recording, build = str(rows["recording"].iloc[0]), str(rows["build"].iloc[0])
    return SweepSection(
        recording=recording,
        build=swept.inputs.builds[build].label,
        **vars(_overview(rows)),
        constant=tuple(
            ConstantOutcome(o.name, o.label, o.unit, o.share, _first(o.y)) for o in outcomes if _constant(o.y)
        ),
        boundary=boundary(swept, rows, points, outcomes) if grows else MISSING,
        outcomes=MISSING if grows else _varying(swept, points, outcomes),
        worst=_worst(rows, swept.parameters, place),
    )


def _varying(
    swept: SweepResult, points: SweepPoints, outcomes: Sequence[SweepOutcome]
) -> tuple[VaryingOutcome, ...]:
    """What follows from the parameters."""
    asked = limits(swept)
    return tuple(
        _outcome(o, points, asked.get(o.name.removeprefix("kpi "))) for o in outcomes if not _constant(o.y)
    )


def _constant(y: Floats) -> bool:
    known = y[np.isfinite(y)]
    return not len(known) or float(np.ptp(known)) <= 1e-12 * float(np.abs(known).max())


def _first(y: Floats) -> float | None:
    known = y[np.isfinite(y)]
    return number(float(known[0])) if len(known) else None


def _overview(rows: pd.DataFrame) -> RunCounts:
    lost = failed(rows)
    did = rows.loc[~lost, "decision"].fillna("").value_counts(sort=False).sort_index(kind="stable")
    reasons = rows.loc[lost, "failure"].fillna("no result").value_counts(sort=False).sort_index()
    risk = rows.loc[~lost, "risk"].to_numpy(dtype=float)
    return RunCounts(
        runs=len(rows),
        points=int(rows["point"].nunique()),
        seeds=int(rows.groupby("point").size().max()),
        failed=int(lost.sum()),
        failures=_counts(reasons),
        passed=int((equal(rows["verdict"], "PASS") & ~lost).sum()),
        collisions=int(equal(rows["collision"], True).sum()),
        same_decision=int((equal(rows["same_decision"], True) & ~lost).sum()),
        decisions=_counts(did),
        largest_risk=number(float(np.nanmax(risk))) if np.isfinite(risk).any() else None,
    )


def _counts(found: pd.Series[int]) -> dict[str, int]:
    """The most frequent first."""
    ordered = found.sort_values(ascending=False, kind="stable")
    return {str(name): int(n) for name, n in ordered.items()}


def _outcome(o: SweepOutcome, points: SweepPoints, limit: str | None) -> VaryingOutcome:
    """Responses, sensitivity, and of shares the requirements and the map."""
    estimate = shares if o.share else means
    varied = [p for p in range(points.x.shape[1]) if len(np.unique(points.x[:, p])) > 1]
    steps = {i: levels(points.x[:, i], BINS, points.along(i)) for i in varied}
    found = {
        i: estimate(
            o.y, step.of, len(step), drawn=points.layout == "drawn" and (len(varied) > 1 or step.binned)
        )
        for i, step in steps.items()
    }
    names = [p.name for p in points.parameters]
    known: Bools = np.asarray(np.isfinite(o.y).any(axis=1))
    reach = ranges([found[i].mean if i in found else np.array([np.nan]) for i in range(len(names))])
    index = _sensitivity(o, points, known)
    influence = reach if index is None else index.total
    order = ranking(influence, np.isin(np.arange(len(names)), varied))
    drawn = _map(o.y, points, order[0], order[1]) if o.share and len(order) > 1 else None
    return VaryingOutcome(
        name=o.name,
        label=o.label,
        unit=o.unit,
        share=o.share,
        mean=number(float(np.nanmean(o.y))),
        without=int(len(known) - known.sum()),
        responses={names[i]: _response(steps[i], found[i]) for i in varied},
        sensitivity=Influence(
            ranking=tuple(names[i] for i in order),
            range=dict(zip(names, numbers(reach), strict=True)),
            sobol=None if index is None else _sobol(index, names),
        ),
        requirements={names[i]: () if names[i] == NUMBER else _requirements(o.y, points, i) for i in varied}
        if o.share
        else MISSING,
        map=drawn if o.share else MISSING,
        limit=limit,
    )


def _response(step: Levels, e: GroupMean) -> ResponseCurve:
    return ResponseCurve(
        at=numbers(step.centre), start=numbers(step.low), to=numbers(step.high), binned=step.binned,
        mean=numbers(e.mean), low=numbers(e.low), high=numbers(e.high),
        points=tuple(e.points.tolist()), runs=tuple(e.runs.tolist()),
    )  # fmt: skip


def _sensitivity(o: SweepOutcome, points: SweepPoints, known: Bools) -> Sensitivity | None:
    """Sobol indices, None where the plan or what is missing does not let them be told."""
    if points.layout == "axes" or np.mean(~known) > LACKING:
        return None
    return sensitivity(points.u, o.y, grid=points.layout == "grid")


def _sobol(s: Sensitivity, names: Sequence[str]) -> SobolIndices:
    each = {
        name: SobolIndex(
            first=number(s.first[i]), first_interval=numbers(s.first_interval[i]),
            total=number(s.total[i]), total_interval=numbers(s.total_interval[i]),
        )
        for i, name in enumerate(names)
    }  # fmt: skip
    q2 = None if s.q2 is None else number(s.q2)
    return SobolIndices(each, number(s.noise), number(s.unexplained), s.method, q2, s.degree)


def _requirements(y: Floats, points: SweepPoints, i: int) -> tuple[RequirementEntry, ...]:
    """From each side; of a parameter around zero, and where neither side keeps it, between two bounds."""
    step = levels(points.x[:, i], FINE, points.along(i), np.delete(points.x, i, axis=1))
    around = bool(step.low[0] < 0.0 < step.high[-1])
    sides: tuple[Side, ...] = ("between",) if around else ("under", "over")
    drawn = points.layout == "drawn"
    found = [requirement(y, step, DEMANDED, side, drawn=drawn) for side in sides]
    if all(r.found == "none" for r in found) and not around:
        found.append(requirement(y, step, DEMANDED, "between", drawn=drawn))
    return tuple(RequirementEntry(**vars(_rounded(r)), binned=step.binned) for r in found)


Rounded = TypeVar("Rounded", Requirement, Crossing)


def _rounded(found: Rounded) -> Rounded:
    """The same, numbers with six digits."""
    short = {
        name: number(v) if isinstance(v, float)
        else tuple(None if x is None else number(x) for x in v) if isinstance(v, tuple) else v
        for name, v in vars(found).items()
    }  # fmt: skip
    return replace(found, **short)  # type: ignore[arg-type]  # each of its own type


def _map(y: Floats, points: SweepPoints, i: int, j: int) -> MapEntry | None:
    """The map over the two most influential parameters; none where they are never varied together."""
    if points.layout == "axes":
        return None
    a, b = points.parameters[i], points.parameters[j]
    if points.layout == "grid":
        found = grid_map(y, levels(points.x[:, i], BINS), levels(points.x[:, j], BINS))
    else:
        (ua, at_a), (ub, at_b) = _mesh(a), _mesh(b)
        found = smooth_map(y, points.u[:, [i, j]], ua, ub, (at_a, at_b))
    return MapEntry(
        a=a.name, b=b.name, others=tuple(p.name for p in points.parameters if p not in (a, b)),
        at_a=numbers(found.a), at_b=numbers(found.b), width=found.width,
        share=_rows(found.share), low=_rows(found.low), high=_rows(found.high),
        boundaries={
            f"{level:g}": tuple(map(_rounded, crossings(found, level))) for level in BOUNDARIES
        },
    )  # fmt: skip


def _mesh(p: SweepParameter) -> tuple[Floats, Floats]:
    """Places along a parameter, as shares of its distribution and in its unit."""
    count = len(p.values) or MESH
    share = (np.arange(count) + 0.5) / count if p.values else np.linspace(0.0, 1.0, count)
    return share, p.at(share)


def _worst(rows: pd.DataFrame, parameters: Sequence[SweepParameter], place: str) -> tuple[WorstRun, ...]:
    """The worst runs: without a result first, then collisions, then by risk, then by how many criteria fail."""
    kpis = [c for c in rows.columns if str(c).startswith("kpi ")]
    bad = (rows[kpis] != "PASS").sum(axis=1).to_numpy()
    risk = rows["risk"].to_numpy(dtype=float)
    hit = equal(rows["collision"], True)
    keys = (
        rows["run"].to_numpy(),
        -bad,
        -np.where(np.isnan(risk), np.inf, risk),
        ~hit,
        ~failed(rows).to_numpy(),
    )
    out = []
    for k in np.lexsort(keys)[:WORST].tolist():
        row = rows.iloc[k]
        run = int(row["run"])
        again = f"run-{run}" if place.startswith("/") or not place.strip("./") else f"{place}-run-{run}"
        out.append(WorstRun(
            run=run, point=int(row["point"]), seed=int(row["seed"]),
            parameters={p.name: number(float(row[p.name])) for p in parameters},
            end=str(row["end"]), failure=None if pd.isna(row["failure"]) else str(row["failure"]),
            decision=None if pd.isna(row["decision"]) else str(row["decision"]),
            collision=None if pd.isna(row["collision"]) else bool(hit[k]), risk=number(float(risk[k])),
            failing=tuple(str(c).removeprefix("kpi ") for c in kpis if row[c] != "PASS"),
            command=shlex.join(["resim", "sweep", "repeat", place, str(run), "--out", again]),
        ))  # fmt: skip
    return tuple(out)


def number(value: float) -> float | None:
    """Give a number with six digits, None for none."""
    return float(f"{value:.6g}") + 0.0 if math.isfinite(value) else None


def numbers(values: Floats) -> Numbers:
    """Give numbers (N,) with six digits, None for none."""
    return tuple(number(v) for v in np.asarray(values, dtype=float).tolist())


def _rows(values: Floats) -> NumberRows:
    return tuple(numbers(row) for row in values)
