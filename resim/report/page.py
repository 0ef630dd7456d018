"""The page: its parts in order, as one HTML file."""

from __future__ import annotations

from pathlib import Path

import plotly.graph_objects as go

from resim.report import assessment, seeds, tables
from resim.report.boxes import box_figure, reaction_figure
from resim.report.document import document
from resim.report.markup import Markup, html, join
from resim.report.outcome import outcome, verdict
from resim.report.plots import number, sample, to_html
from resim.report.road import distance_figure, lateral_figure, plan_figure
from resim.report.steps import BANDS, band_figure
from resim.report.view import OTHERS, SEEDS, View, view
from resim.resimulation import Resimulation, ResimulationAssessment
from resim.scenario.maneuvers import REACTED

PRINT_WIDTH = 980
"""Width [px] that figures are laid out for on paper."""

SCRIPT = f"""
function everyPlot(f) {{ document.querySelectorAll('.plotly-graph-div').forEach(f); }}
window.addEventListener('beforeprint', () => everyPlot(p => Plotly.relayout(p, {{width: {PRINT_WIDTH}}})));
window.addEventListener('afterprint', () => everyPlot(p => Plotly.relayout(p, {{width: null, autosize: true}})));
"""

MEANINGS = (
    ("S", "SD − GT", "what the sensors made of the truth"),
    ("FIT_X", "JSCEN of X − X", "what describing it by splines did, for X = GT, SD, rGT, rSD"),
    ("SIM_X", "rX − JSCEN of X", "what the simulation made of the description"),
    ("PIPE_X", "JSCEN of rX − GT", "the whole chain, from the drive to its described re-simulation"),
)


ADDING = Markup(
    "<h3>Do the steps add up? (Eq. 5.6)</h3><p>Positions add up as vectors: <i>mean of sums</i> is the mean "
    "length of the summed vectors, <i>sum of means</i> the plain sum of the steps' means. What the first does "
    "not explain of the measured error is interpolation between different sample times.</p>"
)


def write_report(result: Resimulation, assessed: ResimulationAssessment, path: Path) -> None:
    """Write the page: one HTML file with all it needs; the same result gives the same bytes."""
    path.write_text(page(view(result), assessed), encoding="utf-8", newline="\n")


def page(look: View, assessed: ResimulationAssessment) -> Markup:
    """Give the page's HTML."""
    parts = [
        _header(look),
        _key(look),
        _section("road", "Traces on the road", _road(look)),
        _section("steps", "Step by step: place, speed and heading over time", _steps(look)),
        _section("errors", "Errors of every step", _errors(look)),
        _section("reaction", "Reaction time", _reaction(look)),
        *_seeds(look),
        _section("assessment", "Criticality, accident risk, criteria", assessment.section(assessed)),
        _section("perceived", "What the AD function perceived", _perceived(look)),
        _section("recording", "Findings in the recording", tables.findings(look)),
        _section("provenance", "Provenance", tables.provenance(look)),
    ]
    title = f"{look.result.recording.name} · {look.result.build.label}"
    return document(title, html("<main>\n{}</main>", join(parts, "\n")), scripts=[SCRIPT])


def _section(name: str, title: str, body: Markup) -> Markup:
    return html('<section id="{}"><h2>{}</h2>\n{}</section>', name, title, body)


def _seeds(look: View) -> list[Markup]:
    """What a perception model did, where one was run."""
    if look.result.perceiving is None:
        return []
    return [_section("seeds-section", "With the perception model", seeds.section(look))]


def _figure(figure: go.Figure, name: str, title: str, note: str = "") -> Markup:
    small = html('<span class="note">{}</span>', note) if note else ""
    return html(
        "<figure><figcaption><b>{}</b> {}</figcaption>{}</figure>\n", title, small, to_html(figure, name)
    )


def _header(look: View) -> Markup:
    result, report = look.result, look.report
    drove = {True: "drove this recording", False: f"did not drive this recording; {result.recording.build} did",
             None: "the recording names no build"}[report.build.drove]  # fmt: skip
    objects = {i for tracks in look.tracks.values() for i in tracks.ids.tolist()} - {look.ego}
    facts = (
        ("build", html("<b>{} {}</b> ({})", result.build.name, result.build.version, drove)),
        ("map", report.map),
        (
            "basis",
            " and ".join(name.removeprefix("r") for name in result.simulated())
            + ("" if result.recording.sd is not None else " (no sensor data)"),
        ),
        ("EGO", f"{look.ego}, with {len(objects)} traffic object{'' if len(objects) == 1 else 's'}"),
        (
            "time",
            f"{look.span[0]:.2f} s to {look.span[1]:.2f} s"
            + ("; figures count from the first" if look.start else ""),
        ),
    )
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    warnings = join(html("<li>{}</li>", w) for w in report.warnings)
    return html(
        '<header><p class="kind">Re-simulation report</p><h1>{name}</h1><dl class="facts">{facts}</dl>\n'
        '<p class="line">{line}</p>\n{outcome}{notes}</header>',
        name=report.recording,
        facts=listed,
        line=_line(look),
        outcome=outcome(look),
        notes=html('<div class="warnings"><b>Note</b><ul>{}</ul></div>', warnings) if warnings else "",
    )


def _line(look: View) -> Markup:
    """The outcome in one sentence per run."""
    out = [html("Measured drive: {}.", tables.decision_words(look.report.decision["GT"]))]
    for run in look.report.end:
        css, words = verdict(look, run)
        said = html("{}: <b>{}</b>", run, words.lstrip("=≠✕ "))
        if css != "failed":
            said += html(" ({}", tables.decision_words(look.report.decision[run]))
            change = look.report.reaction_difference[run]
            difference = tables.difference_words(change, look.report.reaction_spread)
            said += html("; braking {})", difference) if change is not None else ")"
        out.append(said + ".")
    if (found := look.report.perception) is not None:
        of = f"{found.same_decision} of {len(found.seeds)} seeds"
        out.append(html("rGT with the perception model {}: <b>{}</b> as measured.", found.model.name, of))
    return join(out, " ")


def _key(look: View) -> Markup:
    """One key for all figures: colours by object and basis, dashes for what was re-simulated."""
    entries = []
    for source in look.tracks:
        dashed = source.startswith("r")
        here = set(look.tracks[source].ids.tolist())
        entries += [
            sample(f"{look.label(i)} {source}", look.color(i, source), dashed=dashed)
            for i in look.shown
            if i in here
        ]
    if look.result.seeds:
        entries.append(sample("EGO rGT+M, with the perception model", SEEDS))
    if look.others:
        entries.append(sample(f"{len(look.others)} other TOs", OTHERS))
    return html(
        '<div class="key">{}<span class="note">dashed: re-simulated · thin: JSCEN fit, '
        "dots: its knots</span></div>",
        join(entries),
    )


def _road(look: View) -> Markup:
    out = [
        _figure(plan_figure(look), "plan", "From above", "both axes at one scale, travel to the right, 0 where "
                "the measured EGO starts; boxes: vehicles where each source ends"),
        _figure(lateral_figure(look), "lateral", "Across the road, stretched",
                f"offset to the left of {look.path_name}, over the distance along it"),
    ]  # fmt: skip
    if (figure := distance_figure(look)) is not None:
        title = "Distance of the re-simulation from the drive"
        note = "PIPE_X = JSCEN of rX − GT; ribbon: mean ± std"
        if look.result.seeds:
            note += (
                "; with the perception model (+M): median and whole range of the seeds, beside rGT without"
            )
        out.append(_figure(figure, "distance", title, note))
    return join(out)


def _steps(look: View) -> Markup:
    legend = join(
        html("<div><dt>{}</dt><dd>{} <span>{}</span></dd></div>", name, what, why)
        for name, what, why in MEANINGS
    )
    out = [
        html(
            "<p>Every error is <b>later minus earlier</b> in the chain, at equal times; d is the distance between "
            "the two positions. Ribbons: mean ± standard deviation over the whole drive.</p>"
            '<dl class="meanings">{}</dl>',
            legend,
        )
    ]
    for band in BANDS:
        if band.step in look.result.errors:
            name = f"step-{band.step}"
            out.append(_figure(band_figure(look, band), name, f"{band.step} · {band.title}"))
    if "S" not in look.result.errors:
        out.append(Markup("<p>There is no sensor data in this recording, so there is no sensor error S.</p>"))
    return join(out)


def _errors(look: View) -> Markup:
    return (
        _figure(box_figure(look), "boxes", "Errors of the chain", "in each step EGO left, TO right; box: 25 % to "
                "75 %, whiskers: whole range, diamond: mean ± std")
        + Markup("<h3>Numbers</h3>") + tables.numbers(look)
        + ADDING + tables.sums(look)
    )  # fmt: skip


def _reaction(look: View) -> Markup:
    reaction, change = look.report.reaction, look.report.reaction_difference
    said, off = [f"GT: {tables.reaction_words(reaction['GT'])}"], look.report.reaction_spread
    for run in look.report.end:
        text = f"{run}: {tables.reaction_words(reaction[run])}"
        if change[run] is not None:
            text = html("{}, {}", text, tables.difference_words(change[run], off))
        said.append(text)
    return html("<p>{}.</p>", join(said, "; ")) + _figure(
        reaction_figure(look), "reaction-speed", "The EGO's speed and acceleration",
        f"vertical: first acceleration below {number(REACTED, 1)} m/s² (dotted), by the spline of the JSCEN fit, "
        "in GT and simulations alike; ±: how far it is off in GT in two of three cases, by fits with other residuals"
        + (f"; green: {look.label(look.lead)} GT, ahead" if look.lead else ""),
    )  # fmt: skip


def _perceived(look: View) -> Markup:
    return html(
        "<p>Objects shown to the function from the start on, and how far they were off the simulated truth.</p>{}",
        tables.perceived(look),
    )
