"""What the pages take from the code, for readers of plain Markdown: one of `PARTS` between two markers on a page.

`python docs/generated.py` writes it anew, and a test compares. On the site, a part of `ON_THE_SITE` stands instead; the
marker `on the site: page PATH` is for a page from outside of this folder, `on the site: contents` for the navigation.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from field_tables import schema, schema_with_json
from library_reference import api, api_on_the_site

from resim.cli import app
from resim.metrics.measures.registry import MEASURES
from resim.recordings.checks.codes import CODES

OUTSIDE = {
    "README.md": "install.md",
    "CONTRIBUTING.md": "contributing.md",
    "networks/README.md": "reference/maps.md",
    "tools/README.md": "tools.md",
}
"""Pages of the project outside of this folder, and the pages that show them on the site."""

HERE = Path(__file__).parent
ROOT = HERE.parent
COMMAND = "python docs/generated.py"
_END = "<!-- end of generated -->"
_REGION = re.compile(
    rf"^(<!-- generated: (\w+) ?(\S*); by {re.escape(COMMAND)} -->\n).*?^{_END}$", re.MULTILINE | re.DOTALL
)
_SITE = re.compile(r"^<!-- on the site: (page|contents) ?(\S*) -->$", re.MULTILINE)
_LINK = re.compile(r"(\]\()([^)#:\s]+\.md)(#[^)]*)?\)")


def written(page: str) -> str:
    """Give the text of a page with what its markers name. Raises KeyError for an unknown name."""
    return _REGION.sub(lambda m: f"{m[1]}\n{PARTS[m[2]](m[3])}\n\n{_END}", page)


def fill(page: str, name: str) -> str:
    """Give the page of this name (as Sphinx has it) as the site shows it. Raises KeyError for an unknown name."""
    folder = (HERE / name).parent
    said = dict(_SITE.findall(page))
    if shown := said.get("page"):
        return _linked(_section(*shown.split("#")), (ROOT / shown).parent, folder)
    page = _linked(page, folder, folder)
    page = _SITE.sub(lambda m: contents(page), page)
    return _REGION.sub(lambda m: {**PARTS, **ON_THE_SITE}[m[2]](m[3]), page)


def write() -> None:
    """Write what is not the same already."""
    for page in sorted(HERE.rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        if (made := written(text)) != text:
            page.write_text(made, encoding="utf-8")


def _section(path: str, anchor: str = "") -> str:
    """A page of the project, or one section of it, whose heading is then the page's."""
    text = (ROOT / path).read_text(encoding="utf-8")
    if not anchor:
        return text
    sections = ("# " + part for part in text.split("\n## ")[1:])
    return next(s for s in sections if _anchor(s.splitlines()[0]) == anchor)


def _anchor(heading: str) -> str:
    """A heading's anchor, as forges and MyST make it."""
    return re.sub(r"[^\w -]", "", heading.lstrip("# ").lower()).replace(" ", "-")


def _linked(text: str, old: Path, new: Path) -> str:
    """A text with the links of a page in one folder put right for a page of the site in another."""

    def moved(m: re.Match[str]) -> str:
        target = Path(os.path.normpath(old / m[2]))
        if not target.is_relative_to(HERE):
            target = HERE / OUTSIDE[target.relative_to(ROOT).as_posix()]
        return f"{m[1]}{Path(os.path.relpath(target, new)).as_posix()}{m[3] or ''})"

    return _LINK.sub(moved, text)


def contents(page: str) -> str:
    """Give the navigation of the site, from the lists of links under each heading of a page."""
    trees = []
    for section in page.split("\n## ")[1:]:
        links = re.findall(r"^- \[.*?\]\((.+?)\.md\)", section, re.MULTILINE)
        if links:
            head = ["```{toctree}", ":hidden:", f":caption: {section.splitlines()[0]}", ""]
            trees.append("\n".join([*head, *links, "```"]))
    return "\n\n".join(trees)


# commands


def commands(_: str = "") -> str:
    """Give the help of every command, each under a heading."""
    return "\n\n".join(_helps(typer.main.get_command(app), "resim"))


def _helps(command: Any, name: str, above: Any = None) -> Iterator[str]:
    context = command.context_class(
        command, parent=above, info_name=name, **{**command.context_settings, "terminal_width": 86}
    )
    yield f"## {context.command_path}\n\n```text\n{command.get_help(context).rstrip()}\n```"
    for below, one in getattr(command, "commands", {}).items():
        yield from _helps(one, below, context)


# findings


def findings(_: str = "") -> str:
    """Give a table of what `resim check` can find."""
    rows = [f"| `{name}` | {c.severity} | {c.meaning} | {c.repair or '–'} |" for name, c in CODES.items()]
    return "\n".join(["| code | severity | what it means | what `--fix` does |", "|---|---|---|---|", *rows])


# registries


def measures(_: str = "") -> str:
    """Give a table of the measures that resim has."""
    rows = [f"| `{m.name}` | {m.kind} | {m.unit} | {m.meaning} | {m.source} |" for m in MEASURES]
    return "\n".join(["| measure | kind | unit | what | source |", "|---|---|---|---|---|", *rows])


PARTS: Mapping[str, Callable[[str], str]] = {
    "commands": commands, "schema": schema, "findings": findings, "measures": measures, "api": api,
}  # fmt: skip
ON_THE_SITE: Mapping[str, Callable[[str], str]] = {"schema": schema_with_json, "api": api_on_the_site}


if __name__ == "__main__":
    write()
