"""Types of messages that are made here, and schemas with all that they import, as MCAP files hold them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

_Field = descriptor_pb2.FieldDescriptorProto
NUMBER, TEXT, FLAG = _Field.TYPE_DOUBLE, _Field.TYPE_STRING, _Field.TYPE_BOOL
"""Types of fields."""
Fields = Mapping[str, Any]
"""Fields by name: one of the types, or in a list the fields of a message that is there any number of times."""


def message_type(full: str, fields: Fields) -> Any:
    """Give the type of a message by its full name, with these fields, numbered in their order."""
    package, _, name = full.rpartition(".")
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto", package=package, syntax="proto2"
    )
    _describe(file.message_type.add(name=name), f".{package}.{name}", fields)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{package}.{name}"))


def _describe(told: Any, full: str, fields: Fields) -> None:
    for number, (name, kind) in enumerate(fields.items(), start=1):
        if isinstance(kind, list):
            (inner,) = kind
            own = name.capitalize()
            _describe(told.nested_type.add(name=own), f"{full}.{own}", inner)
            told.field.add(
                name=name, number=number, type=_Field.TYPE_MESSAGE, type_name=f"{full}.{own}",
                label=_Field.LABEL_REPEATED,
            )  # fmt: skip
        else:
            told.field.add(name=name, number=number, type=kind, label=_Field.LABEL_OPTIONAL)


@cache
def file_set(file: Any) -> bytes:
    """Give a schema with all that it imports, each once, what is imported first."""
    found: dict[str, Any] = {}

    def add(one: Any) -> None:
        if one.name not in found:
            for other in one.dependencies:
                add(other)
            found[one.name] = one

    add(file)
    told = descriptor_pb2.FileDescriptorSet()
    for one in found.values():
        one.CopyToProto(told.file.add())
    return bytes(told.SerializeToString(deterministic=True))
