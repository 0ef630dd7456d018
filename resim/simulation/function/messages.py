"""An AD function that is asked by messages: what resim tells it, and what its answers have to be.

docs/formats/process.md says what is in each message. Who carries them is the function's `Partner`: a process of its
own (`process`), a stream to a server (`grpc_stream`), or a conversation that was recorded (`conversation`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol
from weakref import WeakKeyDictionary

import msgpack
import numpy as np

from resim.core.errors import FunctionError
from resim.core.files import file_hash
from resim.core.plugins import watchdog
from resim.core.plugins.unlisted_files import unheard
from resim.function import OBJECT, PROTOCOL, packed
from resim.road.links import LaneKey, lane_graph
from resim.road.opendrive import RoadNetwork
from resim.simulation.function.batch import CommandBatch, PerceivedBatch
from resim.simulation.function.conversation import Exchange
from resim.simulation.function.interface import Command, Perceived, Setup

LANE_STEP = 2.0
"""m between points of the lanes that a function is told."""
_FIELDS = ("ids", "kind", "x_ego", "y_ego", "heading_ego", "v", "length", "width", "z_ego")
Answer = dict[str, Any]


class Partner(Protocol):
    """The other side of a conversation, for one run."""

    def start(self) -> None:
        """Begin. Raises FunctionError where that fails."""

    def exchange(self, message: bytes) -> bytes:
        """Send a message, its length before it, and give the body of its answer.

        Raises EOFError, with how it ended in words, where there is nobody any more, and FunctionError for no message.
        """

    def end(self, message: bytes) -> None:
        """Send the last message, and end. Raises FunctionError where it does not end well."""

    def kill(self) -> None:
        """End at once, whatever happens; also what has ended."""


class MessageProgram(Protocol):
    """What a build names that is asked by messages."""

    def partner(self) -> Partner:
        """Give a partner for one run."""


class MessageFunction:
    """A function that is asked by messages.

    Attributes:
        exchanges: What was sent and received, lengths and all, if that is kept: a list that somebody put there.
    """

    def __init__(self, program: MessageProgram, parameters: Mapping[str, Any]) -> None:
        self._partner, self._parameters = program.partner(), dict(parameters)
        self._waiting = False  # for an answer that did not come: no other message is understood
        self._begun = False
        self.exchanges: list[Exchange] | None = None

    def reset(self, setup: Setup) -> None:
        """Begin, and prepare it."""
        self._begin("reset", setup, _run(setup))

    def reset_batch(self, setups: Sequence[Setup]) -> None:
        """Begin, and prepare it for all runs."""
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
        """End it; FunctionError where it does not end by itself, or ends with an error."""
        if self._waiting or not self._begun:
            self._partner.kill()
            return
        self._begun = False
        self._partner.end(packed({"message": "close"}))

    def abandon(self) -> None:
        """End it at once, as a run does that is broken off."""
        self._begun = False
        self._partner.kill()

    def probe(self, message: bytes) -> str:
        """Begin, and say what it does with a message that it cannot know; FunctionError for an answer."""
        self._partner.start()
        self._waiting = True
        try:
            answer = _unpacked(self._partner.exchange(message))
        except EOFError as e:
            if str(e).endswith(("with code 0", "with OK")):
                raise FunctionError(f"{e}, as if all were well") from None
            return str(e)
        if not isinstance(answer, dict) or "error" not in answer:
            raise FunctionError(f"answered {answer!r:.60}, expected an error")
        return f"answered the error {_reason(answer):.100}"

    def repeat(self, message: bytes) -> bytes:
        """Send a message as it was recorded, the first one after a start, and give the answer; b"" for none."""
        if not self._begun:
            self._begun = True
            self._partner.start()
        self._waiting = True
        try:
            answer = self._partner.exchange(message)
        except EOFError:
            return b""
        self._waiting = False
        return answer

    def _begin(self, message: str, setup: Setup, told: Mapping[str, Any]) -> None:
        self._begun = True
        self._partner.start()
        road = {"file": str(setup.road.path.absolute()), **_road(setup.road)}
        head = {"message": message, "protocol": PROTOCOL, "parameters": self._parameters, "road": road}
        answer = self._ask({**head, **told})
        if (version := answer.get("protocol")) != PROTOCOL or isinstance(version, bool):
            raise FunctionError(f"answered {answer!r:.60} to {message!r}, expected protocol = {PROTOCOL}")

    def _ask(self, message: Answer) -> Answer:
        """Send a message and give its answer."""
        if not self._begun:
            raise FunctionError("was asked before its reset")
        self._waiting = True
        asked, body = packed(message), b""
        try:
            body = self._partner.exchange(asked)
        except EOFError as e:
            raise FunctionError(str(e), words=_words()) from None
        finally:
            if self.exchanges is not None:
                self.exchanges.append((asked, body))
        answer = _unpacked(body)
        if not isinstance(answer, dict):
            raise FunctionError(f"answered {answer!r:.60}, expected a map")
        self._waiting = False
        if "error" in answer:
            raise FunctionError(f"failed: {_reason(answer):.300}", words=_words())
        return answer


def _reason(answer: Answer) -> str:
    """The text of an error. Raises FunctionError where it is none."""
    if not isinstance(answer["error"], str):
        raise FunctionError(f"answered {answer!r:.60}, expected a text as error", words=_words())
    return answer["error"]


def _unpacked(body: bytes) -> Any:
    """A message of its bytes. Raises FunctionError where it is none, or has a key twice."""
    try:
        return msgpack.unpackb(body, object_pairs_hook=_map)
    except (ValueError, msgpack.UnpackException) as e:
        raise FunctionError(f"answered what is no msgpack ({e}): {body[:40]!r}") from e


def _map(pairs: list[tuple[Any, Any]]) -> dict[Any, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for k, key in enumerate(keys) if key in keys[:k])
        raise FunctionError(f"answered a map that has {twice!r:.60} twice")
    return found


def _words() -> str:
    return "" if watchdog.words is None else watchdog.last_words(watchdog.words)


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
        numbers = told["acceleration"], told["curvature"]
        if any(isinstance(one, bool) for one in numbers):
            raise TypeError
        plan = None if plan is None else np.array(plan)
        if plan is not None and plan.dtype.kind not in "fiu":
            raise TypeError
        return *numbers, None if plan is None else plan.astype(float)
    except (AttributeError, KeyError, TypeError, ValueError) as e:
        expected = "expected acceleration, curvature and plan (none, or rows of t, x, y, v)"
        raise FunctionError(f"answered {told!r:.60}, {expected}") from e


_known: WeakKeyDictionary[RoadNetwork, dict[str, Any]] = WeakKeyDictionary()


def _road(network: RoadNetwork) -> dict[str, Any]:
    """The hash of a map's file, and its lanes, packed: what a function may know of it, wherever it lies."""
    if network not in _known:
        with unheard():  # resim reads the map, not the code under test
            digest = file_hash(network.path)
        _known[network] = {"hash": digest, "lanes": _lanes(network)}
    return _known[network]


def _lanes(network: RoadNetwork) -> bytes:
    """The lanes of a map and where they lead, packed."""
    shapes = [one for one in network.lane_shapes(LANE_STEP) if one.lane != 0]
    number = {LaneKey(one.road, one.section, one.lane): k for k, one in enumerate(shapes)}
    after = lane_graph(network)
    packed_lanes: bytes = msgpack.packb([
        {
            "road": one.road, "section": one.section, "lane": one.lane, "type": one.type,
            **{name: getattr(one, name).astype("<f8").tobytes() for name in ("centre", "left", "right")},
            "along": network.roads[one.road].along(one.lane, one.section),
            "after": [number[key] for key in after[LaneKey(one.road, one.section, one.lane)]],
        }
        for one in shapes
    ])  # fmt: skip
    return packed_lanes
