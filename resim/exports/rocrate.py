"""A folder of results as an RO-Crate: what is in it, what made it, from what.

Source: RO-Crate 1.1, and Process Run Crate 0.5 of the Workflow Run profiles.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

FILE = "ro-crate-metadata.json"
CRATE = "https://w3id.org/ro/crate/1.1"
PROFILE = "https://w3id.org/ro/wfrun/process/0.5"
SHA256 = "https://w3id.org/ro/terms/workflow-run#sha256"
_RUN, _TOOL, LICENSE = "#run", "#resim", "#license"
_HASH = re.compile("[0-9a-f]{32}|[0-9a-f]{64}")
_OWN = ("checksum", "files", "cases", "versions")
"""Entries of a mark that are of no input."""
_TYPES = {
    ".json": "application/json", ".html": "text/html", ".parquet": "application/vnd.apache.parquet",
    ".xml": "application/xml", ".xodr": "application/xml", ".csv": "text/csv", ".toml": "application/toml",
    ".jsonl": "application/jsonl",
}  # fmt: skip
_WORDS = {
    "run.json": ("Re-simulation", "A measured drive, re-simulated with an automated-driving function"),
    "assessment.json": ("Assessment", "Criticality, accident risk and verdicts of a measured drive"),
    "conversion.json": (
        "Converted map",
        "An OpenDRIVE map as a SUMO network, with the errors of the conversion",
    ),
    "inputs.json": (
        "Verification",
        "Verdicts of measured and re-simulated drives of a function build, compared",
    ),
    "sweep.json": ("Sweep", "Re-simulations of a drive over parameters and perception errors"),
    "variations.json": ("Variations", "Drives near a measured one that a human could have driven"),
    "mined.json": ("Mined recordings", "Maneuvers of recordings, and the scenarios cut out of them"),
    "space.json": (
        "Scenario space",
        "Distances and clusters of scenarios, and how likely and risky each kind is",
    ),
    "release.json": (
        "Release verdict",
        "Whether a function may be released by a scenario space, and what forbids it",
    ),
    "comparison.json": ("Comparison of spaces", "What one scenario space holds and another does not"),
}
"""Title and description of what a folder holds, by its mark."""


def crate(
    title: str, mark: str, told: Mapping[str, Any], files: Mapping[str, tuple[int, str]], date: str
) -> dict[str, Any]:
    """Give ro-crate-metadata.json of a folder.

    title: what was simulated or judged. mark: file that tells what folder it is; told: what that says. files: bytes and
    SHA-256 of each. date: when it was made, by ISO 8601.
    """
    kind, what = _WORDS[mark]
    versions = told["versions"]
    inputs = dict(_inputs({key: value for key, value in told.items() if key not in _OWN}, ""))
    held = [{"@id": quote(name)} for name in files]
    entities = [
        *root(f"{kind}: {title}", f"{what}.", date, held, [_RUN]),
        *(file_entity(name, *about) for name, about in files.items()),
        tool(_TOOL, versions),
        {
            "@id": _RUN, "@type": "CreateAction", "name": kind, "description": f"{what}.",
            "instrument": {"@id": _TOOL}, "endTime": date,
            "object": [{"@id": f"#{quote(name)}"} for name in inputs], "result": held,
        },
        *(
            {"@id": f"#{quote(name)}", "@type": "CreativeWork", "name": name, "identifier": digest}
            for name, digest in inputs.items()
        ),
    ]  # fmt: skip
    return graph(entities)


def root(
    name: str, what: str, date: str, held: list[dict[str, str]], made_by: Sequence[str]
) -> list[dict[str, Any]]:
    """Give what every crate begins with. date: by ISO 8601. held: references to all files. made_by: ids of actions."""
    return [
        {
            "@id": FILE, "@type": "CreativeWork", "about": {"@id": "./"},
            "conformsTo": {"@id": CRATE},
        },
        {
            "@id": "./", "@type": "Dataset", "name": name, "description": what,
            "datePublished": date, "conformsTo": {"@id": PROFILE}, "hasPart": held,
            "mentions": [{"@id": one} for one in made_by] if len(made_by) != 1 else {"@id": made_by[0]},
            "license": {"@id": LICENSE},
        },
        {"@id": PROFILE, "@type": "CreativeWork", "name": "Process Run Crate", "version": "0.5"},
        {
            "@id": LICENSE, "@type": "CreativeWork", "name": "License of the recording and the map",
            "description": "What is made of a recording and a map may be used as these may.",
        },
    ]  # fmt: skip


def tool(name: str, versions: Mapping[str, str]) -> dict[str, Any]:
    """Give the entity of the resim that made something. name: its id."""
    return {
        "@id": name, "@type": "SoftwareApplication", "name": "resim",
        "softwareVersion": f"{versions['resim']}, source {versions.get('code', 'not told')}",
        "softwareRequirements": [
            f"{one} {version}" for one, version in versions.items() if one not in ("resim", "code")
        ],
    }  # fmt: skip


def graph(entities: list[dict[str, Any]]) -> dict[str, Any]:
    """Give ro-crate-metadata.json with these entities."""
    return {"@context": [f"{CRATE}/context", {"sha256": SHA256}], "@graph": entities}


def write(folder: Path, told: Mapping[str, Any]) -> None:
    """Write what `crate` gives into a folder."""
    text = json.dumps(told, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / FILE).write_text(text + "\n", encoding="utf-8")


def file_entity(name: str, size: int, digest: str) -> dict[str, Any]:
    """Give the entity of a file: its name in the crate, bytes and SHA-256."""
    made = {"@id": quote(name), "@type": "File", "name": name, "contentSize": str(size), "sha256": digest}
    kind = _TYPES.get(Path(name).suffix)
    return made if kind is None else {**made, "encodingFormat": kind}


def _inputs(told: Any, name: str) -> Iterator[tuple[str, str]]:
    """Every hash in a mark, SHA-256 or the first half of one, by where it stands in it."""
    if isinstance(told, Mapping):
        for key, value in told.items():
            yield from _inputs(value, f"{name}/{key}" if name else str(key))
    elif isinstance(told, list | tuple):
        for number, value in enumerate(told):
            yield from _inputs(value, f"{name}/{number}")
    elif isinstance(told, str) and _HASH.fullmatch(told):
        yield name, told
