"""A chain as an RO-Crate: results with all that they came from, as far as it is at hand.

Source: as `resim.exports.rocrate`; each result has a CreateAction of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote

from resim.exports.rocrate import file_entity, graph, root, tool


@dataclass(frozen=True)
class ChainLink:
    """One thing of a chain.

    Attributes:
        id: 16 hex digits, or what else tells it from the others.
        kind: Run, recording, map, build, ...
        name: What it is called.
        digest: SHA-256 of its content.
        files: Its files in the crate: bytes and SHA-256 of each.
        missing: Why it has none here, "" where it has.
        origins: Ids of what it came from.
        versions: Of results, of what made them; empty for what resim did not make.
        settings: Of results, seeds and the like.
        written: When, ISO 8601.
        command: Of results what makes them again, from within the crate; "" where nothing does.
    """

    id: str
    kind: str
    name: str
    digest: str
    files: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    missing: str = ""
    origins: tuple[str, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)
    written: str = ""
    command: str = ""


def chain_crate(links: Sequence[ChainLink]) -> dict[str, Any]:
    """Give ro-crate-metadata.json of a chain, of which the first link is what all others led to."""
    files = {name: about for link in links for name, about in link.files.items()}
    made = [link for link in links if link.versions]
    tools = {_tool(link): tool(_tool(link), link.versions) for link in made}
    first = links[0]
    what = f"A {first.kind} with what it came from, by content."
    entities = [
        *root(f"{first.kind} {first.name}, and what it came from", what, first.written, _references(files),
              [_action(link) for link in made]),
        *(file_entity(name, *about) for name, about in files.items()),
        *(_entity(link) for link in links), *tools.values(),
    ]  # fmt: skip
    for link in made:
        entities += _made(link)
    return graph(entities)


def _references(names: Mapping[str, Any]) -> list[dict[str, str]]:
    return [{"@id": quote(name)} for name in names]


def _thing(link_id: str) -> str:
    return f"#{link_id}"


def _action(link: ChainLink) -> str:
    return f"#made-{link.id}"


def _tool(link: ChainLink) -> str:
    return f"#resim-{quote(link.versions.get('code') or link.versions['resim'])}"


def _entity(link: ChainLink) -> dict[str, Any]:
    """What a link is: a collection of its files, or, without them, a work that is known by its hash alone."""
    told = {"@id": _thing(link.id), "name": link.name or link.digest[:12], "additionalType": link.kind,
            "identifier": link.digest}  # fmt: skip
    if link.missing:
        return {**told, "@type": "CreativeWork", "description": f"Not in this crate: {link.missing}."}
    return {**told, "@type": "Collection", "hasPart": _references(link.files)}


def _made(link: ChainLink) -> list[dict[str, Any]]:
    """How results were made: the action, and its settings."""
    settings = [
        {"@id": f"{_action(link)}-{quote(name)}", "@type": "PropertyValue", "name": name, "value": value}
        for name, value in link.settings.items()
    ]
    action = {
        "@id": _action(link), "@type": "CreateAction", "name": f"{link.kind} {link.name}", "endTime": link.written,
        "instrument": {"@id": _tool(link)},
        "object": [{"@id": _thing(one)} for one in link.origins] + [{"@id": one["@id"]} for one in settings],
        "result": [{"@id": _thing(link.id)}, *_references(link.files)],
    }  # fmt: skip
    if link.command:
        action["description"] = f"Again, from within this crate: {link.command}"
    return [action, *settings]
