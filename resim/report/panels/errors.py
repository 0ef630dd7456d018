"""The errors of every step as boxes and numbers, and whether they add up."""

from __future__ import annotations

from resim.report import tables
from resim.report.error_boxes import box_figure
from resim.report.markup import Markup
from resim.report.panels.registry import PANELS, Panel
from resim.report.plots import captioned
from resim.report.view import View

ADDING = Markup(
    "<h3>Do the steps add up? (Eq. 5.6)</h3><p>Positions add up as vectors: <i>mean of sums</i> is the mean "
    "length of the summed vectors, <i>sum of means</i> the plain sum of the steps' means. What the first does "
    "not explain of the measured error is interpolation between different sample times.</p>"
)


def _draw(look: View) -> Markup:
    return (
        captioned(box_figure(look), "boxes", "Errors of the pipeline", "in each step EGO left, TO right; box: 25 % to "
                "75 %, whiskers: whole range, diamond: mean ± std")
        + Markup("<h3>Numbers</h3>") + tables.numbers(look)
        + ADDING + tables.sums(look)
    )  # fmt: skip


PANELS.add(Panel("errors", "Errors of every step", _draw))
