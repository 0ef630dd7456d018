"""The HTML document around a page: its look, its scripts, and the policy that lets nothing else run."""

from __future__ import annotations

import gzip
from base64 import b64encode
from collections.abc import Sequence
from functools import cache
from hashlib import sha256
from importlib.resources import files

from resim.core.schema import GENERATOR
from resim.report.markup import Markup, html, join

LIBRARY = "plotly-cartesian.min.js.gz"
"""What draws the figures: plotly.js, which `tools/vendor_plotly.py` puts into resim/report/plotly."""
FIGURES, TABLES = "figures.js", "tables.js"


def document(
    title: str, body: Markup, *, css: str = "", scripts: Sequence[str] = (), plots: bool = True
) -> Markup:
    """Give the whole file; title is text, css what comes after the look that all pages have.

    scripts: run in this order after the body, those that draw its `plots` and look after its tables around them. They
    and the library that plots need, which the page holds packed, are the only ones that a browser runs: the page's
    content security policy has their hashes, so that what an id, a name or a unit brings into it is never code, and
    that nothing is loaded from elsewhere.
    Raises TypeError where the body is text, in which tags would be shown, not followed.
    """
    if not isinstance(body, Markup):
        raise TypeError(f"the body of a page must be Markup, not {type(body).__name__}")
    first = [text("resim.report", FIGURES)] if plots else []
    last = [text("resim.report", TABLES)] if 'class="wide' in body else []
    runs = [*first, *scripts, *last]
    library, hashed = _library() if plots else ("", "")
    hashes = " ".join(f"'sha256-{one}'" for one in (hashed, *map(_hash, runs)) if one) or "'none'"
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
        '<meta name="color-scheme" content="light dark">'
        "<title>{title}</title>\n<style>{look}</style></head>\n<body>{body}\n{library}{runs}</body></html>\n",
        generator=Markup(GENERATOR),  # noqa: S704
        policy=Markup(policy),  # noqa: S704  ours, and quotes within quotes
        title=title,
        look=Markup(look),  # noqa: S704  files of the package
        body=body,
        library=html('<script type="application/gzip" id="plotly">{}</script>', library) if plots else "",
        runs=_scripts(runs),
    )


@cache
def _library() -> tuple[str, str]:
    """The library, packed, in base64, and the hash of the script that a browser unpacks."""
    packed = files("resim.report").joinpath("plotly", LIBRARY).read_bytes()
    return b64encode(packed).decode(), _hash(gzip.decompress(packed).decode())


def _hash(script: str) -> str:
    return b64encode(sha256(script.encode()).digest()).decode()


def _scripts(scripts: Sequence[str]) -> Markup:
    return join(html("<script>{}</script>", Markup(script)) for script in scripts)  # noqa: S704  those of the package


def text(package: str, name: str) -> str:
    """Give the text of a file that ships with the package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")
