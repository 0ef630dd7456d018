"""Traces on the road: from above at one scale, stretched across the road, and the distance over time."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from resim.core.geometry import Floats, box_corners
from resim.core.tracks import Tracks
from resim.report.figure import Figure, FigurePart
from resim.report.lanes import Box, clip, lane_traces
from resim.report.markup import Markup
from resim.report.model_runs import seeds_panel
from resim.report.plots import fade, joined, line, style
from resim.report.steps import FROM_ZERO, error_panel
from resim.report.view import OTHERS, View
from resim.resimulation import pipeline_step

PLOT_WIDTH = 1120.0
"""Width [px] of a figure's plot area on a page of 1280 px."""

MARGIN_ALONG, MARGIN_ACROSS, BEYOND = 8.0, 6.0, 40.0


def plan_figure(view: View) -> Figure:
    """Draw all traces from above, both axes at one scale, travel to the right (Figs. 5.4, 5.7, 5.8, top)."""
    box = _extent(view)
    figure = Figure()
    figure.add_traces(list(lane_traces(view.lanes, view.plan, box)))
    figure.add_traces(list(_others(view, box)))
    figure.add_traces(list(_traces(view, lambda tracks, name: view.plan(*_xy(tracks, name)))))
    figure.add_traces(list(_boxes(view)))
    height = np.clip(PLOT_WIDTH * (box[3] - box[2]) / (box[1] - box[0]), 110.0, 540.0)
    style(figure, height + 76.0)
    figure.update_xaxes(title_text="in direction of travel [m]", range=box[:2], showgrid=False)
    figure.update_yaxes(
        title_text="to the left [m]", range=box[2:], showgrid=False, scaleanchor="x", scaleratio=1
    )
    return figure


def lateral_figure(view: View) -> Figure:
    """Draw the traces with the road laid straight and stretched across: who changed lanes, and where."""
    spots = [view.along(t, i) for t in view.tracks.values() for i in view.shown if i in t.ids]
    ego = [view.along(t, view.ego) for t in view.tracks.values()]
    s, d = _bounds([a for a, _ in ego], 0.0), _bounds([np.clip(b, -14.0, 14.0) for _, b in spots], 1.5)
    low, high = min(d[0], -2.6), max(d[1], 2.6)
    box = (s[0] - MARGIN_ALONG, s[1] + MARGIN_ALONG, low, high)
    figure = Figure()
    figure.add_traces(list(lane_traces(view.lanes, view.path.project, box)))
    figure.add_traces(list(_traces(view, view.along)))
    style(figure, 300.0)
    figure.update_xaxes(title_text="distance along the road [m]", range=box[:2])
    figure.update_yaxes(title_text=f"left of {view.path_short} [m]", range=box[2:], showgrid=False)
    return figure


def distance_figure(view: View) -> Figure | None:
    """Draw the distance of each basis' re-simulation from the drive over time, with its ribbon; and with a model."""
    steps = [s for s in map(pipeline_step, view.result.simulated()) if s in view.result.errors]
    if not steps:
        return None
    seen = any(pipeline_step(source) in view.result.errors for source in view.result.perceived())
    figure = Figure.of_panels(rows=1, cols=len(steps) + seen, shared_yaxes=True, horizontal_spacing=0.03)
    for column, step in enumerate(steps, start=1):
        error_panel(figure, view, step, "d", {"row": 1, "col": column})
        figure.update_xaxes(title_text=f"{step} over {view.clock}", row=1, col=column)
    if seen:
        cell = {"row": 1, "col": len(steps) + 1}
        seeds_panel(figure, view, cell)
        figure.update_xaxes(title_text=f"PIPE_GT+M over {view.clock}", **cell)
    style(figure, 250.0, margin={"l": 62, "r": 14, "t": 22, "b": 42})
    figure.update_xaxes(range=[0.0, view.span[1] - view.start])
    figure.update_yaxes(**FROM_ZERO)
    figure.update_yaxes(title_text="d [m]", col=1)
    return figure


def _xy(tracks: Tracks, name: str) -> tuple[Floats, Floats]:
    n = tracks.index(name)
    return tracks.x[n], tracks.y[n]


def _bounds(parts: list[Floats], margin: float) -> tuple[float, float]:
    every = np.concatenate(parts)
    return float(np.nanmin(every)) - margin, float(np.nanmax(every)) + margin


def _extent(view: View) -> Box:
    """The view from above: wherever the EGO is in any source, and the TOs in focus as far as 40 m beyond."""
    own = [view.plan(*_xy(tracks, view.ego)) for tracks in view.tracks.values()]
    first, last = _bounds([x for x, _ in own], 0.0)
    xs, ys = [x for x, _ in own], [y for _, y in own]
    for tracks in view.tracks.values():
        for name in set(view.focus) & set(tracks.ids.tolist()):
            x, y = view.plan(*_xy(tracks, name))
            near = (x > first - BEYOND) & (x < last + BEYOND)
            xs.append(np.where(near, x, np.nan))
            ys.append(np.where(near, y, np.nan))
    return *_bounds(xs, MARGIN_ALONG), *_bounds(ys, MARGIN_ACROSS)


def _others(view: View, box: Box) -> Iterator[FigurePart]:
    """The TOs that are not in focus, in grey, as the first source that has them."""
    xs: list[Floats] = []
    ys: list[Floats] = []
    for name in view.others:
        tracks = next(t for t in view.tracks.values() if name in t.ids)
        x, y = view.plan(*_xy(tracks, name))
        clip(x, y, box, (xs, ys))
    if xs:
        yield line(*joined(xs, ys), color=OTHERS, name="other TOs", width=1.2)


def _traces(view: View, places: Callable[[Tracks, str], tuple[Floats, Floats]]) -> Iterator[FigurePart]:
    for name in reversed(view.shown):
        for source, tracks in view.tracks.items():
            if name not in tracks.ids:
                continue
            x, y = places(tracks, name)
            yield line(
                x, y, t=view.since(tracks.t), color=view.color(name, source), name=f"{view.label(name)} {source}",
                dashed=source.startswith("r"), hover=Markup("t = %{customdata:.2f} s<br>%{x:.2f} m, %{y:.2f} m"),
            )  # fmt: skip


def _boxes(view: View) -> Iterator[FigurePart]:
    """Outlines of the vehicles where each source ends."""
    for name in reversed(view.shown):
        for source, tracks in view.tracks.items():
            if name not in tracks.ids or not tracks.valid[tracks.index(name)].any():
                continue
            n = tracks.index(name)
            k = int(np.flatnonzero(tracks.valid[n])[-1])
            corners = box_corners(tracks.x[n, k], tracks.y[n, k], tracks.heading[n, k],
                                  tracks.length[n], tracks.width[n])  # fmt: skip
            x, y = view.plan(*np.concatenate([corners, corners[:1]]).T)
            color = view.color(name, source)
            outline = line(x, y, color=color, name="", width=1.3, dashed=source.startswith("r"))
            outline["line"]["dash"] = "3px,2px" if source.startswith("r") else "solid"
            outline.update(fill="toself", fillcolor=fade(color, 0.16))
            yield outline
