"""Units and signs: speeds in km/h, y down. What is found is put right for the checks after."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from resim.core.finding import Severity
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.derived import motion
from resim.recordings.checks.place import WALKERS
from resim.recordings.checks.tracks import PEDESTRIAN, CheckedTable, Complex, Track
from resim.recordings.sides import MOST_TIMES, sides_swapped
from resim.road.opendrive import RoadNetwork

SPEED_UNITS = {"km/h": 3.6, "mph": 2.236936}
NEAR = 0.08
"""Relative distance from a unit's factor that still is it: noise, and speeds that are late; km/h and mph are far
apart, and no speedometer is wrong by a factor of two."""
MOVING = 1.0
"""Speed of the positions [m/s] from which on their ratio to the speed says something."""
BAD, GOOD = 0.3, 0.8
"""Share of places with the road's direction, as they stand and mirrored, that tell a mirrored map frame."""
STEADY = 0.25
"""Relative distance from a unit's factor that three quarters of the ratios keep: a wrong speed does not."""
ENOUGH = 1000
"""Places that tell a mirrored frame."""
SEVERAL = 3
"""Vehicles that must each look mirrored where they are on the road either way: fewer may be on the wrong side."""
MIRROR_FAR = 2.0
"""Distance of SD and GT [m] from which on a mirror image is looked for."""


def speed_units(table: CheckedTable) -> tuple[CheckedTable, list[RankedFinding]]:
    """Give objects whose speed is a unit's factor larger than their positions', and the table in m/s."""
    units: dict[str, str] = {}
    moving = 0
    for track in table.tracks:
        m = motion(track, table.step)
        drives = (np.abs(m.moved) > MOVING) & (np.abs(m.told) > MOVING)
        if not drives.sum() >= 5:
            continue
        moving += 1
        ratios = np.abs(m.told[drives]) / np.abs(m.moved[drives])
        for unit, factor in SPEED_UNITS.items():
            off = np.abs(ratios / factor - 1.0)
            if abs(float(np.median(ratios)) / factor - 1.0) < NEAR and float(np.quantile(off, 0.75)) < STEADY:
                units[track.id] = unit
    if not units:
        return table, []

    def converted(track: Track) -> Floats:
        return track.v / SPEED_UNITS[units[track.id]] if track.id in units else track.v

    whole = len(units) == moving > 1 and len(set(units.values())) == 1
    out = []
    for name in [""] if whole else units:
        unit = units[name] if name else next(iter(units.values()))
        who = f"all {moving} moving objects: their speeds are" if whole else "its speeds are"
        text = f"{who} {SPEED_UNITS[unit]:.2f} times what the positions give: {unit}"
        factor, span = SPEED_UNITS[unit], table.span_of(name)
        details = {"factor": factor}
        out.append(
            found("SPEED_UNIT", table.source, name, span, factor, "", text, limit=1.0, details=details)
        )
    if whole:  # those at rest are in the same unit
        unit = next(iter(units.values()))
        return table.shaped(v=lambda k: k.v / SPEED_UNITS[unit]), out
    return table.shaped(v=converted), out


@dataclass(frozen=True)
class _Mirror:
    """What a table looks like as it stands and with y turned: share of places that agree with the road.

    sure: it is no traffic on the wrong side: several vehicles say so, or there is a road only when turned.
    """

    as_is: float
    turned: float
    sure: bool = False

    @property
    def is_one(self) -> bool:
        return self.as_is < BAD and self.turned > GOOD

    @property
    def text(self) -> str:
        return (
            f"{100.0 * self.as_is:.0f} % of the positions agree with the map as given, {100.0 * self.turned:.0f} % "
            "with y turned"
        )


def mirrored(
    gt: CheckedTable, sd: CheckedTable | None, network: RoadNetwork | None
) -> tuple[CheckedTable, CheckedTable | None, list[RankedFinding]]:
    """Give sources whose y points down, by the map, and by each other; and the tables with y up."""
    out: list[RankedFinding] = []
    on_road = {k.source: _on_road(k, network) for k in (gt, sd) if k is not None and network is not None}
    wrong = {source for source, look in on_road.items() if look is not None and look.is_one and look.sure}
    if sd is not None and (far := _apart(gt, sd, np.asarray)) > MIRROR_FAR:
        near = _apart(gt, sd, np.conj)
        opposite = near < 0.3 * far
        if opposite and len(wrong) != 1:
            looks = {s: look.as_is if look else 1.0 for s, look in on_road.items()}
            wrong = {"gt" if looks.get("gt", 1.0) < looks.get("sd", 1.0) else "sd"}
    tables = []
    for table in (gt, sd):
        look = None if table is None else on_road.get(table.source)
        if table is None or table.source not in wrong:
            tables.append(table)
            if table is not None and look is not None and look.is_one:
                text = f"y may point down, or traffic drives on the wrong side: {look.text}"
                out.append(_mirrored(table, 1.0, "", text, repair="", severity="warning"))
            continue
        text = f"y points down: {look.text if look and look.is_one else 'it fits the other source when mirrored'}"
        height = float(np.median(np.concatenate([np.abs(k.p.imag) for k in table.tracks])))
        sure = look is not None and look.turned > look.as_is  # else it may be the other source's y
        out.append(_mirrored(table, height, "m", text, repair=None if sure else ""))
        tables.append(_turned(table))
    return tables[0], tables[1], out  # type: ignore[return-value]


def sides(gt: CheckedTable, sd: CheckedTable, ego: str) -> Iterator[RankedFinding]:
    """Give an SD whose left and right of the EGO are swapped: its y was turned in the EGO's frame, not in the map's."""
    own = next((k for k in gt.tracks if k.id == ego), None)
    t = np.unique(np.concatenate([np.zeros(0), *(k.t for k in sd.tracks)]))
    t = t[:: max(len(t) // MOST_TIMES, 1)]
    if own is None or not len(t):
        return

    def places(tracks: list[Track]) -> Complex:
        return np.array([np.interp(t, k.t, k.p, left=np.nan, right=np.nan) for k in tracks])

    others = [k for k in gt.tracks if k.id != ego]
    heading = np.interp(t, own.t, np.unwrap(own.heading))
    if others and (text := sides_swapped(places([own])[0], heading, places([*sd.tracks]), places(others))):
        yield _mirrored(sd, MIRROR_FAR, "m", f"{text}; import it with the other sign of y", repair="")


def _mirrored(
    table: CheckedTable,
    value: float,
    unit: str,
    text: str,
    *,
    repair: str | None,
    severity: Severity | None = None,
) -> RankedFinding:
    return found(
        "MIRRORED_Y",
        table.source,
        "",
        table.span,
        value,
        unit,
        text,
        limit=1.0,
        repair=repair,
        severity=severity,
    )


def _turned(table: CheckedTable) -> CheckedTable:
    """The table with y turned; headings too where they fit then."""
    sign = -1.0 if headings_turn(table) else 1.0
    return table.shaped(heading=lambda k: sign * k.heading, p=lambda k: np.conj(k.p))


def headings_turn(table: CheckedTable) -> bool:
    """Say whether the headings fit the tracks better with their signs turned, once y is turned."""
    as_is = turned = 0.0
    for track in table.tracks:
        way = np.diff(np.conj(track.p))
        as_is += float(np.abs(np.angle(way * np.exp(-1j * track.heading[:-1]))).sum())
        turned += float(np.abs(np.angle(way * np.exp(1j * track.heading[:-1]))).sum())
    return as_is >= turned


def _on_road(table: CheckedTable, network: RoadNetwork | None) -> _Mirror | None:
    """Share of the moving vehicles' places on a lane in its direction, as they stand and mirrored."""
    vehicles = [k for k in table.tracks if k.kind != PEDESTRIAN]
    some = [
        k.at(np.abs(k.v) > MOVING).at(slice(None, None, max(round(0.5 / table.step), 1))) for k in vehicles
    ]
    some = [k for k in some if len(k)]
    if not some or network is None:
        return None
    p, heading = np.concatenate([k.p for k in some]), np.concatenate([k.heading for k in some])
    whose = np.repeat(np.arange(len(some)), [len(k) for k in some])
    few = slice(None, None, max(len(p) // ENOUGH, 1))
    p, heading, whose = p[few], heading[few], whose[few]

    def agrees(p: np.ndarray, heading: Floats) -> tuple[Bools, float]:
        at = network.to_road(p.real, p.imag, heading=heading)
        along = network.lane_heading(at.road, at.lane, at.s)
        return at.on_road & (np.abs(wrap_angle(heading - along)) < 0.5 * np.pi), float(at.on_road.mean())

    (as_is, there), (turned, there_turned) = agrees(p, heading), agrees(np.conj(p), -heading)
    motor = [whose == n for n, k in enumerate(some) if k.kind not in WALKERS and (whose == n).any()]
    each = sum(_Mirror(as_is[own].mean(), turned[own].mean()).is_one for own in motor)
    sure = each >= SEVERAL or (there < BAD and there_turned > GOOD)
    return _Mirror(float(as_is.mean()), float(turned.mean()), sure)


def _apart(gt: CheckedTable, sd: CheckedTable, turn: Callable[..., np.ndarray]) -> float:
    """Median distance [m] of SD, turned, from its GT; NaN without a common time."""
    truth = {k.id: k for k in gt.tracks}
    far = [np.zeros(0)]
    for track in sd.tracks:
        own = truth.get(sd.gt_id.get(track.id, ""))
        if own is not None and len(own) > 1:
            there = (track.t >= own.t[0]) & (track.t <= own.t[-1])
            far.append(np.abs(turn(track.p[there]) - np.interp(track.t[there], own.t, own.p)))
    every = np.concatenate(far)
    return float(np.median(every)) if len(every) else np.nan
