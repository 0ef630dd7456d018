"""How the bytes of a message become named values: JSON, protobuf and ROS 2's CDR."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.recordings.logs.cdr import LONGEST_BYTES, CdrReader, Wanted
from resim.recordings.logs.definitions import definitions, full_name
from resim.recordings.logs.limits import DEEPEST, LONGEST_ARRAY, MOST_ELEMENTS
from resim.recordings.logs.raw import LogChannel, need

ENCODINGS = ("cdr", "protobuf", "json")


def decoder(
    path: Path, channel: LogChannel, wanted: Wanted, list_path: tuple[str, ...], distribution: str | None
) -> Callable[[bytes], object]:
    """Give what makes dicts, lists, numbers and texts of a channel's messages; it raises ValueError for a wrong one.

    Raises InputError for an encoding that is not read, a definition that is none, and where a library is missing.
    """
    if channel.encoding not in ENCODINGS:
        problem = f"the messages of {channel.topic} are encoded as {channel.encoding[:40]!r}"
        remedy = f"Supported: {', '.join(ENCODINGS)}."
        if channel.encoding == "ros1":
            remedy += " Convert a bag of ROS 1: rosbags-convert --src FILE.bag --dst FOLDER."
        raise InputError(path, problem, remedy)
    try:
        if channel.encoding == "json":
            return _of_json
        if channel.encoding == "protobuf":
            return _of_protobuf(path, channel, wanted, list_path)
        types = definitions(path, channel, distribution)
        return CdrReader(types, full_name(channel.type), wanted, list_path).read
    except ValueError as e:
        remedy = "Record the topic again, with its message definitions (MCAP, or rosbag2 of iron and later)."
        raise InputError(path, f"messages of {channel.topic} cannot be read: {e}", remedy) from e


def _of_json(body: bytes) -> object:
    try:
        found = json.loads(body)
        if b"\\ud" in body.lower():
            json.dumps(found, ensure_ascii=False).encode()  # half a character is no text
        return found
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    except UnicodeDecodeError as e:
        raise ValueError(f"it is no UTF-8 ({e})") from e


def _of_protobuf(
    path: Path, channel: LogChannel, wanted: Wanted, list_path: tuple[str, ...]
) -> Callable[[bytes], object]:
    need(path, "google.protobuf", "messages in protobuf")
    from google.protobuf.descriptor_pb2 import FileDescriptorSet
    from google.protobuf.descriptor_pool import DescriptorPool
    from google.protobuf.message_factory import GetMessageClass

    try:
        files = {file.name: file for file in FileDescriptorSet.FromString(channel.schema).file}
        pool = DescriptorPool()
        while files:
            ready = [
                n for n, file in files.items() if not any(d in files and d != n for d in file.dependency)
            ]
            if not ready:
                raise ValueError("files need each other in a circle")
            for name in ready:
                pool.Add(files.pop(name))
        kind: Any = GetMessageClass(pool.FindMessageTypeByName(channel.type))
    except Exception as e:  # what a schema that lies makes protobuf raise is TypeError, KeyError and others
        raise ValueError(f"its schema {channel.type!r} is wrong ({' '.join(str(e).split())[:200]})") from e

    def read(body: bytes) -> object:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                message = kind.FromString(body)
        except Exception as e:  # DecodeError, and RecursionError
            raise ValueError(f"it is no {channel.type} ({' '.join(str(e).split())[:200]})") from e
        return _plain(message, wanted, list_path, ())

    return read


def _plain(
    message: Any, wanted: Wanted, list_path: tuple[str, ...], path: tuple[str, ...]
) -> dict[str, object]:
    """The wanted fields of a protobuf message; one that is not set, and knows so, is left out."""
    if len(path) > DEEPEST:
        raise ValueError(f"{'.'.join(path)[:60]!r} is nested deeper than {DEEPEST} levels")
    found: dict[str, object] = {}
    for field in message.DESCRIPTOR.fields:
        if wanted is not None and field.name not in wanted:
            continue
        inner, here = None if wanted is None else wanted[field.name], (*path, field.name)
        value = getattr(message, field.name)
        if _is_repeated(field):
            found[field.name] = _many(field, value, inner if here == list_path else None, list_path, here)
        elif not field.has_presence or message.HasField(field.name):
            found[field.name] = _one(field, value, inner, list_path, here)
    return found


def _is_repeated(field: Any) -> bool:
    """Whether it is a list: by `is_repeated` since protobuf 6.31, by `label` until 6."""
    known = getattr(field, "is_repeated", None)
    return bool(field.label == field.LABEL_REPEATED if known is None else known)


def _many(
    field: Any, values: Any, wanted: Wanted, list_path: tuple[str, ...], path: tuple[str, ...]
) -> object:
    entry = field.message_type
    if entry is not None and entry.GetOptions().map_entry:
        return None
    if len(values) > (MOST_ELEMENTS if entry is not None else max(LONGEST_ARRAY, LONGEST_BYTES)):
        if entry is None:
            return None
        raise ValueError(f"{'.'.join(path)} has {len(values)} elements, expected up to {MOST_ELEMENTS}")
    return [_one(field, value, wanted, list_path, path) for value in values]


def _one(field: Any, value: Any, wanted: Wanted, list_path: tuple[str, ...], path: tuple[str, ...]) -> object:
    if field.message_type is not None:
        return _plain(value, wanted, list_path, path)
    if field.enum_type is not None:
        known = field.enum_type.values_by_number.get(value)
        return value if known is None else known.name
    return value
