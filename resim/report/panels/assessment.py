"""How dangerous every drive was, and whether it passes."""

from __future__ import annotations

from resim.report import assessment
from resim.report.markup import Markup
from resim.report.panels.registry import PANELS, Panel
from resim.report.view import View


def _draw(look: View) -> Markup:
    return assessment.section(look.assessed)


PANELS.add(Panel("assessment", "Criticality, accident risk, criteria", _draw))
