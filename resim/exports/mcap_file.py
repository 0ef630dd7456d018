"""Topics of an MCAP file: how they are written, and what viewers read of a drive: scenes of Foxglove, and curves.

All are protocol buffers: omega-prime refuses a file in which anything is encoded otherwise.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import foxglove.messages as fg
from mcap.writer import Writer

from resim.core.protobuf import FLAG, NUMBER, TEXT, file_set, message_type
from resim.exports.scenes import ViewedDrive
from resim.exports.states import TimedMessage, nanoseconds, topic_of
from resim.metrics.assessment_report import DriveAssessment
from resim.report.player import PlayedDrive
from resim.report.player.drive import Danger, DriveVerdict, Layer

_EGO = ("t", "x", "y", "heading", "v")
EGO = message_type("resim.Ego", dict.fromkeys(_EGO, NUMBER))
PLAN = message_type("resim.Plan", {"t": NUMBER, "points": [dict.fromkeys("txyv", NUMBER)]})
RISK = message_type(
    "resim.Risk",
    {"t": NUMBER, "risk": NUMBER, "risk_of": TEXT, "ttc": NUMBER, "ttc_of": TEXT, "unknown": FLAG},
)  # fmt: skip
VERDICTS = message_type(
    "resim.Verdicts",
    {
        "source": TEXT, "verdict": TEXT,
        "criteria": [
            {
                "criterion": TEXT, "measure": TEXT, "verdict": TEXT, "value": NUMBER, "limit": NUMBER, "unit": TEXT,
                "t": NUMBER, "object": TEXT, "weight": NUMBER, "reason": TEXT,
            }
        ],
    },
)  # fmt: skip
DRIVE_VERDICT = message_type(
    "resim.DriveVerdict",
    {"verdict": TEXT, "decides": TEXT, "sources": [{"source": TEXT, "verdict": TEXT}]},
)
"""Curves and verdicts. A number that is not known is NaN, which no viewer draws; 0 would look safe."""


class Topic(NamedTuple):
    """What one topic of the file holds: name and text of its schema, metadata, and messages in order of time."""

    name: str
    schema: str
    text: bytes
    metadata: Mapping[str, str]
    messages: Iterable[TimedMessage]


def write_topics(topics: Iterable[Topic], stream: Any, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Write topics, all messages in the order of their time, and the file's metadata by name."""
    writer = Writer(stream)
    writer.start(profile="", library="resim")
    known: dict[tuple[str, bytes], int] = {}
    rows = []
    for number, topic in enumerate(topics):
        key = (topic.schema, topic.text)
        if key not in known:
            known[key] = writer.register_schema(topic.schema, "protobuf", topic.text)
        channel = writer.register_channel(topic.name, "protobuf", known[key], dict(topic.metadata))
        rows.append(_numbered(topic.messages, number, channel))
    for name, told in metadata.items():
        writer.add_metadata(name, dict(told))
    counts: dict[int, int] = {}
    for t, _, channel, body in heapq.merge(*rows, key=lambda row: row[:2]):
        sequence = counts[channel] = counts.get(channel, -1) + 1
        writer.add_message(channel, log_time=t, publish_time=t, data=body, sequence=sequence)
    writer.finish()


def _numbered(
    messages: Iterable[TimedMessage], number: int, channel: int
) -> Iterator[tuple[int, int, int, bytes]]:
    for t, body in messages:
        yield t, number, channel, body


def scene_topics(drive: PlayedDrive, first: int) -> Iterator[Topic]:
    """Give what viewers draw without an extension: scenes, curves, plans and verdicts."""
    scenes = ViewedDrive(drive, first)
    yield _scene("/map", fg.SceneUpdate, scenes.roads())
    yield _scene("/tf", fg.FrameTransforms, scenes.frames())
    yield _scene("/log", fg.Log, scenes.log())
    if drive.judged is not None:
        yield _own("/verdicts/drive", DRIVE_VERDICT, [(scenes.begin, _drive_verdict(drive.judged))])
    for layer in drive.layers:
        name, told = topic_of(layer.name), layer.assessed
        yield _scene(f"/scene/{name}", fg.SceneUpdate, scenes.boxes(layer))
        if drive.ego in layer.tracks.ids:
            yield _own(f"/ego/{name}", EGO, _ego(layer, drive.ego, first))
        if layer.plans:
            yield _own(f"/plans/{name}", PLAN, _plans(layer, first))
        if layer.danger is not None:
            yield _own(f"/risk/{name}", RISK, _risk(layer.danger, first))
        if told is not None and told.criteria:
            yield _own(f"/verdicts/{name}", VERDICTS, [(scenes.begin, _verdicts(layer.name, told))])


def _scene(name: str, kind: Any, messages: Iterator[TimedMessage]) -> Topic:
    schema = kind.get_schema()
    return Topic(name, schema.name, schema.data, {}, messages)


def _own(name: str, kind: Any, messages: Iterable[tuple[int, Any]]) -> Topic:
    told = (TimedMessage(t, bytes(one.SerializeToString(deterministic=True))) for t, one in messages)
    return Topic(name, kind.DESCRIPTOR.full_name, file_set(kind.DESCRIPTOR.file), {}, told)


def _ego(layer: Layer, ego: str, first: int) -> Iterator[tuple[int, Any]]:
    tracks, row = layer.tracks, layer.tracks.index(ego)
    own = tracks.valid[row]
    columns = [tracks.t[own], *(getattr(tracks, name)[row, own] for name in _EGO[1:])]
    for values in zip(*(column.tolist() for column in columns), strict=True):
        yield nanoseconds(values[0], first), EGO(**dict(zip(_EGO, values, strict=True)))


def _plans(layer: Layer, first: int) -> Iterator[tuple[int, Any]]:
    for t, plan in layer.plans:
        points = [dict(zip("txyv", point, strict=True)) for point in plan.tolist()]
        yield nanoseconds(t, first), PLAN(t=t, points=points)


def _risk(curves: Danger, first: int) -> Iterator[tuple[int, Any]]:
    d = curves
    columns = (d.t.tolist(), d.risk.tolist(), d.risk_of, d.ttc.tolist(), d.ttc_of, d.unknown.tolist())
    for values in zip(*columns, strict=True):
        told = dict(zip(("t", "risk", "risk_of", "ttc", "ttc_of", "unknown"), values, strict=True))
        yield nanoseconds(values[0], first), RISK(**told)


def _drive_verdict(judged: DriveVerdict) -> Any:
    """The verdict on the drive, by whom, and what each source came to."""
    each = [{"source": source, "verdict": verdict} for source, verdict in judged.sources.items()]
    return DRIVE_VERDICT(verdict=judged.verdict, decides=", ".join(judged.decides), sources=each)


def _verdicts(source: str, told: DriveAssessment) -> Any:
    """The verdict on a source, and each criterion's."""
    each = [
        {
            "criterion": name,
            **{field: math.nan if value is None else value for field, value in vars(entry).items()},
        }
        for name, entry in told.criteria.items()
    ]
    return VERDICTS(source=source, verdict=told.verdict or "", criteria=each)
