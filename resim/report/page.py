"""The page: its parts in order, as one HTML file."""

from __future__ import annotations

from pathlib import Path

from resim.core.spelling import counted
from resim.report import tables
from resim.report.document import document
from resim.report.markup import Markup, html, join
from resim.report.outcome import outcome, verdict
from resim.report.panels.registry import PANELS
from resim.report.player import player_scripts, player_styles
from resim.report.plots import sample
from resim.report.view import OTHERS, SEEDS, View, view
from resim.resimulation import Resimulation, ResimulationAssessment


def write_report(
    result: Resimulation, assessed: ResimulationAssessment, path: Path, *, shared: bool = False
) -> None:
    """Write the page: one HTML file with all it needs; the same result gives the same bytes.

    shared: but for its scripts, which it takes from the file that `write_shared_scripts` writes beside it.
    """
    path.write_text(page(view(result, assessed), shared=shared), encoding="utf-8", newline="\n")


def page(look: View, *, shared: bool = False) -> Markup:
    """Give the page's HTML."""
    drawn = ((panel, panel.draw(look)) for panel in PANELS)
    parts = [
        _header(look),
        _key(look),
        *(_section(panel.name, panel.title, body) for panel, body in drawn if body is not None),
    ]
    title = f"{look.result.recording.name} · {look.result.build.label}"
    body = html("<main>\n{}</main>", join(parts, "\n"))
    return document(title, body, css=player_styles(), scripts=player_scripts(), shared=shared)


def _section(name: str, title: str, body: Markup) -> Markup:
    return html('<section id="{}"><h2>{}</h2>\n{}</section>', name, title, body)


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
        ("EGO", f"{look.ego}, with {counted(len(objects), 'traffic object')}"),
        (
            "time",
            f"{look.span[0]:.2f} s to {look.span[1]:.2f} s"
            + ("; times count from the first sample" if look.start else ""),
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
