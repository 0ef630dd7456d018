"""What a build file says of an AD function that is asked by messages: a process, a server, or what was recorded."""

from __future__ import annotations

import os
import posixpath
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictStr, model_validator

import resim.function
from resim.core.errors import FunctionError, InputError
from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenCopy
from resim.core.plugins.unlisted_files import NOT_PINNED
from resim.simulation.function.conversation import SUFFIX, Conversation, RecordedPartner, read_conversation
from resim.simulation.function.fmu import FmiTable, fmu_command
from resim.simulation.function.grpc_stream import GrpcProgram
from resim.simulation.function.process import ChildProcess

REMEDY = "Name a program beside the build file, by its path, or one on PATH."
NO_PYTHON = (
    "Make the environment that it belongs to, or name one by its path from the build file, or on PATH."
)


class ProcessTable(BaseModel):
    """`[process]`: how the function is started.

    Attributes:
        command: Program and arguments; files beside the build file are named relative to it.
        python: In place of it, the Python of the environment in which `factory` is served.
        batches: Whether it answers `reset_batch` and `step_batch`.
        environment: Variables of the environment that it gets, besides those that every process gets.
    """

    model_config = ConfigDict(extra="forbid")
    command: tuple[StrictStr, ...] = ()
    python: StrictStr = Field(default="")
    batches: StrictBool = False
    environment: tuple[StrictStr, ...] = ()

    @model_validator(mode="after")
    def _one_of_both(self) -> ProcessTable:
        if bool(self.command) == bool(self.python):
            raise ValueError("expected command, or python beside factory")
        if self.command and not self.command[0]:
            raise ValueError("command: the first word is empty, expected a program")
        return self

    @property
    def first(self) -> str:
        """The word that names the program."""
        return self.command[0] if self.command else self.python


class RecordedTable(BaseModel):
    """`[recorded]`: what takes the function's place.

    Attributes:
        conversations: Folder beside the build file, with one `.conversation` or more.
    """

    model_config = ConfigDict(extra="forbid")
    conversations: StrictStr


@dataclass(frozen=True)
class FunctionProgram:
    """What is started for a run.

    Attributes:
        command: Program and arguments.
        folder: The build's frozen copy.
        unpinned: What of it the build's hash does not cover, in words.
        own: Whether the program lies in the folder.
        hash: SHA-256 of a program that lies elsewhere.
        environment: Variables of the environment that it gets.
        files: SHA-256 of each file in the folder, by its name as seen from there.
    """

    command: tuple[str, ...]
    folder: Path
    unpinned: str
    own: bool
    hash: str = ""
    environment: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)

    def partner(self, *, grouped: bool = False) -> ChildProcess:
        """Give a process for one run; grouped: a process group of its own."""
        return ChildProcess(
            self.command, self.folder, self.own, self.environment, self.refuse_changed, grouped=grouped
        )

    def refuse_changed(self, home: Path) -> None:
        """Raise FunctionError where what is to be run is not what was hashed: a program elsewhere, or the files of the
        build in their copy at `home`, of which a run before may have written the origin."""
        if not self.own and _hash_of(self.command[0]) != self.hash:
            raise FunctionError(f"cannot be started: {self.command[0]!r} has changed since it was first read")
        there = {file.relative_to(home).as_posix() for file in home.rglob("*") if not file.is_dir()}
        own = {name: digest for name, digest in self.files.items() if not name.startswith("..")}
        changed = there ^ set(own) or {name for name in own if _hash_of(str(home / name)) != own[name]}
        if changed:
            raise FunctionError(
                f"cannot be started: the copy of its file {min(changed)!r} has changed since it was made"
            )


def _hash_of(file: str) -> str:
    """SHA-256 of a program, read once for each time that it was written."""
    try:
        found = os.stat(file)  # noqa: PTH116
    except OSError:
        return ""
    return _hashed(file, (found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns))


@lru_cache(maxsize=64)
def _hashed(file: str, written: tuple[int, ...]) -> str:
    try:
        return file_hash(Path(file))
    except InputError:  # a pipe or device in its place
        return ""


@dataclass(frozen=True, eq=False)
class RecordedProgram:
    """What was recorded of a function.

    Attributes:
        conversations: What it was asked and answered, run by run.
        unpinned: "": all of it is in the build's hash.
    """

    conversations: tuple[Conversation, ...] = field(repr=False)
    unpinned: str = ""

    def partner(self) -> RecordedPartner:
        """Give who answers what was recorded, for one run."""
        return RecordedPartner(self.conversations)


NamedProgram = FunctionProgram | GrpcProgram | RecordedProgram
"""What a build may name that is asked by messages."""


def refuse_unrecordable(path: Path, program: NamedProgram | None) -> None:
    """Raise InputError for a build that is no process or server, whose conversation could be recorded."""
    if isinstance(program, FunctionProgram | GrpcProgram):
        return
    what = (
        "is recorded already"
        if program is not None
        else "is Python of this environment, which nobody talks to"
    )
    remedy = "Serve it as a process: `[process]` with `python`."
    raise InputError(path, f"{what}, so there is no conversation to record or repeat", remedy)


def served_program(path: Path, program: NamedProgram | None) -> FunctionProgram:
    """Give the process of a build, to serve it. Raises InputError for a build of another kind."""
    if isinstance(program, FunctionProgram):
        return program
    raise InputError(
        path, "is no process, which alone is served", "Give it `[process]`, with command or python."
    )


def recorded_files(path: Path, recorded: RecordedTable) -> list[str]:
    """Give the conversations of a build file, as seen from its folder. Raises InputError where there is none."""
    name = posixpath.normpath(recorded.conversations)
    found = sorted(
        posixpath.normpath(f"{name}/{file.name}") for file in (path.parent / name).glob(f"*{SUFFIX}")
    )
    if not found:
        problem = f"recorded: there is no {SUFFIX} in the folder {recorded.conversations!r} beside it"
        raise InputError(path, problem, "`resim run --record` makes some.")
    return found


def recorded_program(
    path: Path, recorded: RecordedTable, copy: FrozenCopy, name: str, version: str
) -> RecordedProgram:
    """Read the conversations of a build as it was frozen. Raises InputError where they are not all of one
    build of that name and version.
    """
    named = posixpath.normpath(recorded.conversations)
    files = sorted((copy.folder / named).glob(f"*{SUFFIX}"))
    found = tuple(read_conversation(file, path.parent / named / file.name) for file in files)
    speakers = {(repr(one.speaker), repr(sorted(one.parameters.items(), key=repr))) for one in found}
    if len(speakers) > 1:
        problem = f"recorded: the {len(found)} conversations are of {len(speakers)} builds"
        raise InputError(path, problem, "Give each build a folder of its own.")
    spoke = found[0].speaker
    if (spoke.name, spoke.version) != (name, version):
        of, their = f"{name!r}, version {version!r}", f"{spoke.name!r}, version {spoke.version!r}"
        problem = f"is of {of}, but its conversations are of {their}"
        raise InputError(path, problem, "Give the build file the name and version of who answered.")
    return RecordedProgram(found)


def own_files(path: Path, process: ProcessTable) -> list[str]:
    """Give the files that the command names in the folder of the build file at `path`, as seen from there."""
    return [posixpath.normpath(word) for word in process.command if _is_own(path.parent, word)]


def outside(path: Path, process: ProcessTable) -> dict[str, Path]:
    """Give the program, by its word, where it is not in the build's folder. Raises InputError where it is nowhere."""
    word = process.first
    return {} if process.command and _is_own(path.parent, word) else {word: _found(path, process)}


def program_of(path: Path, process: ProcessTable, factory: str, copy: FrozenCopy) -> FunctionProgram:
    """Give the program of a build as it was frozen. Raises InputError where it is not there, or another by now."""
    word, rest, named = process.first, process.command[1:], process.environment
    if process.command and posixpath.normpath(word) in copy.names:
        unpinned = _unpinned(word, named)
        return FunctionProgram(
            (word, *rest), copy.folder, unpinned, own=True, environment=named, files=copy.digests
        )
    program = _found(path, process)
    if file_hash(program) != copy.outside.get(word):
        raise InputError(
            path, f"process: {str(program)!r} has changed since it was first read", "Begin anew."
        )
    served = (resim.function.__file__, factory) if process.python else ()
    return FunctionProgram(
        (str(program), *served, *rest), copy.folder, _unpinned(word, named), own=False, hash=copy.outside[word],
        environment=named, files=copy.digests,
    )  # fmt: skip


def unit_program(
    path: Path, fmi: FmiTable, parameters: Mapping[str, Any], copy: FrozenCopy
) -> FunctionProgram:
    """Give the program that serves a unit as it was frozen. Raises InputError where the build does not fit it."""
    command, needs_tool = fmu_command(path, fmi, parameters, copy.folder)
    unpinned = _unpinned(fmi.file, ()) if not needs_tool else f"the tool that {fmi.file} needs {NOT_PINNED}"
    return FunctionProgram(
        command, copy.folder, unpinned, own=False, hash=_hash_of(command[0]), files=copy.digests
    )


def _unpinned(word: str, variables: tuple[str, ...]) -> str:
    """What the hash of a program does not cover: what lies elsewhere, and the variables that it gets."""
    named = f"what {' and '.join(variables)} of the environment {'are' if len(variables) > 1 else 'is'} and "
    return f"{named if variables else ''}what {word} loads beside the files of the build {NOT_PINNED}"


def _is_own(folder: Path, word: str) -> bool:
    """Whether a word names a file in the folder, and not, by a link or .., one outside."""
    if not word or word.startswith(("/", "-")) or len(word) > 255 or "\0" in word:
        return False
    file = Path(os.path.realpath(folder / word))
    return file.is_file() and file.is_relative_to(os.path.realpath(folder))


def _found(path: Path, process: ProcessTable) -> Path:
    """Where the program lies that the first word names: relative to the build file with a / in it, else on PATH."""
    word = process.first
    file = Path(os.path.normpath(path.parent.absolute() / word)) if "/" in word else None
    if file is None and (there := shutil.which(word)) is not None:
        file = Path(there).absolute()
    if file is None or not file.is_file():
        remedy = NO_PYTHON if process.python else REMEDY
        raise InputError(path, f"process: there is no program {word!r}", remedy)
    if not os.access(file, os.X_OK):
        raise InputError(path, f"process: {word!r} is no program that you may execute", "Make it executable.")
    return file
