"""Damages the fields of protocol buffers: traces of OSI, alone or in MCAP files, and scenes as JSON in MCAP."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from random import Random
from typing import Any

from fuzzing.trees import tree

DOUBLES = (
    float("nan"),
    float("inf"),
    -float("inf"),
    1e308,
    -1e308,
    1e12,
    1e160,
    1e-320,
    -1.0,
    0.0,
    1e6,
    999.9,
)
WHOLE = (0, 1, 2, 7, 10**9, 2**31 - 1, 2**32 - 1, 2**63 - 1, 2**64 - 1, -1, -(2**31), -(2**63))
WORDS = ("", "ego", "1", "x" * 300, "../../a", "\u202e\u00e4", "a b", "\n", "ego~2")


def trace(name: str) -> Callable[[Random, bytes], bytes]:
    """Give what damages some messages of an .osi file. name: of the messages, `GroundTruth` for one."""

    def torn(rng: Random, data: bytes) -> bytes:
        found, at = [], 0
        while at + 4 <= len(data):
            size = int.from_bytes(data[at : at + 4], "little")
            found.append(data[at + 4 : at + 4 + size])
            at += 4 + size
        bodies = _few(rng, found, name)
        return b"".join(len(body).to_bytes(4, "little") + body for body in bodies)

    return torn


def _few(rng: Random, bodies: list[bytes], name: str) -> list[bytes]:
    """Damage some messages, now and then their order."""
    out = list(bodies)
    for _ in range(rng.choice((1, 1, 2, 5))):
        at = rng.randrange(len(out))
        out[at] = field(rng, out[at], name)
    way = rng.random()
    if way < 0.05:
        rng.shuffle(out)
    elif way < 0.1:
        out.insert(rng.randrange(len(out)), rng.choice(out))
    elif way < 0.15:
        out = out[: rng.randrange(len(out)) + 1]
    return out


def field(rng: Random, body: bytes, name: str) -> bytes:
    """Damage one to three fields of a message of OSI."""
    import osi3.osi_groundtruth_pb2
    import osi3.osi_sensordata_pb2

    kinds = {
        "GroundTruth": osi3.osi_groundtruth_pb2.GroundTruth, "SensorData": osi3.osi_sensordata_pb2.SensorData
    }  # fmt: skip
    told = kinds[name].FromString(body)
    for _ in range(rng.choice((1, 1, 2, 3))):
        _tear(rng, told)
    return bytes(told.SerializeToString())


def _tear(rng: Random, message: Any) -> None:
    """Go down to a field at random; take it out, double it, or set it."""
    there = message.ListFields()
    if not there:
        return
    one, value = rng.choice(there)
    if isinstance(value, int | float | str | bytes):
        _set(rng, message, one, value)
    elif hasattr(value, "append") or hasattr(value, "add"):
        if len(value) and hasattr(value[0], "ListFields") and rng.random() < 0.8:
            _tear(rng, rng.choice(value))
        elif rng.random() < 0.5:
            value.extend([value[0]] * rng.choice((1, 30)))
        else:
            del value[rng.randrange(len(value))]
    elif rng.random() < 0.2:
        message.ClearField(one.name)
    else:
        _tear(rng, value)


def _set(rng: Random, message: Any, one: Any, value: Any) -> None:
    if rng.random() < 0.2:
        message.ClearField(one.name)
        return
    choices = DOUBLES if isinstance(value, float) else WORDS if isinstance(value, str) else WHOLE
    try:
        setattr(message, one.name, rng.choice(choices))
    except (ValueError, TypeError):
        message.ClearField(one.name)


def mcap(rng: Random, data: bytes) -> bytes:
    """Give an MCAP file of OSI with some of its messages damaged, and its checksums right."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    kept = [
        (schema, channel, message)
        for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages()
        if schema is not None and (schema.name.startswith("osi3.") or "map" in channel.topic)
    ]
    chosen = {rng.randrange(len(kept)) for _ in range(3)}
    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    channels: dict[str, int] = {}
    for number, (schema, channel, message) in enumerate(kept):
        if channel.topic not in channels:
            of = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.topic] = writer.register_channel(
                channel.topic, channel.message_encoding, of, channel.metadata
            )
        body, name = message.data, schema.name.removeprefix("osi3.")
        if number in chosen and name in ("GroundTruth", "SensorData"):
            body = field(rng, body, name)
        writer.add_message(channels[channel.topic], message.log_time, body, message.publish_time, number)
    writer.finish()
    return out.getvalue()


def lines(rng: Random, data: bytes) -> bytes:
    """Damage one to three of some lines of JSON."""
    told = [json.loads(line) for line in data.splitlines()]
    for _ in range(rng.choice((1, 1, 3))):
        tree(rng, rng.choice(told))
    return b"\n".join(map(_dumped, told))


def _dumped(told: Any) -> bytes:
    try:
        return json.dumps(told).encode()
    except RecursionError:
        return b"[" * 100_000


def scenes(data: bytes) -> bytes:
    """Give an MCAP file in which each line is a message, 40 ms apart."""
    from mcap.writer import Writer

    out = io.BytesIO()
    writer = Writer(out)
    writer.start()
    channel = writer.register_channel("scene", "json", 0)
    for number, line in enumerate(data.splitlines()):
        writer.add_message(channel, number * 40_000_000, line, number * 40_000_000, number)
    writer.finish()
    return out.getvalue()
