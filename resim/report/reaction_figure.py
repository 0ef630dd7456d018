"""The EGO's reaction, measured and simulated (Fig. 5.12)."""

from __future__ import annotations

from functools import partial

import numpy as np

from resim.report.figure import Figure
from resim.report.markup import html
from resim.report.plots import FAINT, line, style
from resim.report.view import View
from resim.scenario.maneuvers import REACTED


def reaction_figure(view: View) -> Figure:
    """Draw the EGO's speed in GT, rGT and rSD with the times of reaction, and below the acceleration."""
    figure = Figure.of_panels(
        rows=2, cols=1, shared_xaxes=True, row_heights=[0.64, 0.36], vertical_spacing=0.06
    )
    if (lead := view.lead) is not None:
        tracks = view.tracks["GT"]
        trace = line(view.since(tracks.t), tracks.v[tracks.index(lead)], color=view.color(lead, "GT"), width=1.4,
                     name=f"{view.label(lead)} GT", hover="t = %{x:.2f} s: %{y:.2f} m/s")  # fmt: skip
        figure.add_trace(trace, row=1, col=1)
    for source in ("GT", "rGT", "rSD"):
        _draw_reaction(figure, view, source)
    figure.add_hline(y=REACTED, line={"color": FAINT, "width": 1, "dash": "dot"}, row=2, col=1)
    style(figure, 470.0, margin={"l": 62, "r": 14, "t": 58, "b": 44})
    figure.update_yaxes(title_text="v [m/s]", row=1)
    figure.update_yaxes(title_text="EGO a [m/s²]", row=2)
    figure.update_xaxes(range=[0.0, view.span[1] - view.start])
    figure.update_xaxes(title_text=view.clock, row=2)
    return figure


def _draw_reaction(figure: Figure, view: View, source: str) -> None:
    scenario = view.result.scenarios().get(source)
    if scenario is None or source not in view.tracks:
        return
    tracks, color = view.tracks[source], view.color(view.ego, source)
    draw = partial(line, color=color, name=f"EGO {source}", dashed=source.startswith("r"))
    speed = tracks.v[tracks.index(view.ego)]
    figure.add_trace(draw(view.since(tracks.t), speed, hover="t = %{x:.2f} s: %{y:.2f} m/s"), row=1, col=1)
    spline = scenario.ego.v
    t = np.arange(spline.x[0], spline.x[-1], 0.02)
    figure.add_trace(
        draw(view.since(t), spline(t, 1), width=1.5, hover="t = %{x:.2f} s: %{y:.2f} m/s²"),
        row=2,
        col=1,
    )
    at = view.report.reaction[source]
    if at is None:
        return
    at -= view.start
    level = ("GT", "rGT", "rSD").index(source)
    figure.add_shape(
        type="line", xref="x", yref="paper", x0=at, x1=at, y0=0.0, y1=1.015 + 0.042 * level,
        line={"color": color, "width": 1.6, "dash": "dash" if source.startswith("r") else "solid"},
    )  # fmt: skip
    right = at > 0.5 * (view.span[1] - view.start)
    figure.add_annotation(
        text=html("<b>{}</b> {:.2f} s", source, at), xref="x", yref="paper", x=at, y=1.015 + 0.042 * level,
        xanchor="right" if right else "left", yanchor="middle", xshift=-4 if right else 4, showarrow=False,
        font={"color": color, "size": 12},
    )  # fmt: skip
