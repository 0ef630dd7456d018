"""Repair: what an examination found: repairs what is safe, and marks it; reports the rest."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from itertools import groupby

import pandas as pd

from resim.core.finding import Finding, Source
from resim.core.schema import REPAIRED
from resim.recordings import RecordingTables
from resim.recordings.checks import examine
from resim.recordings.repairs.clocks import clock_drift, clock_jump, clock_offset, time_unit
from resim.recordings.repairs.frames import SOURCES, Count, counted, frame_of, numbered, with_frame
from resim.recordings.repairs.gaps import holes, missing_values
from resim.recordings.repairs.identity import ego_detection, id_reused, id_switch, track_broken
from resim.recordings.repairs.motion import heading_disagrees, speed_disagrees
from resim.recordings.repairs.outliers import outlier, repeated_samples, spikes
from resim.recordings.repairs.rows import duplicate_samples, time_backwards
from resim.recordings.repairs.settings import FILTERS, Filter, RepairOptions
from resim.recordings.repairs.sizes import size_changes, size_swapped
from resim.recordings.repairs.units import heading, mirrored_y, speed_unit
from resim.recordings.tables import FILLED, JOINED, PARTED
from resim.road.opendrive import RoadNetwork

__all__ = ["FILTERS", "JUDGED", "AppliedRepair", "Count", "Filter", "Repaired", "repair"]

Repair = Callable[[RecordingTables, Finding, RepairOptions], RecordingTables]

REPAIRS: dict[str, Repair] = {
    "TIME_UNIT": time_unit,
    "SPEED_UNIT": speed_unit,
    "HEADING_UNIT": heading,
    "HEADING_TURNED": heading,
    "HEADING_CONVENTION": heading,
    "CLOCK_JUMP": clock_jump,
    "TIME_BACKWARDS": time_backwards,
    "DUPLICATE_SAMPLES": duplicate_samples,
    "MIRRORED_Y": mirrored_y,
    "CLOCK_DRIFT": clock_drift,
    "CLOCK_OFFSET": clock_offset,
    "EGO_DETECTION": ego_detection,
    "ID_REUSED": id_reused,
    "ID_SWITCH": id_switch,
    "TRACK_BROKEN": track_broken,
    "REPEATED_SAMPLES": repeated_samples,
    "OUTLIER": outlier,
    "SIZE_SWAPPED": size_swapped,
    "SIZE_CHANGES": size_changes,
    "ACCELERATION": spikes,
    "YAW_RATE": spikes,
    "SPEED_DISAGREES": speed_disagrees,
    "HEADING_DISAGREES": heading_disagrees,
    "MISSING_VALUES": missing_values,
    "MISSING_SAMPLES": holes,
    "GAP": holes,
}
"""The repair of each code, from cause to symptom: a code's findings are repaired when none before it is left.

Jumps of a clock come before the order of rows, which nobody knows until they are out, and values that miss
last, when the motion that they are interpolated from is right.
"""

JUDGED = {
    **dict.fromkeys(FILLED, "judged as not seen"),
    JOINED: "judged as a gap",
    PARTED: "judged as two objects with unseen start and end",
    "SIZE_CHANGES": "judged with every recorded size",
}
"""What a repair leaves open, by code: assessments say INVALID where it matters. Other repairs follow a known rule."""
WHOLE = ("MISSING_VALUES", "MISSING_SAMPLES")
"""Codes whose notes are repaired too: to be without holes is what is asked for."""
ONE_BY_ONE = ("ID_REUSED", "ID_SWITCH")
"""Codes of which the first in time is repaired, and the rest is looked at anew."""
LESS = 0.7
"""Part of its size down to which a finding has to come to count as repaired in part."""
SOME = 1.0 - 1e-9
"""The same for values that miss: those of rows at the ends of a track stay so."""
MOST_ROUNDS = 200


@dataclass(frozen=True)
class AppliedRepair:
    """What was repaired of one code in one source: of which objects ("" for the whole table), and how many rows."""

    code: str
    source: Source
    objects: tuple[str, ...]
    count: Count


@dataclass(frozen=True, eq=False)
class Repaired:
    """The repaired tables, what was done, and the findings that are left, worst first."""

    tables: RecordingTables
    done: tuple[AppliedRepair, ...]
    left: tuple[Finding, ...]


def repair(
    tables: RecordingTables, network: RoadNetwork | None, *, max_gap: float = 1.0, outliers: Filter = "robust"
) -> Repaired:
    """Repair what is safe to repair, and mark each row that was changed or added with the code, in `repaired`.

    Errors and warnings that have a repair are repaired, of notes the holes alone: other notes are properties
    of a sensor. A repair that does not take its finding away, or brings an error, is taken back. max_gap [s]:
    longest gap that is filled. outliers: the filter that tells them. The tables given stay as they are. Raises
    InputError for settings that are none.
    """
    how = RepairOptions(max_gap, outliers)
    state = numbered(tables, 0)
    findings = examine(state, network)
    done: list[tuple[Finding, Count]] = []
    futile: set[tuple[str, ...]] = set()
    since = 0  # repairs when those that failed were last given another try
    for _ in range(MOST_ROUNDS):
        now = _next(findings, futile)
        if not now and len(done) > since:
            since, futile = len(done), set()
            now = _next(findings, futile)
        if not now:
            break
        while now:  # without those that fail, until all the others do their work
            tried, counts = _apply(state, now, replace(how, findings=findings))
            after = examine(tried, network) if any(c.samples for c in counts) else findings
            bad = _failed(now, findings, after)
            if not bad:
                state, findings = tried, after
                done += [(f, c) for f, c in zip(now, counts, strict=True) if c.samples]
                break
            futile |= {_key(f) for f in bad}
            now = [f for f in now if f not in bad]
    return Repaired(_given(tables, state), _summed(done), findings)


def _next(findings: tuple[Finding, ...], futile: Collection[tuple[str, ...]]) -> list[Finding]:
    """The findings that are to be repaired now: those of the first code."""
    mine = [
        f for f in findings
        if f.repair and f.code in REPAIRS and _key(f) not in futile
        and (f.severity != "note" or f.code in WHOLE)
    ]  # fmt: skip
    order = list(REPAIRS)
    first = min((order.index(f.code) for f in mine), default=None)
    now = sorted(
        (f for f in mine if order.index(f.code) == first), key=lambda f: (f.start, f.source, f.object)
    )
    return now[:1] if now and now[0].code in ONE_BY_ONE else now


def _apply(
    state: RecordingTables, now: list[Finding], how: RepairOptions
) -> tuple[RecordingTables, list[Count]]:
    counts = []
    for finding in now:
        after = REPAIRS[finding.code](state, finding, how)
        counts.append(counted(state, after))
        state = after
    return state, counts


def _failed(now: list[Finding], before: tuple[Finding, ...], after: tuple[Finding, ...]) -> list[Finding]:
    """Which repairs left their finding as large, or brought an error to their object."""
    left = {_key(f): abs(f.value) for f in after}
    errors = {_key(f) for f in before if f.severity == "error"}
    new = [f for f in after if f.severity == "error" and _key(f) not in errors]
    worse = len([f for f in after if f.severity == "error"]) > len(
        [f for f in before if f.severity == "error"]
    )
    out = []
    for finding in now:
        less = SOME if finding.code == "MISSING_VALUES" else LESS
        stays = left.get(_key(finding), -1.0) > less * abs(finding.value)
        harms = worse and any(f.object in (finding.object, "") or not finding.object for f in new)
        if stays or harms:
            out.append(finding)
    return out or (now if worse else [])


def _key(finding: Finding) -> tuple[str, ...]:
    """What makes a finding the same after a repair of another."""
    when = f"{finding.start:.6f}" if finding.code in ("GAP", "CLOCK_JUMP", *ONE_BY_ONE) else ""
    return finding.code, finding.source, finding.object, when, str(finding.details.get("other", ""))


def _given(tables: RecordingTables, state: RecordingTables) -> RecordingTables:
    """The tables with rows numbered as in a file, and the column of marks where there are any, or were."""
    out = numbered(state, 2)
    for source in SOURCES:
        if source == "sd" and tables.sd is None:
            continue
        frame, before = frame_of(out, source), frame_of(tables, source)
        if REPAIRED not in before and not (frame[REPAIRED] != "").any():
            frame = frame.drop(columns=REPAIRED)
        out = with_frame(out, source, _typed(frame, before))
    return out


def _typed(frame: pd.DataFrame, before: pd.DataFrame) -> pd.DataFrame:
    """The table with the types that its columns of text had; numbers may have become fractions."""
    text = [c for c in before if c in frame and not pd.api.types.is_numeric_dtype(before[c])]
    return frame.astype({c: before[c].dtype for c in text})


def _summed(done: list[tuple[Finding, Count]]) -> tuple[AppliedRepair, ...]:
    """What was done, by code and source in the order of the repairs."""
    order = list(REPAIRS)

    def by(one: tuple[Finding, Count]) -> tuple[int, str]:
        return order.index(one[0].code), one[0].source

    out = []
    for _, group in groupby(sorted(done, key=by), key=by):
        some = list(group)
        objects = tuple(dict.fromkeys(f.object for f, _ in some))
        count = sum((c for _, c in some), Count())
        if count.samples:
            out.append(AppliedRepair(some[0][0].code, some[0][0].source, objects, count))
    return tuple(out)
