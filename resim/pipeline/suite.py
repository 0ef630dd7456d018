"""A suite: the recordings that a build is verified on, by what, and how exactly; a TOML file."""

from __future__ import annotations

import glob
import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from resim.core import faults
from resim.core.errors import InputError
from resim.core.files import file_hash, parse_toml, read_file, refuse_undecodable
from resim.ingest.settings import SETTINGS, read_settings
from resim.variation import PARAMETERS
from resim.verification.paired import Limits
from resim.verification.tolerance import Tolerances

EXAMPLE = "See scenarios/suites/highway.toml, or make one with `resim suite new`."
_FILES = re.compile(r"(recording\.toml|(gt|sd|plan)\.(csv|parquet))")


class Strict(BaseModel):
    """A file's part: what it does not know, and what is no number, is refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


File = TypeVar("File", bound=Strict)


class Entry(Strict):
    """A recording of a suite: its folder, or a glob of folders; hash: SHA-256 of its content (`content_hash`)."""

    folder: str = Field(min_length=1)
    hash: str | None = Field(default=None, pattern="^[0-9a-f]{64}$")


class SuiteFile(Strict):
    """What a suite's file says; paths from the folder of the file.

    bases: what is re-simulated; seeds, seed: how many runs with the perception model at most, and the first one's seed.
    agreement: more than this share of the seeds must agree, as `SequentialTest` tells it. vary: parameters of which the
    range is searched in which the verdicts hold. accept: codes of findings in spite of which to go on. driven_by: other
    builds whose recordings are taken. reports: of how many recordings that are not good there is a re-simulation
    report, the worst first.
    """

    name: str = Field(min_length=1)
    recording: tuple[Entry, ...] = Field(min_length=1)
    criteria: str = Field(min_length=1)
    bases: tuple[Literal["GT", "SD"], ...] = Field(default=("GT", "SD"), min_length=1)
    perception: str | None = None
    seeds: int = Field(strict=True, default=200, ge=1, le=5000)
    seed: int = Field(strict=True, default=0, ge=0)
    agreement: float = Field(strict=True, default=0.9, ge=0.5, le=0.99)
    vary: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
    driven_by: tuple[str, ...] = ()
    tolerances: Tolerances = Tolerances()
    limits: Limits = Limits()
    reports: int = Field(strict=True, default=10, ge=0)

    @field_validator("bases", "vary", "accept", "driven_by")
    @classmethod
    def _once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{twice[0]!r} stands twice")
        return names


class Suite(Strict):
    """A suite, with its recordings found: folders by name, and the hashes that they must have."""

    path: Path
    file: SuiteFile
    folders: dict[str, Path]
    hashes: dict[str, str]

    def beside(self, name: str) -> Path:
        """Give the path of what the file names."""
        return joined(self.path, name)


def read_strict(path: Path, kind: type[File], example: str) -> File:
    """Read a TOML file of this kind. Raises InputError naming every fault; example: where one is to be seen."""
    try:
        return kind.model_validate(parse_toml(read_file(path, example), path, example))
    except ValidationError as e:
        raise InputError(path, faults.said(e.errors()), example) from e


def read_suite(path: Path) -> Suite:
    """Read a suite and find its recordings. Raises InputError naming every fault."""
    file = read_strict(path, SuiteFile, EXAMPLE)
    if strange := [name for name in file.vary if name not in PARAMETERS]:
        raise InputError(path, f"vary: there is no {strange[0]!r}", f"There are: {', '.join(PARAMETERS)}.")
    folders, hashes = found_folders(path, file.recording)
    return Suite(path=path, file=file, folders=folders, hashes=hashes)


def found_folders(path: Path, entries: Sequence[Entry]) -> tuple[dict[str, Path], dict[str, str]]:
    """Give the recordings that the entries of the file at `path` name, and the hashes that they must have, by name."""
    found: list[Path] = []
    hashes: dict[Path, str] = {}
    for entry in entries:
        folders = _folders(path, entry)
        if entry.hash is not None and hashes.setdefault(folders[0], entry.hash) != entry.hash:
            raise InputError(
                path, f"recording {entry.folder!r} stands twice, with two hashes", "Take one away."
            )
        found += [folder for folder in folders if folder not in found]
    named = dict(zip(_names(found), found, strict=True))
    return named, {name: hashes[folder] for name, folder in named.items() if folder in hashes}


def _folders(path: Path, entry: Entry) -> list[Path]:
    """The recordings of an entry; one that is not there is told of when its turn comes."""
    whole = joined(path, entry.folder)
    if entry.hash is not None or not glob.has_magic(entry.folder):
        return [whole]
    try:
        found = sorted(f for f in _matching(whole) if (f / SETTINGS).is_file())
    except ValueError as e:
        raise InputError(path, f"recording {entry.folder!r} is no glob ({e})", "Correct it.") from e
    for folder in found:
        refuse_undecodable(folder)
    if not found:
        raise InputError(path, f"recording {entry.folder!r}: no recording is there", "Correct the glob.")
    return found


def _matching(pattern: Path) -> Iterator[Path]:
    """Paths that a glob fits."""
    root = Path(pattern.anchor)
    return root.glob(str(pattern.relative_to(root)) if pattern.anchor else str(pattern))


def joined(path: Path, name: str) -> Path:
    """Give the path of what the file at `path` names."""
    return Path(os.path.normpath(path.parent / name))


def relative(path: Path, folder: Path) -> str:
    """Give a path as seen from a folder, the same on every machine."""
    return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()


def _names(folders: Sequence[Path]) -> list[str]:
    """Names of recordings, each its own: of the folder, with as many folders above as it takes, else with a number."""
    out: list[str] = []
    for folder in folders:
        parts = [re.sub(r"[^\w.-]", "_", part) for part in folder.absolute().parts if part.strip("/")]
        choices = [".".join(parts[-depth:]) for depth in range(1, len(parts) + 1)]
        numbered = (f"{parts[-1]}.{number}" for number in count(2))
        out.append(next(name for name in chain(choices, numbered) if name not in out))
    return out


def content_hash(folder: Path) -> str:
    """Give the SHA-256 of a recording: of its settings, tables and map. Raises InputError."""
    settings = read_settings(folder / SETTINGS)
    files = {p.name: file_hash(p, EXAMPLE) for p in folder.iterdir() if _FILES.fullmatch(p.name)}
    road = file_hash(folder / settings.map, "The recording names a map that is not there.")
    return hash_of_hashes(files, road)


def refuse_changed(folder: Path, digest: str | None) -> None:
    """Raise InputError where a recording's content has not this hash, or had none (None) when the command began."""
    found = content_hash(folder)
    if digest is None:
        raise InputError(folder, "could not be read when this began", "Begin anew.")
    if found != digest:
        problem = f"its content has the hash {found[:12]}…, expected was {digest[:12]}…"
        raise InputError(folder, problem, "Restore the recording, or begin anew with it as it is.")


def hash_of_hashes(files: Mapping[str, str], road: str) -> str:
    """Give the SHA-256 of a recording from those of its files by name (others are left out) and of its map."""
    told = hashlib.sha256()
    for name in sorted(name for name in files if _FILES.fullmatch(name)):
        told.update(f"{name} {files[name]}\n".encode())
    told.update(f"map {road}\n".encode())
    return told.hexdigest()


def new_suite(folders: Sequence[Path], criteria: Path, out: Path, name: str) -> str:
    """Give the text of a suite of these recordings, with their hashes, for a file at `out`. Raises InputError."""

    folder_of = out.absolute().parent
    entries = [
        f'[[recording]]\nfolder = {json.dumps(relative(folder, folder_of))}\nhash = "{content_hash(folder)}"\n'
        for folder in folders
    ]
    head = (
        f'name = {json.dumps(name)}\ncriteria = {json.dumps(relative(criteria, folder_of))}\nbases = ["GT", "SD"]\n'
        "seeds = 200  # with a perception model, at most\nagreement = 0.9  # more of the seeds than that\n\n"
    )
    return head + "\n".join(entries) + "\n" + tolerances_text()


def tolerances_text() -> str:
    """Give the tolerances that hold where a suite says nothing, as TOML."""
    held = Tolerances()
    lines = [
        "# Largest root mean square errors [m, m/s, rad]; reaction: of first braking [s].",
        "[tolerances]",
    ]
    lines.append(f"reaction = {held.reaction:g}")
    for step in ("sensor", "fit", "simulation", "vehicle", "pipeline"):
        for who in ("ego", "to"):
            limits = getattr(getattr(held, step), who).model_dump(exclude_none=True)
            if limits:
                lines.append(
                    f"{step}.{who} = {{ " + ", ".join(f"{k} = {v:g}" for k, v in limits.items()) + " }"
                )
    return "\n".join(lines) + "\n"
