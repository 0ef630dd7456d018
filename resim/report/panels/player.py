"""The drive as it went: every source from above, with curves and marks."""

from __future__ import annotations

from resim.report.markup import Markup
from resim.report.panels.registry import PANELS, Panel
from resim.report.player import of_resimulation, player
from resim.report.view import View


def _draw(look: View) -> Markup:
    return player([of_resimulation(look.result, look.assessed)])


PANELS.add(Panel("watch", "The drive, played", _draw))
