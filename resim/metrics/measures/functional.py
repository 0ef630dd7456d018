"""Functional measures: what the function and its perception did (Groh 2018, III.B)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.clock import TICK
from resim.core.geometry import Bools, Floats
from resim.core.tracks import Strings, whole_id
from resim.metrics.drive import DriveScenes
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.values import MeasureValues, State

RANGE = 100.0
"""Distance [m] between box centres up to which an object is to be detected."""

LATE = 1.5
"""Periods after which what comes once a period is missing."""


@dataclass(frozen=True, eq=False)
class FunctionActivity:
    """When perception and function were at work.

    lists: (L,) s, times of the object lists, also of empty ones as far as they are known, None where there is no sensor
    data; ids: (N,) of the true objects; seen: (N, L) which of them stand in a list; period: s between two lists of one
    sensor, inf if unknown. answers: (A,) s, when the function answered, None where that was not recorded. delay: s that
    what a list says is older than the list. of_truth: whether the drive's objects are the true ones, that are to be
    detected, and not those detected.
    """

    lists: Floats | None
    ids: Strings
    seen: Bools
    period: float
    answers: Floats | None
    delay: float = 0.0
    of_truth: bool = True


FUNCTION_AVAILABILITY = MeasureDefinition(
    name="function availability",
    unit="1",
    worst="low",
    kind="functional",
    source="Groh 2018, III.B",
    meaning="1 where the function's last answer is still in force",
    of=lambda inputs: function_availability(inputs.drive, inputs.functioning),
    alone=True,
)


def function_availability(drive: DriveScenes, functioning: FunctionActivity | None) -> MeasureValues:
    """Give 1 where the function's last answer is in force (S,), 0 where the next one is late by half a cycle or more.

    NOT_DEFINED before the first answer; NOT_COMPUTED where no two answers were recorded.
    """
    answers = _answers(functioning)
    cycle = np.inf if answers is None else float(np.median(np.diff(answers)))
    age = _age(drive.t, answers)
    return _values(FUNCTION_AVAILABILITY, np.where(age <= LATE * cycle + TICK, 1.0, 0.0), age, answers)


PERCEPTION_AVAILABILITY = MeasureDefinition(
    name="perception availability",
    unit="1",
    worst="low",
    kind="functional",
    source="Groh 2018, III.B",
    meaning="1 where the last object list is still in force",
    of=lambda inputs: perception_availability(inputs.drive, inputs.functioning),
    alone=True,
)


def perception_availability(drive: DriveScenes, functioning: FunctionActivity | None) -> MeasureValues:
    """Give 1 where perception's last list is in force (S,), 0 where the next one is late by half a period or more.

    NOT_DEFINED before the first list; NOT_COMPUTED where there are no two of them.
    """
    lists = None if functioning is None or not np.isfinite(functioning.period) else functioning.lists
    late = np.inf if functioning is None else LATE * functioning.period
    age = _age(drive.t, lists)
    return _values(PERCEPTION_AVAILABILITY, np.where(age <= late + TICK, 1.0, 0.0), age, lists)


CYCLE_TIME = MeasureDefinition(
    name="cycle time",
    unit="s",
    worst="high",
    kind="functional",
    source="Groh 2018, III.B",
    meaning="between the function's last two answers",
    of=lambda inputs: cycle_time(inputs.drive, inputs.functioning),
    alone=True,
)


def cycle_time(drive: DriveScenes, functioning: FunctionActivity | None) -> MeasureValues:
    """Give the time (S,) [s] between the function's last two answers. States as in `function_availability`."""
    answers = _answers(functioning)
    value = np.full(len(drive.t), np.nan)
    if answers is not None:
        last = np.searchsorted(answers, drive.t + TICK, side="right") - 1
        value = np.where(last > 0, np.diff(answers, prepend=np.nan)[last], np.nan)
    return _values(CYCLE_TIME, value, value, answers)


LATENCY = MeasureDefinition(
    name="latency",
    unit="s",
    worst="high",
    kind="functional",
    source="Groh 2018, III.B",
    meaning="age of the newest thing perceived",
    of=lambda inputs: latency(inputs.drive, inputs.functioning),
    alone=True,
)


def latency(drive: DriveScenes, functioning: FunctionActivity | None) -> MeasureValues:
    """Give how old the newest thing perceived is (S,) [s]: the age of the last list, and its delay.

    NOT_DEFINED before the first list; NOT_COMPUTED where there is no sensor data.
    """
    lists = None if functioning is None else functioning.lists
    age = _age(drive.t, lists)
    delay = 0.0 if functioning is None else functioning.delay
    return _values(LATENCY, age + delay, age, lists)


DETECTION = MeasureDefinition(
    name="detection",
    unit="1",
    worst="low",
    kind="functional",
    source="Groh 2018, III.B",
    meaning="1 where an object is on a recent object list",
    of=lambda inputs: detection(inputs.drive, inputs.functioning),
    unseen=lambda absent: absent.at_worst(0.0, absent.now() <= RANGE),
)


def detection(drive: DriveScenes, functioning: FunctionActivity | None) -> MeasureValues:
    """Give 1 where an object (S, K) stands in a list of the last period and a half, 0 where in none.

    NO_CONFLICT for objects over 100 m away, which need not be; NOT_DEFINED for those that are not there, and of SD,
    whose objects are those detected; NOT_COMPUTED where there is no sensor data.
    """
    shape = drive.present.shape
    if functioning is None or functioning.lists is None:
        return _unknown(DETECTION, shape)
    rows = {name: n for n, name in enumerate(functioning.ids.tolist())}
    age = np.full(shape, np.inf)
    for k, name in enumerate(drive.ids):
        row = rows.get(name, rows.get(whole_id(name, rows)))
        if row is not None:
            age[:, k] = np.nan_to_num(_age(drive.t, functioning.lists[functioning.seen[row]]), nan=np.inf)
    own, other = drive.scenes.plan[:, 0, None, :2], drive.scenes.state[..., :2]
    asked = drive.present & functioning.of_truth
    near = asked & (np.hypot(*np.moveaxis(other - own, 2, 0)) <= RANGE)
    state = np.where(near, State.VALUE, np.where(asked, State.NO_CONFLICT, State.NOT_DEFINED)).astype(
        np.uint8
    )
    found = np.where(age <= LATE * functioning.period + TICK, 1.0, 0.0)
    return DETECTION.values(np.where(near, found, np.nan), state)


DETECTION_RATE = MeasureDefinition(
    name="detection rate",
    unit="1",
    worst="low",
    kind="functional",
    source="Groh 2018, III.B",
    meaning="share of the objects within 100 m that are detected",
    of=lambda inputs: detection_rate(inputs.drive, inputs.functioning),
    unseen=lambda absent: absent.at_worst(0.0, absent.now() <= RANGE),
)


def detection_rate(drive: DriveScenes, functioning: FunctionActivity | None) -> MeasureValues:
    """Give the share (S,) of the objects within 100 m that are detected (`detection`).

    NO_CONFLICT where none is within 100 m; NOT_DEFINED of SD; NOT_COMPUTED where there is no sensor data.
    """
    if functioning is None or functioning.lists is None:
        return _unknown(DETECTION_RATE, drive.t.shape)
    every = detection(drive, functioning)
    count = (every.state == State.VALUE).sum(axis=1)
    share = np.where(count > 0, np.nansum(every.value, axis=1) / np.maximum(count, 1), np.nan)
    none = State.NO_CONFLICT if functioning.of_truth else State.NOT_DEFINED
    state = np.where(count > 0, State.VALUE, none).astype(np.uint8)
    return DETECTION_RATE.values(share, state)


def _answers(functioning: FunctionActivity | None) -> Floats | None:
    """When the function answered, if it did twice or more."""
    if functioning is None or functioning.answers is None or len(functioning.answers) < 2:
        return None
    return functioning.answers


def _age(t: Floats, events: Floats | None) -> Floats:
    """How long ago (S,) [s] the last event was, NaN where there was none."""
    if events is None or not len(events):
        return np.full(len(t), np.nan)
    last = np.searchsorted(events, t + TICK, side="right") - 1
    return np.where(last >= 0, np.maximum(t - events[np.maximum(last, 0)], 0.0), np.nan)


def _values(of: MeasureDefinition, value: Floats, known: Floats, events: Floats | None) -> MeasureValues:
    """A measure of the EGO (S,), NOT_DEFINED where `known` is NaN, NOT_COMPUTED without events."""
    if events is None:
        return _unknown(of, value.shape)
    there = np.isfinite(known)
    state = np.where(there, State.VALUE, State.NOT_DEFINED).astype(np.uint8)
    return of.values(np.where(there, value, np.nan), state)


def _unknown(of: MeasureDefinition, shape: tuple[int, ...]) -> MeasureValues:
    state = np.full(shape, State.NOT_COMPUTED, dtype=np.uint8)
    return of.values(np.full(shape, np.nan), state)
