"""What a reader of the results has to know besides the numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from resim.core.objects import GAP
from resim.core.plugins.unlisted_files import NOT_OF_HASH
from resim.core.spelling import counted
from resim.core.tracks import Tracks
from resim.recordings import Recording
from resim.recordings.checked import by_code, finding_lines
from resim.resimulation.fidelity import EGO_ROW, StepErrors
from resim.resimulation.perceived import PerceptionSetup
from resim.resimulation.result import Basis, Resimulation, is_recorded_build, of_seed, source_words
from resim.road.checked import MapCheck
from resim.road.links import LaneKey
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import LaneError
from resim.scenario.misfit import find_misfits
from resim.scenario.scenario import Scenario
from resim.simulation.case import HandedOver, SimulatedDrive
from resim.simulation.function.interface import Build
from resim.simulation.function.program import RecordedProgram

LABEL_ONLY = "without build_hash it is unknown whether this code drove, so the verdict is for the label only"
OF_BUILD = (LABEL_ONLY, *NOT_OF_HASH)
"""Notes end so that say which code a verdict is not of: every table of verdicts repeats them."""

HANDED_OVER = "handed over to drivers"
_TOLD = 3
"""Hand-overs that are told one by one."""

OFF_ROAD = 0.1
"""Share of the EGO's samples on no driving lane from which on the map is worth a look."""

HEADING = 0.2
"""Mean difference [rad] between measured heading and direction of motion that is worth a look."""


def notes(result: Resimulation) -> Iterator[str]:
    """Give one line for each thing that qualifies the results."""
    recording, build, measured, off = result.recording, result.build, result.measured, result.misfits
    yield from finding_lines(recording.findings)
    yield from _repaired(recording)
    yield from _map(result.prepared.checked, measured)
    yield from _who_drove(recording, build)
    if opened := build.opened.note():
        yield f"{build.label}: {opened}"
    if build.program is not None and build.program.unpinned:
        yield f"{build.label}: {build.program.unpinned}"
    if isinstance(build.program, RecordedProgram):
        speaker = build.program.conversations[0].speaker
        yield f"{build.label}: answers were recorded of its hash {speaker.hash[:12]}, nobody drove"
    yield from _plausible(recording, result.network, measured["GT"], result.errors)
    for basis, scenario in result.described.items():
        yield from _described(basis, measured[basis], scenario)
        yield from _of(off, basis)
    for source, drive in result.simulated().items():
        yield from _of(off, source)
        if drive.end in ("collision", "off_road"):
            yield f"{source} ended at t = {drive.truth.t[-1]:.2f} s: {drive.end.replace('_', ' ')}"
        if drive.handed_over:
            traffic = drive.case.traffic
            by_sumo = traffic is not None and traffic.drivers == "sumo"
            yield f"{source}: {handed_over(drive.handed_over, by_sumo=by_sumo)}"
        if drive.left_route is not None:
            yield f"{source} left the measured route at {drive.left_route:.1f} s"
        if drive.failure:
            yield f"{source}: AD function failed: {drive.failure}"
            yield from (f"{source}: {line}" for line in drive.blame())
    if "SD" in measured:
        yield from _sensed(recording, measured, result.errors)


def handed_over(found: Sequence[HandedOver], *, by_sumo: bool = False) -> str:
    """Say which objects left their traces; of many, those who braked hardest with the reason.

    by_sumo: whether SUMO's own models decided for them.
    """
    whose = " of SUMO's own models" if by_sumo else ""
    ids = {one.id for one in found}
    hardest = sorted(sorted(found, key=lambda one: -one.hardest)[:_TOLD], key=lambda one: one.t)
    told = [
        f"{one.id} at {one.t:.2f} s ({one.why}), up to {one.farthest:.1f} m behind its trace, "
        f"braking by up to {one.hardest:.1f} m/s²"
        + _changes(one)
        + (f", until {one.back:.2f} s" if one.back is not None else "")
        for one in hardest
    ]
    more = f"; and {len(found) - _TOLD} times more, braking no harder" if len(found) > _TOLD else ""
    return f"{counted(len(ids), 'traffic object')} {HANDED_OVER}{whose}, not as measured: {'; '.join(told)}{more}"


def _changes(one: HandedOver) -> str:
    """To which sides it changed lanes, and when."""
    told = ", ".join(f"to the {change.side} at {change.t:.2f} s" for change in one.lane_changes)
    return f", changing lanes {told}" if told else ""


def perception_notes(perceiving: PerceptionSetup, drives: Sequence[SimulatedDrive]) -> Iterator[str]:
    """Give what qualifies the drives with a perception model."""
    outside, shown = sum(d.outside for d in drives), sum(d.shown for d in drives)
    if outside:
        yield (
            f"perception model {perceiving.model.name!r}: {outside} of {shown} perceived states lie outside its "
            "training data; its errors there are extrapolated"
        )
    words = {"collision": "ended by a collision", "off_road": "left the road", "function_failed": "failed"}
    for end, what in words.items():
        if count := sum(d.end == end for d in drives):
            yield f"perception model {perceiving.model.name!r}: {count} of {len(drives)} runs {what}"
    if count := sum(bool(d.handed_over) for d in drives):
        yield f"perception model {perceiving.model.name!r}: in {count} of {len(drives)} runs traffic was {HANDED_OVER}"
    yield from _failed_seeds(perceiving, drives)
    if count := sum(d.left_route is not None for d in drives):
        yield f"perception model {perceiving.model.name!r}: {count} of {len(drives)} runs left the measured route"


def _failed_seeds(perceiving: PerceptionSetup, drives: Sequence[SimulatedDrive]) -> Iterator[str]:
    """Each failure that is another one, told once: its first seed, and in how many it was."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for k, drive in enumerate(drives):
        if drive.failure:
            same = drive.traceback or (re.sub(r"at t = [\d.]+ s ", "", drive.failure),)
            alike.setdefault(same, []).append(k)
    for of in alike.values():
        drive, who = drives[of[0]], source_words(of_seed(perceiving.seeds[of[0]]))
        more = f" (and {len(of) - 1} more)" if len(of) > 1 else ""
        yield f"{who}{more}: AD function failed: {drive.failure}"
        yield from (f"{who}: {line}" for line in drive.blame())


def _repaired(recording: Recording) -> Iterator[str]:
    for source, counts in recording.repaired.items():
        what = ", ".join(f"{code} {count}" for code, count in counts.items())
        yield f"{source}: {sum(counts.values())} samples were repaired before ({what})"


def _map(checked: MapCheck, measured: Mapping[Basis, Tracks]) -> Iterator[str]:
    """What is wrong with the lanes that somebody drove on, in the map and in its SUMO net."""
    network, name = checked.network, checked.network.path.name
    told = [(f.code, f"{name}: {f.code}: {f.text}") for f in checked.flaws if f.severity == "error"]
    yield from by_code(told)
    touched: set[LaneKey] = set()
    for tracks in measured.values():
        z = None if tracks.z is None else tracks.z[tracks.valid]
        found = network.to_road(tracks.x[tracks.valid], tracks.y[tracks.valid], z=z)
        places = set(
            zip(found.road.tolist(), found.lane.tolist(), np.round(found.s, 1).tolist(), strict=True)
        )
        touched |= {LaneKey(r, network.roads[r].section_index(s), lane) for r, lane, s in places if s == s}
    roads = {key.road for key in touched}
    doubts = [f for f in checked.flaws if f.severity == "warning" and f.road in roads]
    yield from by_code([(f.code, f"{name}: {f.code}: {f.text}") for f in doubts])
    bad = [lane for lane in checked.net.conversion.bad if lane.key in touched]
    yield from by_code([("such lanes", f"{name}: {_inexact(lane)}") for lane in bad])


def _inexact(lane: LaneError) -> str:
    what = "is not in the SUMO net" if lane.worst is None else f"is {lane.worst:.3f} m off in the SUMO net"
    return f"{lane.key}, which is driven on, {what} ({lane.remark or f'at s = {lane.s:g} m'})"


def _who_drove(recording: Recording, build: Build) -> Iterator[str]:
    if is_recorded_build(recording, build) is not False:
        if recording.build and recording.build_hash is None:
            yield f"{build.label} matches the recording by label only: {LABEL_ONLY}"
        return
    if recording.build != build.label:
        yield f"{recording.build} drove the recording, not {build.label}: EGO differences are those of two builds"
    else:
        yield f"{build.label} drove the recording in another state (hash {str(recording.build_hash)[:12]})"


def _plausible(
    recording: Recording, network: RoadNetwork, gt: Tracks, errors: Mapping[str, StepErrors]
) -> Iterator[str]:
    """The two looks that tell a recording from the wrong map, frame or unit."""
    row = gt.index(recording.ego)
    own = gt.valid[row]
    off = 1.0 - float(network.to_road(gt.x[row, own], gt.y[row, own]).on_road.mean())
    if off > OFF_ROAD:
        yield f"the EGO is on no driving lane in {100.0 * off:.0f} % of its samples: is this the recording's map?"
    turned = float(np.nanmean(np.abs(errors["FIT_GT"].heading[EGO_ROW])))
    if turned > HEADING:
        yield f"the EGO's heading is {turned:.2f} rad off its motion on average: is it in radians, in the map's frame?"


def _described(basis: Basis, tracks: Tracks, scenario: Scenario) -> Iterator[str]:
    there = {scenario.ego.id, *(o.id for o in scenario.objects)}
    if lost := sorted(set(tracks.ids.tolist()) - there):
        yield f"{basis}: seen only once and left out: {', '.join(lost)}"
    yield from _gaps(basis, tracks, scenario.ego.id)


def _of(off: Mapping[str, str], source: str) -> Iterator[str]:
    if source in off:
        yield off[source]


def misfits(
    scenarios: Mapping[str, Scenario], positions: Mapping[str, pd.DataFrame], network: RoadNetwork
) -> dict[str, str]:
    """Give by source a line that names its objects whose traces are not where their positions are, if there are any.

    positions: what each scenario describes, as `find_misfits` takes it.
    """
    told = {name: misfit(name, scenario, positions[name], network) for name, scenario in scenarios.items()}
    return {name: line for name, line in told.items() if line}


def misfit(what: str, scenario: Scenario, positions: pd.DataFrame, network: RoadNetwork) -> str:
    """Give a line that names every object whose trace is off its positions (`find_misfits`), the worst first, or ""."""
    far = sorted(find_misfits(scenario, positions, network), key=lambda m: (m.off, m.object), reverse=True)
    told = ", ".join(f"{m.object} by {m.off:.2f} m at {m.t:.2f} s (noise {m.noise:.2g} m)" for m in far)
    return f"{what}: fitted traces miss their positions by more than noise: {told}" if far else ""


def _gaps(basis: Basis, tracks: Tracks, ego: str) -> Iterator[str]:
    own = tracks.t[tracks.valid[tracks.index(ego)]]
    for gap in np.flatnonzero(np.diff(own) > GAP):
        span = f"from {own[gap]:.2f} to {own[gap + 1]:.2f} s"
        yield f"{basis}: the EGO is not seen {span}; its trace is interpolated there"
    if parts := tracks.parts():
        which = ", ".join(parts[:10]) + (", ..." if len(parts) > 10 else "")
        yield f"{basis}: not seen for over {GAP:g} s; counted as another object from then on: {which}"


def _sensed(
    recording: Recording, measured: Mapping[Basis, Tracks], errors: Mapping[str, StepErrors]
) -> Iterator[str]:
    known = set(measured["GT"].joined().ids.tolist())
    unknown = [i for i in measured["SD"].joined().ids.tolist() if i not in known]
    if unknown:
        yield f"SD holds {len(unknown)} object(s) without ground truth: they are in rSD, but have no errors"
    if not recording.senses_ego:
        yield "SD has no EGO: its ground truth is used instead, so S has no error of it"
    elif not np.isfinite(errors["S"].x[EGO_ROW]).any():
        yield "S of the EGO is empty: no SD sample lies between two neighbouring GT samples"
