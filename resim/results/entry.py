"""What the catalog holds of a folder of results: what went in, what came out, and whether it is still there."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from resim.core.errors import InputError
from resim.core.files import parse_json, read_file
from resim.core.sealed import CHECKSUM
from resim.results.folders import ASSESSMENT, MINING, RUN, SWEEP, VERIFICATION, FolderKind

ResultKind = Literal["run", "assessment", "verification", "sweep", "mining"]
FolderState = Literal["there", "changed", "gone", "elsewhere"]
"""Of a folder: as it was; holding something else; not there; or of another machine, and not to be seen from here."""

KINDS: dict[ResultKind, tuple[str, FolderKind]] = {
    "run": ("run.json", RUN),
    "verification": ("verification.json", VERIFICATION),
    "sweep": ("manifest.json", SWEEP),
    "assessment": ("assessment.json", ASSESSMENT),
    "mining": ("mined.json", MINING),
}
"""Of each kind of result the file that is there once it is finished, and what its folder may hold; a run has an
assessment, too."""


@dataclass(frozen=True)
class CatalogInput:
    """Something that a result follows from.

    role: recording, build, against (the older build), criteria, perception, suite. name: of a recording its name, of a
    build its label. path: absolute, "" where it is not told. hash: SHA-256, "" where it is not told.
    """

    role: str
    name: str
    path: str = ""
    hash: str = ""


@dataclass(frozen=True)
class CatalogOutcome:
    """What came out for one recording and build.

    source: of a run and of an assessment what was judged (GT, SD, rGT, rSD), else "". verdict: "" where nothing was
    judged. cause: why it is not good. The rest is None where it is not told: how many runs, with which verdicts,
    without a result, with a collision of the EGO; same_decision: share of the runs that decide as measured.
    """

    recording: str
    build: str
    source: str = ""
    verdict: str = ""
    cause: str = ""
    runs: int | None = None
    passes: int | None = None
    fails: int | None = None
    invalids: int | None = None
    failures: int | None = None
    collisions: int | None = None
    same_decision: float | None = None


@dataclass(frozen=True)
class CatalogEntry:
    """A folder of results.

    folder: absolute. host: the machine that it was put into the catalog on. written: when its results were, ISO 8601 in
    UTC. digest: SHA-256 of what it holds. resim: version that made it. verdict: over all, "" where nothing was judged.
    counts: of outcomes by verdict, the good ones first.
    """

    kind: ResultKind
    name: str
    folder: Path
    host: str
    written: str
    digest: str
    resim: str
    verdict: str
    counts: Mapping[str, int] = field(default_factory=dict)
    inputs: tuple[CatalogInput, ...] = ()
    outcomes: tuple[CatalogOutcome, ...] = ()

    @property
    def id(self) -> str:
        """Tell the entry from all others: the same content in the same folder has the same id, 16 hex digits."""
        told = os.fsencode(f"{self.kind}\n{self.folder}\n{self.digest}")
        return hashlib.sha256(told).hexdigest()[:16]

    def names(self, role: str) -> list[str]:
        """Give the names of the inputs of a role."""
        return [i.name for i in self.inputs if i.role == role]

    def state(self) -> FolderState:
        """Say whether the folder still holds this result."""
        try:
            if digest(self.folder, self.kind) == self.digest:
                return "there"
        except (OSError, InputError, ValueError, KeyError, TypeError):
            pass
        if self.host != platform.node():
            return "elsewhere"
        return "changed" if (self.folder / KINDS[self.kind][0]).is_file() else "gone"


def kind_of(folder: Path) -> ResultKind:
    """Say what kind of results a folder holds. Raises InputError where they are none, or are not finished."""
    for kind, (file, _) in KINDS.items():
        if (folder / file).is_file():
            return kind
    for kind, again in (("sweep", "resim sweep ... --resume"), ("verification", "resim verify")):
        if (folder / KINDS[kind][1].mark).is_file():
            raise InputError(folder, f"holds a {kind} that is not finished", f"Finish it with `{again}`.")
    remedy = "Give one that `resim run`, `assess --out`, `verify`, `sweep` or `mine` wrote."
    raise InputError(folder, "is no folder of results" if folder.is_dir() else "is no folder", remedy)


def digest(folder: Path, kind: ResultKind) -> str:
    """Give the SHA-256 of what a folder of results holds, without how long it took; of a sweep's table its sizes.

    Raises OSError, InputError, ValueError, KeyError or TypeError for what is not there or is no result.
    """
    told = hashlib.sha256()
    for part in _CONTENT[kind](folder):
        told.update(part)
    return told.hexdigest()


def _read(path: Path) -> bytes:
    return read_file(path, "Take it away, and make the results again.")


def _run_content(folder: Path) -> Iterator[bytes]:
    run: dict[str, Any] = parse_json(_read(folder / "run.json"), folder / "run.json")
    del run["times"], run[CHECKSUM]
    for seed in (run["perception"] or {}).get("seeds", []):
        del seed["time"]
    yield json.dumps(run, sort_keys=True).encode()
    yield _read(folder / "report.json")
    yield _read(folder / "assessment.json")


def _sweep_content(folder: Path) -> Iterator[bytes]:
    yield _read(folder / "manifest.json")
    for part in sorted((folder / "runs").glob("*.parquet")):
        yield f"{part.name} {part.stat().st_size}\n".encode()


_CONTENT: dict[ResultKind, Callable[[Path], Iterator[bytes]]] = {
    "run": _run_content,
    "sweep": _sweep_content,
    "verification": lambda folder: iter([_read(folder / "verification.json")]),
    "assessment": lambda folder: iter([_read(folder / "assessment.json")]),
    "mining": lambda folder: iter([_read(folder / "mined.json")]),
}
