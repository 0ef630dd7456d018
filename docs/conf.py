"""How Sphinx builds the site from this folder: `make docs`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import draw_layers
import field_tables
import generated
import library_reference

from resim import __version__

project = "resim"
author = "The resim developers"
copyright = "the resim developers, Apache-2.0"
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
html_theme = "furo"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
smartquotes = False  # -- is an option, not a dash
html_title = f"resim {__version__}"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_preserve_defaults = True
autodoc_default_options = {"members": True}
nitpicky = False  # types in signatures are those of numpy and pandas, too


def _source(app: Any, name: str, text: list[str]) -> None:
    """Put in what is made from the code, before the page is parsed."""
    text[0] = generated.fill(text[0], name)


def _docstring(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text with code between backticks."""
    lines[:] = library_reference.as_rst(lines)


def _schemas(app: Any, exception: Exception | None) -> None:
    """Publish the JSON Schema of every file beside the pages."""
    field_tables.write_schemas(Path(app.outdir) / "schemas")


def setup(app: Any) -> None:
    """Connect all, and draw the picture of the layers."""
    draw_layers.draw()
    app.connect("build-finished", _schemas)
    app.connect("source-read", _source)
    app.connect("autodoc-process-docstring", _docstring)
