"""What a build file says of an AD function that is a process: the command, and which of its parts the hash is of."""

from __future__ import annotations

import os
import posixpath
import shutil
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictStr, model_validator

import resim.function
from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenCopy
from resim.core.plugins.unlisted_files import NOT_PINNED

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
    """

    model_config = ConfigDict(extra="forbid")
    command: tuple[StrictStr, ...] = ()
    python: StrictStr = Field(default="")
    batches: StrictBool = False

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


@dataclass(frozen=True)
class FunctionProgram:
    """What is started for a run.

    Attributes:
        command: Program and arguments.
        folder: Where it works: the build's frozen copy.
        unpinned: What of it the build's hash does not cover, in words; "" for nothing.
    """

    command: tuple[str, ...]
    folder: Path
    unpinned: str


def own_files(path: Path, process: ProcessTable) -> list[str]:
    """Give the files that the command names in the folder of the build file at `path`, as seen from there."""
    return [posixpath.normpath(word) for word in process.command if _is_own(path.parent, word)]


def outside(path: Path, process: ProcessTable) -> dict[str, Path]:
    """Give the program, by its word, where it is not in the build's folder. Raises InputError where it is nowhere."""
    word = process.first
    return {} if process.command and _is_own(path.parent, word) else {word: _found(path, process)}


def program_of(path: Path, process: ProcessTable, factory: str, copy: FrozenCopy) -> FunctionProgram:
    """Give the program of a build as it was frozen. Raises InputError where it is not there, or another by now."""
    word, rest = process.first, process.command[1:]
    if process.command and posixpath.normpath(word) in copy.names:
        return FunctionProgram((str(copy.folder / word), *rest), copy.folder, "")
    file = _found(path, process)
    if file_hash(file) != copy.outside.get(word):
        raise InputError(path, f"process: {str(file)!r} has changed since it was first read", "Begin anew.")
    served = (resim.function.__file__, factory) if process.python else ()
    why = f"what {word} loads beside the files of the build {NOT_PINNED}"
    return FunctionProgram((str(file), *served, *rest), copy.folder, why)


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
