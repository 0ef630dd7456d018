"""Tables of a sweep: the overview, sensitivity, what is the same in all runs, the worst runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from resim.report.markup import Markup, html, join
from resim.report.tables import NONE, decision_words, table
from resim.sweeps.page.words import axis_title, percent, plain, quantity
from resim.sweeps.report import SobolIndex, SweepSection, SweptParameter, VaryingOutcome, WorstRun


def title(section: SweepSection) -> str:
    """Give a section's name."""
    return f"{section.recording} · {section.build}"


def overview(sections: Sequence[SweepSection], *, shares: bool) -> Markup:
    """Give a row a section: what came of its runs, and as shares of them where these say something."""
    rows = [
        [
            html('<a href="#s-{}">{}</a>', k, title(s)) if len(sections) > 1 else title(s), str(s.runs),
            html("<b>{}</b>", s.failed) if s.failed else "0", _of(s.passed, s, shares), str(s.collisions),
            _of(s.same_decision, s, shares), NONE if s.largest_risk is None else plain(s.largest_risk),
            _decisions(s),
        ]
        for k, s in enumerate(sections)
    ]  # fmt: skip
    head = [
        "",
        "runs",
        "failed",
        "pass every criterion",
        "collisions",
        "make the measured decision",
        "largest risk",
        "decisions",
    ]
    return table(head, rows, "overview")


def _of(count: int, section: SweepSection, shares: bool) -> str:
    return html("{} <i>{}</i>", count, percent(count / section.runs)) if shares else str(count)


def _decisions(section: SweepSection) -> Markup:
    told = (
        html("{} <i>{}</i>", decision_words([w for w in name.split(", ") if w]), n)
        for name, n in section.decisions.items()
    )
    return join(told, Markup("<br>"))


def failures(section: SweepSection) -> Markup:
    """Give why runs failed, and how many."""
    if not section.failed:
        return Markup()
    items = join(html("<li>{} × {}</li>", n, why) for why, n in section.failures.items())
    return html(
        '<div class="warnings"><b>{} of {} runs failed</b>: they have no result, and '
        "count as passing nothing<ul>{}</ul></div>",
        section.failed,
        section.runs,
        items,
    )


def sensitivity(section: SweepSection, parameters: Sequence[SweptParameter]) -> Markup:
    """Give Sobol indices by outcome, or of what varies only how far the means reach."""
    head = ["outcome", *(html("{}<br><i>total, first order</i>", p.label) for p in parameters),
            "seeds", "left over", "estimated by"]  # fmt: skip
    rows = [_indices(o, parameters) for o in section.varying()]
    return table(head, rows, "sensitivity")


def _indices(outcome: VaryingOutcome, parameters: Sequence[SweptParameter]) -> list[str]:
    found, label = outcome.sensitivity, outcome.label
    if (sobol := found.sobol) is None:
        reach = [found.range[p.name] for p in parameters]
        cells = [
            NONE if r is None else html("<i>means reach over</i> {}", quantity(r, outcome.unit))
            for r in reach
        ]
        why = f"no indices: {outcome.without} points have no value" if outcome.without else "no indices"
        return [label, *cells, NONE, NONE, why]
    cells = [_index(sobol.parameters[p.name], p.name == found.ranking[0]) for p in parameters]
    how = "analysis of variance"
    if sobol.method == "chaos" and sobol.q2 is not None:
        doubt = Markup(" <b>unreliable</b>") if sobol.q2 < 0.5 else ""
        how = html("polynomials of degree {}, Q² {:.2f}{}", sobol.degree, sobol.q2, doubt)
    noise = NONE if sobol.noise is None else f"{sobol.noise:.2f}"
    return [label, *cells, noise, f"{sobol.unexplained:.2f}", how]


def _index(found: SobolIndex, leads: bool) -> Markup:
    total, first = found.total, found.first
    if total is None or first is None:
        return NONE
    text = html("<b>{:.2f}</b>", total) if leads and total > 0.0 else f"{total:.2f}"
    bar = html('<span class="meter" style="width:{:.0f}px"></span>', max(60.0 * total, 1.0))
    alone = html("<i>{:.2f} {}</i>", first, _between(found.first_interval))
    return html("{}{} {}<br>{}", bar, text, _between(found.total_interval), alone)


def _between(interval: Sequence[float | None]) -> Markup:
    if interval[0] is None or interval[1] is None:
        return Markup()
    return html("<i>[{:.2f}, {:.2f}]</i>", *interval)


def constant(section: SweepSection) -> Markup:
    """Say what is the same in all runs."""
    shares = [o for o in section.constant if o.share]
    groups: Mapping[str, list[str]] = {
        "Good in all runs": [o.label for o in shares if o.value == 1.0],
        "Good in no run": [o.label for o in shares if o.value == 0.0],
        "Does not vary, or was not measured": [
            f"{o.label} ({'no value' if o.value is None else quantity(o.value, o.unit)})"
            for o in section.constant if not o.share
        ],
    }  # fmt: skip
    return join(html("<p><b>{}</b>: {}.</p>", name, ", ".join(some)) for name, some in groups.items() if some)


def worst(section: SweepSection, parameters: Sequence[SweptParameter]) -> Markup:
    """Give the worst runs, each with the command that repeats it."""
    names = [axis_title(p) for p in parameters]
    head = ["run", *names, "seed", "risk", "fails", "decision", "repeat it"]
    rows = [
        [
            str(w.run), *(quantity(w.parameters[p.name], "") for p in parameters), str(w.seed),
            NONE if w.risk is None else plain(w.risk), _what(w),
            NONE if w.decision is None else decision_words([d for d in w.decision.split(", ") if d]),
            html("<code>{}</code>", w.command),
        ]
        for w in section.worst
    ]  # fmt: skip
    return table(head, rows, "worst")


def _what(run: WorstRun) -> Markup:
    if run.failure is not None or run.end == "failed":
        return html("<b>failed</b>: {}", run.failure or "no result")
    hit = Markup("<b>collision</b>; ") if run.collision else Markup()
    return hit + (", ".join(run.failing) or "passes all")
