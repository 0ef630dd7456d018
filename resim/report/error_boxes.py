"""The errors of every step at a glance (Fig. 5.11)."""

from __future__ import annotations

from collections.abc import Mapping

from resim.report.figure import Figure, FigurePart
from resim.report.figure import trace as figure_trace
from resim.report.plots import fade, style
from resim.report.steps import SYMBOLS
from resim.report.view import View
from resim.resimulation.fidelity import QUANTITIES

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


def _box(
    view: View, basis: str, chain: tuple[tuple[str, str], ...], who: str, quantity: str
) -> FigurePart | None:
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
