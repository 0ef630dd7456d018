"""What one recording gave: kept in a file of its own as soon as it is there, and taken from it if nothing changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from resim.core.errors import InputError
from resim.core.sealed import read_sealed, sealed
from resim.core.spec import EXACT, from_json, to_json
from resim.resimulation.traces import SpeedTraces
from resim.results import whole_file, write_json
from resim.verification.entries import RecordingSource
from resim.verification.report import RecordingResult

CASES = "cases"
"""The folder of these files."""


@dataclass(frozen=True)
class BuildTraces:
    """Speeds with the older build and with the newer one."""

    before: SpeedTraces
    now: SpeedTraces


def _of_builds(found: Any) -> str:
    many = "now" in found if isinstance(found, Mapping) else isinstance(found, BuildTraces)
    return "builds" if many else "measured"


Traces = Annotated[
    Annotated[SpeedTraces, Tag("measured")] | Annotated[BuildTraces, Tag("builds")],
    Discriminator(_of_builds),
]


@dataclass(frozen=True)
class VerificationCase:
    """What one recording gave.

    traces: speeds for the page, None where the recording failed. time: how long it took [s]. reports: hashes of the
    re-simulation reports that were written of it, by name.
    """

    __pydantic_config__ = EXACT

    entry: RecordingResult
    traces: Traces | None
    time: float | None
    reports: Annotated[Mapping[str, str], Field(exclude_if=lambda reports: not reports)] = field(
        default_factory=dict
    )


def keep(out: Path, key: str, case: VerificationCase) -> None:
    """Write what a recording gave. key: of what it follows from."""
    told = to_json(case)
    told["entry"] = {name: value for name, value in told["entry"].items() if name not in _ELSEWHERE}
    with whole_file(out / CASES / f"{case.entry.name}.json", None) as path:
        write_json(sealed({"key": key, **told}), path)


def kept(
    out: Path, source: RecordingSource, key: str, damaged: Callable[[Path], None]
) -> VerificationCase | None:
    """Give what the recording gave before, None where that follows from something else.

    damaged: hears of a file that is not as it was written.
    """
    path = out / CASES / f"{source.name}.json"
    if not path.exists():
        return None
    try:
        told = read_sealed(path, "")
        if told.pop("key") != key:
            return None
        told["entry"] = {**to_json(source), **told["entry"]}
        return from_json(told, VerificationCase, path, "resim verify", "")
    except (InputError, KeyError, TypeError):
        damaged(path)
        return None


_ELSEWHERE = {"name", "folder", "hash", "reports"}
"""Fields of an entry that follow from the request."""
