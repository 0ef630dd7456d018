"""The part of a sweep's page that an adaptive plan has: its points, and the cells in which the outcome changes."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from itertools import combinations

import numpy as np
import plotly.graph_objects as go

from resim.core.geometry import Floats
from resim.report.plots import INK, compact, fade, sample, style, to_html
from resim.report.sweep.boundary_words import ROWS, boundary_lines, ran_out, strip_lines
from resim.report.sweep.figures import SCALE, share_bar
from resim.report.sweep.words import Entry, axis_title
from resim.report.tables import table

BAND = "#e69f00"
"""Colour of the cells in which the outcome changes."""


def boundary_html(section: Entry, parameters: Sequence[Entry], k: int) -> str:
    """Give the part of the page on the k-th section's boundary."""
    found = section["boundary"]
    what, lines = next(boundary_lines(section, parameters))
    warning = None if found["known"] else ran_out(found, parameters)
    told = "".join(f"<li>{escape(line)}</li>" for line in lines if line != warning)
    parts = [
        f"<h2>Boundary <i>{escape(what)}</i></h2>\n",
        "" if warning is None else f'<div class="warnings">{escape(warning)}</div>',
        f'<ul>{told}</ul><div class="panels">{_figures(found, parameters, k)}',
    ]
    if found["strips"] and found["cells"]:
        parts.append(f"<div>{_table(found, *parameters)}</div>")
    return f"{''.join(parts)}</div>"


def _figures(found: Entry, parameters: Sequence[Entry], k: int) -> str:
    """The points and the cells: over one parameter, or over each pair of them."""
    pairs = list(combinations(range(len(parameters)), 2)) or [(0, 0)]
    key = (
        f'<div class="key-here">{sample("cells in which the outcome changes", BAND)}</div>'
        if found["cells"]
        else ""
    )
    html = []
    for n, (i, j) in enumerate(pairs):
        drawn = _figure(found, parameters, i, j)
        caption = f"<b>{escape(parameters[i]['label'])}, {escape(parameters[j]['label'])}</b>"
        note = '<span class="note">all points and cells, projected; a dot has the mean of all that lie there</span>'
        head = f"<figcaption>{caption} {note}</figcaption>" if len(pairs) > 1 else ""
        html.append(f"<figure>{head}{to_html(drawn, f'boundary-{k}-{n}')}{key}</figure>")
    return "".join(html)


def _figure(found: Entry, parameters: Sequence[Entry], i: int, j: int) -> go.Figure:
    """Draw points and cells over the i-th and j-th parameter; of one parameter, the share of good seeds upwards."""
    at = np.array([tried["at"] for tried in found["tried"]])
    share = np.array([tried["good_seeds"] for tried in found["tried"]]) / found["seeds"]
    cells = np.array(found["cells"]).reshape(-1, len(parameters), 2)
    x, a = at[:, i], cells[:, i]
    y, b = (share, np.broadcast_to([-0.05, 1.05], a.shape)) if i == j else (at[:, j], cells[:, j])
    figure = go.Figure([_boxes(a, b), _points(x, y, share)])
    style(figure, 400.0, margin={"l": 56, "r": 8, "t": 8, "b": 48})
    figure.update_xaxes(title_text=axis_title(parameters[i]))
    if i == j:
        figure.update_yaxes(
            title_text="good seeds", tickformat=".0%", tickvals=[0.0, 0.5, 1.0], range=[-0.08, 1.08]
        )
    else:
        figure.update_yaxes(title_text=axis_title(parameters[j]))
    return figure


def _boxes(a: Floats, b: Floats) -> go.Scatter:
    """Boxes from ends a, b (C, 2), each once, as one trace."""
    ends = np.unique(np.concatenate([a, b], axis=1), axis=0)
    gap = np.full((len(ends), 1), np.nan)
    x, y = ends[:, [0, 1, 1, 0, 0]], ends[:, [2, 2, 3, 3, 2]]
    return go.Scatter(
        x=compact(np.hstack([x, gap]).ravel()[:-1]), y=compact(np.hstack([y, gap]).ravel()[:-1]), mode="lines",
        line={"color": BAND, "width": 1.2}, fill="toself", fillcolor=fade(BAND, 0.35), hoverinfo="skip",
    )  # fmt: skip


def _points(x: Floats, y: Floats, share: Floats) -> go.Scatter:
    """Dots (K,), coloured by the share of seeds that are good; those at one place as one, with their mean."""
    places, of, count = np.unique(np.stack([x, y], axis=1), axis=0, return_inverse=True, return_counts=True)
    mean = np.bincount(of.ravel(), weights=share) / count
    return go.Scatter(
        x=compact(places[:, 0]), y=compact(places[:, 1]), mode="markers", customdata=np.stack([mean, count], axis=1),
        marker={
            "color": compact(mean), "colorscale": SCALE, "cmin": 0.0, "cmax": 1.0, "size": 5.5, "colorbar": share_bar(),
            "line": {"color": INK, "width": 0.5},
        },
        hovertemplate="%{x:.6g}, %{y:.6g}: <b>%{customdata[0]:.0%}</b> of the seeds good, %{customdata[1]} points here"
        "<extra></extra>",
    )  # fmt: skip


def _table(found: Entry, first: Entry, second: Entry) -> str:
    """Where the outcome changes along the first parameter, by intervals of the second."""
    rows = [[escape(cell) for cell in row] for row in strip_lines(found, first, second)]
    drawn = table([escape(second["label"]), f"{escape(first['label'])}: it changes", ""], rows, "strips")
    if len(rows) <= ROWS:
        return drawn
    return f"<details><summary>{len(rows)} intervals of {escape(second['label'])}</summary>{drawn}</details>"
