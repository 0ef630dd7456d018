"""A conversation with a function, recorded: what it was asked and answered in a run, byte for byte.

A file is a row of messages, each its length and msgpack, as they are sent: first who spoke (`Speaker`) with a checksum
of the whole, then in turn what was asked and what was answered, empty where no answer came. It takes the function's
place (`RecordedPartner`), or is held against it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import msgpack
from pydantic import Field, TypeAdapter, ValidationError

from resim.core.errors import FunctionError, InputError
from resim.core.files import read_file
from resim.core.sealed import CHECKSUM
from resim.function import framed, packed

SUFFIX = ".conversation"
VERSION = 2
REMEDY = "Record it again, with `resim run --record`."
Exchange = tuple[bytes, bytes]
CycleTime = Annotated[float | None, Field(strict=True, gt=0, allow_inf_nan=False)]
TimeLimit = Annotated[float, Field(strict=True, ge=0.001, le=3600.0)]
_Named = Annotated[str, Field(min_length=1)]


@dataclass(frozen=True)
class Speaker:
    """Who answered: name, version and hash of a build, its cycle time [s] and time limit [s]."""

    name: _Named
    version: _Named
    hash: str
    cycle_time: CycleTime
    time_limit: TimeLimit


@dataclass(frozen=True, eq=False)
class Conversation:
    """What one run was asked and answered: messages with their lengths, and answers without, b"" for none.

    failure: why the function failed in it, "" where it did not. file: name of the file that it was read from.
    """

    speaker: Speaker
    exchanges: Sequence[Exchange]
    failure: str = ""
    file: str = ""

    def packed(self) -> bytes:
        """Give it as a file holds it."""
        head = {"conversation": VERSION, "failure": self.failure, **asdict(self.speaker)}
        rest = b"".join(part for asked, answered in self.exchanges for part in (asked, framed(answered)))
        return packed({**head, CHECKSUM: _checksum(head, rest)}) + rest

    @cached_property
    def first(self) -> bytes:
        """What was asked first, wherever the map lay."""
        return anywhere(self.exchanges[0][0])

    @property
    def parameters(self) -> dict[str, Any]:
        """What the function was made with."""
        given: dict[str, Any] = msgpack.unpackb(self.exchanges[0][0][4:])["parameters"]
        return given


_SPEAKER = TypeAdapter(Speaker)


def build_file(speaker: Speaker) -> str:
    """Give the text of a build file of the conversations in its folder."""
    name, version = (json.dumps(text, ensure_ascii=False) for text in (speaker.name, speaker.version))
    told = "# What this build was asked and answered, in place of it: docs/guides/outside.md."
    return f'{told}\nname = {name}\nversion = {version}\n\n[recorded]\nconversations = "."\n'


def read_conversation(path: Path, named: Path | None = None) -> Conversation:
    """Read a file; named: what errors call it. Raises InputError for one that is cut, changed since, or none."""
    raw, where = read_file(path, REMEDY), named or path
    try:
        head, *rest = _messages(raw)
        said = _map_of(head, "its first message")
        if said.get("conversation") != VERSION:
            raise ValueError(f"does not begin with conversation = {VERSION}")
        if said.pop(CHECKSUM, None) != _checksum(said, raw[len(head) :]):
            raise InputError(where, "was changed after it was recorded: its checksum does not match", REMEDY)
        failure = said.pop("failure", None)
        del said["conversation"]
        if not isinstance(failure, str) or set(said) != {f.name for f in fields(Speaker)}:
            raise ValueError("begins otherwise")
        if not rest or len(rest) % 2:
            raise ValueError(f"has {len(rest)} messages, expected questions with an answer each")
        asked = [_map_of(question, f"question {k}") for k, question in enumerate(rest[::2], start=1)]
        if not _has_text_names(asked[0].get("parameters")):
            raise ValueError("its first message has no parameters, each with a text as name")
        pairs = zip(rest[::2], (answered[4:] for answered in rest[1::2]), strict=True)
        return Conversation(_SPEAKER.validate_python(said), tuple(pairs), failure, path.name)
    except ValidationError as e:
        first = e.errors()[0]
        raise InputError(where, f"speaker's {first['loc'][0]}: {first['msg']}", REMEDY) from e
    except ValueError as e:
        raise InputError(where, f"is no recorded conversation: {e}", REMEDY) from e


def _checksum(head: Mapping[str, Any], rest: bytes) -> str:
    """SHA-256 of all that a file says but this."""
    return hashlib.sha256(packed(dict(head)) + rest).hexdigest()


def _map_of(message: bytes, what: str) -> dict[str, Any]:
    """What a message says. Raises ValueError where that is no map."""
    try:
        told = msgpack.unpackb(message[4:])
    except (ValueError, msgpack.UnpackException) as e:
        raise ValueError(f"{what} is no msgpack") from e
    if not isinstance(told, dict):
        raise ValueError(f"{what} is {told!r:.40}, expected a map")
    return told


def _has_text_names(given: Any) -> bool:
    return isinstance(given, dict) and all(isinstance(name, str) for name in given)


def _messages(raw: bytes) -> Iterator[bytes]:
    if not raw:
        raise ValueError("it is empty")
    at = 0
    while at < len(raw):
        size = 4 + int.from_bytes(raw[at : at + 4], "little")
        if at + size > len(raw):
            raise ValueError(f"it is cut after {len(raw)} bytes, within a message")
        yield raw[at : at + size]
        at += size


def anywhere(asked: bytes) -> bytes:
    """Give a first message without the place of the map, which differs from machine to machine."""
    told = msgpack.unpackb(asked[4:])
    if isinstance(told, dict) and isinstance(told.get("road"), dict):
        told["road"].pop("file", None)
    return packed(told)


class RecordedPartner:
    """Answers what was recorded to who asks the same, and nothing to anybody else.

    Of several conversations those are followed that went the same way so far.
    """

    def __init__(self, conversations: Sequence[Conversation]) -> None:
        self._all = self._left = tuple(conversations)
        self._at = 0

    def start(self) -> None:
        """Begin anew."""
        self._left, self._at = self._all, 0

    def exchange(self, message: bytes) -> bytes:
        """Give the answer that was recorded."""
        at, asked = self._at, message if self._at else anywhere(message)
        there = [c for c in self._left if at < len(c.exchanges)]
        ended = [c for c in self._left if at == len(c.exchanges) and c.failure]
        self._left = tuple(c for c in there if (c.exchanges[at][0] if at else c.first) == asked)
        _agreed(ended, self._left)
        if not there:
            raise FunctionError("was recorded for a shorter drive: nothing more was asked")
        if not self._left:
            recorded = (c.exchanges[at][0] if at else c.first for c in there)
            raise FunctionError(f"was recorded for another drive: {difference(asked, *recorded)}")
        self._at += 1
        first, answer = self._left[0], self._left[0].exchanges[at][1]
        if other := next((c for c in self._left if c.exchanges[at][1] != answer), None):
            raise _differ(first, other)
        if not answer:
            raise FunctionError(f"failed when it was recorded: {first.failure}")
        return answer

    def end(self, message: bytes) -> None:
        """Raise FunctionError where it failed on closing when it was recorded, in all conversations or in one."""
        ended = [c for c in self._left if self._at == len(c.exchanges)]
        _agreed([c for c in ended if c.failure], [c for c in ended if not c.failure])

    def kill(self) -> None:
        """Nothing is left to do."""


def _agreed(failed: Sequence[Conversation], others: Sequence[Conversation]) -> None:
    """Raise FunctionError where conversations that went the same way `failed` here, whether or not `others` did not."""
    if failed and others:
        raise _differ(failed[0], others[0])
    if failed:
        raise FunctionError(f"failed when it was recorded: {failed[0].failure}")


def _differ(one: Conversation, other: Conversation) -> FunctionError:
    first, second = sorted((one.file, other.file))
    return FunctionError(f"answers differ between recordings (not deterministic): {first} and {second}")


def difference(message: bytes, *recorded: bytes) -> str:
    """Say where a message, with its length, differs first from the one recorded that is nearest to it."""
    one = msgpack.unpackb(message[4:])
    others = [[*_differences(one, msgpack.unpackb(other[4:]), "")] for other in recorded]
    nearest = min(others, key=len)
    t = f"at t = {one['t']:.2f} s " if isinstance(one, dict) and isinstance(one.get("t"), float) else ""
    if not nearest:
        return f"{t}the bytes differ, not what they say"
    name, found, was = nearest[0]
    return f"{t}{name.lstrip('.')} is {found!r:.60}, recorded was {was!r:.60}"


def _differences(one: Any, other: Any, name: str) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        for key in one:
            yield from _differences(one[key], other[key], f"{name}.{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for k, pair in enumerate(zip(one, other, strict=True)):
            yield from _differences(*pair, f"{name}[{k}]")
    elif type(one) is not type(other) or packed({"": one}) != packed({"": other}):
        yield name, one, other
