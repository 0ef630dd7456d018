"""One of GT, SD, rGT, rSD: what it is assessed from, and its assessment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from resim.core.clock import regular
from resim.core.geometry import Floats
from resim.core.schema import PLAN_COLUMNS
from resim.core.sightings import SAME
from resim.core.tracks import Strings, Tracks, whole_id
from resim.metrics.assessment import Assessment, asked, assess
from resim.metrics.doubts.unseen import WHOLE, Absence, Doubts
from resim.metrics.drive import Plans, drive
from resim.metrics.measures.collision import contacts
from resim.metrics.measures.functional import FunctionActivity
from resim.metrics.measures.inputs import MeasureInputs, look_together
from resim.resimulation.assessed import AssessmentOptions
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario, ScenarioObject

FINE = 100.0
"""Samples a second [Hz] in which collisions are looked for."""

BACK = 0.1
"""Distance [m] from the end of its trace up to which somebody who left it counts as back on it."""
GONE = "off its trace, whose recording ends here"

TOGETHER = 32
"""Blocks that are assessed together at most: their arrays take memory."""

DELAY = "CLOCK_OFFSET"
"""Code of the finding that says how late SD is."""


@dataclass(frozen=True, eq=False)
class Block:
    """What one block is assessed from. collisions: when [s] and with whom; flaw: why it cannot be judged, or "".

    measured: of a simulated drive, what its traffic is of.
    """

    scenario: Scenario
    plans: Plans
    functioning: FunctionActivity
    collisions: tuple[tuple[float, str], ...]
    flaw: str = ""
    doubts: Doubts = WHOLE
    measured: Scenario | None = None


def assess_block(block: Block, network: RoadNetwork, how: AssessmentOptions) -> Assessment:
    """Assess one block at times `how.rate` a second, and look for collisions FINE times a second."""
    return assess_blocks([block], network, how)[0]


def assess_blocks(blocks: Sequence[Block], network: RoadNetwork, how: AssessmentOptions) -> list[Assessment]:
    """Assess blocks as `assess_block` does each; those of the same objects take less time together."""
    parts = [blocks[k : k + TOGETHER] for k in range(0, len(blocks), TOGETHER)]
    return [found for part in parts for found in _assess_together(part, network, how)]


def _assess_together(
    blocks: Sequence[Block], network: RoadNetwork, how: AssessmentOptions
) -> list[Assessment]:
    """Assess one block or more."""
    made = [_scenes_of(block, network, how) for block in blocks]
    names = [measure.name for measure in asked(made[0].inputs, how.criteria, how.only)]
    every = look_together([one.inputs for one in made], names)
    return [
        assess(inputs, how.criteria, block.flaw, how.only, one.doubts, one.larger)
        for block, one, inputs in zip(blocks, made, every, strict=True)
    ]


class _BlockScenes(NamedTuple):
    """What the measures of a block are computed from; larger: with boxes that hold all that objects may fill."""

    inputs: MeasureInputs
    larger: MeasureInputs | None
    doubts: Doubts


def _scenes_of(block: Block, network: RoadNetwork, how: AssessmentOptions) -> _BlockScenes:
    """The scenes of a block, and what its source leaves open."""
    scenario, doubts = block.scenario, block.doubts
    often, seldom = _times(scenario, FINE), _times(scenario, how.rate)
    t = np.union1d(often, seldom)
    every = scenario.tracks(network, t)
    if block.measured is not None and doubts.excused:
        own = every.samples(np.searchsorted(t, seldom)).select([scenario.ego.id])
        doubts = doubts.beside(own, replace(block.measured, objects=()).tracks(network, seldom))

    if block.measured is not None and (gone := tuple(_gone(scenario, block.measured, network))):
        doubts = replace(doubts, absences=(*doubts.absences, *gone))

    def subject(every: Tracks) -> MeasureInputs:
        made = drive(
            every.samples(np.searchsorted(t, seldom)), ego=scenario.ego.id, plans=block.plans, path=how.path,
            parameters=how.parameters, predicted=how.prediction, road=network if how.road_aware else None,
        )  # fmt: skip
        fine = every if len(t) == len(often) else every.samples(np.searchsorted(t, often))
        hits = tuple(sorted([*contacts(fine, scenario.ego.id), *block.collisions]))
        own = () if how.criteria is None else how.criteria.own
        return MeasureInputs(made, network, how.parameters, block.functioning, hits, own)

    larger = _larger(every, doubts)
    return _BlockScenes(subject(every), None if larger is None else subject(larger), doubts)


def _larger(tracks: Tracks, doubts: Doubts) -> Tracks | None:
    """The tracks with boxes that hold all that objects and their parts may fill; None where none is in doubt."""
    known = {*doubts.sizes, *doubts.off}
    names = [whole_id(name, known) for name in tracks.ids.tolist()]
    if not known.intersection(names):
        return None
    off = np.array([doubts.off.get(name, (0.0, 0.0)) for name in names])
    sizes = np.array([doubts.sizes.get(name, (0.0, 0.0)) for name in names])
    length, width = (
        np.maximum(own, side) + 2.0 * far
        for own, side, far in zip((tracks.length, tracks.width), sizes.T, off.T, strict=True)
    )
    return replace(tracks, length=length, width=width)


def _gone(scenario: Scenario, measured: Scenario, network: RoadNetwork) -> Iterator[Absence]:
    """Who left its trace, and is taken away where its recording ends: from then on nobody knows where it is."""
    traces = {one.id: one for one in measured.objects}
    last = scenario.ego.spawn_time + scenario.duration
    ends = {
        n: float(one.v.x[-1])
        for n, one in enumerate(scenario.objects, start=1)
        if one.id in traces and one.v.x[-1] < last - SAME and not _is_alike(one, traces[one.id])
    }
    if not ends:
        return
    t = np.array([*ends.values()])
    driven = scenario.tracks(network, t)
    for k, (n, end) in enumerate(ends.items()):
        one = scenario.objects[n - 1]
        own = replace(measured, objects=(traces[one.id],))
        there = own.tracks(network, np.array([min(end, float(traces[one.id].v.x[-1]))]))
        x, y, heading, v = (float(c[n, k]) for c in (driven.x, driven.y, driven.heading, driven.v))
        if not np.hypot(x - there.x[1, 0], y - there.y[1, 0]) <= BACK:
            state = np.array([[x, y, heading, v * np.cos(heading), v * np.sin(heading)]])
            yield Absence(
                object=one.id, start=end, end=last, why=GONE, straight=False,
                size=(one.length, one.width), t=np.array([end]), state=state,
            )  # fmt: skip


def _is_alike(one: ScenarioObject, other: ScenarioObject) -> bool:
    """Whether two have the same trace."""
    return one is other or (
        one.start == other.start
        and all(
            np.array_equal(getattr(a, part), getattr(b, part))
            for a, b in ((one.v, other.v), (one.heading, other.heading))
            for part in ("x", "c")
        )
    )


def _times(scenario: Scenario, rate: float) -> Floats:
    """Times [s] of the whole scenario, `rate` a second."""
    return np.round(regular(scenario.ego.spawn_time, scenario.duration, 1.0 / rate), 9)


def plans_of(frame: pd.DataFrame | None) -> Plans:
    """Give the plans in a table of PLAN_COLUMNS, by the time they were made; a planned time counts once."""
    if frame is None or not len(frame):
        return ()
    rows = (
        frame[list(PLAN_COLUMNS)].drop_duplicates(["t", "t_plan"]).sort_values(["t", "t_plan"], kind="stable")
    )
    values = rows.to_numpy(dtype=float)
    made, first = np.unique(values[:, 0], return_index=True)
    return tuple(zip(made.tolist(), np.split(values[:, 1:], first[1:]), strict=True))


def measured_functioning(
    seen: pd.DataFrame | None, plans: Plans, findings: Mapping[str, float | None]
) -> FunctionActivity:
    """Give what perception and function did in the measured drive, as far as it was recorded."""
    answers = np.array([when for when, _ in plans]) if len(plans) else None
    if seen is None:
        return FunctionActivity(None, np.empty(0, dtype=str), np.empty((0, 0), dtype=bool), np.inf, answers)
    return listed(seen, np.unique(seen.t.to_numpy(dtype=float)), answers, findings.get(DELAY) or 0.0)


def listed(seen: pd.DataFrame, lists: Floats, answers: Floats | None, delay: float) -> FunctionActivity:
    """Give lists of perceived objects from the rows of a table."""
    return functioning_of(seen.t.to_numpy(dtype=float), seen.id.to_numpy(dtype=str), lists, answers, delay)


def functioning_of(
    t: Floats, seen: Strings, lists: Floats, answers: Floats | None, delay: float
) -> FunctionActivity:
    """Give lists of perceived objects from when [s] who was seen (N,); parts of one object count as that one."""
    names, of = np.unique(seen, return_inverse=True)
    known = set(names.tolist())
    whole = np.array([whole_id(name, known) for name in names.tolist()], dtype=str)
    ids, row = np.unique(whole, return_inverse=True)
    row, at = row[of], np.searchsorted(lists, t)
    table = np.zeros((len(ids), len(lists)), dtype=bool)
    table[row, np.minimum(at, len(lists) - 1)] = True
    gaps = np.concatenate([np.diff(lists[o]) for o in table] or [np.diff(lists)])
    period = float(np.median(gaps)) if len(gaps) else np.inf
    return FunctionActivity(lists, ids, table, period, answers, delay)
