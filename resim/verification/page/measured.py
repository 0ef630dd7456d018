"""Measured against simulated: the summary, and one row a recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from resim.report.markup import Markup, html
from resim.report.tables import decision_words
from resim.resimulation.traces import SpeedTraces
from resim.verification.cases import Traces
from resim.verification.entries import VerifiedRecording, WayRuns, runs_of
from resim.verification.inputs import VerificationRequest
from resim.verification.page.cells import NONE, badge, filters, link, row, rows_table, second
from resim.verification.page.drive import (
    decisions,
    drive,
    first_braking,
    folded,
    kpis_equal,
    reason,
)
from resim.verification.report import RecordingResult, VerificationReport, VerificationSummary
from resim.verification.sequential import ERROR

ORDER = ("error", "not verified", "undecided", "invalid", "verified")
"""What needs attention first."""
HEAD = (
    "recording", "verdict", "judged by", "KPIs equal", "decision measured", "simulated", "braking delay against GT",
    "largest error beyond tolerance", "first cause", "from",
)  # fmt: skip
NAMES = {"d": "position", "v": "speed", "heading": "heading"}
UNITS = {"d": "m", "v": "m/s", "heading": "rad"}


def measured(
    found: VerificationReport, told: VerificationSummary, traces: Mapping[str, Traces]
) -> Iterator[Markup]:
    """Give the parts of the page of measured against simulated."""
    entries, counts = sorted(found.recordings, key=lambda r: ORDER.index(r.verdict)), told.counts()
    yield filters({verdict: counts[verdict] for verdict in ORDER})
    yield rows_table(HEAD, (_row(r) for r in entries), "overview")
    yield Markup("<h2>Recordings in detail</h2>\n")
    for r in entries:
        speeds = traces.get(r.name)
        yield (
            drive(r, speeds if isinstance(speeds, SpeedTraces) else None, found.inputs)
            if isinstance(r, VerifiedRecording)
            else folded(r, html("<p>{}</p>", reason(r)))
        )


def meaning(inputs: VerificationRequest) -> Markup:
    """Say in a sentence what the verdict means."""
    many = f", in more than {inputs.agreement:.0%} of the seeds" if inputs.perception is not None else ""
    return html(
        "<b>Verified</b>: simulation gives the measured drive's KPI by every criterion and the EGO's decision, and all "
        "errors of the chain are within tolerance{} (Groh 2018, III.B): for this build it may stand in "
        "for that drive, and for no other. KPI outcomes match; values may differ.{}",
        many,
        _tested(inputs),
    )


def _tested(inputs: VerificationRequest) -> Markup:
    """How the share of the seeds is told, where there are any."""
    if inputs.perception is None:
        return Markup()
    demand = inputs.agreement
    return html(
        " Seeds are run one after the other, {seeds} at most, until a sequential test separates a true "
        "share of {demand:.1%} or less (not verified) from one of {over:.1%} or more (verified), "
        "either being wrong in at most {error:.0%} of cases; <b>undecided</b>: it cannot tell. Intervals of the share "
        "of seeds that agree are exact for that test, with {error:.0%} beyond each end; those of single KPIs and "
        "decisions are Wilson's, of 95 %, and treat the number of seeds as fixed.",
        seeds=len(inputs.seeds),
        demand=demand,
        over=0.5 * (1.0 + demand),
        error=ERROR,
    )


def _row(r: RecordingResult) -> Markup:
    if not isinstance(r, VerifiedRecording):
        return row([link(r.name), badge(r.verdict), *[NONE] * (len(HEAD) - 2)], r.verdict)
    cause = r.cause
    cells = [
        link(r.name), badge(r.verdict), r.way, kpis_equal(r, r.way),
        decision_words(r.decision.GT), decisions(r, r.way), first_braking(runs_of(r.judged)), _largest(r.judged),
        NONE if cause is None else html("<b>{}</b>", cause.step), NONE if cause is None else second(cause.t),
    ]  # fmt: skip
    return row(cells, r.verdict)


def _largest(way: WayRuns) -> str:
    """The error that is the most times its tolerance, over all seeds."""
    beyond = [e for run in runs_of(way) for e in run.beyond]
    if not beyond:
        return NONE
    e = max(beyond, key=lambda e: e.value / e.limit if e.limit else float("inf"))
    return html(
        "{}: {} {} {:.3g} {} <i>(tolerance {:g})</i>",
        e.step,
        e.who.upper(),
        NAMES[e.quantity],
        e.value,
        UNITS[e.quantity],
        e.limit,
    )
