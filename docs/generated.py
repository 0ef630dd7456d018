"""What the pages take from the code: a fenced block {generated} on a page names one of `PARTS`, and its argument.

On a forge such a block is read as it stands, so the sentence before it says what is there on the site.
"""

from __future__ import annotations

import inspect
import json
import os
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

import typer

import resim.core.errors
import resim.core.tracks
import resim.jobs.assess
import resim.jobs.check
import resim.jobs.convert
import resim.jobs.play
import resim.jobs.resimulate
import resim.jobs.sweep
import resim.jobs.train
import resim.jobs.verify
import resim.metrics.measures
import resim.metrics.risk
import resim.perception.training
import resim.recordings
import resim.resimulation
import resim.road.opendrive
import resim.road.path
import resim.scenario.jscen
import resim.scenario.scenario
import resim.simulation.case
import resim.simulation.function.interface
from resim.cli import app
from resim.jobs.schemas import FORMATS, schema_of
from resim.metrics.measures.registry import MEASURES
from resim.recordings.checks.codes import CODES

API = {
    "Re-simulate": resim.jobs.resimulate,
    "Assess": resim.jobs.assess,
    "See a drive": resim.jobs.play,
    "Verify and compare": resim.jobs.verify,
    "Sweep": resim.jobs.sweep,
    "Check and repair": resim.jobs.check,
    "Train": resim.jobs.train,
    "Check and convert maps": resim.jobs.convert,
    "Re-simulation": resim.resimulation,
    "Cases and simulated drives": resim.simulation.case,
    "AD functions": resim.simulation.function.interface,
    "Recordings": resim.recordings,
    "Tracks": resim.core.tracks,
    "Scenarios": resim.scenario.scenario,
    "JSCEN files": resim.scenario.jscen,
    "Roads": resim.road.opendrive,
    "Paths along lanes": resim.road.path,
    "Measures": resim.metrics.measures,
    "Accident risk": resim.metrics.risk,
    "Training of perception models": resim.perception.training,
    "Errors": resim.core.errors,
}
"""The modules of the reference, by heading."""

OUTSIDE = {
    "README.md": "install.md",
    "CONTRIBUTING.md": "contributing.md",
    "networks/README.md": "reference/maps.md",
    "tools/README.md": "tools.md",
}
"""Pages of the project outside of this folder, and the pages that show them on the site."""

HERE = Path(__file__).parent
ROOT = HERE.parent
_BLOCK = re.compile(r"^```\{generated\} (\w+) ?(\S*)\n```$", re.MULTILINE)
_LINK = re.compile(r"(\]\()([^)#:\s]+\.md)(#[^)]*)?\)")


def fill(page: str, name: str) -> str:
    """Give the page of this name (as Sphinx has it) with what its blocks name. Raises KeyError for an unknown name."""
    folder = (HERE / name).parent
    shown = next((m[2] for m in _BLOCK.finditer(page) if m[1] == "page"), None)
    if shown is not None:
        return _linked(_section(*shown.split("#")), (ROOT / shown).parent, folder)
    page = _linked(page, folder, folder)
    return _BLOCK.sub(lambda m: contents(page) if m[1] == "contents" else PARTS[m[1]](m[2]), page)


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
    context = command.context_class(command, parent=above, info_name=name, terminal_width=86)
    yield f"## {context.command_path}\n\n```text\n{command.get_help(context).rstrip()}\n```"
    for below, one in getattr(command, "commands", {}).items():
        yield from _helps(one, below, context)


# schemas


def schema(file: str) -> str:
    """Give the fields of a kind of file as tables, one for each of its parts, and its JSON Schema."""
    made = schema_of(file)
    parts = {made["title"]: made, **made.get("$defs", {})}
    tables = [_part(name, parts, top=part is made) for name, part in parts.items() if "properties" in part]
    whole = json.dumps(made, indent=2, ensure_ascii=False)
    tables.append(f"<details><summary>JSON Schema</summary>\n\n```json\n{whole}\n```\n\n</details>")
    return "\n\n".join(tables)


def write_schemas(folder: Path) -> None:
    """Write the JSON Schema of every kind of file into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in FORMATS:
        text = json.dumps(schema_of(name), indent=2, ensure_ascii=False)
        (folder / f"{name}.schema.json").write_text(text + "\n", encoding="utf-8")


def _part(name: str, parts: Mapping[str, Mapping[str, Any]], *, top: bool) -> str:
    part = parts[name]
    head = "**The file**" if top else f"**{_name(name)}**"
    said, meanings = _meanings(inspect.cleandoc(part.get("description", "")), part["properties"])
    needed = part.get("required", ())
    columns = ["field", "type", "default", "meaning"][: 4 if meanings else 3]
    rows = [columns, ["---"] * len(columns)]
    for field, of in part["properties"].items():
        default = "required" if field in needed else _default(of, parts)
        rows.append([f"`{field}`", _type(of), default, meanings.get(field, "")][: len(columns)])
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return "\n\n".join(text for text in (head, said, table) if text)


def _meanings(text: str, fields: Collection[str]) -> tuple[str, dict[str, str]]:
    """A model's docstring as Markdown: what it says of fields, `one, two: meaning.`, and the rest."""
    found: dict[str, str] = {}
    text = re.sub(r"([\[\]*<|])", r"\\\1", text)
    starts = [
        m
        for m in re.finditer(r"(?:(?<=[.;] )|(?<=[.;]\n)|^)(\w+(?:, \w+)*): ", text, re.MULTILINE)
        if set(m[1].split(", ")) <= set(fields)
    ]
    rest = text[: starts[0].start()] if starts else text
    for one, following in zip_longest(starts, starts[1:]):
        meaning = text[one.end() : following.start() if following else None]
        meaning, paragraph, beyond = meaning.partition("\n\n")
        found |= dict.fromkeys(one[1].split(", "), " ".join(meaning.split()).rstrip(";."))
        rest += paragraph + beyond
    return rest.strip(), found


def _default(of: Mapping[str, Any], parts: Mapping[str, Mapping[str, Any]]) -> str:
    """A field's default; nothing where it is a part as that part's own defaults have it."""
    value = of.get("default", ...)
    own = parts.get(of.get("$ref", "").rpartition("/")[2], {}).get("properties", {})
    if value is ... or value == {name: field.get("default") for name, field in own.items()}:
        return ""
    return "none" if value is None else f"`{json.dumps(_said(value), ensure_ascii=False)}`"


def _said(value: Any) -> Any:
    """A default without what is not set."""
    if isinstance(value, Mapping):
        return {name: said for name, one in value.items() if (said := _said(one)) not in (None, {})}
    return value


def _name(reference: str) -> str:
    """A part's name, without its module where two have one name."""
    return reference.rpartition("/")[2].rpartition("__")[2].lstrip("_")


def _type(of: Mapping[str, Any]) -> str:
    """A type in a few words."""
    if "$ref" in of:
        return _name(of["$ref"])
    if several := of.get("anyOf", of.get("oneOf")):
        return " or ".join(dict.fromkeys(_type(one) for one in several if one.get("type") != "null"))
    if "enum" in of or "const" in of:
        return ", ".join(f"`{json.dumps(v)}`" for v in of.get("enum", [of.get("const")]))
    kind = of.get("type")
    if kind == "array":
        items = of.get("items") or next(iter(of.get("prefixItems", ())), {})
        return f"list of {_type(items)}"
    if kind == "object":
        inner = of.get("additionalProperties")
        return f"table of {_type(inner)}" if isinstance(inner, Mapping) else "table"
    words = {"string": "text", "boolean": "true or false", "integer": "integer"}.get(str(kind), str(kind))
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    return ", ".join([words, *(f"{sign} {of[key]}" for key, sign in signs.items() if key in of)])


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


# API


def api(_: str = "") -> str:
    """Give the public classes and functions of the library, module by module."""
    return "\n\n".join(
        f"## {head}\n\n`{module.__name__}`\n\n```{{eval-rst}}\n.. automodule:: {module.__name__}\n```"
        for head, module in API.items()
    )


def as_rst(lines: list[str]) -> list[str]:
    """Give a docstring for reStructuredText: what stands between backticks is code, everything else plain text."""
    out = []
    for line in "\n".join(lines).split("`"):
        out.append(line if len(out) % 2 else re.sub(r"([\\*|_])", r"\\\1", line))
    return "``".join(out).replace("````", "").split("\n")


PARTS: Mapping[str, Callable[[str], str]] = {
    "commands": commands, "schema": schema, "findings": findings, "measures": measures,
    "api": api,
}  # fmt: skip
