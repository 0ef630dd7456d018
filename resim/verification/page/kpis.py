"""The KPIs of all drives of a recording side by side, and the errors of each step against tolerance."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from pydantic import MISSING

from resim.report.markup import Markup, html, join
from resim.resimulation.drive_outcome import KpiOutcome
from resim.verification.entries import MODEL, KpiComparison, KpiEntry, SeedRun, VerifiedRecording
from resim.verification.page.cells import NONE, minus, row, rows_table, share, spread
from resim.verification.share import SeedShare
from resim.verification.tolerance import ErrorLimits, StepLimits, Tolerances

SOURCES = ("GT", "SD", "rGT", "rSD")
OUTCOMES: tuple[KpiOutcome, ...] = ("PASS", "FAIL", "INVALID")
STEPS: Mapping[str, str] = {
    "S": "sensor", "FIT_GT": "fit", "FIT_SD": "fit", "SIM_GT": "simulation", "SIM_SD": "simulation",
    "PIPE_GT": "pipeline", "PIPE_SD": "pipeline",
}  # fmt: skip
"""The tolerances that each step's error is held against, in the order of the chain (Eq. 5.6)."""
QUANTITIES: Mapping[str, tuple[str, int]] = {"d": ("m", 3), "v": ("m/s", 3), "heading": ("rad", 4)}
"""Unit and digits."""
Errors = Mapping[str, Mapping[str, float | None]]
"""Errors by "ego" or "to" and quantity."""


def kpi_table(entry: VerifiedRecording) -> Markup:
    """Give a row a criterion: what each drive came to, marked where it is not as in GT."""
    kpis = entry.kpis
    sources = [s for s in SOURCES if any(s in kpi.single() for kpi in kpis.values())]
    model = any(kpi.over_seeds is not MISSING for kpi in kpis.values())
    rows = []
    for name, kpi in kpis.items():
        unit = "" if kpi.unit == "1" else html(" <i>{}</i>", kpi.unit)
        cells = [_kpi(kpi.single().get(s), kpi.GT) for s in sources]
        if model:
            cells.append(_over_seeds(kpi))
        off = kpi.difference[entry.way]
        cells.append(NONE if off is None else minus(f"{off:+.2g}") if off else "0")
        rows.append(row([name + unit, *cells]))
    head = ["criterion", *sources, *([f"{MODEL}, seeds"] if model else []), f"{entry.way} minus GT"]
    return rows_table(head, rows, "kpis")


def _kpi(found: KpiEntry | None, gt: KpiEntry) -> str:
    """One drive's KPI: outcome, worst value, time and object, and which limit was exceeded or what is not known."""
    if found is None:
        return NONE
    verdict = found.verdict
    text = _outcome(verdict) + _worst(found)
    if verdict != "PASS":
        text += html(" <i>{}</i>", found.reason)
    return text if verdict == gt.verdict else html('<span class="off">≠ {}</span>', text)


def _outcome(verdict: str) -> Markup:
    return html("<b>{}</b>", verdict) if verdict == "PASS" else html('<b class="{}">{}</b>', verdict, verdict)


def _worst(found: KpiEntry) -> str:
    """The worst value, when, and because of which object; nothing where there is none, or it was kept to and is 0."""
    never = found.value == 0.0 and found.reason == "kept"
    if never or found.value is None or found.t is None:
        return ""
    whom = f", object {found.object}" if found.object else ""
    return f" {minus(format(found.value, '.3g'))} at {found.t:.1f} s{whom}"


def _over_seeds(kpi: KpiComparison) -> str:
    """The share of the seeds that are as GT, how many pass and fail, and the range of their worst values."""
    runs, equal = kpi.over_seeds, kpi.equal.get(MODEL)
    if runs is MISSING or not isinstance(equal, SeedShare):
        return NONE
    counts = Counter(None if run is None else run.verdict for run in runs)
    told = join((html("{} {}", _outcome(o), counts[o]) for o in OUTCOMES if counts[o]), ", ")
    values = [run.value for run in runs if run is not None and run.value is not None]
    span = ""
    if any(values):
        low, high = (minus(format(value, ".3g")) for value in (min(values), max(values)))
        span = f"; {low}" if low == high else f"; {low} to {high}"
    if equal.count == equal.of:
        return html("{} of {}{}", told, len(runs), span)
    return html('<span class="off">≠ {} equal: {}{}</span>', share(equal), told, span)


def errors_table(entry: VerifiedRecording, tolerances: Tolerances) -> Markup:
    """Give the root mean square errors of each step, EGO and TO, with the tolerance beneath; marked where beyond."""
    rows = []
    for step, kind in STEPS.items():
        if (errors := entry.errors.get(step)) is not None:
            limits: StepLimits = getattr(tolerances, kind)
            cells = [_error(who, q, errors, limits) for who, q in _columns()]
            rows.append(row([html("{} <i>{}</i>", step, kind), *cells]))
    if (driven := entry.driven) is not None:
        cells = [_error(who, q, {"ego": driven.error}, tolerances.vehicle) for who, q in _columns()]
        rows.append(row([Markup("vehicle model <i>vehicle, largest after one second</i>"), *cells]))
    if entry.seeds:
        cells = list(_pipeline(entry.seeds, tolerances.pipeline.ego))
        rows.append(row([html("PIPE of {} <i>pipeline, median and range</i>", MODEL), *cells]))
    head = [f"{who.upper()} {q} [{QUANTITIES[q][0]}]" for who, q in _columns()]
    return rows_table(["error (RMS)", *head], rows, "rms")


def _columns() -> Iterator[tuple[str, str]]:
    return ((who, quantity) for who in ("ego", "to") for quantity in QUANTITIES)


def _error(who: str, quantity: str, errors: Errors, limits: StepLimits) -> str:
    value = (errors.get(who) or {}).get(quantity)
    if value is None:
        return NONE
    return _held(f"{value:.{QUANTITIES[quantity][1]}f}", value, getattr(getattr(limits, who), quantity))


def _pipeline(seeds: Sequence[SeedRun], limits: ErrorLimits) -> Iterator[str]:
    """The EGO's errors over the seeds; traffic objects drive as they did."""
    for quantity, (_, digits) in QUANTITIES.items():
        values = [v for s in seeds if (v := (s.errors or {}).get(quantity)) is not None]
        text = spread(values, digits, "", sign=False)
        yield _held(text, max(values), getattr(limits, quantity)) if values else NONE
    yield from [NONE] * len(QUANTITIES)


def _held(text: str, value: float, limit: float | None) -> str:
    """Give an error beside its tolerance."""
    if limit is None:
        return text
    beside = html("<i>≤ {:g}</i>", limit)
    return (
        html('<span class="off">&gt; {}</span>{}', text, beside)
        if value > limit
        else html("{}{}", text, beside)
    )
