"""Under which circumstances results came out: what must be equal, besides the recording, to compare two builds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

from resim.results.entry import CatalogFact

FACET = "circumstances"
"""Of the fact that says them, as JSON."""
VERSION = "resim"
"""Circumstance that is told, and does not keep two results from being compared."""
_OF_MODEL = {"perception", "set", "seeds"}
"""Circumstances of drives with a perception model, on which no other drive of a run depends."""
_LONGEST = 60
"""Letters of a value that are kept; of a longer one, or of a table, a digest."""
_RUN = ("engine", "vehicle", "seed", "step", "lead_in", "stop_at_collision", "traffic")
_VERIFICATION = (
    "against", "criteria", "perception", "settings", "seeds", "bases", "agreement", "vary", "vehicle", "traffic",
    "tolerances", "limits",
)  # fmt: skip
_NOT_OF_A_SWEEP = {"name", "recording", "suite", "build", "criteria", "perception", "accept"}
"""What the file of a sweep says of what is swept, which stands elsewhere, too, or changes no verdict."""


def of_run(run: Mapping[str, Any], report: Mapping[str, Any], assessed: Mapping[str, Any]) -> CatalogFact:
    """Give the circumstances of a run: from run.json, report.json and assessment.json."""
    told = {name: run[name] for name in _RUN} | {"criteria": assessed["inputs"]["criteria"]}
    if (seen := report["perception"]) is not None:
        told |= {
            "perception": seen["model"] | {"label": seen["model"]["name"]},
            "set": run["perception"]["set"],
            "seeds": [one["seed"] for one in run["perception"]["seeds"]],
        }
    return _fact(told, run["versions"])


def of_verification(found: Mapping[str, Any]) -> CatalogFact:
    """Give the circumstances of a verification: from verification.json."""
    return _fact({name: found["inputs"][name] for name in _VERIFICATION}, found["versions"])


def of_sweep(manifest: Mapping[str, Any]) -> CatalogFact:
    """Give the circumstances of a sweep: from manifest.json."""
    told = manifest["inputs"]
    own = {name: value for name, value in told["sweep"].items() if name not in _NOT_OF_A_SWEEP}
    named = {name: told.get(name) for name in ("vehicle", "criteria", "perception", "kernels", "verified")}
    return _fact(own | named, manifest["versions"])


def read_circumstances(text: str) -> dict[str, str]:
    """Give circumstances by name, of the text of the fact; {} where they are not known."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return {str(k): str(v) for k, v in found.items()} if isinstance(found, dict) else {}


def comparable(source: str, made: Mapping[str, str]) -> dict[str, str]:
    """Give the circumstances that must be equal of two outcomes of a source to compare them."""
    left_out = {VERSION} | (_OF_MODEL if source in ("rGT", "rSD") else set())
    return {name: told for name, told in made.items() if name not in left_out}


def differences(source: str, one: Mapping[str, str], other: Mapping[str, str]) -> tuple[str, ...]:
    """Say in which of these two outcomes of a source differ."""
    if not (one and other):
        return ("how one of them was made is not known",)
    first, second = comparable(source, one), comparable(source, other)
    return tuple(
        f"{name.replace('_', ' ')}: {first.get(name, 'none')}, {second.get(name, 'none')}"
        for name in sorted({*first, *second})
        if first.get(name) != second.get(name)
    )


def _fact(told: Mapping[str, Any], versions: Mapping[str, Any]) -> CatalogFact:
    made = f"{versions['resim']} {versions.get('code', '')}".strip()
    words = {name: word for name, value in told.items() if (word := _word(value))} | {VERSION: made}
    return CatalogFact(FACET, json.dumps(words, sort_keys=True))


def _word(value: Any) -> str:
    """A value in a few letters, equal for equal values alone; "" for nothing."""
    if value is None or value in ([], (), {}):
        return ""
    if isinstance(value, Mapping) and "hash" in value:
        name = value.get("label") or value.get("name") or PurePath(str(value.get("path", ""))).stem
        return f"{str(name)[:_LONGEST]} {str(value['hash'])[:16]}"
    if isinstance(value, list | tuple):
        return _short(_listed(value))
    return _short(json.dumps(value, sort_keys=True)) if isinstance(value, Mapping) else _short(str(value))


def _listed(values: Sequence[Any]) -> str:
    """Whole numbers in a row as the first and the last, anything else one by one."""
    first = values[0]
    if len(values) > 2 and type(first) is int and [*values] == [*range(first, first + len(values))]:
        return f"{first} to {values[-1]}"
    return json.dumps(values)[1:-1]


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"of {hashlib.sha256(text.encode()).hexdigest()[:16]}"
