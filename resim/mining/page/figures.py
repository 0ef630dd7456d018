"""Figures of what was mined: durations, vehicles by tag, maneuvers over time."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.mining.page.counts import BIN, Counted
from resim.mining.page.views import EGO
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup
from resim.report.plots import style, to_html

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7f7f7f", "#000000")
NAMES = {"l": 170, "r": 14, "t": 10, "b": 44}
"""Margins of a figure with names at its left."""
MOST_MARKS = 20_000
"""Maneuvers of one recording that are drawn over time."""


def durations(counted: Counted) -> Markup:
    """Give how long scenarios are (Wagner 2021, Fig. 6.13)."""
    bars = range(min(counted.durations), max(counted.durations) + 1)
    figure = Figure([
        figure_trace(
            "bar", x=[BIN * (k + 0.5) for k in bars], y=[counted.durations[k] for k in bars], width=BIN,
            marker={"color": EGO},
        )
    ])  # fmt: skip
    figure.update_xaxes(title_text="length of the scenario [s]")
    figure.update_yaxes(title_text="scenarios")
    return to_html(style(figure, 260.0), "durations")


def tags(counted: Counted) -> Markup:
    """Give how many vehicles scenarios have, by tag (Wagner 2021, Fig. 6.14)."""
    vehicles = sorted({n for n, _ in counted.tags})
    figure = Figure(
        figure_trace(
            "bar", x=vehicles, y=[counted.tags[n, tag] for n in vehicles], name=tag,
            marker={"color": COLORS[k % len(COLORS)]},
        )
        for k, tag in enumerate(sorted({tag for _, tag in counted.tags}))
    )  # fmt: skip
    figure.update_layout(barmode="stack")
    figure.update_xaxes(
        title_text="vehicles, with the EGO", dtick=max(1, round((vehicles[-1] - vehicles[0]) / 15.0))
    )
    figure.update_yaxes(title_text="scenarios")
    return to_html(style(figure, 300.0, showlegend=True), "tags")


def over_time(name: str, maneuvers: pd.DataFrame) -> Markup:
    """Give every maneuver of a recording over time, a row a label (Kaefer 2022, Table 4.5); MOST_MARKS at most."""
    shown = maneuvers.head(MOST_MARKS)
    labels = sorted(shown["label"].unique())
    figure = Figure()
    for k, label in enumerate(labels):
        own = shown[shown["label"] == label]
        start, end = own["start"].to_numpy(float), own["end"].to_numpy(float)
        x = np.column_stack([start, end, np.full(len(own), np.nan)]).ravel()
        y = np.where(np.isnan(x), np.nan, float(k))
        color = COLORS[k % len(COLORS)]
        figure.add_trace(figure_trace("scatter", x=x, y=y, mode="lines", line={"color": color, "width": 4.0}))
        figure.add_trace(
            figure_trace(
                "scatter", x=own["t"].to_numpy(float), y=np.full(len(own), float(k)), mode="markers",
                marker={"color": color, "size": 6.0}, name=label,
                text=[f"{a} {b}".strip() for a, b in zip(own["object"], own["partner"], strict=True)],
            )
        )  # fmt: skip
    figure.update_layout(showlegend=False)
    figure.update_yaxes(tickvals=list(range(len(labels))), ticktext=labels)
    figure.update_xaxes(title_text=f"t [s] in {name}")
    return to_html(style(figure, 80.0 + 22.0 * len(labels), margin=NAMES), "time")
