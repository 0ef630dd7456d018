"""Re-simulation with a perception model (rGT+M), seed by seed, beside GT, rGT and rSD."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats
from resim.report.figure import Figure
from resim.report.markup import Markup, html, join
from resim.report.outcome import end_words
from resim.report.plots import FAINT, dots, fade, joined, line, number, sample, style, to_html
from resim.report.tables import NONE, decision_words, table
from resim.report.view import SEEDS, View
from resim.resimulation import pipeline_step
from resim.resimulation.fidelity import EGO_ROW
from resim.resimulation.report import SeedReport
from resim.scenario.maneuvers import REACTED


def section(look: View) -> Markup:
    """Give the section's HTML; the outcome over all seeds is at the top of the page."""
    found = look.report.perception
    assert found is not None
    model, seeds = found.model, found.seeds
    settings = f", with {', '.join(model.set)}" if model.set else ""
    return html(
        "<p>rGT+M: re-simulated on ground truth, the function sees what the model <b>{name}</b>"
        "{settings} lets it see. <b>{same} of {seeds}</b> seeds decide as the measured drive."
        '{outside}</p><div class="key-here">{key}</div>'
        '<figure><figcaption><b>The EGO with the model</b> <span class="note">vertical: first braking of the measured '
        "drive</span></figcaption>{figure}</figure>{table}",
        name=model.name,
        settings=settings,
        same=found.same_decision,
        seeds=len(seeds),
        outside=_outside(look),
        key=_key(look),
        figure=to_html(drive_figure(look), "seeds"),
        table=_table(look),
    )


def _key(look: View) -> Markup:
    entries = [("GT, measured", look.color(look.ego, "GT"), False), ("rGT", look.color(look.ego, "GT"), True)]
    if "rSD" in look.report.end:
        entries.append(("rSD", look.color(look.ego, "SD"), True))
    entries.append(("rGT+M, a line a seed", SEEDS, False))
    lines = join(sample(name, color, dashed=dashed) for name, color, dashed in entries)
    return lines + html(
        '<span class="sample"><svg width="12" height="12" aria-hidden="true"><circle cx="6" cy="6" r="4" fill="{}"/>'
        "</svg>its first braking</span>",
        SEEDS,
    )


def _outside(look: View) -> str:
    drives = look.result.perceived().values()
    outside, shown = sum(d.outside for d in drives), sum(d.shown for d in drives)
    if not outside:
        return ""
    return (
        f" {outside} of {shown} perceived objects were in states outside the model's training data: "
        "its errors there are extrapolated."
    )


def drive_figure(look: View) -> Figure:
    """Draw speed and acceleration over time, a thin line for each seed."""
    figure = Figure.of_panels(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.05, row_heights=[0.56, 0.44]
    )
    own = [drive.truth.select([look.ego]) for drive in look.result.perceived().values()]
    for row, quantity in enumerate(("v", "a"), start=1):
        x, y = joined([look.since(truth.t) for truth in own], [getattr(truth, quantity)[0] for truth in own])
        figure.add_trace(line(x, y, color=fade(SEEDS, 0.35), name="rGT+M", width=1.0), row=row, col=1)
    for source in ("rGT", "rSD", "GT"):
        for row, (t, values) in enumerate(_known(look, source), start=1):
            color, dashed = look.color(look.ego, source), source.startswith("r")
            trace = line(t, values, color=color, name=source, dashed=dashed, hover="t = %{x:.2f} s: %{y:.2f}")
            figure.add_trace(trace, row=row, col=1)
    _reactions(figure, look)
    style(figure, 430.0, margin={"l": 62, "r": 14, "t": 14, "b": 44})
    for row, title in enumerate(("v [m/s]", "a [m/s²]"), start=1):
        figure.update_yaxes(title_text=title, row=row)
    figure.update_xaxes(range=[0.0, look.span[1] - look.start])
    figure.update_xaxes(title_text=look.clock, row=2)
    return figure


def _known(look: View, source: str) -> list[tuple[Floats, Floats]]:
    """Speed, and acceleration by the splines, of a source's EGO; nothing where there is no such source."""
    scenario = look.result.scenarios().get(source)
    if scenario is None or source not in look.tracks:
        return []
    tracks, spline = look.tracks[source].select([look.ego]), scenario.ego.v
    t = np.arange(spline.x[0], spline.x[-1], 0.04)
    return [(look.since(tracks.t), tracks.v[0]), (look.since(t), spline(t, 1))]


def _reactions(figure: Figure, look: View) -> None:
    """The measured first braking as a line, that of each seed as a dot on the curve of acceleration."""
    at = look.report.reaction["GT"]
    if at is not None:
        look_of = {"color": look.color(look.ego, "GT"), "width": 1.4, "dash": "dot"}
        for row in (1, 2):
            figure.add_vline(x=at - look.start, line=look_of, row=row, col=1)
    times = np.array([s.reaction for s in _seeds(look) if s.reaction is not None])
    if len(times):
        level = np.full(len(times), REACTED)
        marks = dots(
            look.since(times), level, color=SEEDS, name="first braking", hover="t = %{x:.2f} s", size=7.0
        )
        figure.add_trace(marks, row=2, col=1)


def seeds_panel(figure: Figure, look: View, cell: dict[str, int]) -> None:
    """Draw the pipeline error's distance of the EGO over time: median and range of the seeds, and rGT without model."""
    steps = map(pipeline_step, look.result.perceived())
    pipes = [look.result.errors[step] for step in steps if step in look.result.errors]
    every = np.stack([pipe.d[EGO_ROW][0] for pipe in pipes])  # all at the times of GT
    there = np.isfinite(every).any(axis=0)
    t = look.since(pipes[0].t[there])
    low, middle, high = np.nanquantile(every[:, there], [0.0, 0.5, 1.0], axis=0)
    band = line(np.r_[t, t[::-1]], np.r_[low, high[::-1]], color=SEEDS, name="", width=0.0)
    band.update(mode="none", fill="toself", fillcolor=fade(SEEDS, 0.22))
    figure.add_trace(band, **cell)
    if (without := look.result.errors.get("PIPE_GT")) is not None:
        color = look.color(look.ego, "rGT")
        trace = line(look.since(without.t), without.d[EGO_ROW][0], color=color, name="EGO PIPE_GT", dashed=True,
                     width=1.4, hover="t = %{x:.2f} s: %{y:.3f} m")  # fmt: skip
        figure.add_trace(trace, **cell)
    name = f"median of {len(pipes)} seeds"
    figure.add_trace(line(t, middle, color=SEEDS, name=name, hover="t = %{x:.2f} s: %{y:.3f} m"), **cell)
    at_the_end = f", {number(float(middle[-1]), 2)} at the end"
    text = html('<span style="color:{}"><b>EGO</b> {}{}</span>', SEEDS, _mean(every), at_the_end)
    figure.add_annotation(
        text=text, xref="x domain", yref="y domain", x=0.0, y=1.0, xanchor="left", yanchor="bottom",
        showarrow=False, font={"size": 11, "color": FAINT}, **cell,
    )  # fmt: skip


def _mean(values: Floats) -> str:
    return f"{number(float(np.nanmean(values)), 3)} ± {number(float(np.nanstd(values)), 3)}"


def _seeds(look: View) -> tuple[SeedReport, ...]:
    return () if look.report.perception is None else look.report.perception.seeds


def _table(look: View) -> Markup:
    """What each seed did; the runs without a model are in the table of the outcome."""
    rows = []
    for s in _seeds(look):
        off, pipe, against = s.end_position_error, s.errors["PIPE"], s.reaction_difference
        rows.append([
            str(s.seed), decision_words(s.decision), end_words(s.end),
            NONE if s.reaction is None else f"{s.reaction:.2f} s",
            NONE if against is None else ("+" if against > 0.0 else "") + f"{number(against, 2)} s",
            NONE if pipe is None or pipe["d"] is None else f"{pipe['d']['mean']:.3f} m",
            NONE if off is None else f"{off:.2f} m",
        ])  # fmt: skip
    head = ["seed", "decision", "end", "first braking", "against GT", "mean position error", "at the end"]
    return table(head, rows, "sums")
