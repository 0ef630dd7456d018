"""What each step did: place across the road, speed and heading over time, and the errors with ribbons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats, unwrap_angle
from resim.core.tracks import Tracks
from resim.report.figure import Figure, FigurePart
from resim.report.markup import Markup, html, join
from resim.report.plots import FAINT, dots, fade, joined, lighten, line, number, style
from resim.report.view import OTHERS, View
from resim.resimulation.fidelity import EGO_ROW, QUANTITIES, TO_ROWS, StepErrors

SYMBOLS = {"d": "d", "v": "Δv", "heading": "Δheading"}
COLUMNS = ("d", "v", "heading")
FROM_ZERO: FigurePart = {"autorangeoptions": {"minallowed": 0.0, "include": [0.0, 0.01]}}
"""Distances are not negative, whatever mean - std is, and what is next to nothing looks like it."""
LEAST = {"v": 0.01, "heading": 0.001}
"""Errors [m/s, rad] up to which an axis reaches at least, to both sides."""


@dataclass(frozen=True)
class Band:
    """One step on the page: its title, and the earlier and later source; JSCEN fits as `JSCEN GT`."""

    step: str
    title: str
    earlier: str
    later: str


BANDS = (
    Band("S", "Sensor: SD against GT", "GT", "SD"),
    Band("FIT_GT", "Fit: JSCEN of GT against GT", "GT", "JSCEN GT"),
    Band("FIT_SD", "Fit: JSCEN of SD against SD", "SD", "JSCEN SD"),
    Band("SIM_GT", "Simulation: rGT against JSCEN of GT", "JSCEN GT", "rGT"),
    Band("SIM_SD", "Simulation: rSD against JSCEN of SD", "JSCEN SD", "rSD"),
)
"""Figs. 5.4 (S), 5.7 (FIT) and 5.8 (SIM)."""


def band_figure(view: View, band: Band) -> Figure:
    """Draw one step: above what was and what became of it, below the error over time."""
    figure = Figure.of_panels(
        rows=2, cols=3, shared_xaxes=True, row_heights=[0.56, 0.44], vertical_spacing=0.07,
        horizontal_spacing=0.09,
    )  # fmt: skip
    for source in (band.earlier, band.later):
        _draw_source(figure, view, source)
    if view.on_lane:
        _draw_lane(figure, view)
    for column, quantity in enumerate(COLUMNS, start=1):
        error_panel(figure, view, band.step, quantity, {"row": 2, "col": column})
    style(figure, 430.0, margin={"l": 68, "r": 14, "t": 12, "b": 42})
    for column, (quantity, above) in enumerate(
        zip(COLUMNS, (f"left of {view.path_short} [m]", "v [m/s]", "heading [rad]"), strict=True), start=1
    ):
        figure.update_yaxes(title_text=above, row=1, col=column)
        below = f"{SYMBOLS[quantity]} [{QUANTITIES[quantity]}]"
        figure.update_yaxes(title_text=below, row=2, col=column)
        if (least := LEAST.get(quantity)) is not None:
            figure.update_yaxes(autorangeoptions_include=[-least, least], row=2, col=column)
    figure.update_yaxes(**FROM_ZERO, row=2, col=1)
    figure.update_xaxes(range=[0.0, view.span[1] - view.start])
    figure.update_xaxes(title_text=view.clock, row=2)
    return figure


def _draw_source(figure: Figure, view: View, source: str) -> None:
    """One source's place across the road, speed and heading, of EGO and TOs in focus."""
    fit = source.removeprefix("JSCEN ")
    scenario = view.result.scenarios()[fit] if fit != source else None
    tracks = view.tracks[fit]
    if scenario is not None:
        tracks = scenario.tracks(view.result.network, tracks.t)
    for name in reversed(view.shown):
        if name not in tracks.ids:
            continue
        color, label = view.color(name, fit), f"{view.label(name)} {source}"
        look = {"color": lighten(color, 0.45), "width": 1.2} if scenario else {"color": color, "width": 2.0}
        for column, (values, unit) in enumerate(_values(view, tracks, name), start=1):
            hover = f"t = %{{x:.2f}} s: %{{y:.3f}} {unit}"
            trace = line(
                view.since(tracks.t), values, name=label, dashed=source.startswith("r"), hover=hover, **look,  # type: ignore[arg-type]
            )  # fmt: skip
            figure.add_trace(trace, row=1, col=column)
        if scenario is not None:
            member = next(m for m in (scenario.ego, *scenario.objects) if m.id == name)
            n = tracks.index(name)
            for column, spline in ((2, member.v), (3, member.heading)):
                values = _values(view, tracks, name)[column - 1][0]
                own = tracks.valid[n]
                at = np.interp(spline.x, tracks.t[own], values[own])
                knots = dots(
                    view.since(spline.x),
                    at,
                    color=color,
                    name=f"{label}: knot",
                    hover="t = %{x:.2f} s",
                    size=5.0 if view.only_one else 3.6,
                )
                figure.add_trace(knots, row=1, col=column)


def _values(view: View, tracks: Tracks, name: str) -> list[tuple[Floats, str]]:
    """Place across the road [m], speed [m/s] and heading [rad, without jumps] of an object, each (T,)."""
    n = tracks.index(name)
    heading = unwrap_angle(tracks.heading[n])
    known = heading[np.isfinite(heading)]
    if len(known):  # the same turn for every source: the first heading nearest to the direction of travel
        heading = heading - 2.0 * np.pi * np.round((known[0] - view.turn) / (2.0 * np.pi))
    return [(view.along(tracks, name)[1], "m"), (tracks.v[n], "m/s"), (heading, "rad")]


def _draw_lane(figure: Figure, view: View) -> None:
    """The borders of the EGO's starting lane and its neighbours, where the EGO is."""
    tracks = next(iter(view.tracks.values()))
    s, _ = view.along(tracks, view.ego)
    path = view.path
    half, left, right = (
        np.interp(s, path.s, c) for c in (path.half_width, path.left_width, path.right_width)
    )
    borders = [half, -half, np.where(left > 0.0, half + left, np.nan)]
    borders.append(np.where(right > 0.0, -half - right, np.nan))
    for border in borders:
        trace = line(view.since(tracks.t), border, color="#b4bac2", name="lane border", width=1.0)
        trace["line"]["dash"] = "dot"
        figure.add_trace(trace, row=1, col=1)


def error_panel(figure: Figure, view: View, step: str, quantity: str, cell: dict[str, int]) -> None:
    """Draw a step's error of d, v or heading over time, with mean ± std of EGO and of all TOs as ribbons."""
    errors = view.result.errors[step]
    source = step.rpartition("_")[2] if "_" in step else "SD"
    values = errors.quantity(quantity)
    every = errors.ids.tolist()
    grey = [n for n, name in enumerate(every) if name in set(view.others)]
    if grey:
        trace = line(*joined([view.since(errors.t)] * len(grey), [values[n] for n in grey]), color=OTHERS,
                     name="other TOs", width=0.8)  # fmt: skip
        figure.add_trace(trace, **cell)
    text = [_ribbon(figure, view, errors, (quantity, source, who), cell) for who in ("TO", "EGO")]
    for name in reversed(view.shown):
        if name in every:
            figure.add_trace(
                line(
                    view.since(errors.t), values[every.index(name)], color=view.color(name, source), width=1.4,
                    name=f"{view.label(name)} {step}", dashed=source.startswith("r"),
                    hover=f"t = %{{x:.2f}} s: %{{y:.4f}} {QUANTITIES[quantity]}",
                ),
                **cell,
            )  # fmt: skip
    figure.add_annotation(
        text=join((part for part in reversed(text) if part), "   "), xref="x domain", yref="y domain", x=0.0,
        y=1.0, xanchor="left", yanchor="bottom", showarrow=False, font={"size": 11, "color": FAINT}, **cell,
    )  # fmt: skip


def _ribbon(
    figure: Figure,
    view: View,
    errors: StepErrors,
    of: tuple[str, str, str],
    cell: dict[str, int],
) -> Markup:
    """Mean ± std over the time of the errors; gives it as a coloured text, "" where there is no error.

    of: quantity, source, and whose they are.
    """
    quantity, source, who = of
    found = errors.statistics(EGO_ROW if who == "EGO" else TO_ROWS)[quantity]
    if found is None:
        return Markup()
    color = view.color(view.ego if who == "EGO" or not view.focus else view.focus[0], source)
    mean, std = found["mean"], found["std"]
    known = view.since(errors.t[np.isfinite(errors.x).any(axis=0)][[0, -1]])
    around = np.r_[known, known[::-1], known[:1]]
    edge = mean + std * np.array([-1.0, -1.0, 1.0, 1.0, -1.0])
    band = line(around, edge, color=color, name="", width=0.0)
    band.update(mode="none", fill="toself", fillcolor=fade(color, 0.17))
    figure.add_trace(band, **cell)
    middle = line(known, np.full(2, mean), color=fade(color, 0.8), name="", width=1.0)
    middle["line"]["dash"] = "dot"
    figure.add_trace(middle, **cell)
    many = len(errors.ids) - 1
    label = who if who == "EGO" or many == 1 else f"{many} TOs"
    digits = 4 if quantity == "heading" else 3
    return html(
        '<span style="color:{}"><b>{}</b> {} ± {}</span>',
        color,
        label,
        number(mean, digits),
        number(std, digits),
    )
