"""Criteria: requirements on measures, from a TOML file, and the verdict (KPI) of each on a drive."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np

from resim.core.clock import TICK
from resim.core.errors import ChangedError, FunctionError, InputError
from resim.core.files import read_file
from resim.core.geometry import Bools, Floats
from resim.core.plugins.frozen import FrozenCopy, FrozenFile, load_frozen
from resim.core.plugins.loading import freeze_code, load_named
from resim.core.plugins.watchdog import Watchdog
from resim.core.spelling import did_you_mean
from resim.metrics.criteria_file import EXAMPLE, SAME, Criterion, OwnMeasure, parse_criteria, step_of
from resim.metrics.measures import MeasureDefinition, MeasureValues, State
from resim.metrics.measures.inputs import MeasureInputs
from resim.metrics.measures.registry import MEASURES
from resim.road.opendrive import lend_network

Outcome = Literal["PASS", "FAIL", "INVALID"]
NAMED = 5
"""Objects that a reason names."""
MEASURE_LIMIT = 60.0
"""s of wall clock for a measure of the user's own, for one drive."""


@dataclass(frozen=True, eq=False)
class Criteria:
    """What a drive has to keep to, and the user's own measures.

    Attributes:
        name: Of the set.
        criteria: In the order of the file.
        own: The user's own measures.
        hash: SHA-256 of the file and the sources of those measures.
    """

    name: str
    criteria: tuple[Criterion, ...]
    own: tuple[MeasureDefinition, ...] = ()
    hash: str = ""


@dataclass(frozen=True)
class Verdict:
    """The KPI of one criterion: outcome, worst value, limit, unit, when [s], which object, and why.

    value and t are None where nothing was measured; object is "" for the EGO itself or the whole scene.
    """

    criterion: str
    measure: str
    outcome: Outcome
    value: float | None
    limit: float
    unit: str
    t: float | None
    object: str
    weight: float
    reason: str


def freeze_criteria(path: Path) -> FrozenFile:
    """Keep a copy of a file of criteria, with the code of its own measures. Raises InputError."""
    raw = read_file(path, EXAMPLE)
    file = parse_criteria(raw, path)
    return freeze_code(path, raw, [o.function for o in file.measure], file.files)


def read_criteria(criteria: str | Path | FrozenFile) -> Criteria:
    """Read a TOML file of criteria, from a frozen copy.

    Args:
        criteria: The file, or its frozen copy.

    Returns:
        The criteria, with the user's own measures.

    Raises:
        InputError: Names every fault.
    """
    frozen = criteria if isinstance(criteria, FrozenFile) else freeze_criteria(Path(criteria))
    path, copy = frozen.path, load_frozen(frozen, freeze_criteria)
    file = parse_criteria(copy.raw, path)
    own = tuple(_own(frozen, copy, o) for o in file.measure)
    known = [measure.name for measure in (*MEASURES, *own)]
    for what, called in (("criterion", [c.name for c in file.criterion]), ("measure", known)):
        if twice := [name for name in called if called.count(name) > 1]:
            raise InputError(path, f"the {what} {twice[0]!r} is a duplicate", "Give each its own name.")
    if strange := [c.measure for c in file.criterion if c.measure not in known]:
        raise InputError(
            path,
            f"there is no measure {strange[0]!r}{did_you_mean(strange[0], known)}",
            f"Measures: {', '.join(known)}.",
        )
    return Criteria(file.name, file.criterion, own, frozen.hash)


def _own(frozen: FrozenFile, copy: FrozenCopy, own: OwnMeasure) -> MeasureDefinition:
    function = load_named(frozen, copy, own.function, "measure")
    path = frozen.path

    def of(inputs: MeasureInputs) -> MeasureValues:
        drive = inputs.drive
        shapes = drive.t.shape, drive.present.shape
        try:
            with (
                lend_network(inputs.network, path) as road, function.afresh() as opened, Watchdog() as watchdog,
            ):  # fmt: skip
                value, what = watchdog.call(
                    MEASURE_LIMIT, lambda: _numbers(function.load()(deepcopy(drive), road), shapes)
                )
        except ChangedError:
            raise
        except FunctionError as e:
            problem = f"measure {own.name!r}: {own.function} {e}"
            raise InputError(path, problem, opened.remedy()) from e
        if what:
            problem = f"measure {own.name!r}: {own.function} gave {what}"
            expected = (
                f"expected an array of real numbers {shapes[0]} (scenes) or {shapes[1]} (scenes, objects)"
            )
            raise InputError(path, f"{problem}; {expected}", "Give NaN where it is not defined.")
        there = drive.present if value.ndim == 2 else np.ones(value.shape, dtype=bool)
        state = np.where(np.isnan(value), State.NOT_DEFINED, State.VALUE)
        state = np.where(there, state, State.NOT_COMPUTED).astype(np.uint8)
        found = definition.values(np.where(state == State.VALUE, value, np.nan), state)
        note = opened.note()
        return replace(found, note=f"measure {own.name!r}: {note}" if note else "")

    definition = MeasureDefinition(
        name=own.name,
        unit=own.unit,
        worst=own.worst,
        kind=own.kind,
        source=own.function,
        meaning="a measure of the user's own",
        of=of,
    )
    return definition


def _numbers(given: Any, shapes: tuple[tuple[int, ...], ...]) -> tuple[Floats, str]:
    """An own measure's values, in one of these shapes, and what it gave instead of that; "" where it gave those.

    What it gave may be an object whose code runs when it is read.
    """
    nothing = np.empty(0)
    if np.ma.isMaskedArray(given):
        return nothing, "a masked array"
    try:
        value = np.asarray(given)
    except (TypeError, ValueError):  # rows of different lengths
        return nothing, f"a {type(given).__name__} that is not an array"
    if value.dtype.kind not in "biuf":
        what = "complex numbers" if value.dtype.kind == "c" else f"values of type {value.dtype}"
        return nothing, f"{what} in an array {value.shape}"
    if value.shape not in shapes:
        return nothing, f"an array {value.shape}"
    numbers = np.array(value, dtype=float)
    return numbers, "inf" if np.isinf(numbers).any() else ""


def judge(
    criterion: Criterion, measure: MeasureValues, t: Floats, ids: Sequence[str], present: Bools | None = None
) -> Verdict:
    """Judge a measure (S,) of the EGO, or (S, K) of it and objects `ids`, over the scenes at t (S,) s.

    present: (S, K) where an object is there; elsewhere nothing has to be computed. FAIL where the limit can have been
    broken for the duration or longer, by one object (`Criterion.lasts`). INVALID, never PASS, where a value that should
    be there was not computed, the measure has no meaning anywhere, what lies beyond its horizon can break the limit,
    or the limit is broken in a part shorter than the duration.
    """
    own = measure.value.ndim == 1
    columns, states = (a[:, None] if own else a for a in (measure.value, measure.state))
    whose = [""] if own else list(ids)
    there = np.ones(states.shape, dtype=bool) if present is None or own else present
    within = criterion.within(t)
    counts = there & within[:, None]
    bad = criterion.badness(np.where(counts, columns, np.nan))
    broken_by = bad > 0.0
    times = np.full(bad.shape[1], -1.0)
    for k in np.flatnonzero(broken_by.any(axis=0)).tolist():
        times[k] = longest(broken_by[:, k], t)
    most, extent = float(times.max(initial=-1.0)), criterion.extent(t)
    short = most >= 0.0 and extent < criterion.duration - TICK
    failed = criterion.lasts(times, t) & (not short)
    fails = bool(failed.any())
    lost = counts & (states == State.NOT_COMPUTED)
    beyond = _beyond(criterion, measure, counts & (states == State.NO_CONFLICT), broken_by, t)
    meant = counts & (states != State.NOT_DEFINED) & ~lost
    worst = _worst(np.where(failed, bad, np.nan) if fails else bad)
    value, when, whom = (None, None, "") if worst is None else (
        float(columns[worst]), float(t[worst[0]]), whose[worst[1]]
    )  # fmt: skip
    upto = most + step_of(t) if fails and most < criterion.duration - TICK else most
    lasted = f"{'up to ' if upto > most else ''}{min(upto, extent):.1f} s"
    broken = f"{criterion.side} {amount(criterion.limit, measure.unit)} for {lasted}"
    outcome: Outcome = "PASS"
    reason = f"{broken} only" if most >= 0.0 else "kept"
    if value is None:
        reason = (
            _no_conflict(criterion, measure, counts & (states == State.NO_CONFLICT)) if whose else "no object"
        )
    if fails:
        outcome, reason = "FAIL", broken
    elif short:
        outcome = "INVALID"
        reason = f"{broken}; the drive has less than {criterion.duration:g} s in this part"
    elif lost.any():
        scenes = f"{int(lost.any(axis=1).sum())} of {int(within.sum())} scenes"
        outcome, reason = "INVALID", f"not computed in {scenes}{_names(lost, whose)}"
    elif not within.any():
        outcome, reason = "INVALID", "the drive has no scene in this part"
    elif beyond.any():
        outcome, reason = "INVALID", f"{_so_far(criterion, measure, beyond)}{_names(beyond, whose)}"
    elif not meant.any() and counts.any():
        outcome, reason = "INVALID", "not defined anywhere in the drive"
    return Verdict(
        criterion.name, criterion.measure, outcome, value, criterion.limit, measure.unit, when, whom,
        criterion.weight, reason,
    )  # fmt: skip


def _beyond(criterion: Criterion, measure: MeasureValues, none: Bools, broken: Bools, t: Floats) -> Bools:
    """In which scenes (S, K) a limit can be broken beyond the horizon, of those who can have broken it for long."""
    if measure.beyond is None:
        return np.zeros(none.shape, dtype=bool)
    can = none & ((criterion.badness(measure.beyond) > SAME) | (not criterion.worsens(measure.worst)))
    long = [
        c.any() and criterion.lasts(np.array([longest(c | b, t)]), t).any()
        for c, b in zip(can.T, broken.T, strict=True)
    ]
    return np.asarray(can & np.array(long, dtype=bool))


def _so_far(criterion: Criterion, measure: MeasureValues, beyond: Bools) -> str:
    """What is not shown by no conflict within the horizon."""
    if not criterion.worsens(measure.worst):
        limit = f"{criterion.side} {amount(criterion.limit, measure.unit)}"
        return f"no conflict within the look-ahead does not show that it is not {limit}"
    return f"no conflict within the look-ahead shows only that it is not {_shown(criterion, measure, beyond)}"


def _no_conflict(criterion: Criterion, measure: MeasureValues, none: Bools) -> str:
    """What no conflict anywhere shows."""
    known = measure.beyond is not None and none.any() and np.isfinite(measure.beyond).all()
    if not known or not criterion.worsens(measure.worst):
        return "no conflict"
    return f"no conflict within the look-ahead: not {_shown(criterion, measure, none)}"


def _shown(criterion: Criterion, measure: MeasureValues, none: Bools) -> str:
    """What a measure is not, where it found nothing within its horizon: "below 4 s"."""
    most = np.broadcast_to(measure.beyond if measure.beyond is not None else np.nan, none.shape)[none]
    worst = float(most.min() if criterion.side == "below" else most.max())
    return f"{criterion.side} {amount(worst, measure.unit)}"


def amount(value: float, unit: str) -> str:
    """Give a value with its unit; "beyond any" where it has no bound."""
    if not math.isfinite(value):
        return "beyond any"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def worst_words(value: float, unit: str, t: float, whom: str) -> str:
    """Give a worst value, when [s], and because of which object, "" for none: "0.31 s at 9.2 s, object 1"."""
    return f"{amount(value, unit)} at {t:.1f} s" + (f", object {whom}" if whom else "")


def reason_words(verdict: Verdict) -> str:
    """Give why a verdict is what it is, with the measure where a limit is broken: "THW below 0.5 s for 1.2 s"."""
    return f"{verdict.measure} {verdict.reason}" if verdict.outcome == "FAIL" else verdict.reason


class HasOutcome(Protocol):
    """A verdict or a KPI."""

    @property
    def outcome(self) -> Outcome:
        """Give PASS, FAIL or INVALID."""


def overall(verdicts: Mapping[str, HasOutcome]) -> Outcome:
    """Give FAIL where one fails, else INVALID where one is, else PASS."""
    outcomes = {v.outcome for v in verdicts.values()}
    return "FAIL" if "FAIL" in outcomes else "INVALID" if "INVALID" in outcomes else "PASS"


def _names(lost: Bools, whose: Sequence[str]) -> str:
    """Of whom something is lost, in brackets; "" for the EGO."""
    names = [name for k, name in enumerate(whose) if name and lost[:, k].any()]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f" (objects {', '.join(names[:NAMED])}{more})" if names else ""


def _worst(bad: Floats) -> tuple[int, int] | None:
    """Scene and column of the largest, None where all are NaN."""
    if np.isnan(bad).all():
        return None
    scene, k = np.unravel_index(int(np.nanargmax(bad)), bad.shape)
    return int(scene), int(k)


def longest(broken: Bools, t: Floats) -> float:
    """Give the longest time [s] that the limit is broken without a break, each scene for its step; -1 for never."""
    if not broken.any():
        return -1.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], broken, [False]]).astype(np.int8)))
    return float((t[edges[1::2] - 1] - t[edges[::2]]).max()) + step_of(t)
