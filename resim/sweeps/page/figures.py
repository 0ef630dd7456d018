"""Figures of a sweep: responses with their bands, and maps of pass and fail with their boundary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.report.figure import Figure, FigurePart
from resim.report.figure import trace as figure_trace
from resim.report.markup import html
from resim.report.plots import DASH, INK, compact, fade, plain, style
from resim.sweeps.page.words import axis_title, keeps
from resim.sweeps.report import MapEntry, ResponseCurve, SweptParameter, VaryingOutcome

SHARE, VALUE = "#0072b2", "#d55e00"
HALF, DEMANDED = INK, "#e69f00"
"""Colours: responses of shares and of values, boundaries at one half and at the demanded share."""
SCALE = [[0.0, "#a1260d"], [0.5, "#f3f1ee"], [1.0, "#0072b2"]]
PANEL, GAP = 112.0, 44.0
"""Height [px] of a panel, and between two."""
TOP, BOTTOM = 34.0, 50.0


def response_figure(outcomes: Sequence[VaryingOutcome], parameter: SweptParameter) -> Figure:
    """Draw how outcomes answer to one parameter, a panel each: mean and 95 % band; all of shares, or all of values."""
    rows = len(outcomes)
    height = rows * PANEL + (rows - 1) * GAP
    titles = [o.label + (f" [{o.unit}]" if o.unit else "") for o in outcomes]
    figure = Figure.of_panels(
        rows=rows, cols=1, shared_xaxes=True, vertical_spacing=GAP / height if rows > 1 else 0.0,
        subplot_titles=titles,
    )  # fmt: skip
    for k, outcome in enumerate(outcomes, start=1):
        for trace in _response(outcome, outcome.responses[parameter.name]):
            figure.add_trace(trace, row=k, col=1)
    style(figure, height + TOP + BOTTOM, margin={"l": 56, "r": 14, "t": TOP, "b": BOTTOM})
    figure.update_annotations(x=0.0, xanchor="left", font={"size": 12})
    if outcomes[0].share:
        figure.update_yaxes(range=[-0.06, 1.06], tickvals=[0.0, 0.5, 1.0], tickformat=".0%")
    else:
        figure.update_yaxes(nticks=4)
    figure.update_xaxes(title_text=axis_title(parameter), row=rows, col=1)
    return figure


def _response(outcome: VaryingOutcome, found: ResponseCurve) -> list[FigurePart]:
    """Band, line and dots of one panel."""
    x, mean, low, high = map(_array, (found.at, found.mean, found.low, found.high))
    color, form = (SHARE, ".1%") if outcome.share else (VALUE, ".4g")
    known = np.isfinite(low + high)
    band = figure_trace("scatter",
        x=compact(np.concatenate([x[known], x[known][::-1]])),
        y=compact(np.concatenate([high[known], low[known][::-1]])),
        fill="toself", fillcolor=fade(color, 0.2), line={"width": 0}, mode="lines", hoverinfo="skip", showlegend=False,
    )  # fmt: skip
    line = figure_trace("scatter",
        x=compact(x), y=compact(mean), mode="lines+markers", showlegend=False,
        line={"color": color, "width": 2}, marker={"size": 5, "color": color},
        customdata=np.stack([low, high, _array(found.runs)], axis=1),
        hovertemplate=html(
            "%{{x:.4g}}: <b>%{{y:{0}}}</b> [%{{customdata[0]:{0}}}, %{{customdata[1]:{0}}}], "
            "%{{customdata[2]}} runs<extra></extra>",
            form,
        ),
    )  # fmt: skip
    return [band, line]


def map_figure(outcome: VaryingOutcome, found: MapEntry, parameters: Sequence[SweptParameter]) -> Figure:
    """Draw the share of runs that are good over two parameters, the boundaries and their 95 % bounds.

    parameters: of the sweep; of two, the first is on the x axis over all that was swept, on the map of any outcome.
    """
    a, b = (p for p in parameters if p.name in (found.a, found.b))
    at = {found.a: _array(found.at_a), found.b: _array(found.at_b)}
    x, y = at[a.name], at[b.name]
    share, low, high = (
        np.array([_array(row) for row in rows]) for rows in (found.share, found.low, found.high)
    )
    if a.name != found.a:
        share, low, high = share.T, low.T, high.T
    figure = Figure(
        [figure_trace("heatmap",
            x=compact(x), y=compact(y), z=compact(share), zmin=0.0, zmax=1.0, colorscale=SCALE,
            customdata=np.stack([low, high], axis=-1), colorbar=share_bar(),
            hovertemplate=html(
                "{} %{{x:.4g}} {}<br>{} %{{y:.4g}} {}<br>"
                "{}: <b>%{{z:.0%}}</b> [%{{customdata[0]:.0%}}, %{{customdata[1]:.0%}}]<extra></extra>",
                *map(plain, (a.label, a.unit, b.label, b.unit, keeps(outcome, outcome.limit))),
            ),
        )]
    )  # fmt: skip
    for level, color in zip(map(float, found.boundaries), (HALF, DEMANDED), strict=True):
        for z, dashed in ((low, True), (high, True), (share, False)):
            figure.add_trace(_contour(x, y, z, level, color, dashed))
    style(figure, 330.0, margin={"l": 56, "r": 8, "t": 8, "b": 48})
    figure.update_xaxes(title_text=axis_title(a), range=_reach(a, x), showgrid=False)
    figure.update_yaxes(title_text=axis_title(b), range=_reach(b, y), showgrid=False)
    return figure


def _reach(parameter: SweptParameter, at: Floats) -> list[float]:
    """What an axis of a map spans: all that was swept, and the cells around its first and last value."""
    ends = 0.5 * np.diff(at) if len(at) > 1 else np.ones(1)
    return [min(parameter.low, float(at[0] - ends[0])), max(parameter.high, float(at[-1] + ends[-1]))]


def _contour(x: Floats, y: Floats, z: Floats, level: float, color: str, dashed: bool) -> FigurePart:
    return figure_trace("contour",
        x=compact(x), y=compact(y), z=compact(z), showscale=False, hoverinfo="skip", showlegend=False,
        contours={"start": level, "end": level, "size": 1.0, "coloring": "none"},
        line={"color": color, "width": 1.4 if dashed else 3.0, "dash": DASH if dashed else "solid", "smoothing": 0.0},
    )  # fmt: skip


def share_bar() -> dict[str, object]:
    """Give the bar that explains the colours of `SCALE`, as plotly takes it."""
    return {"thickness": 10, "len": 1.0, "tickformat": ".0%", "tickvals": [0.0, 0.5, 1.0], "outlinewidth": 0,
            "tickfont": {"size": 11}, "xpad": 4}  # fmt: skip


def _array(values: Sequence[float | None]) -> Floats:
    """Numbers as JSON has them as an array, NaN for None."""
    return np.array([np.nan if v is None else v for v in values], dtype=float)
