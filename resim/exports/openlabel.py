"""Sources of a drive as labels: objects over time, what the EGO decided, what happened, and tags of the scenario.

Source: ASAM OpenLABEL 1.0.0, its JSON schema and ontology of scenario tags.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from resim.exports.states import ExportedState, derived, states, topic_of
from resim.report.player import PlayedDrive
from resim.report.player.drive import Layer, TimelineMark

ONTOLOGY = "https://openlabel.asam.net/V1-0-0/ontologies/"
_TAGS, _OWN = "0", "1"
"""Ontologies: that of scenario tags, and what that one has no word for."""
_MAP = "map"
_KINDS = {
    "car": "VehicleCar", "van": "VehicleVan", "truck": "VehicleTruck", "bus": "VehicleBus",
    "trailer": "VehicleTrailer", "motorcycle": "VehicleMotorcycle", "bicycle": "VehicleCycle",
    "pedestrian": "HumanPedestrian",
}  # fmt: skip
_UNKNOWN = "RoadUser"
_MOTIONS = {
    "first braking": "MotionDecelerate", "changes lane to the left": "MotionLaneChangeLeft",
    "changes lane to the right": "MotionLaneChangeRight",
}  # fmt: skip
_NUMBERS = ("v", "a", "yaw_rate")


def write(drive: PlayedDrive, folder: Path) -> dict[str, str]:
    """Write the labels of each source that has any sample. Gives the file of each."""
    files = {}
    for layer in drive.layers:
        if layer.tracks.valid.any():
            files[layer.name] = f"{topic_of(layer.name)}.openlabel.json"
            text = json.dumps(
                labels(layer, drive), ensure_ascii=False, allow_nan=False, separators=(",", ":")
            )
            (folder / files[layer.name]).write_text(text + "\n", encoding="utf-8")
    return files


def labels(layer: Layer, drive: PlayedDrive) -> dict[str, Any]:
    """Give the labels of a source: a frame for each time at which anybody is there."""
    there = [(t, everyone) for t, everyone in states(layer, drive.network) if everyone]
    times = np.array([t for t, _ in there])
    names = dict.fromkeys([drive.ego, *(one.id for _, everyone in there for one in everyone)])
    known = {name for _, everyone in there for name in (one.id for one in everyone)}
    uids = {name: str(number) for number, name in enumerate(name for name in names if name in known)}
    numbers = [name for name in _NUMBERS if name not in derived(layer)]
    marks = [mark for mark in drive.marks if mark.source in ("", layer.name)]
    told: dict[str, Any] = {
        "metadata": {
            "schema_version": "1.0.0", "name": f"{drive.name}: {layer.name}", "annotator": "resim",
            "comment": layer.title, "tagged_file": drive.network.path.name,
        },
        "ontologies": {_TAGS: ONTOLOGY, _OWN: "resim"},
        "coordinate_systems": {_MAP: {"type": "scene_cs", "parent": "", "children": []}},
        "frames": {str(k): _frame(t, everyone, uids, numbers) for k, (t, everyone) in enumerate(there)},
        "frame_intervals": [{"frame_start": 0, "frame_end": len(there) - 1}],
        "objects": _objects(there, uids, numbers),
        "tags": dict(_numbered(_tags(layer, drive, marks))),
    }  # fmt: skip
    if events := dict(_numbered(_event(mark, times) for mark in marks)):
        told["events"] = events
    if actions := dict(_numbered(_actions(layer, times, uids))):
        told["actions"] = actions
    return {"openlabel": told}


def _frame(
    t: float, everyone: list[ExportedState], uids: Mapping[str, str], numbers: list[str]
) -> dict[str, Any]:
    objects = {}
    for one in everyone:
        middle = (one.x, one.y, one.z + 0.5 * one.height)
        box = [*middle, 0.0, 0.0, one.heading, one.length, one.width, one.height]
        objects[uids[one.id]] = {
            "object_data": {
                "cuboid": [{"name": "box", "val": box, "coordinate_system": _MAP}],
                "num": [{"name": name, "val": getattr(one, name)} for name in numbers],
            }
        }
    return {"frame_properties": {"timestamp": f"{t:.9f}"}, "objects": objects}


def _objects(
    there: list[tuple[float, list[ExportedState]]], uids: Mapping[str, str], numbers: list[str]
) -> dict[str, Any]:
    """Who is there, of what kind, in which frames."""
    kinds: dict[str, str] = {}
    frames: dict[str, list[int]] = {}
    for k, (_, everyone) in enumerate(there):
        for one in everyone:
            kinds[one.id] = one.kind
            frames.setdefault(one.id, []).append(k)
    told = {}
    for name, uid in uids.items():
        spans = _spans(frames[name])
        types = {"box": "cuboid", **dict.fromkeys(numbers, "num")}
        told[uid] = {
            "name": name, "type": _KINDS.get(kinds[name], _UNKNOWN), "ontology_uid": _TAGS, "frame_intervals": spans,
            "coordinate_system": _MAP,
            "object_data_pointers": {
                pointer: {"type": kind, "frame_intervals": spans} for pointer, kind in types.items()
            },
        }  # fmt: skip
    return told


def _spans(frames: list[int]) -> list[dict[str, int]]:
    """Frames as intervals."""
    parts = np.split(np.array(frames), np.flatnonzero(np.diff(frames) > 1) + 1)
    return [{"frame_start": int(part[0]), "frame_end": int(part[-1])} for part in parts]


def _event(mark: TimelineMark, times: Any) -> dict[str, Any]:
    """What happened, at the frame that is nearest to when it began."""
    k = int(np.argmin(np.abs(times - mark.start)))
    type_ = _MOTIONS.get(mark.text)
    text = [{"name": "text", "val": mark.text}]
    if mark.object:
        text.append({"name": "object", "val": mark.object})
    return {
        "name": mark.text, "type": type_ or mark.kind.capitalize(), "ontology_uid": _TAGS if type_ else _OWN,
        "frame_intervals": [{"frame_start": k, "frame_end": k}],
        "event_data": {
            "text": text, "num": [{"name": "start", "val": mark.start}, {"name": "end", "val": mark.end}],
        },
    }  # fmt: skip


def _actions(layer: Layer, times: Any, uids: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """What objects did, from the first frame to the last in which they did it."""
    if layer.maneuvers is None:
        return
    for one in layer.maneuvers.to_dict("records"):
        first, last = (int(np.argmin(np.abs(times - one[name]))) for name in ("start", "end"))
        who = [{"name": name, "val": uids[str(one[name])]} for name in ("object", "partner") if one[name]]
        numbers = [{"name": name, "val": float(one[name])} for name in ("start", "end")]
        yield {
            "name": one["label"], "type": one["label"], "ontology_uid": _OWN,
            "frame_intervals": [{"frame_start": first, "frame_end": last}],
            "action_data": {"text": who, "num": numbers},
        }  # fmt: skip


def _tags(layer: Layer, drive: PlayedDrive, marks: list[TimelineMark]) -> Iterator[dict[str, Any]]:
    """Tags of the scenario: its name, who is in it, what the EGO does, the verdicts on the drive and its source."""
    yield {"type": "scenarioName", "ontology_uid": _TAGS, "tag_data": drive.name}
    others = layer.tracks.kind[layer.tracks.ids != drive.ego].tolist()
    for kind in sorted({_KINDS.get(one, _UNKNOWN) for one in others}):
        yield {"type": kind, "ontology_uid": _TAGS}
    for motion in sorted({_MOTIONS[mark.text] for mark in marks if mark.text in _MOTIONS}):
        yield {"type": motion, "ontology_uid": _TAGS}
    if drive.judged is not None:
        told = {
            "verdict": drive.judged.verdict,
            "decides": ", ".join(drive.judged.decides),
            **drive.judged.sources,
        }
        text = [{"name": key, "val": value} for key, value in told.items()]
        yield {"type": "DriveVerdict", "ontology_uid": _OWN, "tag_data": {"text": text}}
    if layer.assessed is None or layer.assessed.verdict is None:
        return
    yield {"type": "Verdict", "ontology_uid": _OWN, "tag_data": layer.assessed.verdict}
    for name, entry in layer.assessed.criteria.items():
        words = {"criterion": name, "verdict": entry.verdict, "unit": entry.unit, "reason": entry.reason}
        values = {"value": entry.value, "limit": entry.limit}
        yield {
            "type": "Criterion", "ontology_uid": _OWN,
            "tag_data": {
                "text": [{"name": key, "val": value} for key, value in words.items()],
                "num": [{"name": key, "val": v} for key, v in values.items() if v is not None and math.isfinite(v)],
            },
        }  # fmt: skip


def _numbered(rows: Iterable[dict[str, Any]]) -> Iterator[tuple[str, dict[str, Any]]]:
    return ((str(number), row) for number, row in enumerate(rows))
