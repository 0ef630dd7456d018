"""What goes over gRPC between resim and a function: `resim/function/function.proto`, without generated code."""

from __future__ import annotations

import importlib.util
import ipaddress
import re
from typing import Any

from resim.core.errors import InputError
from resim.core.plugins.unlisted_files import unheard
from resim.function import LONGEST

METHOD = "/resim.Function/Drive"
OPTIONS: tuple[tuple[str, Any], ...] = (
    ("grpc.max_receive_message_length", LONGEST + 16),
    ("grpc.max_send_message_length", LONGEST + 16),
    ("grpc.enable_http_proxy", 0),
    ("grpc.so_reuseport", 0),  # a second server does not share the port of the first
)
"""Of channels and servers."""
_BODY = 0x0A
"""Tag of field 1, whose value has a length."""
_ADDRESS = re.compile(r"(?:\[([0-9a-fA-F:]+)\]|([A-Za-z0-9.-]+)):([0-9]{1,5})")


def refuse_without_grpc(source: str) -> None:
    """Raise InputError where grpcio is not installed. source: what needs it."""
    if importlib.util.find_spec("grpc") is None:
        raise InputError(source, "needs grpcio", "In resim's own folder: pip install '.[grpc]'")


def grpc_library(source: str) -> Any:
    """Import grpcio, unheard by who watches a user's code. Raises InputError where it is not installed."""
    refuse_without_grpc(source)
    with unheard():
        import grpc
    return grpc


def host_of(address: str) -> str:
    """Give the host of host:port. Raises ValueError for another text."""
    found = _ADDRESS.fullmatch(address)
    if found is None or int(found[3]) > 65535:
        raise ValueError(f"address {address!r}: expected host:port, such as localhost:50051")
    return found[1] or found[2]


def is_loopback(address: str) -> bool:
    """Whether host:port is of this machine alone. Raises ValueError for another text."""
    host = host_of(address)
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def encode(body: bytes) -> bytes:
    """Give a `Message` of this body."""
    return b"%c%b%b" % (_BODY, _varint(len(body)), body)


def decode(message: bytes) -> bytes:
    """Give the body of a `Message`. Raises ValueError for bytes that are none."""
    body, at = b"", 0
    while at < len(message):
        tag, at = _number(message, at)
        if tag & 7 == 0:
            _, at = _number(message, at)
            continue
        if tag & 7 == 2:
            size, at = _number(message, at)
        elif tag & 7 in (1, 5):
            size = 8 if tag & 7 == 1 else 4
        else:
            raise ValueError(f"a field of the unknown wire type {tag & 7}")
        if at + size > len(message):
            raise ValueError(f"a field of {size} bytes where {len(message) - at} are left")
        if tag == _BODY:
            body = message[at : at + size]
        at += size
    return body


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 0x7F:
        out.append(number & 0x7F | 0x80)
        number >>= 7
    out.append(number)
    return bytes(out)


def _number(message: bytes, at: int) -> tuple[int, int]:
    """The varint that begins there, and where it ends."""
    number = 0
    for k, byte in enumerate(message[at : at + 10]):
        number |= (byte & 0x7F) << 7 * k
        if byte < 0x80:
            return number, at + k + 1
    raise ValueError("a number without an end")
