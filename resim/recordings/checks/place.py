"""Place: objects on no lane, and against their lane's direction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

import numpy as np

from resim.core.finding import Severity
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import PEDESTRIAN, CheckedTable, Track, longest_run
from resim.road.opendrive import RoadNetwork

EVERY = 0.5
"""Time [s] between the places that are looked up."""
BESIDE = 2.0
"""Distance [m] of a centre from the nearest driving lane from which on it is off the map: the run of an EGO ends
there as well."""
LONG = 1.0
"""Time [s] for which it is off the map, or drives against the lane."""
DRIVES = 2.0
"""Speed [m/s] of what has to be on a lane; parked vehicles stand beside."""
AGAINST = 2.4
"""Angle [rad] to the lane's direction from which on it drives against it; less is turning and parking."""
THROUGHOUT = 0.9
"""Share of its time off the map that leaves an EGO without a road."""
MOST = 0.5
"""Share of the vehicles that makes it the table's finding."""
WALKERS = (PEDESTRIAN, "bicycle", "unknown")

_Hit: TypeAlias = tuple[Track, tuple[float, float], float]


class _Fault(NamedTuple):
    """What a vehicle does, and from which value on. say: its words, of the value and the span [s]."""

    code: str
    unit: str
    limit: float
    say: Callable[[float, tuple[float, float]], str]


def places(table: CheckedTable, network: RoadNetwork, ego: str) -> Iterator[RankedFinding]:
    """Give vehicles that drive on no lane, or against theirs; where most do, the table.

    An EGO that is off the map nearly all the time is an error: it cannot be re-simulated there.
    """
    off: list[_Hit] = []
    against: list[_Hit] = []
    drivers: set[str] = set()
    for whole in table.tracks:
        track = whole.at(slice(None, None, max(round(EVERY / table.step), 1)))
        drives = np.abs(track.v) > DRIVES
        if whole.kind in WALKERS or not drives.any():
            continue
        drivers.add(whole.id)
        beyond, turned = _look(network, track)
        if (span := _lasting(drives & (beyond > BESIDE), track.t)) is not None:
            off.append((whole, span, float(beyond[drives].max())))
        if (span := _lasting(drives & (turned > AGAINST) & (beyond <= 0.0), track.t)) is not None:
            against.append((whole, span, span[1] - span[0]))
    yield from _finding(table, _Fault("OFF_MAP", "m", BESIDE, _off_text), off, len(drivers), ego=ego)
    yield from _finding(table, _Fault("WRONG_WAY", "s", LONG, _against_text), against, len(drivers))


def _look(network: RoadNetwork, track: Track) -> tuple[Floats, Floats]:
    """Distance [m] beyond the nearest driving lane, 0 or less on one, and angle [rad] to its direction."""
    at = network.to_road(track.p.real, track.p.imag, heading=track.heading, z=track.z)
    x, y = network.to_xy(at.road, at.lane, at.s, at.t)
    away = np.abs(track.p - (x + 1j * y))  # s ends with the road
    beyond = np.maximum(np.abs(at.t) - 0.5 * network.lane_width(at.road, at.lane, at.s), away)
    along = network.lane_heading(at.road, at.lane, at.s)
    return np.where(at.on_road, 0.0, beyond), np.abs(wrap_angle(track.heading - along))


def _lasting(mask: Bools, t: Floats) -> tuple[float, float] | None:
    span = longest_run(mask, t)
    return span if span is not None and span[1] - span[0] >= LONG - 1e-6 else None


def _off_text(value: float, span: tuple[float, float]) -> str:
    return f"drives up to {value:.1f} m beside the nearest driving lane, for {span[1] - span[0]:.2f} s"


def _against_text(value: float, span: tuple[float, float]) -> str:
    return f"drives against its lane for {span[1] - span[0]:.2f} s"


def _finding(
    table: CheckedTable, fault: _Fault, hits: list[_Hit], drivers: int, *, ego: str = ""
) -> Iterator[RankedFinding]:
    """One finding per object, or one of the table where most are concerned."""
    code, unit, limit, say = fault
    names = list(dict.fromkeys(track.id for track, _, _ in hits))
    if len(names) > 2 and len(names) > MOST * drivers:
        worst = max(hits, key=lambda h: h[2])
        text = f"{len(names)} of {drivers} vehicles, {worst[0].id!r} worst: {say(worst[2], worst[1])}; the wrong map?"
        yield found(code, table.source, "", table.span, worst[2], unit, text, limit=limit, severity="error")
        return
    for track, span, value in hits:
        whole = track.id == ego and span[1] - span[0] > THROUGHOUT * (track.t[-1] - track.t[0])
        text = say(value, span) + ("; the wrong map?" if whole else "")
        severity: Severity | None = "error" if whole else None
        yield found(code, table.source, track.id, span, value, unit, text, limit=limit, severity=severity)
