"""variations.html: the variations as ribbons around their origin, what was rejected, and trust (Figs. 6.5, 6.6)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.geometry import Floats
from resim.report.document import document
from resim.report.figure import Figure
from resim.report.figure import trace as figure_trace
from resim.report.markup import Markup, html, join
from resim.report.plots import captioned, joined, line, sample, style
from resim.report.tables import table
from resim.scenario.trace import Trace, TraceStates
from resim.variations.candidate import VariedDrive
from resim.variations.evaluation import of_humans
from resim.variations.origin import object_of
from resim.variations.report import VariationInputs
from resim.variations.search import FoundVariation, VariationPlan

SHOWN = 100
"""Variations that are drawn, as in Fig. 6.6."""
LISTED = 500
VARIED, ORIGIN = "#7B3294", "#009E73"
STEP = 0.05
"""s between drawn samples."""


def write_variation_page(
    path: Path,
    inputs: VariationInputs,
    plan: VariationPlan,
    found: Sequence[FoundVariation],
    rows: pd.DataFrame,
) -> None:
    """Write the page."""
    body = [
        _header(inputs, plan, rows), _ribbons(found, plan), _rejected(found, inputs),
        _distances(rows), _table(rows),
    ]  # fmt: skip
    page = html("<main>\n{}</main>", join(body, "\n"))
    path.write_text(document("Variations", page), encoding="utf-8", newline="\n")


def _header(inputs: VariationInputs, plan: VariationPlan, rows: pd.DataFrame) -> Markup:
    levels = Counter(rows["trust"].tolist())
    facts = (
        ("origin", inputs.recording), ("varied", ", ".join(inputs.maneuvers)),
        ("box", f"{100.0 * inputs.box:g} % of each component's range, to either side"),
        ("kernels", f"{inputs.kernels}, from {inputs.data} drives"),
        ("trust", ", ".join(f"{n} {level}" for level, n in levels.most_common())),
    )  # fmt: skip
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    outside = len(rows) - levels["inside"]
    warning = (
        html(
            '<p class="note"><b>{} of {} variations are not legitimised</b> by a verification of their origin: results '
            "of them hold in simulation alone.</p>", outside, len(rows),
        ) if outside else ""
    )  # fmt: skip
    notes = of_humans(plan.kernels, [one.label for one in plan.maneuvers])
    claim = join(html('<p class="note">{}.</p>', note[0].upper() + note[1:]) for note in notes)
    return html(
        '<header><p class="kind">Variations</p><h1>Around {}</h1><dl class="facts">{}</dl>{}{}</header>',
        inputs.recording, listed, warning, claim,
    )  # fmt: skip


def _ribbons(found: Sequence[FoundVariation], plan: VariationPlan) -> Markup:
    kept = [one.drive for one in found if not one.rejected and one.drive is not None][:SHOWN]
    out = []
    for number, name in enumerate(plan.varied):
        whole = object_of(plan.scenario, name)
        t = np.arange(whole.spawn_time, float(whole.v.x[-1]), STEP)
        origin = _states(plan, name, t, None)
        varied = [_states(plan, name, t, k) for k in kept]
        out.append(_ribbon(name, t, origin, varied, f"ribbon{number}"))
    key = html('<p class="key">{}{}</p>', sample("origin", ORIGIN), sample("variations", VARIED))
    return html("<section><h2>Ribbons</h2>{}{}</section>", key, join(out))


def _states(plan: VariationPlan, name: str, t: Floats, drive: VariedDrive | None) -> TraceStates:
    """An object's states, its place from where it starts."""
    one = object_of(plan.scenario if drive is None else drive.scenario, name)
    return Trace(0.0, 0.0, one.v, one.heading).states(t)


def _ribbon(name: str, t: Floats, origin: TraceStates, varied: Sequence[TraceStates], mark: str) -> Markup:
    """Fig. 6.6: places from the start, speeds and headings of one object."""
    figure = Figure.of_panels(1, 3, horizontal_spacing=0.08)
    turn = np.exp(-1j * origin.heading[0])

    def panels(one: TraceStates) -> tuple[tuple[Floats, Floats], ...]:
        xy = (one.x + 1j * one.y) * turn
        return (xy.real, xy.imag), (t, one.v), (t, one.heading)

    bundle = [panels(one) for one in varied]
    own = panels(origin)
    titles = (("x from the start [m]", "y [m]"), ("t [s]", "v [m/s]"), ("t [s]", "heading [rad]"))
    for k, (across, up) in enumerate(titles):
        x, y = joined([one[k][0] for one in bundle], [one[k][1] for one in bundle])
        ribbon = line(x, y, color="rgba(123,50,148,0.3)", name="variations", width=0.8)
        figure.add_trace(ribbon, 1, k + 1)
        figure.add_trace(line(*own[k], color=ORIGIN, name="origin", width=1.8), 1, k + 1)
        figure.update_xaxes(col=k + 1, title_text=across)
        figure.update_yaxes(col=k + 1, title_text=up)
    note = f"{len(varied)} variations and the origin, turned to its first heading (Fig. 6.6)"
    return captioned(style(figure, 300.0), mark, f"Object {name}", note)


def _rejected(found: Sequence[FoundVariation], inputs: VariationInputs) -> Markup:
    counts = Counter(one.rejected for one in found if one.rejected)
    if not counts:
        return html("<section><h2>Rejected</h2><p>None of {} points.</p></section>", len(found))
    rows = [[reason, str(n), f"{100.0 * n / len(found):.1f} %"] for reason, n in counts.most_common()]
    told = f"{sum(counts.values())} of {len(found)} points; the next ones took their places."
    return html(
        "<section><h2>Rejected</h2><p>{}</p>{}</section>", told, table(["reason", "points", "share"], rows)
    )


def _distances(rows: pd.DataFrame) -> Markup:
    figure = Figure([figure_trace("histogram", x=rows["distance"].to_numpy(float), marker={"color": VARIED})])
    figure.update_xaxes(title_text="distance from the origin [standard deviations of the data]")
    figure.update_yaxes(title_text="variations")
    note = "over all components together (Mahalanobis)"
    return html(
        "<section><h2>Distance</h2>{}</section>",
        captioned(style(figure, 240.0), "distances", "Distance", note),
    )


def _table(rows: pd.DataFrame) -> Markup:
    shown = rows.head(LISTED)
    cells = [
        [str(one.variation), str(one.halton_index), f"{one.distance:.3f}",
         "legitimised" if one.trust == "inside" else f"not legitimised ({one.trust})", str(one.trust_reason),
         str(one.rejections), str(one.sizes), str(one.environment)]
        for one in shown.itertuples()
    ]  # fmt: skip
    head = ["variation", "point", "distance", "trust", "why", "rejected before it", "sizes", "environment"]
    more = "" if len(rows) <= LISTED else f"{len(rows) - LISTED} more are in variations.parquet."
    return html("<section><h2>Variations</h2>{}<p>{}</p></section>", table(head, cells), more)
