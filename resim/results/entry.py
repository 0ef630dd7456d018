"""What the catalog holds of a folder of results, a recording or another file: what went in, what came out, what is
known of it, and whether it is still there."""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from resim.core.errors import InputError
from resim.core.files import parse_json, read_file
from resim.core.sealed import CHECKSUM
from resim.results.folders import ASSESSMENT, MINING, RUN, SPACE, SWEEP, VERIFICATION, FolderKind

ResultKind = Literal["run", "assessment", "verification", "sweep", "mining", "space"]
InputKind = Literal[
    "recording", "map", "scenario", "build", "model", "kernels", "criteria", "suite", "sweep-file"
]
ItemKind = ResultKind | InputKind | Literal["cluster"]
"""Whatever the lake knows; a cluster is a kind of scenario of a space."""
FolderState = Literal["there", "changed", "gone", "elsewhere"]
"""Of a folder: as it was; holding something else; not there; or of another machine, and not to be seen from here."""

KINDS: dict[ItemKind, tuple[str, FolderKind]] = {
    "run": ("run.json", RUN),
    "verification": ("verification.json", VERIFICATION),
    "sweep": ("manifest.json", SWEEP),
    "assessment": ("assessment.json", ASSESSMENT),
    "mining": ("mined.json", MINING),
    "space": ("space.json", SPACE),
}
"""Of each kind of result the file that is there once it is finished, and what its folder may hold; a run has an
assessment, too."""


NAME = "name"
"""Facet of the name that a recording gives itself, beside that of its folder."""
REPORT = "report"
"""Facet of a run's report.json, by whose hash assessments of the run name it."""


@dataclass(frozen=True)
class CatalogInput:
    """Something that a result follows from.

    role: recording, map, build, against (the older build), drove (the build that drove a recording), criteria,
    perception, suite, mining, space, run (that was assessed). name: of a recording its name, of a build its label.
    path: absolute, "" where it is not told. hash: SHA-256, "" where it is not told.
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
class CatalogFact:
    """Something that is known of a recording, a scenario or a result.

    hash: of the content that it is true of, "" for the entry itself. facet: name (that a recording gives itself),
    table, weather, tag, finding, maneuver, scenarios, risk, member, report, circumstances. name: which; value: how
    much, how often, None where that says nothing.
    """

    facet: str
    name: str
    value: float | None = None
    hash: str = ""


FileStamps = Mapping[str, list[int] | None]
"""Time of change [ns] and size of each file that an entry was read from, None for one that is not there."""


@dataclass(frozen=True)
class CatalogEntry:
    """A folder of results, a recording, or a file that jobs are given.

    folder: absolute; of what is a file alone its path. host: the machine that it was put into the catalog on. written:
    when it was, ISO 8601 in UTC. digest: SHA-256 of what it holds, "" where that cannot be told. resim: version that
    made it, "" for what it did not make. verdict: over all, "" where nothing was judged. counts: of outcomes by
    verdict, the good ones first. files: paths seen from the folder, by which a change is noticed. fault: why it cannot
    be used, "" if it can.
    """

    kind: ItemKind
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
    facts: tuple[CatalogFact, ...] = ()
    files: FileStamps = field(default_factory=dict)
    fault: str = ""

    @property
    def id(self) -> str:
        """Tell the entry from all others: the same content in the same folder has the same id, 16 hex digits."""
        told = os.fsencode(f"{self.kind}\n{self.folder}\n{self.digest}")
        return hashlib.sha256(told).hexdigest()[:16]

    @property
    def home(self) -> Path:
        """The folder that it is, or in which its file lies."""
        return self.folder if self.kind in (*KINDS, "recording", "cluster") else self.folder.parent

    def names(self, role: str) -> list[str]:
        """Give the names of the inputs of a role."""
        return [i.name for i in self.inputs if i.role == role]

    def state(self) -> FolderState:
        """Say whether the folder still holds this: by the digest of a result, by the times of anything else's files."""
        mark = self.folder
        if self.kind in KINDS:
            mark = self.folder / KINDS[self.kind][0]
            try:
                if digest(self.folder, self.kind) == self.digest:
                    return "there"
            except (OSError, InputError, ValueError, KeyError, TypeError, AttributeError):
                pass
        elif mark.exists() and stamps(self.home, self.files) == self.files:
            return "there"
        if self.host != platform.node():
            return "elsewhere"
        return "changed" if mark.exists() else "gone"


def stamps(folder: Path, names: Iterable[str]) -> dict[str, list[int] | None]:
    """Give by which a change of files is noticed; names: paths seen from the folder."""
    found: dict[str, list[int] | None] = {}
    for name in names:
        try:
            stat = (folder / name).stat()
            found[name] = [stat.st_mtime_ns, stat.st_size]
        except OSError:
            found[name] = None
    return found


def kind_of(folder: Path) -> ItemKind:
    """Say what kind of results a folder holds. Raises InputError where they are none, or are not finished."""
    for kind, (file, _) in KINDS.items():
        if (folder / file).is_file():
            return kind
    for kind, again in (("sweep", "resim sweep ... --resume"), ("verification", "resim verify")):
        if (folder / KINDS[kind][1].mark).is_file():
            raise InputError(folder, f"holds a {kind} that is not finished", f"Finish it with `{again}`.")
    remedy = "Give one that `resim run`, `assess --out`, `verify`, `sweep`, `mine` or `space` wrote."
    raise InputError(folder, "is no folder of results" if folder.is_dir() else "is no folder", remedy)


def digest(folder: Path, kind: ItemKind) -> str:
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


_CONTENT: dict[ItemKind, Callable[[Path], Iterator[bytes]]] = {
    "run": _run_content,
    "sweep": _sweep_content,
    "verification": lambda folder: iter([_read(folder / "verification.json")]),
    "assessment": lambda folder: iter([_read(folder / "assessment.json")]),
    "mining": lambda folder: iter([_read(folder / "mined.json")]),
    "space": lambda folder: iter([_read(folder / "space.json")]),
}
