"""Plotly as the page uses it: one look, compact arrays, and the HTML of a figure."""

from __future__ import annotations

import gzip
import json
from base64 import b64encode
from typing import Any

import numpy as np
import shapely

from resim.core.geometry import Floats
from resim.report.figure import PLAIN, Figure, FigurePart
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, escape, html

INK, GRID, FAINT = "#1d2733", "#e6e9ed", "#5b6673"
FONT = "Inter, 'Segoe UI', system-ui, -apple-system, 'Helvetica Neue', Arial, 'DejaVu Sans', sans-serif"
DASH = "6px,4px"
CONFIG = {"displayModeBar": False, "responsive": True}
"""Zoom by dragging, back by a double click; a bar of buttons would cover the figures."""


LEAST_PANEL = 290
"""Width [px] of a panel beside others, under which its texts overlap: a narrow screen scrolls sideways."""
FINEST = 1e-4
"""Part of a figure's width that is finer than a pixel."""
SEEN = 2.5e-4
"""Part of its width and height by which a line may be off whose values nobody can ask for: a quarter of a pixel."""


def compact(values: Floats) -> np.ndarray[Any, Any]:
    """Give values as 32-bit floats, half the page, where these are finer than a pixel; else as they are."""
    known = np.abs(values[np.isfinite(values)])
    fine = not known.size or np.spacing(np.float32(known.max())) <= FINEST * float(
        np.ptp(values[np.isfinite(values)])
    )
    return np.ascontiguousarray(values, dtype=np.float32 if fine else np.float64)


def clock_words(start: float) -> str:
    """Give the title of an axis of times [s] counted from a start [s] of the recording's clock."""
    return f"t [s] from {start:.2f} s on" if start else "t [s]"


def fade(color: str, share: float) -> str:
    """Give a colour #rrggbb with an opacity of 0 to 1."""
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},{share:g})"


def lighten(color: str, share: float) -> str:
    """Give a colour #rrggbb mixed with a share of 0 to 1 of white."""
    parts = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round(p + share * (255 - p)):02x}" for p in parts)


def line(
    x: Floats,
    y: Floats,
    *,
    color: str,
    name: str,
    width: float = 2.0,
    dashed: bool = False,
    hover: str = "",
    t: Floats | None = None,
) -> FigurePart:
    """Give a line; x, y (K,), NaN breaks it.

    hover: its text, a d3 template over x, y, and customdata if times t (K,) [s] are given; none if empty.
    """
    part = known(x + y)
    drawn = (x[part], y[part]) if hover else without_unseen(x[part], y[part])
    return figure_trace("scatter",
        x=compact(drawn[0]), y=compact(drawn[1]), mode="lines", name=name, showlegend=False,
        customdata=None if t is None else compact(t[part]),
        line={"color": color, "width": width, "dash": DASH if dashed else "solid"},
        hoverinfo="skip" if not hover else None,
        hovertemplate=html("<b>{}</b><br>{}<extra></extra>", plain(name), hover) if hover else None,
    )  # fmt: skip


def without_unseen(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Give a line x, y (K,) without the points that nobody would miss: it is off by SEEN of its extent at most.

    NaN, which breaks it, stays. Zoomed in four times it is still within a pixel.
    """
    there = np.isfinite(x) & np.isfinite(y)
    pieces = np.flatnonzero(np.diff(np.r_[False, there, False])).reshape(-1, 2)
    scale = [1.0 / (SEEN * (float(np.ptp(values[there])) or 1.0)) for values in (x, y)] if there.any() else []
    keep = ~there & np.r_[True, there[:-1]]  # one break where there are many
    for first, last in pieces.tolist():
        keep[first:last] = _bends(x[first:last] * scale[0], y[first:last] * scale[1])
    return x[keep], y[keep]


def _bends(x: Floats, y: Floats) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Which points (K,) a line needs that is off by 1 at most (Douglas and Peucker 1973)."""
    if len(x) < 3:
        return np.ones(len(x), dtype=bool)
    line = shapely.linestrings(np.column_stack([x, y, np.arange(len(x))]))
    keep = np.zeros(len(x), dtype=bool)
    kept = shapely.get_coordinates(shapely.simplify(line, 1.0, preserve_topology=False), include_z=True)[:, 2]
    keep[kept.astype(int)] = True
    return keep


def known(values: Floats) -> slice:
    """Give the part of values (K,) from the first to the last that is not NaN."""
    finite = np.flatnonzero(np.isfinite(values))
    return slice(int(finite[0]), int(finite[-1]) + 1) if len(finite) else slice(0, 0)


def dots(x: Floats, y: Floats, *, color: str, name: str, hover: str, size: float = 5.0) -> FigurePart:
    """Give dots with a white rim; x, y (K,)."""
    return figure_trace("scatter",
        x=compact(x), y=compact(y), mode="markers", name=name, showlegend=False,
        marker={"color": color, "size": size, "line": {"color": "white", "width": 0.8}},
        hovertemplate=html("<b>{}</b><br>{}<extra></extra>", plain(name), hover),
    )  # fmt: skip


def number(value: float, digits: int) -> str:
    """Give a number with a true minus sign, and no sign where it rounds to zero."""
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", "−")


def joined(xs: list[Floats], ys: list[Floats]) -> tuple[Floats, Floats]:
    """Give many lines as one, with a NaN between them."""
    gap = np.array([np.nan])
    parts: tuple[list[Floats], list[Floats]] = ([np.empty(0)], [np.empty(0)])
    for x, y in zip(xs, ys, strict=True):
        part = known(x + y)
        parts[0].extend((x[part], gap))
        parts[1].extend((y[part], gap))
    return np.concatenate(parts[0]), np.concatenate(parts[1])


def style(figure: Figure, height: float, **layout: Any) -> Figure:
    """Give the figure the page's look."""
    figure.update_layout(
        template=PLAIN, height=round(height), paper_bgcolor="white", plot_bgcolor="white",
        font={"family": FONT, "size": 12, "color": INK}, showlegend=False, hovermode="closest",
        hoverlabel={"bgcolor": "white", "font": {"size": 12, "color": INK}},
        margin={"l": 62, "r": 14, "t": 30, "b": 44},
    )  # fmt: skip
    axis: FigurePart = {
        "gridcolor": GRID, "gridwidth": 1, "zeroline": False, "linecolor": "#9aa3ad", "linewidth": 1,
        "showline": True, "ticks": "outside", "ticklen": 4, "tickcolor": "#9aa3ad",
        "tickfont": {"size": 11}, "title": {"font": {"size": 12}, "standoff": 8},
        "exponentformat": "e", "minexponent": 5,
    }  # fmt: skip
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    figure.update_layout(**layout)
    return figure


def plain(text: str) -> Markup:
    """Give a text for a hover template, in which it is neither a tag nor a field; Markup stays what it is."""
    return escape(text).replace("%{", Markup("&#37;{"))


def to_html(figure: Figure, name: str) -> Markup:
    """Give the figure as a div of this id and its data, which `resim.report.document` draws.

    Plotly reads tags and entities in the texts of a figure, so that those that are not Markup are escaped here.
    """
    drawn = _escaped(figure.to_dict()) | {"config": CONFIG}
    told = json.dumps(drawn, separators=(",", ":"), allow_nan=False).encode()
    plot = html(
        '<div class="plot" style="min-width:{}px"><div id="{}" class="plotly-graph-div" data-height="{}"></div>'
        '<script type="application/gzip">{}</script></div>',
        LEAST_PANEL * figure.columns if figure.columns > 1 else 0,
        name,
        figure.layout["height"],
        b64encode(gzip.compress(told, mtime=0)).decode(),
    )
    return html('<div class="wide">{}</div>', plot) if figure.columns > 1 else plot


TEXTS = {"name", "text", "hovertext", "hovertemplate", "texttemplate", "ticktext", "ticksuffix", "tickprefix"}
"""Attributes that plotly reads tags in."""


def _escaped(part: Any, read: bool = False) -> Any:
    """A part of a figure with its texts escaped; read: whether it is the value of one of TEXTS."""
    if isinstance(part, dict):
        return {key: _escaped(value, key in TEXTS) for key, value in part.items()}
    if isinstance(part, list | tuple):
        return [_escaped(value, read) for value in part]
    return escape(part) if read and isinstance(part, str) else part


def sample(text: str, color: str, *, dashed: bool = False) -> Markup:
    """Give an entry of a key: a piece of line and its text."""
    dash = Markup(' stroke-dasharray="6 4"') if dashed else ""
    return html(
        '<span class="sample"><svg width="30" height="12" aria-hidden="true"><line x1="1" y1="6" x2="29" y2="6" '
        'stroke="{}" stroke-width="2.6"{}/></svg>{}</span>',
        color,
        dash,
        text,
    )


def captioned(figure: Figure, name: str, title: str, note: str = "") -> Markup:
    """Give the figure as `to_html` does, with a title and a note above it."""
    small = html('<span class="note">{}</span>', note) if note else ""
    return html(
        "<figure><figcaption><b>{}</b> {}</figcaption>{}</figure>\n", title, small, to_html(figure, name)
    )
