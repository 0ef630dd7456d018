"""Whether a build does what resim asks of an AD function, found out on a short drive of its own making.

The drive is straight: the EGO at 20 m/s comes up behind a slower car, another one is beside it, and at times none is
seen. Nothing is simulated: the function is asked the same lists whatever it answers.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import msgpack
import numpy as np

from resim.core.errors import FunctionError
from resim.core.geometry import Bools, Floats, constant
from resim.core.plugins.watchdog import Watchdog
from resim.function import framed, packed
from resim.road.driven_route import driven_route
from resim.road.opendrive import RoadNetwork
from resim.simulation.function.batch import Keys, stacked
from resim.simulation.function.conversation import Conversation, difference
from resim.simulation.function.driver import RESET_LIMIT, driver_of
from resim.simulation.function.grpc_stream import GrpcProgram
from resim.simulation.function.interface import Build, EgoState, Perceived, Setup, unknown_heights
from resim.simulation.function.messages import MessageFunction
from resim.simulation.function.program import FunctionProgram

STEPS, STEP, SPEED = 200, 0.04, 20.0
HARDEST, TIGHTEST = 15.0, 0.5
"""m/s² and 1/m that no vehicle at SPEED does: other units, or degrees."""
SLOWER = 2.0
"""m/s by which each run of a batch starts slower than the one before it."""
RUNS = 3
"""Runs that are asked at once."""
PAUSE = 0.01
"""s between two questions in the drive that asks whether the function looks at the clock."""


@dataclass(frozen=True)
class Check:
    """One thing that was asked for: name, whether it holds, and what was found."""

    name: str
    holds: bool
    found: str


@dataclass(frozen=True)
class _Answers:
    """What a function answered in one run: commands (STEPS, 2), and its plan in each step, None for none."""

    commands: Floats
    plans: tuple[Floats | None, ...]

    def differ(self, other: _Answers) -> Bools:
        """Say in which steps (STEPS,) it answered otherwise."""
        pairs = zip(self.plans, other.plans, strict=True)
        plans = [(a is None) != (b is None) or not np.array_equal(a, b) for a, b in pairs]  # type: ignore[arg-type]
        return np.asarray((self.commands != other.commands).any(axis=1) | np.array(plans))


def conformance(build: Build, road: RoadNetwork, start: EgoState) -> Iterator[Check]:
    """Give what holds of a build. start: where the EGO begins on the road, with room for 160 m straight on.

    Once it does not answer at all, no more is asked.
    """
    first = _asked(build, road, (start,))
    if isinstance(first, str):
        yield Check("answers", False, first)
        return
    answers, times = first[0][0], first[1]
    yield Check("answers", True, f"{STEPS} lists answered, the first and the last without any object")
    most, tightest = np.abs(answers.commands).max(axis=0)
    sane = most <= HARDEST and tightest <= TIGHTEST
    yield Check("units", bool(sane), f"up to {most:.3g} m/s² and {tightest:.3g} 1/m at {SPEED:g} m/s")
    yield _same("determinism", answers, _alone(build, road, start), "the same again in a second run")
    yield _same(
        "clock",
        answers,
        _alone(build, road, start, pause=PAUSE),
        f"the same with {PAUSE:g} s between answers",
    )
    late = float(np.quantile(times, 0.99))
    told = f"median {1e3 * np.median(times):.3g} ms, 99 % {1e3 * late:.3g} ms"
    told += f" of {1e3 * build.time_limit:.3g} ms allowed"
    yield Check("latency", late < 0.5 * build.time_limit, told)
    if build.in_batches:
        yield _batches(build, road, start, answers)
    if isinstance(build.program, FunctionProgram | GrpcProgram):
        yield _restart(build, road, start, answers)
        yield _malformed(build)


def repeated(build: Build, name: str, conversation: Conversation) -> Check:
    """Ask a process what was recorded, and say whether it answers the same, byte for byte."""
    what = f"conversation {name}"
    with Watchdog() as watchdog, build.factory.afresh():
        function = build.make()
        assert isinstance(function, MessageFunction)
        k = 0
        try:
            for k, (asked, answered) in enumerate(conversation.exchanges, start=1):
                limit = build.time_limit if k > 1 else RESET_LIMIT
                found = watchdog.call(limit, function.repeat, asked)
                if found != answered:
                    watchdog.call(RESET_LIMIT, function.close)
                    return Check(what, False, _other_answer(k - 1, asked, found, answered))
            watchdog.call(RESET_LIMIT, function.close)
        except FunctionError as e:
            return Check(what, False, f"after question {k} of {len(conversation.exchanges)}: {e}")
    return Check(what, True, f"{len(conversation.exchanges)} answers the same, byte for byte")


def _other_answer(k: int, asked: bytes, found: bytes, recorded: bytes) -> str:
    t = msgpack.unpackb(asked[4:]).get("t")
    where = f"answer {k + 1}" + (f", at t = {t:.2f} s" if isinstance(t, float) else "")
    if not found or not recorded:
        return f"{where}: none {'comes' if not found else 'came when it was recorded'}"
    return f"{where}: {difference(framed(found), framed(recorded))}"


def _restart(build: Build, road: RoadNetwork, start: EgoState, answers: _Answers) -> Check:
    """Whether a run gets the same answers after one that was broken off, without `close`."""
    try:
        with Watchdog() as watchdog, build.factory.afresh():
            function = build.make()
            assert isinstance(function, MessageFunction)
            try:
                watchdog.call(RESET_LIMIT, function.reset, _setup(road, start))
                for k in range(STEPS // 2):
                    watchdog.call(build.time_limit, function.step, _seen(k, start, 0))
            finally:
                function.abandon()
    except FunctionError as e:
        return Check("restart", False, str(e))
    again = "the same again after a run that was broken off"
    return _same("restart", answers, _alone(build, road, start), again)


def _batches(build: Build, road: RoadNetwork, start: EgoState, answers: _Answers) -> Check:
    """Whether runs at once, which differ in their speeds and in what they see, get the answers that each gets alone."""
    starts = tuple(start._replace(v=start.v - SLOWER * b) for b in range(RUNS))
    together = _asked(build, road, starts)
    if isinstance(together, str):
        return Check("batches", False, together)
    for b, one in enumerate(starts):
        alone = _alone(build, road, one, run=b) if b else answers
        if isinstance(alone, str):
            return Check("batches", False, f"run {b + 1} of {RUNS} alone: {alone}")
        what = f"the same for run {b + 1} of {RUNS} at once, from {one.v:g} m/s, as for it alone"
        if not (found := _same("batches", alone, together[0][b], what)).holds:
            return found
    return Check("batches", True, f"the same for {RUNS} different runs at once as for each alone")


def _same(name: str, answers: _Answers, again: _Answers | str, what: str) -> Check:
    if isinstance(again, str):
        return Check(name, False, again)
    differ = np.flatnonzero(answers.differ(again))
    where = "" if not len(differ) else f"not {what}: {len(differ)} of {STEPS} answers differ, first that at "
    return Check(name, not len(differ), f"{where}{differ[0] * STEP:.2f} s" if where else what)


def _alone(
    build: Build, road: RoadNetwork, start: EgoState, *, pause: float = 0.0, run: int = 0
) -> _Answers | str:
    """Answers of a run that is asked alone; run: which of those of a batch it is."""
    found = _asked(build, road, (start,), pause=pause, first=run)
    return found if isinstance(found, str) else found[0][0]


def _asked(
    build: Build, road: RoadNetwork, starts: Sequence[EgoState], *, pause: float = 0.0, first: int = 0
) -> tuple[list[_Answers], Floats] | str:
    """Answers and times [s] of B whole drives, asked at once; else why there are none.

    first: which of the runs of a batch the first is, which says what it sees.
    """
    runs = len(starts)
    answers, times = np.empty((runs, STEPS, 2)), np.empty(STEPS)
    try:
        with Watchdog() as watchdog, build.factory.afresh():
            driver = driver_of(build, watchdog, runs)
            try:
                driver.reset([_setup(road, start) for start in starts])
                keys = Keys(runs)
                for k in range(STEPS):
                    seen = [_seen(k, start, first + b) for b, start in enumerate(starts)]
                    batch = stacked(seen, [keys.of_traffic(one.ids) for one in seen])
                    time.sleep(pause)
                    begin = time.perf_counter()
                    answer = driver.step(batch, keep=True)
                    times[k] = time.perf_counter() - begin
                    if not isinstance(answer, np.ndarray):
                        return "places the EGO, which oracles do"
                    answers[:, k] = answer
                plans = [dict(driver.plans(b, np.inf)) for b in range(runs)]
            finally:
                driver.close()
    except FunctionError as e:
        return str(e) + (f" ({e.words})" if e.words else "")
    told = [
        _Answers(of_run, tuple(made.get(k * STEP) for k in range(STEPS)))
        for of_run, made in zip(answers, plans, strict=True)
    ]
    return told, times


def _setup(road: RoadNetwork, start: EgoState) -> Setup:
    far = STEPS * STEP * start.v
    x, y = start.x + far * np.cos(start.heading), start.y + far * np.sin(start.heading)
    way = np.linspace(0.0, 1.0, 50)
    route = driven_route(
        road, start.x + way * (x - start.x), start.y + way * (y - start.y), np.full(50, start.heading)
    )
    return Setup(road, start, (float(x), float(y)), 4.7, 1.9, STEP, 0, None, route)


def _seen(k: int, start: EgoState, run: int) -> Perceived:
    """What the function sees at step k: in each run of a batch the car ahead elsewhere, in the second it alone."""
    t = k * STEP
    far = t * start.v
    ego = start._replace(x=start.x + far * np.cos(start.heading), y=start.y + far * np.sin(start.heading))
    n = 0 if k < 20 or k >= STEPS - 20 else 1 if run == 1 else 2
    x, y = np.array([60.0 + 3.0 * run - 5.0 * t, 10.0])[:n], np.array([0.0, 3.5])[:n]
    return Perceived(
        t, ego, constant(np.array(["1", "2"])[:n]), constant(np.array(["car", "truck"])[:n]), constant(x), constant(y),
        constant(np.zeros(n)), constant(np.array([15.0, 20.0])[:n]), constant(np.full(n, 4.5)),
        constant(np.full(n, 1.8)), unknown_heights(n),
    )  # fmt: skip


def _malformed(build: Build) -> Check:
    """What a process does with bytes that are no message, and with a message that there is none of."""
    ways: dict[str, Callable[[MessageFunction], str]] = {
        "a message of no kind": lambda function: function.probe(packed({"message": "no such message"})),
        "bytes that are no msgpack": lambda function: function.probe(b"\x04\0\0\0\xc1\xc1\xc1\xc1"),
    }
    found, holds = [], True
    for what, way in ways.items():
        with Watchdog() as watchdog, build.factory.afresh(), _unheard_words():
            function = build.make()
            assert isinstance(function, MessageFunction)
            try:
                said = watchdog.call(build.time_limit + 5.0, way, function)
                found.append(f"{what}: {said}")
            except FunctionError as e:
                holds = False
                found.append(f"{what}: {e}")
            finally:
                function.close()
    return Check("malformed input", holds, "; ".join(found))


@contextmanager
def _unheard_words() -> Iterator[None]:
    """Context in which what is written to the standard error, such as tracebacks that were asked for, goes nowhere."""
    sys.stderr.flush()
    before = os.dup(2)
    with open(os.devnull, "wb") as nowhere:  # noqa: PTH123
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
