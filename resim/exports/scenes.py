"""Sources of a drive as scenes of Foxglove: boxes, the EGO's plan, roads, frames and a log; viewers need no extension.

Source: Foxglove schemas (SceneUpdate, FrameTransforms, Log). Places count from DRIVE_FRAME, near the drive: viewers
draw with single precision, which at UTM coordinates is half a metre. Scenes are flat, as plans and lanes are.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import foxglove.messages as fg
import numpy as np

from resim.exports.states import SECOND, ExportedState, TimedMessage, first_time, nanoseconds, states
from resim.report.player import PlayedDrive
from resim.report.player.colors import layer_colors
from resim.report.player.data import cut_network, near_roads
from resim.report.player.drive import Layer

MAP_FRAME, DRIVE_FRAME = "map", "drive"
_ROUND = 100.0
"""m to which the place of the drive's frame is rounded."""
_STEP = 2.0
"""m between points of a lane's border."""
_LEVELS = {"error": fg.LogLevel.Error, "warning": fg.LogLevel.Warning}


class ViewedDrive:
    """A drive for viewers. first: second that times count from."""

    def __init__(self, drive: PlayedDrive, first: int) -> None:
        self.drive, self.first = drive, first
        self.begin = first_time(drive, first)
        self.origin = _origin(drive)

    def boxes(self, layer: Layer) -> Iterator[TimedMessage]:
        """Give the boxes of a source over time, with ids, and the plans of its EGO."""
        colors = layer_colors(layer.name)
        plans = [(nanoseconds(t, self.first), plan) for t, plan in layer.plans]
        there: set[str] = set()
        for t, everyone in states(layer, self.drive.network):
            now = nanoseconds(t, self.first)
            at, ids = _time(now), {one.id for one in everyone}
            gone = [
                fg.SceneEntityDeletion(timestamp=at, type=fg.SceneEntityDeletionType.MatchingId, id=name)
                for name in sorted(there - ids)
            ]
            entities = [self._box(one, at, colors, layer) for one in everyone]
            made = None
            while plans and plans[0][0] <= now:
                made = plans.pop(0)[1]
            if made is not None:
                entities.append(self._plan(made, at, colors))
            there = ids
            yield TimedMessage(now, fg.SceneUpdate(deletions=gone, entities=entities).encode())

    def frames(self) -> Iterator[TimedMessage]:
        """Give the drive's frame in the map's, and the EGO's of each source in that."""
        x, y = self.origin
        fixed = fg.FrameTransform(
            timestamp=_time(self.begin), parent_frame_id=MAP_FRAME, child_frame_id=DRIVE_FRAME,
            translation=fg.Vector3(x=x, y=y, z=0.0), rotation=_rotation(0.0),
        )  # fmt: skip
        rows = [(self.begin, -1, fixed)]
        for number, layer in enumerate(self.drive.layers):
            for t, ego in states(layer, self.drive.network, self.drive.ego):
                now = nanoseconds(t, self.first)
                for one in ego:
                    place = fg.Vector3(x=one.x - x, y=one.y - y, z=0.0)
                    told = fg.FrameTransform(
                        timestamp=_time(now), parent_frame_id=DRIVE_FRAME, child_frame_id=f"EGO {layer.name}",
                        translation=place, rotation=_rotation(one.heading),
                    )  # fmt: skip
                    rows.append((now, number, told))
        for now, _, told in sorted(rows, key=lambda row: row[:2]):
            yield TimedMessage(now, fg.FrameTransforms(transforms=[told]).encode())

    def roads(self) -> Iterator[TimedMessage]:
        """Give the borders of the lanes near the drive, once."""
        lines = []
        for shape in cut_network(self.drive.network, near_roads(self.drive)).lane_shapes(_STEP):
            border = shape.left if shape.lane > 0 else shape.right
            if len(border) > 1:
                dark = shape.mark in ("", "none")
                color = fg.Color(r=0.5, g=0.5, b=0.5, a=0.4 if dark else 1.0)
                points = [fg.Point3(x=px, y=py, z=0.0) for px, py in (border - self.origin).tolist()]
                lines.append(_line(points, 0.1, color))
        entity = fg.SceneEntity(
            timestamp=_time(self.begin), frame_id=DRIVE_FRAME, id="roads", frame_locked=True, lines=lines
        )
        yield TimedMessage(self.begin, fg.SceneUpdate(entities=[entity]).encode())

    def log(self) -> Iterator[TimedMessage]:
        """Give what happened when: findings, decisions, collisions, criteria that are not met; notes come first."""
        rows = [(self.begin, fg.LogLevel.Info, "", note) for note in self.drive.notes]
        for mark in self.drive.marks:
            now = max(nanoseconds(mark.start, self.first), self.begin)
            level = _LEVELS.get(mark.text.partition(":")[0], fg.LogLevel.Info)
            if mark.kind == "collision":
                level = fg.LogLevel.Error
            who = f"{mark.object}: " if mark.object else ""
            rows.append((now, level, mark.source, f"{who}{mark.text}"))
        for now, level, source, text in sorted(rows, key=lambda row: row[0]):
            told = fg.Log(timestamp=_time(now), level=level, name=source or self.drive.name, message=text)
            yield TimedMessage(now, told.encode())

    def _box(self, one: ExportedState, at: Any, colors: Any, layer: Layer) -> Any:
        own = one.id == self.drive.ego
        color = _color((colors.ego if own else colors.other)[0], max(colors.fill, 0.25))
        x, y = one.x - self.origin[0], one.y - self.origin[1]
        place = fg.Pose(position=fg.Vector3(x=x, y=y, z=0.5 * one.height), orientation=_rotation(one.heading))
        box = fg.CubePrimitive(
            pose=place, size=fg.Vector3(x=one.length, y=one.width, z=one.height), color=color
        )
        above = fg.Pose(position=fg.Vector3(x=x, y=y, z=one.height + 0.8), orientation=_rotation(0.0))
        name = fg.TextPrimitive(
            pose=above, billboard=True, font_size=0.8, text=f"EGO {layer.name}" if own else one.id,
            color=_color((colors.ego if own else colors.other)[0], 1.0),
        )  # fmt: skip
        told = [("kind", one.kind), ("v", f"{one.v:.2f} m/s"), ("a", f"{one.a:.2f} m/s²")]
        return fg.SceneEntity(
            timestamp=at, frame_id=DRIVE_FRAME, id=one.id, cubes=[box], texts=[name],
            metadata=[fg.KeyValuePair(key=key, value=value) for key, value in told],
        )  # fmt: skip

    def _plan(self, plan: Any, at: Any, colors: Any) -> Any:
        places = plan[np.isfinite(plan[:, 1:3]).all(axis=1), 1:3] - self.origin
        points = [fg.Point3(x=x, y=y, z=0.2) for x, y in places.tolist()]
        line = [_line(points, 0.25, _color(colors.ego[0], 0.8))] if len(points) > 1 else []
        return fg.SceneEntity(timestamp=at, frame_id=DRIVE_FRAME, id="plan", lines=line)


def _origin(drive: PlayedDrive) -> tuple[float, float]:
    """Where the first sample of the drive is, rounded [m]."""
    tracks = next((layer.tracks for layer in drive.layers if layer.tracks.valid.any()), None)
    if tracks is None:
        return 0.0, 0.0
    rows, samples = np.nonzero(tracks.valid)
    first = int(np.argmin(samples))
    x, y = (float(c[rows[first], samples[first]]) for c in (tracks.x, tracks.y))
    return _ROUND * round(x / _ROUND), _ROUND * round(y / _ROUND)


def _time(now: int) -> Any:
    return fg.Timestamp(*divmod(now, SECOND))


def _rotation(heading: float) -> Any:
    return fg.Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * heading), w=math.cos(0.5 * heading))


def _line(points: list[Any], thickness: float, color: Any) -> Any:
    return fg.LinePrimitive(
        type=fg.LinePrimitiveLineType.LineStrip, pose=fg.Pose(position=fg.Vector3(), orientation=_rotation(0.0)),
        thickness=thickness, points=points, color=color,
    )  # fmt: skip


def _color(hexadecimal: str, opacity: float) -> Any:
    r, g, b = (int(hexadecimal[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    return fg.Color(r=r, g=g, b=b, a=opacity)
