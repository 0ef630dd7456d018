"""The page of a sweep, put together: one HTML file that opens from disk; the same rows give the same bytes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pydantic import MISSING

from resim.report.document import document, text
from resim.report.markup import Markup, html, join
from resim.report.plots import sample, to_html
from resim.report.tables import table
from resim.sweeps.page import tables
from resim.sweeps.page.boundary import boundary_html
from resim.sweeps.page.figures import DEMANDED, HALF, map_figure, response_figure
from resim.sweeps.page.words import (
    demanded_of,
    engine_line,
    keeps,
    overview_line,
    percent,
    quantity,
    requirement_lines,
)
from resim.sweeps.plans.registry import PLANS
from resim.sweeps.report import (
    MapEntry,
    SweepReport,
    SweepSection,
    SweptParameter,
    VaryingOutcome,
    traffic_notes,
    variation_notes,
)
from resim.verification.inputs import HashedFile

REDRAW = (
    "document.querySelectorAll('details').forEach(d => "
    "d.addEventListener('toggle', () => window.dispatchEvent(new Event('resize'))));"
    "addEventListener('hashchange', () => document.getElementById(location.hash.slice(1))?.setAttribute('open', ''))"
)
"""Figures in a part that was folded get its width once it is open."""

READING = Markup(
    "<h2>How to read it</h2><ul>"
    "<li>The plan spends its runs where the outcome changes: it halves every cell that has good and other points, "
    "until the cells are as small as requested. Its points are therefore <b>not spread over the ranges</b>, and no "
    "share of runs, sensitivity or response is given: they would be those of the points, not of the parameters. For "
    "these, sweep the same parameters with another plan.</li>"
    "<li>A point is good where enough of its seeds are; near the boundary chance decides, too, which makes it wider "
    "than a cell. Good at every tested point is no more than that: it holds for the points, and says nothing of how "
    "rarely a run between them is otherwise.</li>"
    "<li>The cells are not the whole boundary where chance decides: in trials with noisy outcomes 13 to 15 % of the "
    "line on which half of the runs are good lay outside of them. More seeds a point leave out less.</li>"
    "<li>What lies within one cell of the first grid and touches none of its points is not found: the probability "
    "to miss an island of a given size, anywhere, is given above. More steps miss less.</li>"
    "<li>A run that failed is never good.</li></ul>"
)


def write_sweep_page(found: SweepReport, path: Path) -> None:
    """Write the page."""
    path.write_text(page(found), encoding="utf-8", newline="\n")


def page(found: SweepReport) -> Markup:
    """Give the page's HTML."""
    several = len(found.sections) > 1
    body = [
        Markup("<main>\n"),
        _header(found),
        tables.overview(found.sections, shares=not PLANS[found.plan].grows),
    ]
    for k, section in enumerate(found.sections):
        inside = join(_section(found, section, k))
        if several:
            inside = html("<summary>{}</summary>{}", tables.title(section), inside)
            inside = html(
                '<details class="part" id="s-{}"{}>{}</details>\n', k, " open" if k == 0 else "", inside
            )
        body.append(inside)
    body += [_reading(found), _inputs(found), Markup("</main>")]
    css = text("resim.sweeps.page", "sweep.css")
    return document(f"{found.name} · sweep", join(body), css=css, scripts=[REDRAW])


def _header(found: SweepReport) -> Markup:
    first, inputs = found.sections[0], found.inputs
    plan = PLANS[found.plan].words
    counts = sorted({s.points for s in found.sections})  # of an adaptive plan, each section has its own
    points = " to ".join(str(n) for n in dict.fromkeys((counts[0], counts[-1])))
    facts = [("plan", f"{plan}: {points} points, {first.seeds} seeds each")]
    facts.append(("engine", engine_line(found)))
    facts += [("note", note) for note in (*found.unpinned, *traffic_notes(found), *variation_notes(found))]
    facts += [
        (name, Path(file.path).name)
        for name, file in (("perception", inputs.perception), ("criteria", inputs.criteria))
        if file is not None
    ]
    facts += [(p.label, f"{quantity(p.low, '')} to {quantity(p.high, p.unit)}") for p in found.parameters]
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    line = html('<p class="line">{}.</p>', overview_line(first)) if len(found.sections) == 1 else ""
    return html(
        '<header><p class="kind">Sweep report</p><h1>{}</h1><dl class="facts">{}</dl>\n{}</header>\n',
        found.name,
        listed,
        line,
    )


def _section(found: SweepReport, section: SweepSection, k: int) -> Iterator[Markup]:
    yield tables.failures(section)
    if section.boundary is not MISSING:
        yield boundary_html(section.boundary, found.parameters, k)
    else:
        yield from _spread(found, section, k)
    yield html("<h2>The same in all runs</h2>\n{}", tables.constant(section))
    yield Markup(
        "<h2>Worst runs <i>failed first, then collisions, then by risk, then by criteria that fail</i></h2>\n"
    )
    yield Markup("<p>The commands are for the folder that this report was made from.</p>")
    yield tables.worst(section, found.parameters)


def _spread(found: SweepReport, section: SweepSection, k: int) -> Iterator[Markup]:
    """What points that are spread over the ranges tell of these."""
    parameters = found.parameters
    yield html(
        "<h2>Requirements <i>in {} of runs</i></h2>\n{}",
        percent(demanded_of(found)),
        _requirements(found, section),
    )
    yield _maps(section, parameters, k)
    yield Markup("<h2>Sensitivity <i>shares of the variance of all runs, with 95 % intervals</i></h2>\n")
    yield tables.sensitivity(section, parameters)
    for share, words in ((True, "How often a run is good"), (False, "Values")):
        outcomes = [o for o in section.varying() if o.share == share]
        if outcomes:
            yield html(
                "<h2>{} <i>mean and 95 % band over points</i></h2>\n{}",
                words,
                _responses(outcomes, parameters, k),
            )


def _requirements(found: SweepReport, section: SweepSection) -> Markup:
    items = [
        html("<dt>{}</dt><dd><ul>{}</ul></dd>", what, join(html("<li>{}</li>", line) for line in lines))
        for what, lines in requirement_lines(
            section, found.parameters, demanded_of(found), variation_notes(found)
        )
    ]
    if not items:
        return Markup("<p>No outcome varies.</p>")
    return html('<dl class="requirements">{}</dl>', join(items))


def _maps(section: SweepSection, parameters: Sequence[SweptParameter], k: int) -> Markup:
    """A map for each share that varies."""
    by_name = {p.name: p for p in parameters}
    drawn = [(o, o.map) for o in section.varying() if o.map is not MISSING and o.map is not None]
    if not drawn:
        return Markup()
    figures = [
        html("<figure><figcaption><b>{}</b> {}</figcaption>", keeps(o, o.limit), _note(m, by_name))
        + to_html(map_figure(o, m, parameters), f"map-{k}-{n}")
        + Markup("</figure>")
        for n, (o, m) in enumerate(drawn)
    ]
    key = join(
        sample(f"{percent(level)} of runs", color) + sample("its 95 % bounds", color, dashed=True)
        for level, color in zip(map(float, drawn[0][1].boundaries), (HALF, DEMANDED), strict=True)
    )
    return html(
        "<h2>Boundaries <i>share of runs that are good</i></h2>\n"
        '<div class="panels">{}</div><div class="key-here on-scale">{}</div>',
        join(figures),
        key,
    )


def _note(found: MapEntry, by_name: Mapping[str, SweptParameter]) -> Markup:
    parts = []
    if found.others:
        parts.append("varies, too: " + ", ".join(by_name[name].label for name in found.others))
    if found.width is not None:
        parts.append(f"smoothed over {percent(found.width)} of the ranges; bounds are of the smoothed share")
    return html('<span class="note">{}</span>', "; ".join(parts)) if parts else Markup()


def _responses(outcomes: Sequence[VaryingOutcome], parameters: Sequence[SweptParameter], k: int) -> Markup:
    kind = "share" if outcomes[0].share else "value"
    figures = [
        html("<figure>{}</figure>", to_html(response_figure(outcomes, p), f"{kind}-{k}-{n}"))
        for n, p in enumerate(parameters)
        if p.name in outcomes[0].responses
    ]
    return html('<div class="panels">{}</div>', join(figures))


def _reading(found: SweepReport) -> Markup:
    if PLANS[found.plan].grows:
        return READING
    return html(
        "<h2>How to read it</h2><ul>"
        "<li>All intervals are of 95 %. What is counted is points of the plan, not runs: the seeds of a point are no "
        "independent evidence about a parameter. Only where one point stands alone, its seeds are counted.</li>"
        "<li>Shares over drawn points have the exact interval (Clopper and Pearson) of as many as there are points; of "
        "a grid Wilson's, of as many independent runs as the variance between its points comes to; means have "
        "Student's t over points. The other parameters vary as the sweep varies them.</li>"
        "<li>A requirement is given at its safe end: the farthest value up to (or from) which the share of good runs "
        "is shown to be {} or more, that is the lower end of its interval. In fewer than "
        "5 % of sweeps the true share is less. <i>Estimate</i> is where the share itself is that high, <i>possible</i> "
        "where the upper end of its interval is. All runs within a bound count, so that good runs well within make up "
        "for worse ones near the bound: therefore the share at the bound alone. Bounds are values that were swept, "
        "never between two of them. Of a grid, each run counts, as its points are all that is asked about.</li>"
        "<li>Boundaries on the maps are interpolated between the values swept. Drawn points are smoothed by a Gaussian "
        "kernel, whose width is that by which points are best predicted from the others: intervals there are "
        "of the <b>smoothed share</b>, what the true one is on average over the kernel. Beside a sharp boundary, and "
        "at the edges of the ranges, the share at the place itself may lie far outside them. Where a bound is not "
        "drawn, there are too few seeds or points to show so high a share.</li>"
        "<li>Sensitivity: <b>first order</b> is what a parameter does alone, <b>total</b> includes what it does "
        "together with others; <b>seeds</b> is chance. On a full grid the variance is decomposed exactly, with "
        "intervals over seeds (jackknife); of drawn points, polynomials are fitted (chaos expansion), and Q² is what "
        "they predict where they were not fitted; the unexplained rest may belong to any parameter, so that the upper "
        "ends of the intervals include it; it is large for sharp outcomes. One-at-a-time plans give main "
        "effects only.</li>"
        "<li>A run that failed is never good.</li></ul>",
        percent(demanded_of(found)),
    )


def _inputs(found: SweepReport) -> Markup:
    inputs = found.inputs
    used: dict[str, HashedFile | None] = {
        "criteria": inputs.criteria, "perception": inputs.perception,
        **{f"build {b.label}": b for b in inputs.builds.values()},
        **{f"recording {name}": file for name, file in inputs.recordings.items()},
    }  # fmt: skip
    rows = [[name, html("<code>{}</code>", f.hash)] for name, f in used.items() if f is not None]
    versions = ", ".join(f"{name} {v}" for name, v in found.versions.items())
    return html(
        "<details><summary>Inputs, hashes and versions</summary><p>Run with {}.</p>{}</details>",
        versions,
        table(["", "SHA-256"], rows),
    )
