"""The other side of a process build: `serve` runs an AD function in a process of its own, and answers resim there.

This file needs Python 3.8, msgpack and NumPy, and nothing else of resim, so that it runs in any environment. A message
is its length (4 bytes, little endian) and as many bytes of msgpack; docs/formats/process.md says what is in each.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import pathlib
import struct
import sys
import traceback
import types
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, NamedTuple

try:
    import msgpack
    import numpy as np
except ImportError as e:
    raise ImportError(f"{e}: {sys.executable} needs msgpack and NumPy (pip install msgpack numpy)") from e

PROTOCOL = 1
"""Version of the messages."""
LONGEST = 1 << 28
"""Bytes of a message; one that claims more is none."""
OBJECT = ("id", "kind", "x", "y", "heading", "v", "length", "width", "z")
"""Columns of the objects of a list, in the order of the fields of `ObjectList`."""


def packed(message: dict[str, Any]) -> bytes:
    """Give a message as it is sent, its length before it."""
    return framed(msgpack.packb(message))


def framed(body: bytes) -> bytes:
    """Give bytes as they are sent, their length before them."""
    return struct.pack("<I", len(body)) + body


class EgoState(NamedTuple):
    """The EGO: x, y [m] of its box centre and heading [rad] in the map, v [m/s], a [m/s²], yaw_rate [rad/s]."""

    x: float
    y: float
    heading: float
    v: float
    a: float = 0.0
    yaw_rate: float = 0.0


class ObjectList(NamedTuple):
    """What the function sees at time t [s]: N objects in the EGO's frame, each column an array (N,).

    x_ego, y_ego [m] ahead and left of the EGO's box centre; heading_ego [rad] against the EGO's; v [m/s] over ground
    along the object's heading; length, width [m]; z_ego [m] of the road under it above that under the EGO, NaN where
    it is not known.
    """

    t: float
    ego: EgoState
    ids: Any
    kind: Any
    x_ego: Any
    y_ego: Any
    heading_ego: Any
    v: Any
    length: Any
    width: Any
    z_ego: Any


class Command(NamedTuple):
    """The answer: acceleration [m/s²], curvature [1/m, left positive], and a plan: rows of t [s], x, y [m], v [m/s]."""

    acceleration: float
    curvature: float
    plan: Any = None


class MapLane(NamedTuple):
    """A lane of one lane section: centre, left and right border (K, 2) [m] in the direction of its road's s.

    along: whether it is driven in that direction, too, and not against it. after: numbers of the lanes that it goes on
    into, in driving direction, in the list of lanes.
    """

    road: str
    section: int
    lane: int
    type: str
    centre: Any
    left: Any
    right: Any
    along: bool
    after: tuple[int, ...]


class LaneMap:
    """The map. file: where its OpenDRIVE lies."""

    def __init__(self, told: dict[str, Any]) -> None:
        self.file: str = told["file"]
        self._packed: bytes = told["lanes"]
        self._lanes: list[MapLane] | None = None

    @property
    def lanes(self) -> list[MapLane]:
        """The lanes of the map, points at most 2 m apart."""
        if self._lanes is None:
            self._lanes = [
                MapLane(one["road"], one["section"], one["lane"], one["type"], _points(one["centre"]),
                     _points(one["left"]), _points(one["right"]), one["along"], tuple(one["after"]))
                for one in msgpack.unpackb(self._packed)
            ]  # fmt: skip
        return self._lanes


def _points(told: bytes) -> Any:
    return np.frombuffer(told, dtype="<f8").reshape(-1, 2)


class RunSetup(NamedTuple):
    """What a function gets before a run: see `resim.simulation.function.interface.Setup`; road is a `LaneMap`.

    route: for each step of it the ids of the roads, of which the EGO is on one.
    """

    road: LaneMap
    start: EgoState
    goal: tuple[float, float]
    length: float
    width: float
    cycle: float
    seed: int
    route: tuple[tuple[str, ...], ...]


def serve(factory: Callable[..., Any]) -> None:
    """Answer resim on the standard streams until the run ends.

    factory: called with the parameters of the build file, by keyword; gives an object with `reset(setup)`,
    `step(perceived)`, which answers a `Command` or what has its three fields, and `close()`; for several runs at once
    `reset_batch(setups)` and `step_batch(list of perceived)`, which answers one for each. What it prints goes to the
    standard error.
    """
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)
    asked = os.fdopen(os.dup(0), "rb")
    os.close(0)
    os.open(os.devnull, os.O_RDONLY)  # what reads the standard input takes no message away
    function: Any = None
    while (message := _read(asked)) is not None:
        kind = message["message"]
        answer: dict[str, Any] = {}
        try:
            if kind == "step":
                answer = _told(function.step(_perceived(message, message["t"])))
            elif kind == "step_batch":
                told = function.step_batch([_perceived(one, message["t"]) for one in message["runs"]])
                answer = {"runs": [_told(one) for one in told]}
            elif kind in ("reset", "reset_batch"):
                if message["protocol"] != PROTOCOL:
                    raise ValueError(f"resim speaks version {message['protocol']}, this adapter {PROTOCOL}")
                function = factory(**message["parameters"])
                road = LaneMap(message["road"])
                if kind == "reset":
                    function.reset(_setup(message, road))
                else:
                    function.reset_batch([_setup(one, road) for one in message["runs"]])
                answer = {"protocol": PROTOCOL}
            elif kind == "close":
                if function is not None:
                    function.close()
                return
            else:
                raise ValueError(f"there is no message {kind!r}")
        except Exception as e:
            traceback.print_exc()
            answer = {"error": f"{type(e).__name__}: {e}"}
        sys.stderr.flush()
        answers.write(packed(answer))


def _read(stream: BinaryIO) -> dict[str, Any] | None:
    """The next message; None at the end."""
    head = stream.read(4)
    if len(head) < 4:
        return None
    told: dict[str, Any] = msgpack.unpackb(stream.read(struct.unpack("<I", head)[0]))
    return told


def _setup(told: dict[str, Any], road: LaneMap) -> RunSetup:
    return RunSetup(
        road, EgoState(*told["start"]), tuple(told["goal"]), told["length"], told["width"], told["cycle"], told["seed"],
        tuple(map(tuple, told["route"])),
    )  # fmt: skip


def _perceived(told: dict[str, Any], t: float) -> ObjectList:
    objects = told["objects"]
    texts = [np.array(objects[name], dtype=str) for name in OBJECT[:2]]
    return ObjectList(
        t, EgoState(*told["ego"]), *texts, *(np.array(objects[name], dtype=float) for name in OBJECT[2:])
    )


def _told(answer: Any) -> dict[str, Any]:
    if not hasattr(answer, "plan"):
        raise TypeError(f"step gave {answer!r:.60}, expected resim.function.Command")
    plan = answer.plan
    return {
        "acceleration": float(answer.acceleration),
        "curvature": float(answer.curvature),
        "plan": None if plan is None else np.asarray(plan, dtype=float).tolist(),
    }


def main(arguments: Sequence[str]) -> None:
    """Serve the "module:name" given, from the working folder.

    Where resim is not installed, `resim.function` is this file.
    """
    sys.path[0] = str(pathlib.Path.cwd())
    if importlib.util.find_spec("resim") is None:
        whole = types.ModuleType("resim")
        whole.function = sys.modules["resim.function"] = sys.modules[__name__]  # type: ignore[attr-defined]
        sys.modules["resim"] = whole
    module, _, name = arguments[0].partition(":")
    try:
        factory = getattr(importlib.import_module(module), name)
    except Exception as e:
        traceback.print_exc()
        serve(_failing(e))
    else:
        serve(factory)


def _failing(e: Exception) -> Callable[..., Any]:
    """A factory that raises what went wrong before, for the answer to say it."""

    def fail(**_: Any) -> Any:
        raise e

    return fail


if __name__ == "__main__":
    main(sys.argv[1:])
