"""When the EGO first braked, in every drive."""

from __future__ import annotations

from resim.report import tables
from resim.report.markup import Markup, html, join
from resim.report.panels.registry import PANELS, Panel
from resim.report.plots import captioned, number
from resim.report.reaction_figure import reaction_figure
from resim.report.view import View
from resim.scenario.maneuvers import REACTED


def _draw(look: View) -> Markup:
    reaction, change = look.report.reaction, look.report.reaction_difference
    said, off = [f"GT: {tables.reaction_words(reaction['GT'])}"], look.report.reaction_spread
    for run in look.report.end:
        text = f"{run}: {tables.reaction_words(reaction[run])}"
        if change[run] is not None:
            text = html("{}, {}", text, tables.difference_words(change[run], off))
        said.append(text)
    return html("<p>{}.</p>", join(said, "; ")) + captioned(
        reaction_figure(look), "reaction-speed", "The EGO's speed and acceleration",
        f"vertical: first acceleration below {number(REACTED, 1)} m/s² (dotted), by the spline of the JSCEN fit, "
        "in GT and simulations alike; ±: standard error in GT, by bootstrap of the fit's residuals"
        + (f"; green: {look.label(look.lead)} GT, ahead" if look.lead else ""),
    )  # fmt: skip


PANELS.add(Panel("reaction", "Reaction time", _draw))
