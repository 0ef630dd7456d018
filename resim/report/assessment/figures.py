"""Risk over time: of all sources in one picture (Fig. 5.9), and of each with its scenes (Figs. 4.12 to 4.15)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from resim.core.geometry import Floats, box_corners, to_frame
from resim.metrics.assessment import Assessment
from resim.report.assessment.marks import NUMBERS, RISK, TIMES, block_color, least, marked
from resim.report.figure import Figure, FigurePart
from resim.report.figure import trace as figure_trace
from resim.report.lanes import Box, lane_traces
from resim.report.markup import html
from resim.report.plots import FAINT, clock_words, compact, fade, line, style
from resim.report.view import OTHERS
from resim.resimulation import ResimulationAssessment
from resim.road.opendrive import LaneShape, RoadNetwork

BEHIND, AHEAD, ASIDE = 45.0, 95.0, 6.6
"""m of road in a strip: behind the EGO, ahead of it, and to either side."""
LONGEST = 6.0
"""s up to which times are drawn."""
STRIP, PANEL = 116.0, 190.0
"""Heights [px]."""
OBJECT = "#D55E00"
SMALLEST = 1e-7
"""Risk below which the logarithmic scale does not tell."""


def risk_figure(assessed: ResimulationAssessment) -> Figure:
    """Draw the accident risk of GT, SD, rGT and rSD over time: linear above, logarithmic below."""
    figure = Figure.of_panels(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.6, 0.4]
    )
    largest = max(float(np.nan_to_num(a.risk.r_ind).max()) for a in assessed.blocks.values())
    start = min(float(a.drive.t[0]) for a in assessed.blocks.values())
    for name, a in assessed.blocks.items():
        for row in (1, 2):
            shown = np.maximum(a.risk.r_ind, SMALLEST) if row == 2 else a.risk.r_ind
            trace = line(a.drive.t - start, shown, color=block_color(name), name=name, dashed=name.startswith("r"),
                         hover="t = %{x:.1f} s: %{y:.3g}")  # fmt: skip
            figure.add_trace(trace, row=row, col=1)
    for limit in _limits(assessed):
        if limit < 3.0 * largest:
            figure.add_hline(y=limit, line={"color": FAINT, "width": 1, "dash": "dot"}, row=1, col=1)
    style(figure, 400.0, margin={"l": 62, "r": 14, "t": 14, "b": 42})
    figure.update_yaxes(title_text="risk", rangemode="tozero", row=1)
    figure.update_yaxes(
        title_text="risk", type="log", range=[-7.0, 0.2], dtick=2, exponentformat="power", row=2
    )
    figure.update_xaxes(title_text=clock_words(start), row=2)
    return figure


def _limits(assessed: ResimulationAssessment) -> list[float]:
    every = assessed.criteria.criteria if assessed.criteria is not None else ()
    return [c.limit for c in every if c.measure == "risk"]


def drive_figure(assessment: Assessment, network: RoadNetwork, color: str) -> Figure:
    """Draw marked scenes as strips of road, below criticality and risk over time, the scenes marked in both."""
    scenes = marked(assessment)
    n = len(scenes)
    heights = [STRIP] * n + [PANEL, PANEL]
    figure = Figure.of_panels(rows=n + 2, cols=1, row_heights=heights, vertical_spacing=0.034)
    shapes = network.lane_shapes(2.0)
    for row, scene in enumerate(scenes, start=1):
        for trace in _strip(assessment, shapes, scene, color):
            figure.add_trace(trace, row=row, col=1)
    _times(figure, assessment, n + 1)
    figure.add_trace(_area(assessment), row=n + 2, col=1)
    style(figure, sum(heights) + 90.0, margin={"l": 62, "r": 14, "t": 8, "b": 42})
    for row, scene in enumerate(scenes, start=1):
        _frame(figure, assessment, row, scene)
    start = float(assessment.drive.t[0])
    span = [0.0, float(assessment.drive.t[-1]) - start]
    figure.update_xaxes(range=span, row=n + 1, col=1, showticklabels=False)
    figure.update_xaxes(range=span, row=n + 2, col=1, title_text=clock_words(start))
    figure.update_yaxes(title_text="time [s]", range=[0.0, LONGEST], row=n + 1, col=1)
    figure.update_yaxes(title_text="risk", rangemode="tozero", row=n + 2, col=1)
    return figure


def _frame(figure: Figure, assessment: Assessment, row: int, scene: int) -> None:
    """A strip's axes, its words, and its mark in the panels below."""
    t = float(assessment.drive.t[scene] - assessment.drive.t[0])
    risk = float(assessment.risk.r_ind[scene])
    bottom = len(marked(assessment)) + 2
    figure.update_xaxes(range=[-BEHIND, AHEAD], showgrid=False, showticklabels=row == bottom - 2, row=row, col=1,
                        ticksuffix=" m")  # fmt: skip
    figure.update_yaxes(range=[-ASIDE, ASIDE], showgrid=False, showticklabels=False, ticks="", row=row, col=1,
                        scaleanchor=f"x{row if row > 1 else ''}", scaleratio=1)  # fmt: skip
    told = html("<b>{}</b> t = {:.1f} s, risk {}", NUMBERS[row - 1], t, _risk_words(risk))
    figure.add_annotation(text=told, showarrow=False,
                          xref="x domain", yref="y domain", x=0.004, y=0.99, xanchor="left", yanchor="top",
                          bgcolor="rgba(255,255,255,.8)", row=row, col=1)  # fmt: skip
    for panel in (bottom - 1, bottom):
        figure.add_vline(x=t, line={"color": RISK, "width": 1, "dash": "dash"}, row=panel, col=1)
    figure.add_annotation(text=NUMBERS[row - 1], showarrow=False, x=t, y=1.0, yref="y domain", xanchor="left",
                          yanchor="top", font={"size": 14}, row=bottom - 1, col=1)  # fmt: skip


def _risk_words(risk: float) -> str:
    if not np.isfinite(risk):
        return "not computed"
    return "< 0.0001" if 0.0 < risk < 1e-4 else f"{risk:.2g}"


def _times(figure: Figure, assessment: Assessment, row: int) -> None:
    for name, color in TIMES.items():
        value = least(assessment, name)
        trace = line(
            assessment.drive.t - assessment.drive.t[0],
            value,
            color=color,
            name=name,
            hover="t = %{x:.1f} s: %{y:.2f} s",
        )
        trace.update(mode="lines+markers", marker={"size": 3.5, "color": color})
        figure.add_trace(trace, row=row, col=1)


def _area(assessment: Assessment) -> FigurePart:
    trace = line(assessment.drive.t - assessment.drive.t[0], assessment.risk.r_ind, color=RISK, name="risk",
                 hover="t = %{x:.1f} s: %{y:.3g}")  # fmt: skip
    return trace | {"fill": "tozeroy", "fillcolor": fade(RISK, 0.12)}


def _strip(assessment: Assessment, shapes: list[LaneShape], scene: int, color: str) -> Iterator[FigurePart]:
    """The road around the EGO, travel to the right; its box and path, and the objects with their risk."""
    drive = assessment.drive
    x, y, heading = (float(column[0, scene]) for column in (drive.own.x, drive.own.y, drive.own.heading))

    def place(px: Floats, py: Floats) -> tuple[Floats, Floats]:
        return to_frame(px, py, x, y, heading)

    box: Box = (-BEHIND, AHEAD, -ASIDE, ASIDE)
    low, high = np.array([x, y]) - 2.0 * AHEAD, np.array([x, y]) + 2.0 * AHEAD
    near = [s for s in shapes if ((s.centre >= low) & (s.centre <= high)).all(axis=1).any()]
    yield from lane_traces(near, place, box)
    plan = drive.scenes.plan[scene]
    yield line(*place(plan[:, 0], plan[:, 1]), color=fade(color, 0.55), name="path of the EGO", width=1.4)
    for k, name in enumerate(drive.ids):
        if drive.present[scene, k]:
            state, size = drive.scenes.state[scene, k], drive.scenes.size[scene, k]
            risk = float(assessment.risk.r_to[scene, k])
            yield _box(
                place(*_corners(state, size)),
                OBJECT if risk > 0.0 else OTHERS,
                f"{name}: risk {_risk_words(risk)}",
            )
    yield _box(place(*_corners(np.array([x, y, heading]), drive.scenes.ego_size[scene])), color, "EGO")


def _corners(pose: Floats, size: Floats) -> tuple[Floats, Floats]:
    corners = box_corners(pose[0], pose[1], pose[2], size[0], size[1])
    ring = np.concatenate([corners, corners[:1]])
    return ring[:, 0], ring[:, 1]


def _box(ring: tuple[Floats, Floats], color: str, name: str) -> FigurePart:
    return figure_trace("scatter",
        x=compact(ring[0]), y=compact(ring[1]), mode="lines", fill="toself", fillcolor=fade(color, 0.45), name=name,
        line={"color": color, "width": 1.6}, showlegend=False, hoveron="fills", hoverinfo="name",
        hoverlabel={"namelength": -1},
    )  # fmt: skip
