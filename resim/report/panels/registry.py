"""The panels of a re-simulation's report: each looks at the result and draws one section of the page."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from resim.core.registry import Registry
from resim.report.markup import Markup
from resim.report.view import View


@dataclass(frozen=True)
class Panel:
    """A section of the page: its anchor, its title, and what draws it from the view of a result; None: nothing to show.

    draw: the same view gives the same markup; ids of its figures are its own.
    """

    name: str
    title: str
    draw: Callable[[View], Markup | None]


PANELS: Registry[Panel] = Registry("panel of the report")
"""Every panel in the order of the page, added by its own file."""
