"""Figures as plotly.js reads them, made without plotly's checks of every value, which take longer than a whole run.

The methods have the names and the meaning of plotly's; what plotly makes of the same calls is the oracle of the tests.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from resim.core.geometry import Floats

FigurePart = dict[str, Any]
"""A part of a figure: a trace, an axis, an annotation; as in plotly.js."""

PLAIN: FigurePart = {"data": {"scatter": [{"type": "scatter"}]}}
"""The template without a look of its own, plotly's "none"."""
_WHOLE = ("paper_bgcolor", "plot_bgcolor")
"""Names that have an underscore; in all others it leads into a part."""
_SMALLEST = ("i1", "i2", "i4")


def trace(kind: str, **attributes: Any) -> FigurePart:
    """Give a trace of a kind ("scatter", "heatmap", "contour", "box"); what is None is not told."""
    return {"type": kind, **{name: value for name, value in attributes.items() if value is not None}}


class Figure:
    """Traces and their layout, in rows and columns of panels, counted from 1 at the top left.

    Attributes:
        data: The traces.
        layout: The layout.
    """

    def __init__(self, traces: Iterable[FigurePart] = ()) -> None:
        self.data: list[FigurePart] = list(traces)
        self.layout: FigurePart = {"xaxis": {}, "yaxis": {}}
        self._panels: dict[tuple[int, int], str] = {(1, 1): ""}

    @classmethod
    def of_panels(
        cls,
        rows: int,
        cols: int,
        *,
        row_heights: Sequence[float] | None = None,
        column_widths: Sequence[float] | None = None,
        vertical_spacing: float = 0.0,
        horizontal_spacing: float = 0.0,
        shared_xaxes: bool = False,
        shared_yaxes: bool = False,
        subplot_titles: Sequence[str] = (),
    ) -> Figure:
        """Give an empty figure with panels, as plotly's `make_subplots`.

        row_heights, column_widths: to each other. vertical_spacing, horizontal_spacing: between panels, as shares of
        the whole. shared_xaxes: the panels of a column have one x axis, told at the bottom; shared_yaxes: those of a
        row have one y axis, told at the left. subplot_titles: row by row.
        """
        figure = cls()
        across = list(_spans(column_widths or [1.0] * cols, horizontal_spacing))
        up = list(_spans(list(reversed(row_heights or [1.0] * rows)), vertical_spacing))[::-1]
        for row in range(1, rows + 1):
            for column in range(1, cols + 1):
                number = (row - 1) * cols + column
                mark = "" if number == 1 else str(number)
                figure._panels[row, column] = mark
                x: FigurePart = {"anchor": f"y{mark}", "domain": across[column - 1]}
                y: FigurePart = {"anchor": f"x{mark}", "domain": up[row - 1]}
                if shared_xaxes and row < rows:
                    x |= {"matches": f"x{_mark((rows - 1) * cols + column)}", "showticklabels": False}
                if shared_yaxes and column > 1:
                    y |= {"matches": f"y{_mark((row - 1) * cols + 1)}", "showticklabels": False}
                figure.layout |= {f"xaxis{mark}": x, f"yaxis{mark}": y}
        for (row, column), title in zip(list(figure._panels), subplot_titles, strict=False):
            (left, right), (_, top) = across[column - 1], up[row - 1]
            figure._annotations().append(
                {
                    "text": title, "x": 0.5 * (left + right), "y": top, "xref": "paper", "yref": "paper",
                    "xanchor": "center", "yanchor": "bottom", "showarrow": False, "font": {"size": 16},
                }
            )  # fmt: skip
        return figure

    @property
    def columns(self) -> int:
        """How many columns of panels it has."""
        return max(column for _, column in self._panels)

    def add_trace(self, added: FigurePart, row: int | None = None, col: int | None = None) -> None:
        """Add a trace to a panel."""
        if row is not None and col is not None:
            mark = self._panels[row, col]
            added = {**added, "xaxis": f"x{mark}", "yaxis": f"y{mark}"}
        self.data.append(added)

    def add_traces(self, added: Iterable[FigurePart]) -> None:
        """Add traces to a figure of one panel."""
        self.data.extend(added)

    def update_layout(self, **attributes: Any) -> None:
        """Set parts of the layout."""
        _update(self.layout, attributes)

    def update_xaxes(self, row: int | None = None, col: int | None = None, **attributes: Any) -> None:
        """Set parts of the x axes, of a row or column only where it is given."""
        self._update_axes("x", row, col, attributes)

    def update_yaxes(self, row: int | None = None, col: int | None = None, **attributes: Any) -> None:
        """Set parts of the y axes, of a row or column only where it is given."""
        self._update_axes("y", row, col, attributes)

    def add_annotation(self, row: int | None = None, col: int | None = None, **attributes: Any) -> None:
        """Add a text; in a panel "x domain" and "y domain" are that panel's."""
        added: FigurePart = {}
        _update(added, attributes)
        if row is not None and col is not None:
            for side in "xy":
                domain = " domain" if "domain" in added.get(f"{side}ref", "") else ""
                added[f"{side}ref"] = f"{side}{self._panels[row, col]}{domain}"
        self._annotations().append(added)

    def update_annotations(self, **attributes: Any) -> None:
        """Set parts of all texts."""
        for one in self._annotations():
            _update(one, attributes)

    def add_shape(self, **attributes: Any) -> None:
        """Add a shape."""
        added: FigurePart = {}
        _update(added, attributes)
        self.layout.setdefault("shapes", []).append(added)

    def add_vline(self, x: float, row: int, col: int, **attributes: Any) -> None:
        """Add a line from the bottom of a panel to its top; none where the panel is empty yet."""
        self._add_line("y", {"x0": x, "x1": x, "y0": 0, "y1": 1}, row, col, attributes)

    def add_hline(self, y: float, row: int, col: int, **attributes: Any) -> None:
        """Add a line from the left of a panel to its right; none where the panel is empty yet."""
        self._add_line("x", {"x0": 0, "x1": 1, "y0": y, "y1": y}, row, col, attributes)

    def to_dict(self) -> FigurePart:
        """Give what plotly.js reads, with arrays as it packs them."""
        layout = {name: part for name, part in self.layout.items() if part != {}}
        return {"data": [_packed(one) for one in self.data], "layout": _packed(layout)}

    def _annotations(self) -> list[FigurePart]:
        found: list[FigurePart] = self.layout.setdefault("annotations", [])
        return found

    def _update_axes(self, side: str, row: int | None, col: int | None, attributes: FigurePart) -> None:
        for (r, c), mark in self._panels.items():
            if row in (None, r) and col in (None, c):
                _update(self.layout[f"{side}axis{mark}"], attributes)

    def _add_line(self, along: str, ends: FigurePart, row: int, col: int, attributes: FigurePart) -> None:
        mark = self._panels[row, col]
        if any(one.get("xaxis", "x") == f"x{mark}" for one in self.data):
            refs = {f"{side}ref": f"{side}{mark}{' domain' if side == along else ''}" for side in "xy"}
            self.add_shape(type="line", **ends, **refs, **attributes)


def _mark(number: int) -> str:
    return "" if number == 1 else str(number)


def _spans(sizes: Sequence[float], gap: float) -> Iterator[list[float]]:
    """Where parts of these sizes begin and end in 0 to 1, with gaps between."""
    room, whole, begin = 1.0 - gap * (len(sizes) - 1), sum(sizes), 0.0
    for size in sizes:
        end = begin + room * size / whole
        yield [max(0.0, min(1.0, begin)), max(0.0, min(1.0, end))]
        begin = end + gap


def _update(part: FigurePart, attributes: Mapping[str, Any]) -> None:
    """Set attributes of a part: those of parts in it one by one, None not at all; title_text is the text of title."""
    for name, value in attributes.items():
        if "_" in name and name not in _WHOLE:
            outer, _, inner = name.partition("_")
            _update(part, {outer: {inner: value}})
        elif isinstance(value, Mapping):
            _update(part.setdefault(name, {}), value)
        elif value is not None:
            part[name] = value


def _packed(part: Any) -> Any:
    """A part with its arrays packed as plotly.js reads them, whole numbers as small as they go."""
    if isinstance(part, dict):
        return {name: _packed(value) for name, value in part.items() if value is not None}
    if isinstance(part, list | tuple):
        return [_packed(value) for value in part]
    if isinstance(part, float | np.floating):
        return float(part) if np.isfinite(part) else None
    if not isinstance(part, np.ndarray) or part.dtype.kind not in "iuf":
        return part.tolist() if isinstance(part, np.ndarray | np.generic) else part
    values: Floats = part
    if not values.size:
        return []
    kind = values.dtype.str[1:]
    if kind == "i8":
        fits = [
            k
            for k in _SMALLEST
            if np.iinfo(k).min <= values.min(initial=0) and values.max(initial=0) <= np.iinfo(k).max
        ]
        if not fits:
            return part.tolist()
        kind = fits[0]
    told = {"dtype": kind, "bdata": base64.b64encode(values.astype(f"<{kind}").tobytes()).decode("ascii")}
    return told if values.ndim == 1 else {**told, "shape": ", ".join(map(str, values.shape))}
