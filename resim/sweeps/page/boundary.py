"""The part of a sweep's page that an adaptive plan has: its points, and the cells in which the outcome changes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from resim.core.geometry import Floats
from resim.report.figure import Figure, FigurePart
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import INK, compact, fade, sample, style, to_html
from resim.report.tables import table
from resim.sweeps.boundary import BoundaryReport
from resim.sweeps.page.boundary_words import ROWS, boundary_lines, ran_out, strip_lines
from resim.sweeps.page.figures import SCALE, share_bar
from resim.sweeps.page.words import axis_title
from resim.sweeps.report import SweptParameter

BAND = "#e69f00"
"""Colour of the cells in which the outcome changes."""


def boundary_html(found: BoundaryReport, parameters: Sequence[SweptParameter], k: int) -> Markup:
    """Give the part of the page on the k-th section's boundary."""
    what, lines = next(boundary_lines(found, parameters))
    warning = None if found.known else ran_out(found, parameters)
    told = join(html("<li>{}</li>", line) for line in lines if line != warning)
    parts = [
        html("<h2>Boundary <i>{}</i></h2>\n", what),
        Markup() if warning is None else html('<div class="warnings">{}</div>', warning),
        html('<ul>{}</ul><div class="panels">{}', told, _figures(found, parameters, k)),
    ]
    if found.strips and found.cells:
        parts.append(html("<div>{}</div>", _table(found, *parameters)))
    return html("{}</div>", join(parts))


def _figures(found: BoundaryReport, parameters: Sequence[SweptParameter], k: int) -> Markup:
    """The points and the cells: over one parameter, or over each pair of them."""
    pairs = list(combinations(range(len(parameters)), 2)) or [(0, 0)]
    key = (
        html('<div class="key-here">{}</div>', sample("cells in which the outcome changes", BAND))
        if found.cells
        else ""
    )
    figures = []
    for n, (i, j) in enumerate(pairs):
        drawn = _figure(found, parameters, i, j)
        caption = html("<b>{}, {}</b>", parameters[i].label, parameters[j].label)
        note = Markup(
            '<span class="note">all points and cells, projected; a dot has the mean of all that lie there</span>'
        )
        head = html("<figcaption>{} {}</figcaption>", caption, note) if len(pairs) > 1 else ""
        figures.append(html("<figure>{}{}{}</figure>", head, to_html(drawn, f"boundary-{k}-{n}"), key))
    return join(figures)


def _figure(found: BoundaryReport, parameters: Sequence[SweptParameter], i: int, j: int) -> Figure:
    """Draw points and cells over the i-th and j-th parameter; of one parameter, the share of good seeds upwards."""
    at = np.array([tried.at for tried in found.tried])
    share = np.array([tried.good_seeds for tried in found.tried]) / found.seeds
    cells = np.array(found.cells).reshape(-1, len(parameters), 2)
    x, a = at[:, i], cells[:, i]
    y, b = (share, np.broadcast_to([-0.05, 1.05], a.shape)) if i == j else (at[:, j], cells[:, j])
    figure = Figure([_boxes(a, b), _points(x, y, share)])
    style(figure, 400.0, margin={"l": 56, "r": 8, "t": 8, "b": 48})
    figure.update_xaxes(title_text=axis_title(parameters[i]))
    if i == j:
        figure.update_yaxes(
            title_text="good seeds", tickformat=".0%", tickvals=[0.0, 0.5, 1.0], range=[-0.08, 1.08]
        )
    else:
        figure.update_yaxes(title_text=axis_title(parameters[j]))
    return figure


def _boxes(a: Floats, b: Floats) -> FigurePart:
    """Boxes from ends a, b (C, 2), each once, as one trace."""
    ends = np.unique(np.concatenate([a, b], axis=1), axis=0)
    gap = np.full((len(ends), 1), np.nan)
    x, y = ends[:, [0, 1, 1, 0, 0]], ends[:, [2, 2, 3, 3, 2]]
    return figure_trace("scatter",
        x=compact(np.hstack([x, gap]).ravel()[:-1]), y=compact(np.hstack([y, gap]).ravel()[:-1]), mode="lines",
        line={"color": BAND, "width": 1.2}, fill="toself", fillcolor=fade(BAND, 0.35), hoverinfo="skip",
    )  # fmt: skip


def _points(x: Floats, y: Floats, share: Floats) -> FigurePart:
    """Dots (K,), coloured by the share of seeds that are good; those at one place as one, with their mean."""
    places, of, count = np.unique(np.stack([x, y], axis=1), axis=0, return_inverse=True, return_counts=True)
    mean = np.bincount(of.ravel(), weights=share) / count
    return figure_trace("scatter",
        x=compact(places[:, 0]), y=compact(places[:, 1]), mode="markers", customdata=np.stack([mean, count], axis=1),
        marker={
            "color": compact(mean), "colorscale": SCALE, "cmin": 0.0, "cmax": 1.0, "size": 5.5, "colorbar": share_bar(),
            "line": {"color": INK, "width": 0.5},
        },
        hovertemplate=Markup(
            "%{x:.6g}, %{y:.6g}: <b>%{customdata[0]:.0%}</b> of the seeds good, %{customdata[1]} points here"
            "<extra></extra>"
        ),
    )  # fmt: skip


def _table(found: BoundaryReport, first: SweptParameter, second: SweptParameter) -> Markup:
    """Where the outcome changes along the first parameter, by intervals of the second."""
    rows = list(strip_lines(found, first, second))
    drawn = table([second.label, f"{first.label}: it changes", ""], rows, "strips")
    if len(rows) <= ROWS:
        return drawn
    return html("<details><summary>{} intervals of {}</summary>{}</details>", len(rows), second.label, drawn)
