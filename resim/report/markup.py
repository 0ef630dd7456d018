"""Markup: a text of type `Markup` is HTML, every other text is escaped wherever it enters HTML.

Markup is written as literals only, whose values `html` fills in: ruff refuses anything else (S704).
"""

from __future__ import annotations

from collections.abc import Iterable

from markupsafe import Markup, escape

__all__ = ["Markup", "escape", "html", "join", "script_data"]


def html(template: str, /, *args: object, **values: object) -> Markup:
    """Fill values into a template of HTML, as `str.format` does; those that are not Markup are escaped."""
    return Markup(template).format(*args, **values)  # noqa: S704  a literal: the callers are checked


def join(parts: Iterable[str], between: str = "") -> Markup:
    """Give parts one after the other as HTML; what is not Markup is escaped."""
    return escape(between).join(parts)


def script_data(json: str) -> Markup:
    """Give JSON as the content of a script element, which nothing in it can end."""
    return Markup(json.replace("<", "\\u003c"))  # noqa: S704  JSON reads \u003c in a string as <, and has it nowhere else
