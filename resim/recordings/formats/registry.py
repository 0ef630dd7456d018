"""The recording formats: each becomes a command `resim import NAME`, made from what its file says here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from resim.core.registry import Registry
from resim.recordings.recording import Recording
from resim.recordings.source import RecordingTables


@dataclass(frozen=True)
class FormatOption:
    """An option that one format has beside those of all: `--name`, given to the reader as `name`.

    type: str, int, float, bool, Path or a tuple of these; the option's value is None where it is not given.
    required: whether it has to be given. patterns: of a file how such are called, for choosing one.
    """

    name: str
    type: Any
    help: str
    metavar: str | None = None
    required: bool = False
    patterns: tuple[str, ...] = ("*",)


@dataclass(frozen=True)
class RecordingFormat:
    """A format of recordings that others write.

    name: of the command. source: what it reads, in words ("a CommonRoad scenario"). file: the name of the file to
    read, as the command's usage has it; file_help: what that file is.
    reader: called with the file, and by keyword with map (Path), ego (id), start, end ([s] or None) and the format's
    own options; gives the Recording, or tables with faults in them for `resim check`; raises InputError naming file,
    place and value.
    works_out: of map and ego, what the reader finds where the option is not given, which is then None.
    patterns: how such files are called, for choosing one; "./NAME" is a folder that holds a file of this name.
    """

    name: str
    source: str
    file: str
    file_help: str
    reader: Callable[..., Recording | RecordingTables]
    options: tuple[FormatOption, ...] = ()
    works_out: tuple[str, ...] = ()
    patterns: tuple[str, ...] = ("*",)


FORMATS: Registry[RecordingFormat] = Registry("recording format")
"""Every format, added by its own file."""
