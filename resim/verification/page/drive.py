"""One recording, measured against simulated: why it is verified or not, in full."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from urllib.parse import quote

from resim.report.markup import Markup, html, join
from resim.report.outcome import tallied
from resim.report.tables import decision_words
from resim.resimulation.traces import SpeedTraces
from resim.verification.compare import SimulatedSource
from resim.verification.entries import (
    ComparedRecording,
    ComparedRun,
    RecordingSource,
    SeedRun,
    SeedRuns,
    VerifiedRecording,
    runs_of,
)
from resim.verification.inputs import NamedBuild, VerificationRequest
from resim.verification.page.cells import (
    NONE,
    anchor,
    badge,
    bullets,
    row,
    rows_table,
    second,
    share,
    spread,
)
from resim.verification.page.kpis import errors_table, kpi_table
from resim.verification.page.ranges import ranges
from resim.verification.page.speeds import measured_figure
from resim.verification.report import RecordingResult

REPORTED = 20
"""How many seeds a re-simulation report has at most: a picture of what was decided by more."""


def drive(entry: VerifiedRecording, traces: SpeedTraces | None, inputs: VerificationRequest) -> Markup:
    """Give the part of a recording, folded; traces: its speeds."""
    parts = [
        html("<p>{}</p>", reason(entry)),
        _differences(entry),
        _figure(entry, traces),
        Markup("<h4>Ways through the simulation</h4>") + _ways(entry),
        Markup("<h4>KPIs <i>outcome, worst value, time and object; ≠: not as in GT</i></h4>")
        + kpi_table(entry),
        Markup("<h4>Errors of each step <i>tolerance in grey; &gt;: beyond it</i></h4>")
        + errors_table(entry, inputs.tolerances),
        _seeds(entry.seeds),
        Markup("<h4>Local validity</h4>") + ranges(entry.validity) if entry.validity else "",
        html("<h4>Notes</h4>{}", bullets(entry.notes)) if entry.notes else "",
        _look_closer(entry, inputs),
    ]
    return folded(entry, join(parts))


def _figure(entry: VerifiedRecording, traces: SpeedTraces | None) -> Markup:
    if traces is None:
        return Markup()
    since = None if entry.cause is None else entry.cause.t
    return measured_figure(entry.name, entry.reaction.each(), since, traces)


def folded(entry: RecordingResult, inside: Markup) -> Markup:
    """Give a recording's part of the page under its name and verdict."""
    name, verdict = entry.name, entry.verdict
    return html(
        '<details id="{}" data-verdict="{}"><summary><b>{}</b> {}</summary>\n{}</details>\n',
        anchor(name),
        verdict,
        name,
        badge(verdict),
        inside,
    )


def reason(entry: RecordingResult) -> str:
    """Say why a recording has its verdict."""
    if entry.error is not None or not isinstance(entry, VerifiedRecording):
        return html("<b>Error</b>: {}", entry.error)
    cause, judged = entry.cause, entry.judged
    if cause is None:
        seeds = html(" in {} seeds", share(judged.share)) if isinstance(judged, SeedRuns) else ""
        return html(
            "Verified on {}{}: KPIs and decision as measured, errors within tolerance.", entry.way, seeds
        )
    when = "" if cause.t is None else html(", from <b>{:.1f} s</b>", cause.t)
    return html("First cause: <b>{}</b>{}: {}.", cause.step, when, cause.text)


def decisions(entry: VerifiedRecording, way: SimulatedSource) -> str:
    """Give what the EGO did in the simulation, over seeds with how many of them."""
    found = entry.decision.each().get(way)
    return tallied([decision_words(one) for one in found]) if found else NONE


def first_braking(runs: Sequence[ComparedRun]) -> str:
    """Give the difference of first braking, simulated minus measured; over seeds the median and range."""
    return spread([run.reaction_difference for run in runs], 2, "s")


def kpis_equal(entry: VerifiedRecording, way: SimulatedSource) -> str:
    """Give how many KPIs are equal; over seeds the share that is verified."""
    found = entry.ways[way]
    if isinstance(found, SeedRuns):
        return html("{} seeds", share(found.share))
    equal = [kpi.equal.get(way) for kpi in entry.kpis.values()]
    return f"{equal.count('equal')} of {len(equal)}"


def _differences(entry: VerifiedRecording) -> Markup:
    """All that differs in the first run that the verdict is judged by."""
    runs = runs_of(entry.judged)
    run = next((r for r in runs if r.verdict == entry.verdict), runs[0])
    where = f" in the run with seed {run.seed}" if isinstance(run, SeedRun) else ""
    if not run.differences:
        return Markup()
    return html("<p>What differs{}:</p>{}", where, bullets(run.differences))


def _ways(entry: VerifiedRecording) -> Markup:
    """What each re-simulation gave, and where shown what was recorded as perceived."""
    rows = []
    for way, found in entry.ways.items():
        why = NONE if found.cause is None else f"{found.cause.step}: {found.cause.text}"
        rests = Markup(" <i>the verdict is judged by it</i>") if way == entry.way else Markup()
        cells = [kpis_equal(entry, way), decisions(entry, way), first_braking(runs_of(found)), why]
        rows.append(row([way + rests, badge(found.verdict), *cells]))
    if (shown := entry.recorded) is not None:
        same = "as measured" if shown.same_decision else "not as measured"
        text = "; ".join(shown.differences) or "acts as measured"
        name = Markup("rGT <i>shown what was recorded as perceived</i>")
        rows.append(row([name, badge(shown.verdict), NONE, same, first_braking([shown]), text]))
    measured = html("decision <i>measured: {}</i>", decision_words(entry.decision.GT))
    off = entry.reaction_spread
    late = "braking delay against GT" + ("" if off is None else html(" <i>± {:.2f} s</i>", off))
    head = ["", "verdict", "KPIs equal", measured, late, "first cause"]
    return rows_table(head, rows, "ways")


def _seeds(seeds: Sequence[SeedRun]) -> Markup:
    """What each seed did, folded."""
    if not seeds:
        return Markup()
    rows = []
    for s in seeds:
        differ = ", ".join(dict.fromkeys(text.split(":")[0] for text in s.differences))
        since = "" if s.t is None else second(s.t)
        rows.append(row([str(s.seed), s.verdict, first_braking([s]), since, s.failure or differ]))
    head = ["seed", "verdict", "braking delay against GT", "differs from", "in"]
    return html("<details><summary>Each seed</summary>{}</details>", rows_table(head, rows))


def _look_closer(entry: VerifiedRecording, inputs: VerificationRequest) -> Markup:
    """Links to the re-simulation reports, or the command that makes one."""
    if entry.reports:
        return html("<p>{}</p>", join([*drive_link(entry), report_links(entry)], " · "))
    return html(
        "<p>{}</p><p>To see every step, in this file's folder:</p><pre>{}</pre>",
        join(drive_link(entry)),
        command(entry, inputs, inputs.build),
    )


def drive_link(entry: VerifiedRecording | ComparedRecording) -> list[Markup]:
    """Give the link to the page that plays the drive, where there is one."""
    return [] if entry.drive is None else [html('<a href="{}">Play the drive</a>', quote(entry.drive))]


def report_links(entry: RecordingResult, *names: str) -> Markup:
    """Give links to the re-simulation reports, each by its name."""
    texts = names or ("Re-simulation report",)
    links = zip(entry.reports, texts, strict=False)
    return join((html('<a href="{}">{}</a>', quote(path), text) for path, text in links), " · ")


def command(entry: RecordingSource, inputs: VerificationRequest, build: NamedBuild) -> str:
    """Give the command that re-simulates a recording with its report."""
    words = [
        "resim",
        "run",
        entry.folder,
        "--build",
        build.path,
        "--criteria",
        inputs.criteria.path,
    ]
    if inputs.against is not None or len(inputs.bases) == 1:
        words += ["--basis", "gt" if inputs.against is not None else inputs.bases[0].lower()]
    if inputs.perception is not None:
        seeds = inputs.seeds[:REPORTED]
        words += [
            "--perception",
            inputs.perception.path,
            "--seeds",
            str(len(seeds)),
            "--seed",
            str(seeds[0]),
        ]
    words += [word for setting in inputs.settings for word in ("--set", setting)]
    words += [word for code in inputs.accept for word in ("--accept", code)]
    return shlex.join([*words, "--out", f"../{entry.name}.{build.label}"])
