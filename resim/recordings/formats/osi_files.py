"""Files of OSI: messages one after the other (.osi), or on topics of an MCAP file, which may hold the map, too.

Source: ASAM OSI 3.8, "OSI trace file formats"; omega-prime's specification (map).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.core.files import open_file
from resim.core.osi import DERIVED, MAP_FIELDS, MAP_SCHEMA, SENSED
from resim.core.protobuf import TEXT, message_type
from resim.recordings.logs.kinds import MCAP
from resim.recordings.logs.mcap_file import mcap_messages

LONGEST = 1 << 28
"""Bytes of a message; one that claims more is none."""
WORLDS = ("GroundTruth", "SensorView")
"""Messages that say where everybody is."""
REMEDY = "Write the trace with its tool again."
_ENDINGS = (".osi", ".mcap")


@dataclass(frozen=True, eq=False)
class TraceTopics:
    """What an MCAP file holds.

    Attributes:
        worlds: Topics of WORLDS, with the name of their message.
        sensed: Topics of SensorData.
        maps: Topics of maps.
        derived: By topic the columns of tracks that no source says.
    """

    worlds: Mapping[str, str]
    sensed: tuple[str, ...]
    maps: tuple[str, ...]
    derived: Mapping[str, tuple[str, ...]]


def is_mcap(trace: Path) -> bool:
    """Say whether a file is MCAP. Raises InputError for one that is neither that nor named .osi."""
    with open_file(trace, "Check the path") as file:
        if file.read(len(MCAP)) == MCAP:
            return True
    if trace.suffix.lower() not in _ENDINGS:
        raise InputError(trace, "is neither an .osi nor an MCAP file", "Give a trace of OSI.")
    return False


def worlds(trace: Path) -> tuple[Iterator[Any], str, tuple[str, ...]]:
    """Give the messages that say where everybody is, their name, and which columns of tracks no source says.

    Raises InputError, also while messages are taken.
    """
    from osi3.osi_groundtruth_pb2 import GroundTruth
    from osi3.osi_sensorview_pb2 import SensorView

    kinds = {"GroundTruth": GroundTruth, "SensorView": SensorView}
    if is_mcap(trace):
        there = topics(trace)
        if len(there.worlds) != 1:
            told = ", ".join(f"{topic} ({name})" for topic, name in sorted(there.worlds.items())) or "none"
            problem = (
                f"has {len(there.worlds)} topics of {' or '.join(WORLDS)}, expected one; there are: {told}"
            )
            raise InputError(trace, problem, "Write a trace with one of them.")
        ((topic, name),) = there.worlds.items()
        return _parsed(trace, _on(trace, topic), kinds[name], name), name, there.derived.get(topic, ())
    name = _name(next(_framed(trace), b""), SensorView)
    return _parsed(trace, _framed(trace), kinds[name], name), name, ()


def sensed(trace: Path) -> Iterator[Any] | None:
    """Give the messages SensorData of a file: of the one topic, or that named SENSED; None where there is none."""
    from osi3.osi_sensordata_pb2 import SensorData

    if not is_mcap(trace):
        return _parsed(trace, _framed(trace), SensorData, "SensorData")
    there = topics(trace).sensed
    topic = SENSED if SENSED in there else there[0] if len(there) == 1 else None
    return None if topic is None else _parsed(trace, _on(trace, topic), SensorData, "SensorData")


def held_map(trace: Path) -> tuple[str, str] | None:
    """Give name and text of the map in a file, None where there is none. Raises InputError for several."""
    if not is_mcap(trace) or not (there := topics(trace).maps):
        return None
    if len(there) > 1:
        raise InputError(
            trace, f"holds maps on {len(there)} topics: {', '.join(there)}", "Name one by --map."
        )
    kind = message_type(MAP_SCHEMA, dict.fromkeys(MAP_FIELDS, TEXT))
    told = next(_parsed(trace, _on(trace, there[0]), kind, "map"), None)
    if told is None or not told.open_drive_xml_content:
        raise InputError(trace, f"{there[0]}: holds no OpenDRIVE", "Name a map by --map.")
    return str(told.map_reference), str(told.open_drive_xml_content)


def topics(trace: Path) -> TraceTopics:
    """Give what topics an MCAP file has messages on. Raises InputError for a damaged one."""
    found = {
        one.channel.topic: one.channel
        for one in mcap_messages(trace, None)
        if one.channel.encoding == "protobuf"
    }
    own = {topic: channel.type.removeprefix("osi3.") for topic, channel in sorted(found.items())}
    return TraceTopics(
        {topic: name for topic, name in own.items() if name in WORLDS},
        tuple(topic for topic, name in own.items() if name == "SensorData"),
        tuple(topic for topic in own if found[topic].type == MAP_SCHEMA),
        {
            topic: tuple(text.split(", "))
            for topic, one in found.items()
            if (text := dict(one.metadata).get(DERIVED, ""))
        },
    )


def _on(trace: Path, topic: str) -> Iterator[bytes]:
    """The messages on a topic of an MCAP file, by the time at which they were recorded."""
    found = [(one.log_time, one.body) for one in mcap_messages(trace, topic)]
    return (body for _, body in sorted(found, key=lambda row: row[0]))


def _framed(trace: Path) -> Iterator[bytes]:
    """The messages of an .osi file, each after its length."""
    with open_file(trace, "Check the path") as file:
        number = 0
        while head := file.read(4):
            number += 1
            size = int.from_bytes(head, "little")
            body = file.read(size) if len(head) == 4 and size <= LONGEST else b""
            if len(body) != size or not size:
                problem = f"message {number} claims {size} bytes, of which {len(body)} are there"
                raise InputError(trace, problem, REMEDY)
            yield body


def _parsed(trace: Path, bodies: Iterator[bytes], kind: Any, name: str) -> Iterator[Any]:
    from google.protobuf.message import DecodeError

    for number, body in enumerate(bodies, start=1):
        try:
            yield kind.FromString(body)
        except DecodeError as e:
            raise InputError(trace, f"message {number} is no {name} of OSI", REMEDY) from e


def _name(body: bytes, view: Any) -> str:
    """What a message without a name is: a SensorView if it has a ground truth with something in it."""
    from google.protobuf.message import DecodeError

    try:
        told = view.FromString(body)
    except DecodeError:
        return "GroundTruth"
    return "SensorView" if told.global_ground_truth.HasField("timestamp") else "GroundTruth"
