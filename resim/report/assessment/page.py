"""The section of an assessment, and the page that holds it alone."""

from __future__ import annotations

from html import escape
from pathlib import Path

from resim.assess.assessment import Worst
from resim.assess.criteria import Verdict
from resim.assess.objectifications import KINDS
from resim.pipeline import Assessed
from resim.pipeline.model_runs import WORST, ModelRuns
from resim.report.assessment.figures import amount_words, drive_figure, risk_figure
from resim.report.assessment.marks import RISK, TIMES, block_color
from resim.report.document import document
from resim.report.plots import sample, to_html
from resim.report.tables import NONE, table

DASHES = ' stroke-dasharray="6 4"'
SIGNS = {"PASS": "✓", "FAIL": "✕", "INVALID": "?"}


def section(assessed: Assessed) -> str:
    """Give the section's HTML: verdicts, four risk curves, the scenes of each source, the worst of everything."""
    parts = [_notes(assessed), _verdicts(assessed), _curves(assessed)]
    for name, a in assessed.blocks.items():
        path = " and ".join(sorted(set(a.drive.path)))
        note = (
            "travel to the right; orange: objects with a risk; line: path of the EGO, by its "
            f"{escape(path)}; below the least over all objects"
        )
        figure = to_html(drive_figure(a, assessed.network, block_color(name)), f"scenes-{name}")
        parts.append(
            f'<figure><figcaption><b>{name}: scenes, criticality and risk</b> <span class="note">{note}</span>'
            f"</figcaption>{_key()}{figure}</figure>"
        )
    parts.append(_worst(assessed))
    return "\n".join(part for part in parts if part)


def write_assessment_page(assessed: Assessed, path: Path) -> None:
    """Write the section as a page of its own: one HTML file; the same assessment gives the same bytes."""
    body = (
        "<main>\n"
        f'<header><p class="kind">Assessment</p><h1>{escape(assessed.name)}</h1></header>\n'
        f'<section id="assessment">{section(assessed)}</section></main>'
    )
    path.write_text(document(f"{assessed.name} · assessment", body), encoding="utf-8", newline="\n")


def _notes(assessed: Assessed) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in [*assessed.findings, *assessed.notes()])
    return f'<div class="warnings"><b>Note</b><ul>{items}</ul></div>' if items else ""


def _verdicts(assessed: Assessed) -> str:
    if assessed.criteria is None:
        return "<p>Not judged: no criteria were given (<code>--criteria FILE</code>).</p>"
    rows = []
    for c in assessed.criteria.criteria:
        verdicts = [a.verdicts[c.name] for a in assessed.blocks.values()]
        limit = f"{c.side} {amount_words(c.limit, verdicts[0].unit, c.measure)}"
        lasts = f" for {c.duration:g} s" if c.duration else ""
        head = f'<span title="{escape(c.source, quote=True)}">{escape(c.name)}</span>'
        cells = [*map(_cell, verdicts), *_seeds(assessed.model, c.name)]
        rows.append([head, f"{escape(c.measure)}<br>{limit}{lasts}", *cells])
    whole = [*(_badge(str(a.verdict)) for a in assessed.blocks.values()), *_seeds(assessed.model)]
    rows.append(["<b>all</b>", "", *whole])
    title = f"<h3>Criteria: {escape(assessed.criteria.name)}</h3>"
    sources = [*assessed.blocks, *(["rGT+M"] if assessed.model is not None else [])]
    return title + table(["criterion", "fails", *sources], rows, "kpis")


def _seeds(model: ModelRuns | None, criterion: str | None = None) -> list[str]:
    """The cell of the runs with a perception model, if there are any: how many seeds pass, and collide."""
    if model is None:
        return []
    counts = model.counts(criterion)
    worst = next(outcome for outcome in WORST if counts[outcome])
    words = f"{counts['PASS']} of {sum(counts.values())} seeds pass"
    if criterion is None and model.collided:
        words += f"; {len(model.collided)} collide"
    return [f"{_badge(worst)}<br>{words}"]


def _badge(outcome: str) -> str:
    return f'<span class="badge {outcome.lower()}">{SIGNS[outcome]} {outcome}</span>'


def _cell(verdict: Verdict) -> str:
    words = ""
    if verdict.value is not None and verdict.t is not None:
        words = f"{amount_words(verdict.value, verdict.unit, verdict.measure)} at {verdict.t:.1f} s"
        words += f", {escape(verdict.object)}" if verdict.object else ""
    reason = "" if verdict.reason == "kept" else f'<br><span class="note">{escape(verdict.reason)}</span>'
    return f"{_badge(verdict.outcome)}{'<br>' if words else ''}{words}{reason}"


def _curves(assessed: Assessed) -> str:
    entries = "".join(
        sample(name, block_color(name), DASHES if name.startswith("r") else "") for name in assessed.blocks
    )
    figure = to_html(risk_figure(assessed), "risk")
    return (
        '<figure><figcaption><b>Accident risk</b> <span class="note">r_ind of each scene; below on a logarithmic '
        f'scale; dotted: limit of the criteria</span></figcaption><div class="key-here">{entries}</div>'
        f"{figure}</figure>"
    )


def _key() -> str:
    entries = "".join(sample(name, color) for name, color in TIMES.items())
    return f'<div class="key-here">{entries}{sample("risk", RISK)}</div>'


def _worst(assessed: Assessed) -> str:
    """The worst of every objectification, a column for each source."""
    found = {name: {w.name: w for w in a.worst()} for name, a in assessed.blocks.items()}
    kinds = next(iter(assessed.blocks.values())).kinds
    rows = [
        [escape(name), kind, *(_worst_cell(found[block].get(name)) for block in assessed.blocks)]
        for kind in KINDS
        for name in kinds
        if kinds[name] == kind and any(name in of for of in found.values())
    ]
    body = table(["objectification", "kind", *assessed.blocks], rows, "kpis")
    return f"<h3>The worst of each objectification, when, and because of whom</h3>{body}"


def _worst_cell(worst: Worst | None) -> str:
    if worst is None:
        return NONE
    whom = f", {escape(worst.object)}" if worst.object else ""
    return f'{amount_words(worst.value, worst.unit, worst.name)} <span class="note">at {worst.t:.1f} s{whom}</span>'
