"""What a recording leaves open: who was where in the time between, and how large."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from resim.core.objects import GAP, HARDEST, ObjectIds
from resim.core.sightings import Sightings
from resim.core.tracks import Tracks
from resim.metrics.doubts.contradiction import FAR, LEAP, WORTH, off_by, size_turned, turned_by
from resim.metrics.doubts.unseen import Absence, Doubts, absences, cut_off, never_sighted
from resim.recordings import Recording
from resim.recordings.checks import TORN
from resim.recordings.checks.bodies import LEAST_LARGEST, SEEN, SIZE
from resim.recordings.checks.tracks import PEDESTRIAN
from resim.recordings.identity import DetectionSpread, doubled, sensor_names
from resim.resimulation.result import Basis
from resim.resimulation.unrepaired import without_repairs
from resim.road.opendrive import RoadNetwork
from resim.scenario.misfit import find_misfits
from resim.scenario.scenario import Scenario

PERSON, RUNNING = 1.5, 5.0
"""Size [m] and speed [m/s] up to which what is called a pedestrian can be one that walks in any direction."""
EGO_APART = 5.0
"""Distance [m] by which sensor data may have the EGO elsewhere: delay at motorway speed, and its localisation."""
TURNED = 0.2
"""Angle [rad] by which a trace may have another heading than is told: along its way, which tells the better one."""
HELD = 0.4
"""Time [s] over which such angles are averaged."""
FARTHEST = 20.0
"""Distance [m] by which a place is in doubt at most; beyond it nobody knows where the object is."""


def doubts(
    recording: Recording, basis: Basis, tracks: Tracks, scenario: Scenario | None, network: RoadNetwork
) -> Doubts:
    """Give what a measurement leaves open.

    tracks: `measured_tracks` of that basis; scenario: what describes them, by which they are judged and simulated, None
    where nothing is. Where a trace is off its samples, or samples are off their track, nobody knows which is right.
    """
    name = basis.lower()
    told = without_repairs(recording, basis, tracks)
    whom = ObjectIds.of(told.tracks, told.incomplete, ego=recording.ego)
    absent, excused = absences(whom)
    found = (*absent, *told.gaps)
    whole = recording.gt if basis == "GT" else recording.sd_by_gt() if recording.senses_ego else tracks
    every = without_repairs(recording, basis, tracks if whole is None else whole)
    rows = ObjectIds.of(every.tracks, every.incomplete, ego=recording.ego, beyond=True)
    found += tuple(cut_off(rows, _span(recording)))
    torn = list(_torn(recording, basis))
    swapped = {f.object for f in recording.findings if f.code == "SIZE_SWAPPED" and f.source == name == "gt"}
    misfits = dict(_misfits(tracks, scenario, network))
    turns = dict(_turns(tracks, scenario, network))
    off: dict[str, tuple[float, float]] = {}
    sizes: dict[str, tuple[float, float]] = {}
    told_sizes, doubled = recording.sizes.get(name, {}), _doubled(recording, basis)
    for ids, parts in _bodies(whom):
        repeated = recording.repeated.get(name, {})
        twice = [of[who] for of in (doubled, repeated) for who in ids if who in of]
        far = [max(d.apart, GAP * d.faster) for d in twice if max(d.apart, GAP * d.faster) >= FAR]
        least = max(
            [sum(far for who, far in torn if who in ids), *far, *(misfits.get(who, 0.0) for who in ids)]
            + [_beside(k, told.incomplete) for k in parts]
        )
        walks = _walks(ids, parts, told_sizes)
        by = np.max([(least, least), *(off_by(k, walks=walks) for k in parts)], axis=0)
        off.update((who, (float(by[0]), float(by[1]))) for who in ids if by.any())
        turned = (
            0.0
            if walks
            else max(
                [turned_by(k) for k in parts]
                + [d.turned for d in twice if d.turned > WORTH]
                + [turns[who] for who in ids if who in turns]
            )
        )
        if swapped.intersection(ids):
            turned = 0.5 * np.pi
        sizes.update(_larger(ids, parts, told_sizes, tracks, turned, SEEN if basis == "SD" else 1.0))
    off.update(_all_ways(off, tracks, scenario, network))
    if (apart := _ego_apart(recording, basis)) > EGO_APART:
        off[recording.ego] = (max(apart, *off.get(recording.ego, (0.0, 0.0))),) * 2
    lost = [
        _lost(tracks, who, max(by)) for who, by in off.items() if max(by) > FARTHEST and who in tracks.ids
    ]
    return Doubts(
        (*(replace(a, size=sizes.get(a.object, a.size)) for a in found), *lost),
        sizes,
        {who: by for who, by in off.items() if max(by) <= FARTHEST},
        whom.same,
        tuple(replace(a, size=sizes.get(a.object, a.size)) for a in excused),
    )


def _ego_apart(recording: Recording, basis: Basis) -> float:
    """How far [m] the SD has the EGO from where the GT has it, in the median; 0 where only one of them has it."""
    if basis == "GT" or not recording.senses_ego or (sd := recording.sd_by_gt()) is None:
        return 0.0
    own, true = sd.select([recording.ego]), recording.ego_at(sd.t)
    apart = np.hypot(own.x - true.x, own.y - true.y)[own.valid & true.valid]
    return float(np.median(apart)) if len(apart) else 0.0


def _span(recording: Recording) -> tuple[float, float]:
    """First and last time [s] of any row, in whichever source, and of any plan: so long the drive lasted."""
    times = [k.t for k in (recording.gt, recording.sd) if k is not None]
    tables = [*recording.incomplete.values(), *([] if recording.plan is None else [recording.plan])]
    times += [table["t"].to_numpy(float) for table in tables if len(table)]
    return min(float(t.min()) for t in times), max(float(t.max()) for t in times)


def _bodies(whom: ObjectIds) -> Iterator[tuple[tuple[str, ...], list[Sightings]]]:
    """The ids that can be one object, and what is known of it."""
    every = (whom.ego, *whom.others)
    together = {name: ids for ids in whom.same for name in ids}
    for ids in dict.fromkeys(together.get(k.ids[0], k.ids) for k in every):
        yield ids, [k for k in every if k.ids[0] in ids]


def _beside(k: Sightings, incomplete: pd.DataFrame | None) -> float:
    """How far [m] rows with a position, but not all values, are from where samples about them lead; 0 up to LEAP."""
    t, place = k.t[k.usable], k.state[k.usable, 0] + 1j * k.state[k.usable, 1]
    if incomplete is None or len(t) < 2:
        return 0.0
    rows = incomplete[incomplete["id"].isin(k.ids)]
    when, there = rows["t"].to_numpy(float), rows["x"].to_numpy(float) + 1j * rows["y"].to_numpy(float)
    after = np.clip(np.searchsorted(t, when), 1, len(t) - 1)
    wide = t[after] - t[after - 1]
    inside = (when >= t[0]) & (when <= t[-1]) & np.isfinite(there) & (wide <= GAP)
    share = (when - t[after - 1]) / wide
    led = place[after - 1] + share * (place[after] - place[after - 1])
    off = np.where(inside, np.abs(there - led) - 0.25 * HARDEST * wide**2, 0.0)
    return float(off.max(initial=0.0)) if off.max(initial=0.0) > LEAP else 0.0


def _walks(ids: tuple[str, ...], parts: list[Sightings], told: Mapping[str, tuple[float, float]]) -> bool:
    """Whether it is a pedestrian throughout, whose heading says nothing: by its kind, its largest size and its speed.

    told: the largest size [m] that rows give an id.
    """
    longest = max([max(k.size) for k in parts] + [max(told[i]) for i in ids if i in told])
    fastest = max(float(np.hypot(*k.state[:, 3:].T).max(initial=0.0)) for k in parts)
    return all(k.kind == PEDESTRIAN for k in parts) and longest <= PERSON and fastest <= RUNNING


def _larger(
    ids: tuple[str, ...],
    parts: list[Sightings],
    told: Mapping[str, tuple[float, float]],
    tracks: Tracks,
    turned: float,
    seen: float,
) -> Iterator[tuple[str, tuple[float, float]]]:
    """The size [m] that an object can have, under those of its ids that have a smaller one.

    told: the largest that rows give an id; turned: rad, by how much its heading can be off; seen: part of the least
    sides of a kind that may be all that is told.
    """
    length, width = np.max([*(k.size for k in parts), *(told[i] for i in ids if i in told)], axis=0).tolist()
    least, largest = LEAST_LARGEST.get(parts[0].kind, LEAST_LARGEST["unknown"])
    if length < seen * least[0] or width < seen * least[1]:  # none is so small: nothing is told
        length, width = largest
    for who in ids:
        n = np.flatnonzero(tracks.ids == who)
        own = (
            (float(tracks.length[n[0]]), float(tracks.width[n[0]]))
            if len(n)
            else told.get(who, (length, width))
        )
        if turned or length > own[0] + SIZE or width > own[1] + SIZE:
            yield who, size_turned((max(length, own[0]), max(width, own[1])), turned)


def _lost(tracks: Tracks, name: str, off: float) -> Absence:
    """Somebody whose place is worth nothing."""
    why = f"its trace is {off:.0f} m away from its positions, or these contradict each other"
    return never_sighted(tracks, tracks.index(name), why)


def _torn(recording: Recording, basis: Basis) -> Iterator[tuple[str, float]]:
    """Who jumps farther than he can, for good, and how far [m]: where he was is wrong before, or after."""
    source, sd = basis.lower(), recording.sd
    names: dict[str, str] = {}
    if basis == "SD" and sd is not None and recording.sd_gt_id is not None:
        names = dict(zip(sd.ids.tolist(), sensor_names(sd, recording.sd_gt_id).tolist(), strict=True))
    for f in recording.findings:
        if f.source == source and f.code in TORN:
            yield names.get(f.object, f.object), f.value


def _doubled(recording: Recording, basis: Basis) -> dict[str, DetectionSpread]:
    """Who is detected twice at one time, and by what that differs: only one of them is judged and simulated."""
    if basis == "GT" or recording.sd is None or recording.sd_gt_id is None:
        return {}
    return doubled(recording.sd, recording.sd_gt_id)


def _all_ways(
    off: Mapping[str, tuple[float, float]], tracks: Tracks, scenario: Scenario | None, network: RoadNetwork
) -> Iterator[tuple[str, tuple[float, float]]]:
    """How far those are off, in all directions where the trace has another heading than is told: boxes lie along it."""
    if scenario is None or not off:
        return
    traces = scenario.tracks(network, tracks.t).joined()
    for who in set(off).intersection(traces.ids.tolist(), tracks.ids.tolist()):
        n, m = tracks.index(who), traces.index(who)
        both = tracks.valid[n] & traces.valid[m]
        turn = np.angle(np.exp(2j * (traces.heading[m, both] - tracks.heading[n, both]))) / 2.0
        if np.abs(turn).max(initial=0.0) > WORTH:
            along, across = off[who]
            in_any = np.isclose(along, across, rtol=0.01)  # alike: so far in any direction
            far = along if in_any else float(np.hypot(along, across))
            yield who, (far, far)


def _misfits(tracks: Tracks, scenario: Scenario | None, network: RoadNetwork) -> Iterator[tuple[str, float]]:
    """Whose trace is off its samples, and how far [m]."""
    if scenario is not None:
        yield from ((m.object, m.off) for m in find_misfits(scenario, tracks.to_frame(), network))


def _turns(tracks: Tracks, scenario: Scenario | None, network: RoadNetwork) -> Iterator[tuple[str, float]]:
    """Whose trace has another heading than is told, by how much [rad]: it is along its way, as of who slides it is not.

    Noise is averaged. Front and back are the same: it is about where boxes are.
    """
    if scenario is None:
        return
    traces = scenario.tracks(network, tracks.t).joined()
    rows = {name: n for n, name in enumerate(tracks.ids.tolist())}
    for m, who in enumerate(traces.ids.tolist()):
        if (n := rows.get(who)) is None:
            continue
        both = tracks.valid[n] & traces.valid[m]
        turn = np.exp(2j * (traces.heading[m, both] - tracks.heading[n, both]))
        if not len(turn):
            continue
        count = min(
            len(turn), max(1, round(HELD / float(np.median(np.diff(tracks.t[both]))))) if len(turn) > 1 else 1
        )
        by = 0.5 * float(np.abs(np.angle(np.convolve(turn, np.full(count, 1.0 / count), "valid"))).max())
        if by > TURNED:
            yield who, by
