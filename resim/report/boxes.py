"""The errors of every step at a glance (Fig. 5.11), and the EGO's reaction (Fig. 5.12)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from resim.report.figure import Figure, Part
from resim.report.figure import trace as figure_trace
from resim.report.markup import html
from resim.report.plots import FAINT, fade, line, style
from resim.report.steps import SYMBOLS
from resim.report.view import View
from resim.resimulation.fidelity import QUANTITIES
from resim.scenario.maneuvers import REACTED

CHAINS: Mapping[str, tuple[tuple[str, str], ...]] = {
    "GT": (("FIT", "FIT_GT"), ("SIM", "SIM_GT"), ("FIT_r", "FIT_rGT"), ("PIPE", "PIPE_GT")),
    "SD": (("S", "S"), ("FIT", "FIT_SD"), ("SIM", "SIM_SD"), ("FIT_r", "FIT_rSD"), ("PIPE", "PIPE_SD")),
}
"""The steps of each basis in the order of the chain, by the name on the axis."""


def chains(view: View) -> dict[str, tuple[tuple[str, str], ...]]:
    """Give the chains, as far as there are errors of their steps."""
    known = {basis: tuple(s for s in chain if s[1] in view.result.errors) for basis, chain in CHAINS.items()}
    return {basis: chain for basis, chain in known.items() if chain}


def box_figure(view: View) -> Figure:
    """Draw the error boxes: rows d, Δv, Δheading, a column per step, EGO left and TO right in each."""
    columns = chains(view)
    figure = Figure.of_panels(
        rows=3, cols=len(columns), shared_yaxes=True, vertical_spacing=0.045, horizontal_spacing=0.02,
        column_widths=[len(chain) for chain in columns.values()],
        subplot_titles=[f"{basis} branch" for basis in columns],
    )  # fmt: skip
    for column, (basis, chain) in enumerate(columns.items(), start=1):
        for row, quantity in enumerate(QUANTITIES, start=1):
            for who in ("ego", "to"):
                if (trace := _box(view, basis, chain, who, quantity)) is not None:
                    figure.add_trace(trace, row=row, col=column)
            figure.update_xaxes(
                row=row, col=column, type="category", showgrid=False, showticklabels=row == 3,
                categoryorder="array", categoryarray=[name for name, _ in chain],
                range=[-0.5, len(chain) - 0.5],
            )  # fmt: skip
    style(figure, 720.0, boxmode="group", boxgap=0.25, boxgroupgap=0.15)
    for row, (quantity, unit) in enumerate(QUANTITIES.items(), start=1):
        figure.update_yaxes(title_text=f"{SYMBOLS[quantity]} [{unit}]", row=row, col=1)
        figure.update_yaxes(zeroline=True, zerolinecolor="#9aa3ad", zerolinewidth=1, row=row)
    figure.update_xaxes(tickfont={"size": 13})
    return figure


def _box(view: View, basis: str, chain: tuple[tuple[str, str], ...], who: str, quantity: str) -> Part | None:
    found = [(name, view.report.errors[step][who][quantity]) for name, step in chain]
    known = [(name, box) for name, box in found if box is not None]
    if not known:
        return None
    object_id = view.ego if who == "ego" or not view.focus else view.focus[0]
    color = view.color(object_id, basis)
    parts = {
        key: [box[key] for _, box in known] for key in ("q25", "q50", "q75", "min", "max", "mean", "std")
    }
    return figure_trace("box",
        x=[name for name, _ in known], q1=parts["q25"], median=parts["q50"], q3=parts["q75"],
        lowerfence=parts["min"], upperfence=parts["max"], mean=parts["mean"], sd=parts["std"], boxmean="sd",
        name="EGO" if who == "ego" else "TO", offsetgroup=who, line={"color": color, "width": 1.5},
        fillcolor=fade(color, 0.22), hoverinfo="y+name",
    )  # fmt: skip


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
