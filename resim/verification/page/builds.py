"""Build against build: what the new one lost, gained and changed, worst regressions first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from resim.metrics.measures.registry import MEASURES
from resim.report.markup import Markup, html, join
from resim.report.outcome import tallied
from resim.report.tables import decision_words
from resim.verification.cases import BuildTraces, Traces
from resim.verification.entries import ComparedRecording
from resim.verification.inputs import VerificationRequest
from resim.verification.page.cells import (
    NONE,
    badge,
    bullets,
    filters,
    link,
    row,
    rows_table,
    second,
    signed,
    spread,
)
from resim.verification.page.drive import command, drive_link, folded, reason, report_links
from resim.verification.page.speeds import builds_figure
from resim.verification.paired import DIFFERENT, RECORDINGS, Difference, RunPair
from resim.verification.report import ComparisonSummary, RecordingResult, VerificationReport
from resim.verification.summary import namesakes

ORDER = ("error", "worse", "changed", "better", "same")
HEAD = (
    "recording", "verdict", "KPIs lost", "KPIs gained", "decision before", "now", "largest risk, change (new - old)",
    "diverge at", "re-simulations",
)  # fmt: skip
LIMITS = {
    "lost": ("KPIs lost in all runs", "g"),
    "changed": ("decisions changed in all runs", "g"),
    "risk": ("largest rise of the largest risk in a run", ".3g"),
}
UNITS = {measure.name: measure.unit for measure in MEASURES}


def builds(
    found: VerificationReport, told: ComparisonSummary, traces: Mapping[str, Traces]
) -> Iterator[Markup]:
    """Give the parts of the page of build against build."""
    counts = told.counts()
    yield _limits(told)
    yield _means(told)
    yield Markup("<h2>Recordings</h2>\n") + filters({verdict: counts[verdict] for verdict in ORDER})
    entries = _ordered(found)
    yield rows_table(HEAD, (_row(r) for r in entries), "overview")
    yield Markup("<h2>Recordings in detail</h2>\n")
    for r in entries:
        if isinstance(r, ComparedRecording):
            speeds = traces.get(r.name)
            yield folded(r, _detail(r, speeds if isinstance(speeds, BuildTraces) else None, found.inputs))
        else:
            yield folded(r, html("<p>{}</p>", reason(r)))


def meaning(inputs: VerificationRequest) -> Markup:
    """Say in a sentence what is compared."""
    seeds = f", each with the same {len(inputs.seeds)} seeds" if inputs.seeds else ""
    return html(
        "Both builds drove the same scenarios on ground truth{}. <b>Worse</b>: a KPI that passed no longer "
        "does; <b>better</b>: one is gained and none lost; <b>changed</b>: the EGO decides differently.{}",
        seeds,
        f" Note: {same}." if (same := namesakes(inputs)) else "",
    )


def _ordered(found: VerificationReport) -> list[RecordingResult]:
    """Errors first, then the worst regressions, then what is the same."""
    by_name = {r.name: r for r in found.recordings}
    worst = found.summary.worst
    first = [name for name, r in by_name.items() if r.verdict == "error"]
    rest = [name for name in by_name if name not in worst and name not in first]
    return [by_name[name] for name in (*first, *worst, *rest)]


def _limits(told: ComparisonSummary) -> Markup:
    """Each limit of the suite, and whether it is kept."""
    rows = []
    for name, (text, form) in LIMITS.items():
        limit = told.limits[name]
        value = NONE if limit.value is None else format(limit.value, form).replace("-", "−")
        most = "any" if limit.limit is None else f"{limit.limit:g}"
        state = ("pass", "met") if limit.kept else ("fail", "exceeded")
        if limit.limit is None:
            state = ("none", "no limit")
        rows.append(row([text, value, most, html('<span class="badge {}">{}</span>', state[0], state[1])]))
    return Markup("<h2>Limits of the suite</h2>") + rows_table(["", "found", "at most", ""], rows, "limits")


def _means(told: ComparisonSummary) -> Markup:
    """Mean differences of risk and comfort over the recordings, with their intervals."""
    rows = [_mean("largest risk", "", told.risk, 4)]
    rows += [_mean(f"largest {name}", UNITS.get(name, ""), d, 3) for name, d in told.comfort.items()]
    note = (
        "Change (new - old); a recording counts with the mean of its seeds, the interval is Student's over these, "
        f"widened for skew. It is not shown of fewer than {RECORDINGS} recordings, or where fewer than {DIFFERENT} "
        "differ from what most of them give. What happens in so few recordings that none here shows it is in no "
        "interval."
    )
    head = ["", "mean difference", "95 % interval", "recordings"]
    return html("<h2>Risk and comfort</h2><p>{}</p>{}", note, rows_table(head, rows, "limits"))


def _mean(name: str, unit: str, d: Difference | None, digits: int) -> Markup:
    if d is None:
        return row([name, NONE, NONE, "0"])
    between: str = "not shown"
    if d.low is not None and d.high is not None:
        between = f"{signed(d.low, digits)} to {signed(d.high, digits)} {unit}"
    return row([name, f"{signed(d.mean, digits)} {unit}", between, str(d.of)])


def _row(r: RecordingResult) -> Markup:
    if not isinstance(r, ComparedRecording):
        return row([link(r.name), badge(r.verdict), *[NONE] * (len(HEAD) - 2)], r.verdict)
    pairs = r.pairs
    cells = [
        link(r.name), badge(r.verdict), _kpis([p.lost for p in pairs]), _kpis([p.gained for p in pairs]),
        *(tallied([decision_words(p.decisions[k]) for p in pairs]) for k in (0, 1)),
        spread([p.risk for p in pairs], 3, ""), second(r.t),
        report_links(r, "before", "now") or NONE,
    ]  # fmt: skip
    return row(cells, r.verdict)


def _kpis(runs: Sequence[Sequence[str]]) -> str:
    """KPIs lost or gained in each run, each with in how many of them."""
    told = []
    for name in dict.fromkeys(name for names in runs for name in names):
        count = sum(name in names for names in runs)
        told.append(name + (f" ({count} of {len(runs)})" if count < len(runs) else ""))
    return ", ".join(told) or NONE


def _detail(r: ComparedRecording, traces: BuildTraces | None, inputs: VerificationRequest) -> Markup:
    builds = {when: b for when, b in (("before", inputs.against), ("now", inputs.build)) if b is not None}
    labels = {when: build.label for when, build in builds.items()}
    out = [html("<p>{}</p>", reason(r))] if r.error is not None else []
    if r.differences:
        since = "" if r.t is None else html(", from <b>{:.1f} s</b>", r.t)
        out.append(html("<p>What differs in the worst run{}:</p>{}", since, bullets(r.differences)))
    if traces is not None:
        out.append(builds_figure(r.name, r.reaction, r.t, traces, labels))
    out.append(Markup("<h4>Each run</h4>") + _pairs(r.pairs))
    if r.reports:
        names = (f"Re-simulation report of {label}" for label in labels.values())
        return join([*out, html("<p>{}</p>", join([*drive_link(r), report_links(r, *names)], " · "))])
    both = "\n".join(command(r, inputs, build) for build in builds.values())
    more = html(
        "<p>{}</p><p>To see every step, in this file's folder:</p><pre>{}</pre>", join(drive_link(r)), both
    )
    return join([*out, more])


def _pairs(pairs: Sequence[RunPair]) -> Markup:
    """Each run of both builds with the same seed: KPIs, decisions, differences of risk and comfort."""
    rows = []
    for p in pairs:
        named = (", ".join(p.lost) or NONE, ", ".join(p.gained) or NONE)
        comfort = [NONE if v is None else signed(v, 2) for v in p.comfort.values()]
        risk = NONE if p.risk is None else signed(p.risk, 4)
        did = (decision_words(one) for one in p.decisions)
        seed = "without model" if p.seed is None else f"seed {p.seed}"
        rows.append(row([seed, *named, *did, risk, *comfort, second(p.t)]))
    measures = [f"{name} [{UNITS.get(name, '')}]" for name in pairs[0].comfort]
    head = ["", "lost", "gained", "decision before", "now", "risk", *measures, "diverge at"]
    return rows_table(head, rows, "pairs")
