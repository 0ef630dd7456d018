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
FIGURES, TABLES, SHARED = "figures.js", "tables.js", "shared.js"
SHEET = "scripts.css"
"""The file beside pages that share their scripts: a browser checks no hash of a script that lies on disk, so that they
come as texts in a style sheet, and the page runs them only where they have the hashes of its policy."""


def document(
    title: str,
    body: Markup,
    *,
    css: str = "",
    scripts: Sequence[str] = (),
    plots: bool = True,
    shared: bool = False,
) -> Markup:
    """Give the whole file; title is text, css what comes after the look that all pages have.

    scripts: run in this order after the body, those that draw its `plots` and look after its tables around them. They
    and the library that plots need, which the page holds packed, are the only ones that a browser runs: the page's
    content security policy has their hashes, so that what an id, a name or a unit brings into it is never code, and
    that nothing is loaded from elsewhere.
    shared: whether it takes its scripts from SHEET beside it, which `resim.report.shared` writes.
    Raises TypeError where the body is text, in which tags would be shown, not followed.
    """
    if not isinstance(body, Markup):
        raise TypeError(f"the body of a page must be Markup, not {type(body).__name__}")
    first = [text("resim.report", FIGURES)] if plots else []
    last = [text("resim.report", TABLES)] if 'class="wide' in body else []
    runs = [*first, *scripts, *last]
    own = [text("resim.report", SHARED)] if shared else runs
    hashes = [*map(script_hash, dict.fromkeys([*own, *runs])), *([_library()[1]] if plots else [])]
    told = " ".join(f"'sha256-{one}'" for one in hashes) or "'none'"
    styles = "'unsafe-inline' 'self' file:" if shared else "'unsafe-inline'"
    policy = (
        f"default-src 'none'; script-src {told}; style-src {styles}; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )
    look = text("resim.report", "page.css") + css
    return html(
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta http-equiv="Content-Security-Policy" content="{policy}">'
        "{generator}"
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="color-scheme" content="light dark">'
        "<title>{title}</title>\n{sheet}<style>{look}</style></head>\n<body>{body}\n{library}{runs}</body></html>\n",
        generator=Markup(GENERATOR),  # noqa: S704
        policy=Markup(policy),  # noqa: S704  ours, and quotes within quotes
        title=title,
        look=Markup(look),  # noqa: S704  files of the package
        body=body,
        sheet=html('<link rel="stylesheet" href="{}">', SHEET) if shared else "",
        library=_taken(runs, plots) if shared else _held(plots),
        runs=_scripts(own),
    )


def _held(plots: bool) -> Markup:
    """The library, which the script of the figures unpacks."""
    return (
        html('<script type="application/gzip" id="plotly">{}</script>', _library()[0]) if plots else Markup()
    )


def _taken(runs: Sequence[str], plots: bool) -> Markup:
    """Where the scripts from the sheet arrive, in their order."""
    hashes = [*([_library()[1]] if plots else []), *map(script_hash, runs)]
    return join(html('<i hidden data-script="{}"></i>', one) for one in hashes)


def script_sheet(scripts: Sequence[str], *, plots: bool) -> str:
    """Give what SHEET holds: these scripts and the library of the plots, each packed, by its hash."""
    held = {script_hash(one): b64encode(gzip.compress(one.encode(), mtime=0)).decode() for one in scripts}
    if plots:
        library, hashed = _library()
        held[hashed] = library
    return "".join(f'[data-script="{name}"]{{--script:"{one}"}}\n' for name, one in held.items())


def own_scripts() -> list[str]:
    """Give the scripts that documents bring along: of the figures, and of the tables."""
    return [text("resim.report", FIGURES), text("resim.report", TABLES)]


@cache
def _library() -> tuple[str, str]:
    """The library, packed, in base64, and the hash of the script that a browser unpacks."""
    packed = files("resim.report").joinpath("plotly", LIBRARY).read_bytes()
    return b64encode(packed).decode(), script_hash(gzip.decompress(packed).decode())


def script_hash(script: str) -> str:
    """Give the hash of a script as a policy names it."""
    return b64encode(sha256(script.encode()).digest()).decode()


def _scripts(scripts: Sequence[str]) -> Markup:
    return join(html("<script>{}</script>", Markup(script)) for script in scripts)  # noqa: S704  those of the package


def text(package: str, name: str) -> str:
    """Give the text of a file that ships with the package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")
