"""The figures of mined.html: durations, vehicles by tag, maneuvers over time, and scenarios from above."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd

from resim.core.geometry import to_frame
from resim.core.tracks import Tracks
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import style, to_html

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7f7f7f", "#000000")
EGO = "#0072B2"
WIDTH, HEIGHT = 360.0, 120.0
"""Pixels of a scenario from above."""
NAMES = {"l": 170, "r": 14, "t": 10, "b": 44}
"""Margins of a figure with names at its left."""
MOST_MARKS = 20_000
"""Maneuvers of one recording that are drawn over time."""


def durations(scenarios: pd.DataFrame) -> Markup:
    """Give how long scenarios are (Wagner 2021, Fig. 6.13)."""
    figure = Figure(
        [figure_trace("histogram", x=scenarios["duration"].to_numpy(float), marker={"color": EGO})]
    )
    figure.update_xaxes(title_text="length of the scenario [s]")
    figure.update_yaxes(title_text="scenarios")
    return to_html(style(figure, 260.0), "durations")


def tags(scenarios: pd.DataFrame) -> Markup:
    """Give how many vehicles scenarios have, by tag (Wagner 2021, Fig. 6.14)."""
    table = pd.crosstab(scenarios["vehicles"], scenarios["tag"])
    figure = Figure(
        figure_trace(
            "bar", x=table.index.to_numpy(float), y=table[tag].to_numpy(float), name=str(tag),
            marker={"color": COLORS[k % len(COLORS)]},
        )
        for k, tag in enumerate(table.columns)
    )  # fmt: skip
    figure.update_layout(barmode="stack", showlegend=True)
    figure.update_xaxes(
        title_text="vehicles, with the EGO", dtick=max(1, round(float(np.ptp(table.index)) / 15.0))
    )
    figure.update_yaxes(title_text="scenarios")
    return to_html(style(figure, 300.0), "tags")


def over_time(name: str, maneuvers: pd.DataFrame, number: int) -> Markup:
    """Give every maneuver of a recording over time, a row a label (Kaefer 2022, Table 4.5)."""
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
    return to_html(style(figure, 80.0 + 22.0 * len(labels), margin=NAMES), f"time{number}")


def top_view(tracks: Tracks, ego: str) -> Markup:
    """Give the ways of a scenario from above, along the way of its EGO: the EGO blue, a dot where each ends."""
    row = tracks.index(ego)
    along, aside = to_frame(tracks.x, tracks.y, *along_ego(tracks, row))
    low, high = np.nanmin(along), np.nanmax(along)
    middle = 0.5 * (np.nanmin(aside) + np.nanmax(aside))
    scale = (WIDTH - 12.0) / max(high - low, 1.0)
    across = min((HEIGHT - 12.0) / max(np.nanmax(aside) - np.nanmin(aside), 1.0), 4.0 * scale)
    px, py = 6.0 + (along - low) * scale, 0.5 * HEIGHT - (aside - middle) * across
    ways = [_way(px[n], py[n], EGO if n == row else "#b0603a") for n in _order(len(tracks), row)]
    return html(
        '<svg viewBox="0 0 {} {}" width="{}" height="{}" role="img">{}</svg>', f"{WIDTH:g}", f"{HEIGHT:g}",
        f"{WIDTH:g}", f"{HEIGHT:g}", join(ways),
    )  # fmt: skip


def along_ego(tracks: Tracks, row: int) -> tuple[float, float, float]:
    """Give the frame x [m], y [m], heading [rad] of the EGO's whole way: from where it is first to where it is last."""
    own = np.flatnonzero(tracks.valid[row])[[0, -1]]
    (x, x_end), (y, y_end) = tracks.x[row, own].tolist(), tracks.y[row, own].tolist()
    return x, y, math.atan2(y_end - y, x_end - x)


def _order(count: int, last: int) -> Sequence[int]:
    return [n for n in range(count) if n != last] + [last]


def _way(x: np.ndarray, y: np.ndarray, color: str) -> Markup:
    known = np.flatnonzero(np.isfinite(x))
    if not len(known):
        return Markup()
    taken = known[np.unique(np.linspace(0, len(known) - 1, 40).astype(int))]
    points = " ".join(f"{x[k]:.1f},{y[k]:.1f}" for k in taken.tolist())
    return html(
        '<polyline points="{}" fill="none" stroke="{}" stroke-width="1.6"/><circle cx="{}" cy="{}" r="2.6" fill="{}"/>',
        points, color, f"{x[known[-1]]:.1f}", f"{y[known[-1]]:.1f}", color,
    )  # fmt: skip
