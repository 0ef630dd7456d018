"""An AD function that is a process of its own: resim asks it over its standard streams, message by message.

Each run has a process of its own, which ends with it. Time is that of the simulation: the process is asked, and waited
for within the build's limits. What it writes to the standard error goes where a function's words go.
"""

from __future__ import annotations

import os
import signal
import struct
import subprocess
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any
from weakref import WeakKeyDictionary

import msgpack
import numpy as np

from resim.core.errors import FunctionError
from resim.core.plugins import watchdog
from resim.core.plugins.unlisted_files import unheard
from resim.function import LONGEST, OBJECT, PROTOCOL, packed
from resim.road.links import LaneKey, lane_graph
from resim.road.opendrive import RoadNetwork
from resim.simulation.function.batch import CommandBatch, PerceivedBatch
from resim.simulation.function.interface import Command, Perceived, Setup
from resim.simulation.function.program import FunctionProgram

LANE_STEP = 2.0
"""m between points of the lanes that a process is told."""
_ENDING = 5.0
"""s that a process has to end by itself, once its run has."""
_FIELDS = ("ids", "kind", "x_ego", "y_ego", "heading_ego", "v", "length", "width", "z_ego")
_Answer = dict[str, Any]


class ProcessFunction:
    """A function behind a process."""

    def __init__(self, program: FunctionProgram, parameters: Mapping[str, Any]) -> None:
        self._program, self._parameters = program, dict(parameters)
        self._process: subprocess.Popen[bytes] | None = None
        self._waiting = False  # for an answer that did not come: no other message is understood

    def reset(self, setup: Setup) -> None:
        """Start the process, and prepare it."""
        self._begin("reset", setup, _run(setup))

    def reset_batch(self, setups: Sequence[Setup]) -> None:
        """Start the process, and prepare it for all runs."""
        self._begin("reset_batch", setups[0], {"runs": [_run(setup) for setup in setups]})

    def step(self, perceived: Perceived) -> Command:
        """Ask for an answer."""
        p = perceived
        return Command(*_numbers(self._ask({"message": "step", "t": p.t, **_list(p)})))

    def step_batch(self, perceived: PerceivedBatch) -> CommandBatch:
        """Ask for the answers of all runs at once."""
        lists = [perceived.of(b) for b in range(len(perceived))]
        told = self._ask({"message": "step_batch", "t": perceived.t, "runs": [_list(one) for one in lists]})
        runs = told.get("runs")
        if not isinstance(runs, list) or len(runs) != len(lists):
            raise FunctionError(f"answered {told!r:.60}, expected 'runs' with {len(lists)} answers")
        a, curvature, plans = zip(*map(_numbers, runs), strict=True)
        none = [plan is None for plan in plans]
        if any(none) and not all(none):
            raise FunctionError("answered plans for some of its runs only")
        if len({np.shape(plan) for plan in plans}) > 1:
            raise FunctionError(
                "answered plans with different numbers of rows for its runs, expected one number"
            )
        return CommandBatch(np.array(a), np.array(curvature), None if all(none) else np.array(plans))

    def close(self) -> None:
        """End the process; FunctionError where it does not end by itself, or ends with an error."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            if self._waiting:
                return
            with suppress(OSError):
                process.stdin.write(packed({"message": "close"}))
            process.stdin.close()
            try:
                code = process.wait(_ENDING)
            except subprocess.TimeoutExpired:
                raise FunctionError(f"did not end within {_ENDING:g} s of the message 'close'") from None
            if code != 0:
                raise FunctionError(f"ended its process {_ending(code)}")
        finally:
            process.kill()
            process.wait()
            process.stdin.close()
            process.stdout.close()

    def probe(self, message: dict[str, Any] | bytes) -> str:
        """Start the process, and say what it does with a message that it cannot know; FunctionError for an answer."""
        body = struct.pack("<I", len(message)) + message if isinstance(message, bytes) else packed(message)
        process = self._start(heard=False)  # that it complains is what is asked for
        try:
            answer = self._exchange(process, body)
        except EOFError:
            code = process.wait()
            if code == 0:
                raise FunctionError("ended its process with code 0, as if all were well") from None
            return f"ended its process {_ending(code)}"
        if not isinstance(answer, dict) or "error" not in answer:
            raise FunctionError(f"answered {answer!r:.60}, expected an error")
        return f"answered the error {answer['error']!s:.100}"

    def kill(self) -> None:
        """End the process, whatever it does."""
        self._waiting = True
        self.close()

    def _start(self, *, heard: bool = True) -> subprocess.Popen[bytes]:
        command, folder = self._program.command, self._program.folder
        try:
            with unheard():
                self._process = subprocess.Popen(
                    command, cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0,
                    env=_environment(), stderr=None if heard else subprocess.DEVNULL,
                )  # fmt: skip
        except (OSError, ValueError) as e:
            raise FunctionError(f"cannot be started: {command[0]!r}: {getattr(e, 'strerror', e)}") from e
        return self._process

    def _begin(self, message: str, setup: Setup, told: Mapping[str, Any]) -> None:
        self._start()
        road = {"file": str(setup.road.path.absolute()), "lanes": _lanes(setup.road)}
        head = {"message": message, "protocol": PROTOCOL, "parameters": self._parameters, "road": road}
        answer = self._ask({**head, **told})
        if answer.get("protocol") != PROTOCOL:
            raise FunctionError(f"answered {answer!r:.60} to {message!r}, expected protocol = {PROTOCOL}")

    def _ask(self, message: _Answer) -> _Answer:
        """Send a message and give its answer."""
        process = self._process
        if process is None:
            raise FunctionError("was asked before its reset")
        try:
            answer = self._exchange(process, packed(message))
        except EOFError:
            raise FunctionError(f"ended its process {_ending(process.wait())}", words=_words()) from None
        if not isinstance(answer, dict):
            raise FunctionError(f"answered {answer!r:.60}, expected a map")
        self._waiting = False
        if "error" in answer:
            raise FunctionError(f"failed: {answer['error']!s:.300}", words=_words())
        return answer

    def _exchange(self, process: subprocess.Popen[bytes], message: bytes) -> Any:
        """Send a message and give what is answered, whatever that is. Raises EOFError where the process has ended."""
        assert process.stdin is not None
        assert process.stdout is not None
        self._waiting = True
        try:
            _send(process.stdin.fileno(), message)
            body = _received(process.stdout.fileno())
        except BrokenPipeError:
            raise EOFError from None
        try:
            return msgpack.unpackb(body)
        except (ValueError, msgpack.UnpackException) as e:
            raise FunctionError(f"answered what is no msgpack ({e}): {body[:40]!r}") from e


def _send(to: int, message: bytes) -> None:
    sent = os.write(to, message)
    while sent < len(message):
        sent += os.write(to, message[sent:])


def _received(stream: int) -> bytes:
    """The body of the next message."""
    (size,) = struct.unpack("<I", _exactly(stream, 4))
    if size > LONGEST:
        begin = struct.pack("<I", size) + os.read(stream, 40)
        raise FunctionError(
            f"wrote {begin!r} to its standard output, which is no message: print to the standard error instead"
        )
    return _exactly(stream, size)


def _exactly(stream: int, size: int) -> bytes:
    parts = [os.read(stream, size)] if size else [b""]
    left = size - len(parts[0])
    while left:
        if not parts[-1]:
            raise EOFError
        parts.append(os.read(stream, min(left, 1 << 20)))
        left -= len(parts[-1])
    return parts[0] if len(parts) == 1 else b"".join(parts)


def _ending(code: int) -> str:
    return f"by {signal.Signals(-code).name}" if code < 0 else f"with code {code}"


def _words() -> str:
    return "" if watchdog.words is None else watchdog.last_words(watchdog.words)


def _environment() -> dict[str, str]:
    """That of the command; Python draws the same hashes, and puts no bytecode beside the frozen files."""
    return {**os.environ, "PYTHONHASHSEED": "0", "PYTHONDONTWRITEBYTECODE": "1"}


def _run(setup: Setup) -> dict[str, Any]:
    return {
        "start": list(setup.start), "goal": list(setup.goal), "length": setup.length, "width": setup.width,
        "cycle": setup.cycle, "seed": setup.seed, "route": [list(step) for step in setup.route.steps],
    }  # fmt: skip


def _list(p: Perceived) -> dict[str, Any]:
    columns = {name: getattr(p, field).tolist() for name, field in zip(OBJECT, _FIELDS, strict=True)}
    return {"ego": p.ego, "objects": columns}


def _numbers(told: Any) -> tuple[Any, Any, Any]:
    """Acceleration, curvature and plan as they are told; who drives checks them."""
    try:
        plan = told.get("plan")
        return told["acceleration"], told["curvature"], None if plan is None else np.array(plan, dtype=float)
    except (AttributeError, KeyError, TypeError, ValueError) as e:
        expected = "expected acceleration, curvature and plan (none, or rows of t, x, y, v)"
        raise FunctionError(f"answered {told!r:.60}, {expected}") from e


_known: WeakKeyDictionary[RoadNetwork, bytes] = WeakKeyDictionary()


def _lanes(network: RoadNetwork) -> bytes:
    """The lanes of a map and where they lead, packed."""
    if network not in _known:
        shapes = [one for one in network.lane_shapes(LANE_STEP) if one.lane != 0]
        number = {LaneKey(one.road, one.section, one.lane): k for k, one in enumerate(shapes)}
        after = lane_graph(network)
        _known[network] = msgpack.packb([
            {
                "road": one.road, "section": one.section, "lane": one.lane, "type": one.type,
                **{name: getattr(one, name).astype("<f8").tobytes() for name in ("centre", "left", "right")},
                "along": network.roads[one.road].along(one.lane, one.section),
                "after": [number[key] for key in after[LaneKey(one.road, one.section, one.lane)]],
            }
            for one in shapes
        ])  # fmt: skip
    return _known[network]
