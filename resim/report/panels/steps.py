"""What every step did, over time."""

from __future__ import annotations

from resim.report.markup import Markup, html, join
from resim.report.panels.registry import PANELS, Panel
from resim.report.plots import captioned
from resim.report.steps import BANDS, band_figure
from resim.report.view import View

MEANINGS = (
    ("S", "SD − GT", "error of the sensors"),
    ("FIT_X", "JSCEN of X − X", "error of the spline fit, for X = GT, SD, rGT, rSD"),
    ("SIM_X", "rX − JSCEN of X", "error of the simulation"),
    ("PIPE_X", "JSCEN of rX − GT", "the whole pipeline, from the drive to its fitted re-simulation"),
)


def _draw(look: View) -> Markup:
    legend = join(
        html("<div><dt>{}</dt><dd>{} <span>{}</span></dd></div>", name, what, why)
        for name, what, why in MEANINGS
    )
    out = [
        html(
            "<p>Every error is <b>later minus earlier</b> in the chain, at equal times; d is the distance between "
            "the two positions. Ribbons: mean ± standard deviation over the whole drive.</p>"
            '<dl class="meanings">{}</dl>',
            legend,
        )
    ]
    for band in BANDS:
        if band.step in look.result.errors:
            name = f"step-{band.step}"
            out.append(captioned(band_figure(look, band), name, f"{band.step} · {band.title}"))
    if "S" not in look.result.errors:
        out.append(Markup("<p>There is no sensor data in this recording, so there is no sensor error S.</p>"))
    return join(out)


PANELS.add(Panel("steps", "Step by step: place, speed and heading over time", _draw))
