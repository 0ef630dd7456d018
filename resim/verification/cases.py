"""What one recording gave: kept in a file of its own as soon as it is there, and taken from it if nothing changed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from resim.core.errors import InputError
from resim.core.sealed import read_sealed, sealed
from resim.core.spec import EXACT, from_json, to_json
from resim.resimulation.traces import SpeedTraces
from resim.results import whole_file, write_json
from resim.verification.entries import (
    ComparedContent,
    ComparedRecording,
    FailedRecording,
    RecordingSource,
    VerifiedContent,
    VerifiedRecording,
)
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


Reports = Mapping[str, str]
"""Hashes of the re-simulation reports that were written of a recording, by name."""


@dataclass(frozen=True)
class VerificationCase:
    """What one recording gave.

    traces: speeds for the page, None where the recording failed. time: how long it took [s]. drive: hash of the page
    that plays it, None where there is none.
    """

    entry: RecordingResult
    traces: Traces | None
    time: float | None
    reports: Reports = field(default_factory=dict)
    drive: str | None = None


def _two_builds(found: Any) -> str:
    pairs = "pairs" in found if isinstance(found, Mapping) else isinstance(found, ComparedContent)
    return "builds" if pairs else "measured"


CaseContent = Annotated[
    Annotated[VerifiedContent, Tag("measured")] | Annotated[ComparedContent, Tag("builds")],
    Discriminator(_two_builds),
]


@dataclass(frozen=True)
class CaseFile:
    """What cases/*.json says: what one recording gave, wherever it lies.

    key: of all that it follows from. traces: speeds [m/s] for the page. time: how long it took [s]. reports: hashes of
    the re-simulation reports that were written of it, by name. drive: hash of the page that plays it.
    """

    __pydantic_config__ = EXACT

    key: str
    entry: CaseContent
    traces: Traces
    time: float
    reports: Annotated[Reports, Field(exclude_if=lambda reports: not reports)] = field(default_factory=dict)
    drive: str | None = None


def keep(out: Path, key: str, case: VerificationCase) -> None:
    """Write what a recording gave, unless that is no result. key: of what it follows from."""
    entry = case.entry
    if isinstance(entry, FailedRecording) or case.traces is None or case.time is None:
        return
    kind = VerifiedContent if isinstance(entry, VerifiedRecording) else ComparedContent
    content = kind(**{f.name: getattr(entry, f.name) for f in fields(kind)})
    told = CaseFile(key, content, case.traces, case.time, case.reports, case.drive)
    with whole_file(out / CASES / f"{entry.name}.json", None) as path:
        write_json(sealed(to_json(told)), path)


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
        if told["key"] != key:  # of another version of resim it may have other fields
            return None
        found = from_json(told, CaseFile, path, "resim verify", "")
    except (InputError, KeyError):
        damaged(path)
        return None
    kind = VerifiedRecording if isinstance(found.entry, VerifiedContent) else ComparedRecording
    return VerificationCase(
        kind(**vars(source), **vars(found.entry)), found.traces, found.time, found.reports, found.drive
    )
