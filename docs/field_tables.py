"""The fields of every kind of file as tables, from the models that read the files."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Collection, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

from resim.jobs.schemas import FORMATS, schema_of

_ATTRIBUTES = re.compile(r"^Attributes:\n((?:    .*(?:\n|\Z))+)", re.MULTILINE)


def schema(file: str) -> str:
    """Give the fields of a kind of file as tables, one for each of its parts."""
    made = schema_of(file)
    parts = {made["title"]: made, **made.get("$defs", {})}
    tables = [_part(name, parts, top=part is made) for name, part in parts.items() if "properties" in part]
    return "\n\n".join(tables)


def schema_with_json(file: str) -> str:
    """Give the tables of `schema` and the JSON Schema that they are made from."""
    whole = json.dumps(schema_of(file), indent=2, ensure_ascii=False)
    shown = f"<details><summary>JSON Schema</summary>\n\n```json\n{whole}\n```\n\n</details>"
    return f"{schema(file)}\n\n{shown}"


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
    """A model's docstring as Markdown: what it says of fields, `one, two: meaning.` or as attributes, and the rest."""
    found: dict[str, str] = {}
    if attributes := _ATTRIBUTES.search(text):  # in Google's style
        for name, meaning in re.findall(r"^    (\w+): (.*(?:\n {5,}.*)*)", attributes[1], re.MULTILINE):
            found[name] = re.sub(r"([*<|]|\](?=\())", r"\\\1", " ".join(meaning.split()).rstrip(";."))
        text = text[: attributes.start()] + text[attributes.end() :]
    text = re.sub(r"([*<|]|\](?=\())", r"\\\1", text)
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
        items: Mapping[str, Any] = of.get("items") or next(iter(of.get("prefixItems", ())), {})
        return f"list of {_type(items)}"
    if kind == "object":
        inner = of.get("additionalProperties")
        return f"table of {_type(inner)}" if isinstance(inner, Mapping) else "table"
    words = {"string": "text", "boolean": "true or false", "integer": "integer"}.get(str(kind), str(kind))
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    return ", ".join([words, *(f"{sign} {of[key]}" for key, sign in signs.items() if key in of)])
