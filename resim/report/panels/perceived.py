"""What the AD function was shown."""

from __future__ import annotations

from resim.report import tables
from resim.report.markup import Markup, html
from resim.report.panels.registry import PANELS, Panel
from resim.report.view import View


def _draw(look: View) -> Markup:
    return html(
        "<p>Objects shown to the function from the start on, and how far they were off the simulated truth.</p>{}",
        tables.perceived(look),
    )


PANELS.add(Panel("perceived", "What the AD function perceived", _draw))
