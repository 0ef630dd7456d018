"""What a verification says, in the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from resim.cli.verdicts import console
from resim.core.spelling import counted
from resim.resimulation.notes import HANDED_OVER, OF_BUILD
from resim.verification.entries import (
    ComparedRecording,
    ComparedRun,
    FailedRecording,
    SeedRuns,
    VerifiedRecording,
    runs_of,
)
from resim.verification.paired import NOT_COMPARED
from resim.verification.report import ComparisonSummary, RecordingResult, VerificationReport
from resim.verification.summary import namesakes
from resim.verification.validity_interval import ValidityInterval


def print_verification(found: VerificationReport) -> None:
    """Print one row a recording, why those that are not good are not, and the summary."""
    if isinstance(found.summary, ComparisonSummary):
        _compared(found, found.summary)
    else:
        _verified(found)
    counts = ", ".join(f"{count} {verdict}" for verdict, count in found.summary.counts().items())
    console().print(f"{counted(len(found.recordings), 'recording')}: {counts}", highlight=False)


def _verified(found: VerificationReport) -> None:
    inputs = found.inputs
    table = Table(title=f"{inputs.name}: {inputs.build.label}, simulated against measured")
    for column in ("recording", "verdict", "by", "agrees", "decision measured", "first braking", "cause"):
        table.add_column(column)
    for r in found.recordings:
        if not isinstance(r, VerifiedRecording):
            table.add_row(r.name, r.verdict, "", "", "", "", "")
            continue
        table.add_row(
            r.name, r.verdict, r.way, _equal(r), ", ".join(r.decision.GT) or "–",
            _reaction(runs_of(r.judged), r.reaction_spread),
            "" if r.cause is None else r.cause.step,
        )  # fmt: skip
    out = console()
    out.print(table)
    _print_errors(found, out)
    for r in found.recordings:
        if isinstance(r, VerifiedRecording) and r.error is None and r.cause is not None:
            when = "" if r.cause.t is None else f" at {r.cause.t:.1f} s"
            out.print(f"{r.name}: {r.verdict}{when}: {r.cause.step}: {r.cause.text}", highlight=False)
        for v in r.validity if isinstance(r, VerifiedRecording) else ():
            out.print(f"{r.name}: {_range(v)}", highlight=False)
    _print_notes(found, out)


def _print_notes(found: VerificationReport, out: Console) -> None:
    """Which code the verdicts are not of, and which criteria: each note once."""
    names: dict[str, list[str]] = {}
    for r in found.recordings:
        for note in () if isinstance(r, FailedRecording) else r.notes:
            if note.endswith(OF_BUILD) or note.startswith(NOT_COMPARED) or HANDED_OVER in note:
                names.setdefault(note, []).append(r.name)
    for note, of in names.items():
        who = f"{of[0]}: " if len(of) == 1 else f"{len(of)} of {len(found.recordings)} recordings: "
        out.print(f"{who}note: {note}", highlight=False)


def _print_errors(found: VerificationReport, out: Console) -> None:
    """What is wrong with the recordings, and what is broken, apart from what is not good."""
    for r in found.recordings:
        for finding in () if isinstance(r, FailedRecording) else r.findings:
            out.print(f"{r.name}: finding: {finding}", highlight=False)
        if r.error is not None:
            out.print(f"{r.name}: error: {r.error}", highlight=False)


def _equal(r: VerifiedRecording) -> str:
    """How many KPIs are equal; over seeds in the share that the suite asks for."""
    if isinstance(r.judged, SeedRuns):
        share = r.judged.share
        return f"{share.count} of {share.of} seeds [{share.low:.2f}, {share.high:.2f}]"
    equal = [kpi.equal[r.way] for kpi in r.kpis.values()]
    return f"{equal.count('equal')} of {len(equal)}"


def _reaction(runs: Sequence[ComparedRun], off: float | None) -> str:
    late = (run.reaction_difference for run in runs)
    known = sorted(value for value in late if value is not None)
    if not known:
        return "–"
    if len(known) == 1:
        return f"{known[0]:+.2f} s" if off is None else f"{known[0]:+.2f} ± {off:.2f} s"
    return f"{known[len(known) // 2]:+.2f} s, {known[0]:+.2f} to {known[-1]:+.2f}"


def _range(v: ValidityInterval) -> str:
    ends = [
        f"{end.amount:+.3g} {v.unit} ({'then ' + ', '.join(then) if then else 'as far as tried'})"
        for end in (v.low, v.high)
        for then in [(*end.flips, *end.others)]
    ]
    seeds = "" if v.agreement is None else f" in more than {v.agreement:g} of the seeds"
    return f"{v.parameter} of object {v.object}: no KPI flips{seeds} from {ends[0]} to {ends[1]}"


def _compared(found: VerificationReport, told: ComparisonSummary) -> None:
    inputs = found.inputs
    old = "" if inputs.against is None else inputs.against.label
    table = Table(title=f"{inputs.name}: {inputs.build.label} against {old}")
    for column in ("recording", "verdict", "KPIs lost", "KPIs gained", "decisions changed", "risk", "from"):
        table.add_column(column)
    by_name = {r.name: r for r in found.recordings}
    order = [*told.worst, *(n for n in by_name if n not in told.worst)]
    for name in order:
        table.add_row(*_compared_row(by_name[name]))
    out = console()
    out.print(table)
    if same := namesakes(inputs):
        out.print(f"note: {same}", highlight=False)
    _print_errors(found, out)
    _print_notes(found, out)
    if (risk := told.risk) is not None:
        between = "" if risk.low is None else f" [{risk.low:+.4f}, {risk.high:+.4f}]"
        out.print(
            f"largest risk, change (new - old), mean over {risk.of} recordings: {risk.mean:+.4f}{between}",
            highlight=False,
        )


def _compared_row(r: RecordingResult) -> tuple[str, ...]:
    if not isinstance(r, ComparedRecording):
        return r.name, r.verdict, *[""] * 5
    pairs = r.pairs
    lost = sorted({name for p in pairs for name in p.lost})
    gained = sorted({name for p in pairs for name in p.gained})
    risks = [p.risk for p in pairs if p.risk is not None]
    return (
        r.name, r.verdict, ", ".join(lost), ", ".join(gained),
        f"{sum(p.changed for p in pairs)} of {len(pairs)}",
        f"{max(risks, key=abs):+.3f}" if risks else "–", "" if r.t is None else f"{r.t:.1f} s",
    )  # fmt: skip
