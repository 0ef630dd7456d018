"""The HTML document around a page: its look, its scripts, and the policy that lets nothing else run."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from importlib.resources import files

from plotly.offline import get_plotlyjs

from resim.core.schema import GENERATOR
from resim.report.markup import Markup, html, join

DRAW = """"use strict";
document.querySelectorAll(".plot").forEach(plot => {
  const {data, layout, config} = JSON.parse(plot.querySelector("script").textContent);
  Plotly.newPlot(plot.querySelector("div"), data, layout, config);
});
"""
"""Draws the figures that `resim.report.plots.to_html` leaves in a page."""


def document(
    title: str, body: Markup, *, css: str = "", scripts: Sequence[str] = (), plots: bool = True
) -> Markup:
    """Give the whole file; title is text, css what comes after the look that all pages have.

    scripts: run in this order after the body, after the figures are drawn where the page has `plots`. They are the only
    ones that a browser runs: the page's content security policy has their hashes, so that what an id, a name or a unit
    brings into it is never code, and that nothing is loaded from elsewhere.
    Raises TypeError where the body is text, in which tags would be shown, not followed.
    """
    if not isinstance(body, Markup):
        raise TypeError(f"the body of a page must be Markup, not {type(body).__name__}")
    library, last = ([get_plotlyjs()], [DRAW, *scripts]) if plots else ([], scripts)
    runs = [*library, *last]
    hashes = " ".join(f"'sha256-{b64encode(sha256(s.encode()).digest()).decode()}'" for s in runs) or "'none'"
    policy = (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    look = text("resim.report", "page.css") + css
    return html(
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta http-equiv="Content-Security-Policy" content="{policy}">'
        "{generator}"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        "<title>{title}</title>\n<style>{look}</style>{first}</head>\n<body>{body}\n{last}</body></html>\n",
        generator=Markup(GENERATOR),  # noqa: S704
        policy=Markup(policy),  # noqa: S704  ours, and quotes within quotes
        title=title,
        look=Markup(look),  # noqa: S704  files of the package
        first=_scripts(library),
        body=body,
        last=_scripts(last),
    )


def _scripts(scripts: Sequence[str]) -> Markup:
    return join(html("<script>{}</script>", Markup(script)) for script in scripts)  # noqa: S704  those of the package


def text(package: str, name: str) -> str:
    """Give the text of a file that ships with the package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")
