"""Kaefer's graphical statistics of a recording (Table 4.5): every trajectory, speed and lane, and who is where when."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.mining.page.figures import COLORS, NAMES
from resim.mining.page.views import EGO
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, join
from resim.report.plots import style, to_html

MOST_LANES = 40
"""Lanes that are named at the axis."""
TOTALS = ("speeding", "standing")
"""Labels whose vehicles are counted at each time."""


def graphs(name: str, overview: pd.DataFrame, maneuvers: pd.DataFrame) -> Markup:
    """Give trajectories, speeds and lanes over time, and how many vehicles speed and stand (Kaefer 2022, Table 4.5).

    overview: rows as of `overview_frame`.
    """
    lines = _Lines(overview)
    drawn = [
        _trajectories(name, lines),
        _over_time(f"speed [m/s] in {name}", lines, lines.of("v"), "speeds"),
        _lanes(name, lines),
    ]
    counted = maneuvers[maneuvers["label"].isin(TOTALS)]
    return join([*drawn, _totals(name, counted)] if len(counted) else drawn)


class _Lines:
    """Rows of the overview as lines: a gap after each piece."""

    def __init__(self, overview: pd.DataFrame) -> None:
        self.rows = overview
        piece = overview["piece"].to_numpy()
        self._gaps = np.flatnonzero(piece[1:] != piece[:-1]) + 1
        ids = overview["object"].to_numpy(dtype=object)
        self.ids: list[str] = np.insert(ids, self._gaps, "").tolist()

    def of(self, column: str) -> Floats:
        """Give the values of a column, NaN in each gap."""
        return self.gapped(self.rows[column].to_numpy(float))

    def gapped(self, values: Floats) -> Floats:
        """Give values a row with NaN in each gap."""
        out: Floats = np.insert(values, self._gaps, np.nan)
        return out


def _line(lines: _Lines, x: Floats, y: Floats) -> dict[str, object]:
    return figure_trace(
        "scatter", x=x, y=y, mode="lines", line={"color": EGO, "width": 1.0}, opacity=0.5, text=lines.ids,
        hovertemplate="%{text}: %{x:.2f}, %{y:.2f}<extra></extra>",
    )  # fmt: skip


def _trajectories(name: str, lines: _Lines) -> Markup:
    figure = Figure([_line(lines, lines.of("x"), lines.of("y"))])
    figure.update_xaxes(title_text=f"x [m] in {name}")
    figure.update_yaxes(title_text="y [m]", scaleanchor="x")
    return to_html(style(figure, 340.0), "ways")


def _over_time(told: str, lines: _Lines, values: Floats, name: str) -> Markup:
    figure = Figure([_line(lines, lines.of("t"), values)])
    figure.update_xaxes(title_text="t [s]")
    figure.update_yaxes(title_text=told)
    return to_html(style(figure, 260.0), name)


def _lanes(name: str, lines: _Lines) -> Markup:
    """Give the lane of each vehicle at each time."""
    told = lines.rows["lane"].to_numpy(dtype=str)
    names = sorted({*told.tolist()} - {""}, key=_lane_key)
    place = {lane: float(k) for k, lane in enumerate(names)}
    rank = np.array([place.get(lane, np.nan) for lane in told.tolist()])
    figure = Figure([_line(lines, lines.of("t"), lines.gapped(rank))])
    figure.data[0]["line"] |= {"shape": "hv"}
    shown = list(range(0, len(names), max(1, -(-len(names) // MOST_LANES))))
    figure.update_yaxes(tickvals=shown, ticktext=[names[k] for k in shown])
    figure.update_xaxes(title_text=f"t [s] in {name}: the lane (road/lane) of each vehicle")
    return to_html(style(figure, 90.0 + 16.0 * len(shown), margin=NAMES), "lanes")


def _lane_key(lane: str) -> tuple[str, int]:
    road, _, number = lane.rpartition("/")
    return road.rjust(12, "0"), int(number)


def _totals(name: str, maneuvers: pd.DataFrame) -> Markup:
    """Give how many vehicles speed and stand at each time."""
    figure = Figure()
    for k, label in enumerate(TOTALS):
        own = maneuvers[maneuvers["label"] == label]
        t, count = counted_over_time(own["start"].to_numpy(float), own["end"].to_numpy(float))
        line = {"color": COLORS[k], "shape": "hv", "width": 1.6}
        figure.add_trace(figure_trace("scatter", x=t, y=count, mode="lines", name=label, line=line))
    figure.update_xaxes(title_text=f"t [s] in {name}")
    figure.update_yaxes(title_text="vehicles", rangemode="tozero")
    return to_html(style(figure, 220.0, showlegend=True), "totals")


def counted_over_time(start: Floats, end: Floats) -> tuple[Floats, Floats]:
    """Give times [s] and how many of some spans (start to end [s]) there are from each on."""
    times = np.concatenate([start, end])
    change = np.concatenate([np.ones(len(start)), -np.ones(len(end))])
    t, place = np.unique(times, return_inverse=True)
    return t, np.cumsum(np.bincount(place, change, len(t)))
