"""What every log gives: messages as bytes, each with its channel, which says how they are to be read."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError
from resim.core.spelling import did_you_mean


@dataclass(frozen=True)
class LogChannel:
    """A topic as one writer wrote it.

    Attributes:
        topic: Its name.
        type: Name of the message type, "" where there is none.
        encoding: How messages are written: "cdr", "protobuf", "json", ...
        schema_encoding: How the definition is written: "ros2msg", "ros2idl", "protobuf", ...; "" where it is not in the
            log.
        schema: The definition.
        distribution: ROS distribution that the log names, "" where it names none.
        metadata: What the channel says besides: names and texts.
    """

    topic: str
    type: str
    encoding: str
    schema_encoding: str = ""
    schema: bytes = b""
    distribution: str = ""
    metadata: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class RawMessage:
    """A message as it stands in the log.

    Attributes:
        channel: Where it was sent.
        log_time: When it was recorded [ns], mostly since 1970.
        body: Its bytes.
        where: Its place in the log, in words.
    """

    channel: LogChannel
    log_time: int
    body: bytes
    where: str


def listed(channels: Mapping[str, str]) -> str:
    """Give topics with their types (or counts) in words, the first of many."""
    names = [f"{name} ({told})" if told else name for name, told in sorted(channels.items())]
    more = f" and {len(names) - 40} more" if len(names) > 40 else ""
    return (", ".join(names[:40]) or "none") + more


def no_such_topic(path: Path, topic: str | None, there: Mapping[str, str], where: str) -> InputError:
    """Give the error for a topic that is not in a log, or not named; there: topics with their types."""
    remedy = f"Its topics are: {listed(there)}."
    if topic is None:
        return InputError(path, f"is a log of many topics, and {where} of the mapping names no topic", remedy)
    hint = did_you_mean(topic, list(there), cutoff=0.5)
    return InputError(path, f"has no messages of topic {topic!r}, which {where}.topic names{hint}", remedy)


def need(path: Path, module: str, what: str, extra: str = "ros") -> None:
    """Raise InputError, with what to install, where a library is missing; what: which files need it."""
    try:
        found = importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # of a package within another, which is missing
        found = False
    if not found:
        raise InputError(path, f"{what} need {module}", f"In resim's own folder: pip install '.[{extra}]'")
