"""Check: looks at a recording's tables for what would make a result wrong, before anything is computed of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import pandas as pd

from resim.core.finding import Finding, Source
from resim.core.schema import GT_ID
from resim.recordings import RecordingTables
from resim.recordings.checks.bodies import impossible, overlaps, sizes, swapped
from resim.recordings.checks.clock import in_order
from resim.recordings.checks.codes import CODES, FindingCode, RankedFinding, worst_first
from resim.recordings.checks.delay import clocks
from resim.recordings.checks.ego_detection import ego_detections
from resim.recordings.checks.headings import headings
from resim.recordings.checks.heights import heights
from resim.recordings.checks.identity import broken, jumps, parts_of
from resim.recordings.checks.matching import egos_misnamed, misnamed, pairs, strangers
from resim.recordings.checks.motion import heading, limits, speed
from resim.recordings.checks.offsets import offsets
from resim.recordings.checks.place import places
from resim.recordings.checks.reference import reference_points
from resim.recordings.checks.samples import duplicates, holes, missing_values, repeated
from resim.recordings.checks.time_unit import time_unit
from resim.recordings.checks.tracks import CheckedTable, table_of
from resim.recordings.checks.units import mirrored, sides, speed_units
from resim.road.opendrive import RoadNetwork

__all__ = ["CODES", "FindingCode", "examine"]

TORN = ("ID_SWITCH", "ID_REUSED", "POSITION_JUMP")
"""Findings that tear a track: what differs from the other source, the map or other boxes after them follows."""

EXPLAINED = {
    "ACCELERATION": ("SPEED_DISAGREES",),
    "YAW_RATE": ("HEADING_DISAGREES",),
    "SPEED_DISAGREES": ("CLOCK_DRIFT",),
    "HEADING_DISAGREES": ("HEADING_UNIT", "HEADING_TURNED", "HEADING_CONVENTION"),
    "WRONG_WAY": ("HEADING_DISAGREES", *TORN),
    "OFF_MAP": TORN,
    "OVERLAP": ("OFF_MAP", "SIZE_IMPOSSIBLE", *TORN),
    "GAP": ("ID_REUSED",),
    "MISSING_SAMPLES": ("ID_REUSED",),
}
"""Findings that are symptoms where the same object, or its table, has one of these."""


def examine(tables: RecordingTables, network: RoadNetwork | None) -> tuple[Finding, ...]:
    """Give what is wrong with a recording, worst first; the same tables give the same findings.

    network: the recording's map, None where there is none to look at. A look goes from cause to symptom: what
    is found is put right in memory (units, clock jumps, outliers) before the next look, so that one fault gives
    one finding. Raises nothing on any tables that `read_tables` lets through.
    """
    ego = tables.settings.ego
    gt, out = _source("gt", tables.gt, {}, ego)
    sd: CheckedTable | None = None
    if tables.sd is not None:
        sd, more = _source("sd", tables.sd, _gt_names(tables.sd, tables.gt), ego)
        out += more
    gt, sd, more = mirrored(gt, sd, network)
    out += more
    gt, more = _motion(gt, network, ego)
    out += more
    if sd is not None:
        sd, more = _motion(sd, network, ego)
        out += more + list(_both(gt, sd, out + more, ego))
        assert tables.sd is not None
        out += egos_misnamed(tables.sd, tables.gt, ego)
    return worst_first(_causes(out))


def _source(
    source: Source, frame: pd.DataFrame, gt_id: dict[str, str], ego: str
) -> tuple[CheckedTable, list[RankedFinding]]:
    """What the rows of one source show, and its table in SI units."""
    frame, out = time_unit(source, frame)
    frame, more = in_order(source, frame)
    out += more
    out += missing_values(source, frame)
    out += duplicates(source, frame)
    out += sizes(source, frame)
    out += impossible(source, frame)
    frame, more = swapped(source, frame)
    out += more
    out += holes(table_of(source, frame, gt_id, incomplete=True), ego)
    table = table_of(source, frame, gt_id)
    for look in (repeated, speed_units, headings):
        table, more = look(table)
        out += more
    return table, out


def _motion(
    table: CheckedTable, network: RoadNetwork | None, ego: str
) -> tuple[CheckedTable, list[RankedFinding]]:
    """What the motion of one source shows, and its table, cut where tracks are torn."""
    if not table.tracks:
        return table, []
    out = broken(table)
    table, more = jumps(table)
    out += more
    table, more = heights(table, network)
    out += more
    for look in (speed, heading, limits, overlaps):
        out += look(table)
    if network is not None:
        out += places(table, network, ego)
    return table, out


def _both(
    gt: CheckedTable, sd: CheckedTable, known: list[RankedFinding], ego: str
) -> Iterator[RankedFinding]:
    """What the two sources show beside each other, but for what a whole table on the wrong map explains.

    Tracks that are torn have no one clock or name; where the tear is no error, their pieces are compared as well.
    """
    if swapped := [*sides(gt, sd, ego)]:
        yield from swapped
        return
    named = [f.finding for f in known]
    elsewhere = {f.source for f in named if f.code in ("OFF_MAP", "WRONG_WAY") and not f.object}
    if len(elsewhere) == 1:
        return
    whole = {(k.source, n) for k in (gt, sd) for n, c in Counter(t.id for t in k.tracks).items() if c == 1}
    grave = {(f.source, f.object) for f in named if f.code in TORN and f.severity == "error"}
    every = [p for p in pairs(gt, sd) if not grave & {("gt", p.gt.id), ("sd", p.sd.id)}]
    pieces = [p for p in every if not {("gt", p.gt.id), ("sd", p.sd.id)} <= whole]
    beside, mistaken = misnamed(gt, [p for p in every if p not in pieces])
    yield from mistaken
    found_clocks, explained = clocks(gt, sd, beside, ego)
    yield from found_clocks
    points = list(reference_points(beside, explained, ego))
    yield from points
    own = list(ego_detections(gt, sd, ego))
    yield from own
    far = list(strangers(sd, beside, explained, parts_of(known) | {f.finding.object for f in own}))
    yield from far
    told = {f.finding.object for f in (*points, *far)}
    yield from offsets(sd, [p for p in (*beside, *pieces) if p.sd.id not in told], explained)


def _gt_names(sd: pd.DataFrame, gt: pd.DataFrame) -> dict[str, str]:
    """The GT id of each SD object, "" for none."""
    if GT_ID in sd:
        return {str(name): str(own) for name, own in sd.groupby("id", sort=False)[GT_ID].first().items()}
    known = set(gt["id"])
    return {name: name if name in known else "" for name in dict.fromkeys(sd["id"])}


def _causes(everything: list[RankedFinding]) -> list[RankedFinding]:
    """The findings without symptoms, and of each code and object the worst (each gap stays)."""
    have = {(f.finding.code, f.finding.source, f.finding.object) for f in everything}
    whole = {(f.finding.code, f.finding.source) for f in everything if not f.finding.object}
    best: dict[tuple[object, ...], RankedFinding] = {}
    for one in everything:
        f = one.finding
        causes = EXPLAINED.get(f.code, ())
        if not one.own and any(
            (c, f.source, f.object) in have or {(c, f.source), (c, "recording")} & whole for c in causes
        ):
            continue
        key = (f.code, f.source, f.object, f.start if f.code in ("GAP", *TORN) else 0.0)
        if key not in best or one.excess > best[key].excess:
            best[key] = one
    return list(best.values())
