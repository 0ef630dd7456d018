"""Lanes drawn as a ground to draw on, in any coordinates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from resim.core.geometry import Floats
from resim.report.figure import FigurePart
from resim.report.figure import trace as figure_trace
from resim.report.plots import compact, joined, line
from resim.road.opendrive import VEHICLE_LANES, LaneShape

LANE, MARK = "#e7eaed", "#ffffff"
LEAP = 30.0
"""Distance [m] between neighbours beyond which a border, laid straight, is torn and not drawn as an area."""

Coordinates = Callable[[Floats, Floats], tuple[Floats, Floats]]
Box = tuple[float, float, float, float]
"""Least and largest x, least and largest y."""
Polylines = tuple[list[Floats], list[Floats]]


def lane_traces(shapes: Iterable[LaneShape], coordinates: Coordinates, box: Box) -> Iterator[FigurePart]:
    """Give driving lanes as areas, and the borders of all lanes as lines, as far as they reach into the box."""
    areas: Polylines = ([], [])
    solid: Polylines = ([], [])
    broken: Polylines = ([], [])
    for shape in shapes:
        driven = shape.type in VEHICLE_LANES
        outer = shape.left if shape.lane > 0 else shape.right
        if shape.mark != "none" or driven:
            clip(*coordinates(*outer.T), box, broken if "broken" in shape.mark else solid)
        if driven:
            _area(*coordinates(*shape.left.T), *coordinates(*shape.right.T), box, areas)
    x, y = joined(*areas)
    yield figure_trace(
        "scatter", x=compact(x), y=compact(y), mode="none", fill="toself", fillcolor=LANE, hoverinfo="skip"
    )
    for lines, dash in ((solid, "solid"), (broken, "9px,8px")):
        border = line(*joined(*lines), color=MARK, name="lane", width=1.6)
        border["line"]["dash"] = dash
        yield border


def _area(x: Floats, y: Floats, x2: Floats, y2: Floats, box: Box, areas: Polylines) -> None:
    """The part of a lane that lies in the box, between its left and right border."""
    keep = np.flatnonzero(_inside(x, y, box) | _inside(x2, y2, box))
    if not len(keep):
        return
    part = slice(int(keep[0]), int(keep[-1]) + 1)
    ring = np.concatenate([x[part], x2[part][::-1], x[part][:1]])
    if len(ring) > 3 and np.abs(np.diff(ring)).max() < LEAP:
        areas[0].append(ring)
        areas[1].append(np.concatenate([y[part], y2[part][::-1], y[part][:1]]))


def _inside(x: Floats, y: Floats, box: Box) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    reach = 8.0
    return np.asarray(
        (x > box[0] - reach) & (x < box[1] + reach) & (y > box[2] - reach) & (y < box[3] + reach)
    )


def clip(x: Floats, y: Floats, box: Box, lines: Polylines) -> None:
    """Add to the lines what of this one lies in the box."""
    keep = _inside(x, y, box)
    if keep.any():
        first, last = int(np.argmax(keep)), len(keep) - int(np.argmax(keep[::-1]))
        inside = keep[first:last]
        lines[0].append(np.where(inside, x[first:last], np.nan))
        lines[1].append(np.where(inside, y[first:last], np.nan))
