"""Re-simulation with a perception model: what the function does with it, seed by seed, beside GT, rGT and rSD."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from resim.core.geometry import Floats
from resim.pipeline import PerceivedRun
from resim.report.plots import dots, fade, joined, line, sample, style, to_html
from resim.report.tables import NONE, decision_words, table
from resim.report.view import View

SEEDS = "#7a3fb0"
"""Colour of the runs with a perception model."""
DASHES = ' stroke-dasharray="6 4"'


def section(look: View) -> str:
    """Give the section's HTML, "" where no model was run."""
    found = look.report["perception"]
    if found is None:
        return ""
    model, seeds = found["model"], found["seeds"]
    same = same_decision(look.report)
    settings = f", with {escape(', '.join(model['set']))}" if model["set"] else ""
    key = "".join(
        sample(name, color, dashes)
        for name, color, dashes in (
            ("GT, measured", look.color(look.ego, "GT"), ""), ("rGT", look.color(look.ego, "GT"), DASHES),
            *((("rSD", look.color(look.ego, "SD"), DASHES),) if "rSD" in look.report["end"] else ()),
            ("rGT+M, a line a seed", SEEDS, ""),
        )
    )  # fmt: skip
    return (
        f"<p>rGT+M: re-simulated on ground truth, the function sees what the model <b>{escape(model['name'])}</b>"
        f"{settings} lets it see. <b>{same} of {len(seeds)}</b> seeds decide as the measured drive."
        f'{_outside(look)}</p><div class="key-here">{key}</div>'
        f'<figure><figcaption><b>The EGO with the model</b> <span class="note">vertical: first braking of the measured '
        f"drive</span></figcaption>{to_html(drive_figure(look), 'seeds')}</figure>" + _table(look)
    )


def same_decision(report: Mapping[str, Any]) -> int:
    """Give how many seeds decide as the measured drive; a run that failed decides nothing."""
    measured = report["decision"]["GT"]
    return sum(
        s["decision"] == measured and s["end"] != "function_failed" for s in report["perception"]["seeds"]
    )


def _outside(look: View) -> str:
    runs = look.result.perceived_runs
    outside, shown = sum(p.outside for p in runs), sum(p.shown for p in runs)
    if not outside:
        return ""
    return (
        f" {outside} of {shown} perceived objects were in states that the model was not trained on: what it says of "
        "them is extrapolated."
    )


def drive_figure(look: View) -> go.Figure:
    """Draw speed, acceleration and distance from the measured drive over time, a thin line for each seed."""
    figure = make_subplots(
        rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.045, row_heights=[0.4, 0.3, 0.3]
    )
    runs = look.result.perceived_runs
    for row, quantity in enumerate(("v", "a", "d"), start=1):
        lines = [_curve(look, p, quantity) for p in runs]
        x, y = joined([t for t, _ in lines], [values for _, values in lines])
        figure.add_trace(line(x, y, color=fade(SEEDS, 0.35), name="rGT+M", width=1.0), row=row, col=1)
    for source in ("rGT", "rSD", "GT"):
        if source not in look.tracks:
            continue
        color, dashed = look.color(look.ego, source), source.startswith("r")
        for row, (t, values) in enumerate(_known(look, source), start=1):
            trace = line(t, values, color=color, name=source, dashed=dashed, hover="t = %{x:.2f} s: %{y:.2f}")
            figure.add_trace(trace, row=row, col=1)
    _reactions(figure, look)
    style(figure, 560.0, margin={"l": 62, "r": 14, "t": 14, "b": 44})
    for row, title in enumerate(("v [m/s]", "a [m/s²]", "d to GT [m]"), start=1):
        figure.update_yaxes(title_text=title, row=row)
    figure.update_xaxes(range=look.span)
    figure.update_xaxes(title_text="t [s]", row=3)
    return figure


def _curve(look: View, perceived: PerceivedRun, quantity: str) -> tuple[Floats, Floats]:
    truth = perceived.run.truth.select([look.ego])
    if quantity == "d":
        return truth.t, _distance(look, truth.t, truth.x[0], truth.y[0])
    values = truth.v if quantity == "v" else truth.a
    assert values is not None  # a run has them
    return truth.t, values[0]


def _known(look: View, source: str) -> list[tuple[Floats, Floats]]:
    """Speed, acceleration and distance from GT of a source's EGO."""
    tracks = look.tracks[source].select([look.ego])
    scenario = look.result.scenarios().get(source)
    if scenario is None:
        return []
    t = np.arange(scenario.ego.v.x[0], scenario.ego.v.x[-1], 0.04)
    out = [(tracks.t, tracks.v[0]), (t, scenario.ego.v(t, 1))]
    if source != "GT":
        out.append((tracks.t, _distance(look, tracks.t, tracks.x[0], tracks.y[0])))
    return out


def _distance(look: View, t: Floats, x: Floats, y: Floats) -> Floats:
    gt = look.tracks["GT"].select([look.ego]).at(t)
    return np.asarray(np.hypot(x - gt.x[0], y - gt.y[0]))


def _reactions(figure: go.Figure, look: View) -> None:
    """The measured first braking as a line, that of each seed as a dot on the curve of acceleration."""
    at = look.report["reaction"]["GT"]
    if at is not None:
        look_of = {"color": look.color(look.ego, "GT"), "width": 1.4, "dash": "dot"}
        for row in (1, 2, 3):
            figure.add_vline(x=at, line=look_of, row=row, col=1)
    times = np.array([s["reaction"] for s in look.report["perception"]["seeds"] if s["reaction"] is not None])
    if len(times):
        marks = dots(
            times, np.full(len(times), -0.5), color=SEEDS, name="first braking", hover="t = %{x:.2f} s"
        )
        figure.add_trace(marks, row=2, col=1)


def _table(look: View) -> str:
    report = look.report
    rows = [_row("GT, measured", report["decision"]["GT"], report["reaction"]["GT"], None, None, "measured")]
    for run in ("rGT", "rSD"):
        if run in report["end"]:
            cells = (report["decision"][run], report["reaction"][run], report["reaction_difference"][run])
            rows.append(_row(run, *cells, report["end_position_error"][run], report["end"][run]))
    for s in report["perception"]["seeds"]:
        told = (s["decision"], s["reaction"], s["reaction_difference"], s["end_position_error"], s["end"])
        rows.append(_row(f"seed {s['seed']}", *told))
    rows.append(_middle(report["perception"]["seeds"]))
    head = ["run", "decision", "end", "first braking", "against GT", "position error at the end"]
    return table(head, rows, "sums")


def _row(
    name: str, decision: list[str] | None, reaction: float | None, difference: float | None,
    off: float | None, end: str,
) -> list[str]:  # fmt: skip
    against = NONE if difference is None else f"{difference:+.2f} s".replace("-", "−")
    braking = NONE if reaction is None else f"{reaction:.2f} s"
    ended = {"duration": "whole duration", "measured": "last sample"}.get(
        end, f"<b>{end.replace('_', ' ')}</b>"
    )
    return [name, decision_words(decision), ended, braking, against, NONE if off is None else f"{off:.2f} m"]


def _middle(seeds: list[dict[str, float | None]]) -> list[str]:
    """Median and range over the seeds."""

    def told(name: str, unit: str, sign: str) -> str:
        values = [s[name] for s in seeds if s[name] is not None]
        if not values:
            return NONE
        low, middle, high = np.quantile(np.array(values, dtype=float), [0.0, 0.5, 1.0])
        return f"<b>{middle:{sign}.2f} {unit}</b> ({low:{sign}.2f} to {high:{sign}.2f})".replace("-", "−")

    return [
        "<b>median of seeds</b>", "", "", told("reaction", "s", ""), told("reaction_difference", "s", "+"),
        told("end_position_error", "m", ""),
    ]  # fmt: skip
