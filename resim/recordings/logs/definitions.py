"""Definitions of ROS 2 message types: those in a log, Autoware's and those of a distribution."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal

from resim.core.errors import InputError
from resim.recordings.logs.cdr import PRIMITIVES, Definitions, MessageField
from resim.recordings.logs.idl import MOST_FIXED, parse_idl
from resim.recordings.logs.raw import LogChannel, need

Distribution = Literal["foxy", "galactic", "humble", "iron", "jazzy", "kilted"]
"""Distributions of ROS 2 whose message definitions rosbags has."""
DEFAULT = "humble"
"""Distribution whose definitions are taken where neither the log nor the mapping says one."""
_LINE = re.compile(
    r"(?P<type>[A-Za-z][\w/]*)(<=\d+)?(?P<list>\[(?:(?P<most><=)?(?P<size>\d+))?\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)"
)
_SEPARATOR = re.compile(r"^={80}\s*$", re.MULTILINE)
_ALIASES = {
    "Header": "std_msgs/msg/Header",
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
}


def definitions(path: Path, channel: LogChannel, distribution: str | None) -> Definitions:
    """Give what is known of a channel's type and of all types in it.

    path: of the log, for errors; distribution: the one that the mapping states. Raises InputError where a definition
    cannot be read, or a library is missing.
    """
    known = dict(_own())
    try:
        if channel.schema_encoding == "ros2msg":
            return known | parse(channel.schema.decode(), channel.type)
        if channel.schema_encoding == "ros2idl":
            return known | _of_idl(channel.schema.decode())
    except ValueError as e:
        problem = f"the definition of {channel.type} cannot be read ({_short(e)})"
        raise InputError(path, problem, "Record the topic again.") from e
    need(path, "rosbags", "logs without message definitions")
    return dict(_standard(distribution or channel.distribution or DEFAULT)) | known


def full_name(name: str) -> str:
    """Give the full name of a type: geometry_msgs/Pose is geometry_msgs/msg/Pose."""
    package, _, own = name.rpartition("/")
    return name if not package or "/" in package else f"{package}/msg/{own}"


def parse(text: str, name: str) -> dict[str, tuple[MessageField, ...]]:
    """Give the types in a definition as ROS 2 writes it (.msg), of the type of this name and of those it needs.

    Raises ValueError for a line that is no field.
    """
    first, *others = _SEPARATOR.split(text)
    found = {full_name(name): _fields(first, full_name(name))}
    for part in others:
        head, _, body = part.strip().partition("\n")
        if not head.startswith("MSG: "):
            raise ValueError(f"{head[:60]!r} is no name of a type, expected MSG: PACKAGE/NAME")
        own = full_name(head.removeprefix("MSG: ").strip())
        found[own] = _fields(body, own)
    return found


def _fields(text: str, name: str) -> tuple[MessageField, ...]:
    fields = []
    for line in text.splitlines():
        line = line.partition("#")[0].strip()
        if not line or line.startswith("@"):
            continue
        told = _LINE.fullmatch(line)
        if told is None:
            raise ValueError(f"{name}: {line[:60]!r} is no field")
        if told["rest"].startswith("="):
            continue
        size = None if told["list"] is None else 0
        if told["size"] and not told["most"]:
            size = int(told["size"][:9])
            if not 0 < size <= MOST_FIXED:
                raise ValueError(f"{name}: {line[:60]!r} is a list of {size}")
        fields.append(MessageField(told["name"], _type(told["type"], name), size))
    if len({field.name for field in fields}) < len(fields):
        raise ValueError(f"{name}: a field is a duplicate")
    return tuple(fields)


def _type(told: str, owner: str) -> str:
    """The full name of a field's type."""
    if told in PRIMITIVES or told == "string":
        return told
    if told in ("wstring", "float128"):
        raise ValueError(f"{owner} has a {told}, which is not read")
    if told in _ALIASES:
        return _ALIASES[told]
    return full_name(told) if "/" in told else f"{owner.rpartition('/')[0]}/{told}"


def _of_idl(text: str) -> dict[str, tuple[MessageField, ...]]:
    """The types in definitions of IDL, one after the other with a line before each that names it."""
    found: dict[str, tuple[MessageField, ...]] = {}
    for part in re.split(r"^={80}\s*\nIDL: .*$", text, flags=re.MULTILINE):
        found |= parse_idl(part)
    return found


@cache
def _standard(distribution: str) -> Definitions:
    """The types of a distribution, as rosbags has them."""
    from rosbags.typesys import Stores, get_typestore

    store = next((s for s in Stores if s.value == f"ros2_{distribution}"), Stores.ROS2_HUMBLE)
    return _converted(get_typestore(store).fielddefs)


@cache
def _own() -> Definitions:
    """Autoware's types, which no distribution has."""
    return parse(
        (resources.files("resim.recordings.logs") / "autoware.msg").read_text("utf-8"), "autoware/msg/None"
    )


def _converted(types: Any) -> dict[str, tuple[MessageField, ...]]:
    """The same types as `rosbags` has them: kinds of nodes are 1 a base type, 2 a name, 3 an array, 4 a sequence."""
    found = {}
    for name, (_, fields) in types.items():
        own = []
        for field, (node, told) in fields:
            size = None
            if int(node) in (3, 4):
                (inner, kind), most = told
                size = int(most) if int(node) == 3 else 0
                node, told = inner, kind
            kind = str(told[0]) if int(node) == 1 else str(told)
            if kind in ("wstring", "wchar", "float128") or (size == 0 and int(node) == 3):
                raise ValueError(f"{name} has a {kind}, which is not read")
            own.append(MessageField(field, kind, size))
        found[name] = tuple(own)
    return found


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
