"""What a perception model did, where one was run."""

from __future__ import annotations

from resim.report import model_runs
from resim.report.markup import Markup
from resim.report.panels.registry import PANELS, Panel
from resim.report.view import View


def _draw(look: View) -> Markup | None:
    return None if look.result.perceiving is None else model_runs.section(look)


PANELS.add(Panel("seeds-section", "With the perception model", _draw))
