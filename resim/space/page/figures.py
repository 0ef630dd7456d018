"""The figures of space.html: dendrogram, members over each other, curves of discovery, map of the clusters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.cluster.hierarchy import dendrogram as drawn

from resim.core.geometry import Floats
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import style, to_html
from resim.space.report import BucketEntry, DiscoveryCurve
from resim.space.traces import RATE, SlotTraces

COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7f7f7f", "#000000")
ABOVE = "#9aa3ad"
WIDTH, HEIGHT = 330.0, 112.0
"""Pixels of a cluster from above."""
REACH = (-50.0, 100.0)
"""m that slots reach behind and ahead."""
SIDES = (0, 0, 0, 1, 1, 2, 2, 2)
"""Which lane a slot is on: the left, the EGO's own, the right one."""
MOST_LEAVES = 600
ANOTHER = 6.0
"""m between two scenes from which on another vehicle holds a slot: 30 m/s of relative speed."""


def dendrogram(bucket: BucketEntry) -> Markup:
    """Give the dendrogram of a bucket (Wagner 2021, Fig. 6.18): clusters in colours, the threshold dashed."""
    links = np.array(bucket.links)
    if not len(links):
        return html("<p>One scenario: there is no dendrogram.</p>")
    if len(links) >= MOST_LEAVES:
        return html("<p>{} scenarios: too many to draw their dendrogram.</p>", len(links) + 1)
    told = drawn(links, no_plot=True)
    figure = Figure()
    heights = np.array(told["dcoord"])
    for color, part in _by_color(np.array(told["icoord"]), heights, links, bucket.threshold):
        x, y = (np.column_stack([one, np.full(len(one), np.nan)]).ravel() for one in part)
        figure.add_trace(
            figure_trace(
                "scatter", x=x, y=y, mode="lines", line={"color": color, "width": 1.2}, hoverinfo="skip"
            )
        )
    figure.add_hline(bucket.threshold, row=1, col=1, line={"color": "#333333", "width": 1, "dash": "6px,4px"})
    leaves, highest = len(links) + 1, max(float(heights.max()), bucket.threshold)
    figure.update_xaxes(
        showticklabels=False, title_text=f"{leaves} scenarios, by cluster", range=[0.0, 10.0 * leaves]
    )  # scipy draws leaf k at 10 k + 5
    figure.update_yaxes(title_text="distance", range=[0.0, 1.05 * highest])
    return to_html(style(figure, 300.0), f"dendrogram{bucket.number}")


def _by_color(
    x: Floats, y: Floats, links: Floats, threshold: float
) -> list[tuple[str, tuple[Floats, Floats]]]:
    """Links up to the threshold in alternating colours, cluster by cluster from the left; those above in grey."""
    below = y.max(axis=1) <= threshold
    out = [(ABOVE, (x[~below], y[~below]))] if (~below).any() else []
    order = np.argsort(x[below].min(axis=1), kind="stable")
    xs, ys = x[below][order], y[below][order]
    group, right = np.zeros(len(xs), dtype=int), -np.inf
    for k in range(len(xs)):  # links of one cluster overlap from left to right
        group[k] = group[k - 1] + (xs[k].min() > right) if k else 0
        right = max(right, xs[k].max())
    for color in range(min(len(COLORS) - 1, int(group.max(initial=-1)) + 1)):
        mine = group % (len(COLORS) - 1) == color
        out.append((COLORS[color], (xs[mine], ys[mine])))
    return out


def members(traces: SlotTraces, rows: Sequence[int], medoid: int) -> Markup:
    """Give scenarios of a cluster over each other, around the EGO (Fig. 6.19): where the others are in its slots over
    time, the medoid dark. Rows: left lane, own lane, right lane; the EGO is the blue box; a dot is where a trace ends.
    """
    parts = [_frame()]
    for row in [*(r for r in rows if r != medoid), medoid]:
        color, width = ("#7a3b12", 1.8) if row == medoid else ("#d98c5f", 0.8)
        parts += _ways(traces, row, color, width)
    return html(
        '<svg viewBox="0 0 {} {}" width="{}" height="{}" role="img">{}</svg>', f"{WIDTH:g}", f"{HEIGHT:g}",
        f"{WIDTH:g}", f"{HEIGHT:g}", join(parts),
    )  # fmt: skip


def _x(metres: Floats) -> Floats:
    return (metres - REACH[0]) / (REACH[1] - REACH[0]) * (WIDTH - 8.0) + 4.0


def _frame() -> Markup:
    """Lanes, the borders of the slots, and the EGO."""
    lane = HEIGHT / 3.0
    lines = [
        html(
            '<line x1="0" y1="{y}" x2="{w}" y2="{y}" stroke="#c6ccd3"/>', y=f"{k * lane:.1f}", w=f"{WIDTH:g}"
        )
        for k in (1, 2)
    ]
    for metres in (-5.0, 5.0):
        x = f"{float(_x(np.array(metres))):.1f}"
        lines.append(html('<line x1="{x}" y1="0" x2="{x}" y2="{h}" stroke="#e6e9ed"/>', x=x, h=f"{HEIGHT:g}"))
    low, high = (float(_x(np.array(m))) for m in (-2.3, 2.3))
    lines.append(
        html('<rect x="{}" y="{}" width="{}" height="9" fill="#0072B2"/>', f"{low:.1f}", f"{1.5 * lane - 4.5:.1f}",
             f"{high - low:.1f}")
    )  # fmt: skip
    return join(lines)


def _ways(traces: SlotTraces, row: int, color: str, width: float) -> list[Markup]:
    """Where others are over time: a polyline a stay in the slots of one lane, which drifts down as time goes on."""
    own = slice(int(traces.first[row]), int(traces.first[row + 1]))
    offset, lane = traces.offset[own], HEIGHT / 3.0
    count = len(offset)
    down = np.linspace(-0.38, 0.38, count) * lane if count > 1 else np.zeros(1)
    out = []
    for slot in range(8):
        there = np.isfinite(offset[:, slot])
        jumps = np.flatnonzero(np.abs(np.diff(offset[:, slot])) > ANOTHER) + 1  # another vehicle holds it
        edges = np.sort(np.r_[np.flatnonzero(np.diff(np.r_[False, there, False])), jumps, jumps])
        for begin, end in edges.reshape(-1, 2).tolist():
            x, y = _x(offset[begin:end, slot]), (SIDES[slot] + 0.5) * lane + down[begin:end]
            step = max((end - begin) // 20, 1)
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[::step], y[::step], strict=True))
            out.append(
                html(
                    '<polyline points="{}" fill="none" stroke="{}" stroke-width="{}"/>'
                    '<circle cx="{}" cy="{}" r="1.6" fill="{}"/>',
                    points, color, f"{width:g}", f"{x[-1]:.1f}", f"{y[-1]:.1f}", color,
                )
            )  # fmt: skip
    return out


def discovery(curve: DiscoveryCurve, name: str) -> Markup:
    """Give the curves of Fig. 6.20: kinds found, the probability that the next is new, and how far kinds reach."""
    hours = np.array(curve.hours)
    known = bool(np.isfinite(hours).all()) and len(hours) > 0
    x = hours if known else np.array(curve.scenarios, dtype=float)
    titles = ("kinds found", "probability that the next is new", "mean radius of kinds")
    figure = Figure.of_panels(1, 3, horizontal_spacing=0.08, subplot_titles=titles)
    for column, values in enumerate((curve.clusters, curve.unseen, curve.radius), start=1):
        figure.add_trace(
            figure_trace(
                "scatter", x=x, y=np.array(values, dtype=float), mode="lines+markers",
                line={"color": COLORS[0], "width": 1.8}, marker={"size": 4.0},
            ),
            1, column,
        )  # fmt: skip
    figure.update_xaxes(title_text="driven [h]" if known else "scenarios")
    figure.update_yaxes(rangemode="tozero")
    return to_html(style(figure, 250.0), name)


def cluster_map(
    place: Floats, size: Floats, risk: Floats, names: Sequence[str], hover: Mapping[str, str]
) -> Markup:
    """Give the clusters laid out by distance (the hyper-surface of Fig. 6.20 from above).

    place (C, 2); size (C,): exposure [1/h]; risk (C,): colour, grey where it is NaN; names (C,).
    """
    scale = 8.0 + 30.0 * np.sqrt(size / max(float(np.nanmax(size)), 1e-12)) if len(size) else size
    told = np.isfinite(risk)
    figure = Figure()
    for known in (False, True):
        mine = told == known
        if not mine.any():
            continue
        marker: dict[str, object] = {"size": scale[mine], "line": {"color": "white", "width": 0.8}}
        if known:
            marker |= {"color": risk[mine], "colorscale": "YlOrRd", "reversescale": True, "cmin": 0.0,
                       "showscale": True, "cmax": max(float(risk[mine].max()), 1e-6),
                       "colorbar": {"title": {"text": "risk"}}}  # fmt: skip
        else:
            marker["color"] = "#b4bcc5"
        figure.add_trace(
            figure_trace(
                "scatter", x=place[mine, 0], y=place[mine, 1], mode="markers", marker=marker,
                text=[f"{names[k]}: {hover[names[k]]}" for k in np.flatnonzero(mine).tolist()], hoverinfo="text",
            )
        )  # fmt: skip
    figure.update_xaxes(title_text="distance", showgrid=False)
    figure.update_yaxes(showgrid=False)
    return to_html(style(figure, 420.0), "clusters")


def seconds(traces: SlotTraces, row: int) -> float:
    """Give how long a scenario is [s]."""
    return float(traces.scenes[row] - 1) / RATE
