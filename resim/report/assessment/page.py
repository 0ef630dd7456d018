"""The section of an assessment, and the page that holds it alone."""

from __future__ import annotations

from pathlib import Path

from resim.metrics.assessment import Worst
from resim.metrics.criteria import Verdict, amount, reason_words, worst_words
from resim.metrics.measures.definition import KINDS
from resim.report.assessment.figures import drive_figure, risk_figure
from resim.report.assessment.marks import RISK, TIMES, block_color
from resim.report.document import document
from resim.report.markup import Markup, html, join
from resim.report.player import of_assessment, player, player_scripts, player_styles
from resim.report.plots import sample, to_html
from resim.report.tables import NONE, table
from resim.resimulation import ResimulationAssessment
from resim.resimulation.model_runs import WORST, ModelRuns

SIGNS = {"PASS": "✓", "FAIL": "✕", "INVALID": "?"}


def section(assessed: ResimulationAssessment) -> Markup:
    """Give the section's HTML: verdicts, four risk curves, the scenes of each source, the worst of everything."""
    parts = [_notes(assessed), _verdicts(assessed), _curves(assessed)]
    for name, a in assessed.blocks.items():
        path = " and ".join(sorted(set(a.drive.path)))
        note = (
            "travel to the right; orange: objects with a risk; line: path of the EGO, by its "
            f"{path}; below: minimum over all objects"
        )
        figure = to_html(drive_figure(a, assessed.network, block_color(name)), f"scenes-{name}")
        parts.append(
            html(
                '<figure><figcaption><b>{name}: scenes, criticality and risk</b> <span class="note">{note}</span>'
                "</figcaption>{key}{figure}</figure>",
                name=name,
                note=note,
                key=_key(),
                figure=figure,
            )
        )
    parts.append(_worst(assessed))
    return join((part for part in parts if part), "\n")


def write_assessment_page(assessed: ResimulationAssessment, path: Path) -> None:
    """Write the section as a page of its own: one HTML file; the same assessment gives the same bytes."""
    body = html(
        "<main>\n"
        '<header><p class="kind">Assessment</p><h1>{}</h1></header>\n'
        "{}"
        '<section id="assessment">{}</section></main>',
        assessed.name,
        _played(assessed),
        section(assessed),
    )
    title = f"{assessed.name} · assessment"
    page = document(title, body, css=player_styles(), scripts=player_scripts())
    path.write_text(page, encoding="utf-8", newline="\n")


def _played(assessed: ResimulationAssessment) -> Markup:
    """The player of what was assessed."""
    if not assessed.blocks:
        return Markup()
    return html(
        '<section id="watch"><h2>The drive, played</h2>\n{}</section>\n', player([of_assessment(assessed)])
    )


def _notes(assessed: ResimulationAssessment) -> Markup:
    items = join(html("<li>{}</li>", note) for note in [*assessed.findings, *assessed.notes()])
    return html('<div class="warnings"><b>Note</b><ul>{}</ul></div>', items) if items else Markup()


def _verdicts(assessed: ResimulationAssessment) -> Markup:
    if assessed.criteria is None:
        return Markup("<p>Not judged: no criteria were given (<code>--criteria FILE</code>).</p>")
    rows = []
    for c in assessed.criteria.criteria:
        verdicts = [a.verdicts[c.name] for a in assessed.blocks.values()]
        limit = f"{c.side} {_minus(amount(c.limit, verdicts[0].unit))}"
        lasts = f" for {c.duration:g} s" if c.duration else ""
        head = html('<span title="{}">{}</span>', c.source, c.name)
        cells = [*map(_cell, verdicts), *_seeds(assessed.model, c.name)]
        rows.append([head, html("{}<br>{}{}", c.measure, limit, lasts), *cells])
    whole = [*(_badge(str(a.verdict)) for a in assessed.blocks.values()), *_seeds(assessed.model)]
    rows.append([Markup("<b>all</b>"), Markup(), *whole])
    title = html("<h3>Criteria: {}</h3>", assessed.criteria.name)
    sources = [*assessed.blocks, *(["rGT+M"] if assessed.model is not None else [])]
    return title + table(["criterion", "fails", *sources], rows, "kpis")


def _seeds(model: ModelRuns | None, criterion: str | None = None) -> list[Markup]:
    """The cell of the runs with a perception model, if there are any: how many seeds pass, and collide."""
    if model is None:
        return []
    counts = model.counts(criterion)
    worst = next(outcome for outcome in WORST if counts[outcome])
    words = f"{counts['PASS']} of {sum(counts.values())} seeds pass"
    if criterion is None and model.collided:
        words += f"; {len(model.collided)} collide"
    return [html("{}<br>{}", _badge(worst), words)]


def _badge(outcome: str) -> Markup:
    return html('<span class="badge {}">{} {}</span>', outcome.lower(), SIGNS[outcome], outcome)


def _cell(verdict: Verdict) -> Markup:
    """The verdict, why, and the worst value, when, and because of which object."""
    parts = [_badge(verdict.outcome)]
    if verdict.reason != "kept":
        failed = verdict.outcome == "FAIL"
        parts.append(html("{}" if failed else '<span class="note">{}</span>', reason_words(verdict)))
    if verdict.value is not None and verdict.t is not None:
        words = worst_words(verdict.value, verdict.unit, verdict.t, verdict.object)
        parts.append(html('<span class="note">worst: {}</span>', _minus(words)))
    return join(parts, Markup("<br>"))


def _minus(words: str) -> str:
    """Words that begin with a number, with a true minus sign."""
    return f"−{words[1:]}" if words.startswith("-") else words


def _curves(assessed: ResimulationAssessment) -> Markup:
    entries = join(sample(name, block_color(name), dashed=name.startswith("r")) for name in assessed.blocks)
    figure = to_html(risk_figure(assessed), "risk")
    return html(
        '<figure><figcaption><b>Accident risk</b> <span class="note">r_ind of each scene; below on a logarithmic '
        'scale; dotted: limit of the criteria</span></figcaption><div class="key-here">{}</div>'
        "{}</figure>",
        entries,
        figure,
    )


def _key() -> Markup:
    entries = join(sample(name, color) for name, color in TIMES.items())
    return html('<div class="key-here">{}{}</div>', entries, sample("risk", RISK))


def _worst(assessed: ResimulationAssessment) -> Markup:
    """The worst of every measure, a column for each source."""
    found = {name: {w.name: w for w in a.worst()} for name, a in assessed.blocks.items()}
    kinds = next(iter(assessed.blocks.values())).kinds
    rows = [
        [name, kind, *(_worst_cell(found[block].get(name)) for block in assessed.blocks)]
        for kind in KINDS
        for name in kinds
        if kinds[name] == kind and any(name in of for of in found.values())
    ]
    body = table(["measure", "kind", *assessed.blocks], rows, "kpis")
    return html("<h3>The worst of each measure, with time and object</h3>{}", body)


def _worst_cell(worst: Worst | None) -> Markup:
    if worst is None:
        return NONE
    value, at, when = worst_words(worst.value, worst.unit, worst.t, worst.object).partition(" at ")
    return html('{} <span class="note">{}{}</span>', _minus(value), at.lstrip(), when)
