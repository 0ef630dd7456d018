"""Where everybody drove: from above, across the road, and how far the re-simulation is off."""

from __future__ import annotations

from resim.report.markup import Markup, join
from resim.report.panels.registry import PANELS, Panel
from resim.report.plots import captioned
from resim.report.road import distance_figure, lateral_figure, plan_figure
from resim.report.view import View


def _draw(look: View) -> Markup:
    out = [
        captioned(plan_figure(look), "plan", "From above", "equal scales, travel to the right, 0: start of "
                "the measured EGO; boxes: vehicles at the end of each source"),
        captioned(lateral_figure(look), "lateral", "Across the road, stretched",
                f"offset to the left of {look.path_name}, over the distance along it"),
    ]  # fmt: skip
    if (figure := distance_figure(look)) is not None:
        title = "Distance of the re-simulation from the drive"
        note = "PIPE_X = JSCEN of rX − GT; ribbon: mean ± std"
        if look.result.seeds:
            note += (
                "; with the perception model (+M): median and whole range of the seeds, beside rGT without"
            )
        out.append(captioned(figure, "distance", title, note))
    return join(out)


PANELS.add(Panel("road", "Traces on the road", _draw))
