"""The HTML document around a page of figures: its look, and plotly.js once."""

from __future__ import annotations

from html import escape
from importlib.resources import files

from plotly.offline import get_plotlyjs


def document(title: str, body: str) -> str:
    """Give the whole file; title is text, body HTML."""
    css = files("resim.report").joinpath("page.css").read_text(encoding="utf-8")
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title>\n<style>{css}</style>\n"
        f"<script>{get_plotlyjs()}</script></head>\n<body>{body}</body></html>\n"
    )
