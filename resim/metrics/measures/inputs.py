"""What measures are computed from: one argument for all of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from resim.core.tracks import Tracks
from resim.metrics.drive import DriveScenes, joined
from resim.metrics.measures.collision import contacts
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.functional import FunctionActivity
from resim.metrics.measures.horizon import LookAhead
from resim.metrics.measures.pairs import Pairs
from resim.metrics.measures.registry import MEASURES
from resim.metrics.measures.scenes import driven_pairs
from resim.metrics.measures.values import MeasureValues
from resim.metrics.risk import DEFAULTS, Risk, RiskParameters
from resim.road.opendrive import RoadNetwork


@dataclass(frozen=True, eq=False)
class MeasureInputs:
    """What measures are computed from: the drive, its road, and what function and perception did, if known.

    hits: when [s] the EGO's box touched whose (`contacts`), if that is known finer than by scenes. own: the user's own
    measures. seen: how far is looked ahead. found: the accident risk, if it is known.
    """

    drive: DriveScenes
    network: RoadNetwork
    parameters: RiskParameters = DEFAULTS
    functioning: FunctionActivity | None = None
    hits: tuple[tuple[float, str], ...] | None = None
    own: tuple[MeasureDefinition, ...] = ()
    farther: LookAhead | None = None
    found: Risk | None = None
    _known: dict[str, MeasureValues] = field(default_factory=dict)
    _looking: dict[LookAhead, MeasureInputs] = field(default_factory=dict)

    @property
    def definitions(self) -> tuple[MeasureDefinition, ...]:
        """Every measure, the user's own last."""
        return (*MEASURES, *self.own)

    def definition(self, name: str) -> MeasureDefinition:
        """Give a measure by its name."""
        return next(measure for measure in self.definitions if measure.name == name)

    def measure(self, name: str) -> MeasureValues:
        """Give the values of a measure by its name; computed once."""
        if name not in self._known:
            self._known[name] = self.definition(name).compute(self)
        return self._known[name]

    def judged(self, name: str, side: str, limit: float) -> tuple[MeasureValues, LookAhead]:
        """Give a measure for a limit, looked for as far ahead as that needs, with what is open beyond."""
        measure = self.definition(name)
        ahead = self.looking(measure.ahead(self, side, limit))
        beyond = None if measure.open_beyond is None else measure.open_beyond(ahead)
        return replace(ahead.measure(name), beyond=beyond), ahead.seen

    def looking(self, seen: LookAhead) -> MeasureInputs:
        """Give the same, looking ahead so far."""
        if seen == self.seen:
            return self
        if seen not in self._looking:
            self._looking[seen] = replace(self, farther=seen, _known={}, _looking={})
        return self._looking[seen]

    @cached_property
    def usual(self) -> LookAhead:
        """How far is looked ahead for what asks for no more."""
        return LookAhead((self.drive.scenes.plan.shape[1] - 1) * self.parameters.step)

    @property
    def seen(self) -> LookAhead:
        """How far is looked ahead."""
        return self.farther or self.usual

    @cached_property
    def pairs(self) -> Pairs:
        """The EGO with each object, predicted as far as is looked ahead; straight on after the plan's end."""
        horizon = None if self.seen.horizon == self.usual.horizon else self.seen.horizon
        return Pairs.of(self.drive.scenes, self.parameters.step, horizon)

    @cached_property
    def driven(self) -> Pairs:
        """The EGO with each object, on the paths that they drove."""
        drive, p = self.drive, self.parameters
        pairs = driven_pairs(
            drive.tracks, str(drive.own.ids[0]), drive.t, horizon=p.horizon, step=p.step, driven=True
        )
        if drive.apart is None:
            return pairs
        return replace(pairs, size=np.where(drive.apart[..., None], np.nan, pairs.size))

    @cached_property
    def contacts(self) -> tuple[tuple[float, str], ...]:
        """When [s] the EGO's box touches whose."""
        if self.hits is not None:
            return self.hits
        return tuple(contacts(self.drive.tracks, str(self.drive.own.ids[0])))

    @cached_property
    def risk(self) -> Risk:
        """The accident risk of each scene."""
        return self.drive.risk(self.parameters) if self.found is None else self.found


def look_together(drives: Sequence[MeasureInputs], names: Iterable[str]) -> list[MeasureInputs]:
    """Give the inputs of drives on one map with those of these measures known that can be computed for all at once.

    They are what they are alone, to the bit, and so is the risk. Where the drives do not have the same objects they are
    left as they are.
    """
    one = drives[0]
    if len(drives) == 1 or not all(_are_alike(one, other) for other in drives[1:]):
        return list(drives)
    asked = [one.definition(name) for name in names]
    every = [*asked, *(one.definition(name) for measure in asked for name in measure.made_of)]
    risks, known = _of_scenes(drives, [measure.name for measure in every if measure.by_scene])
    together = _of_same_times(drives)
    for measure in every:
        if measure.own is not None:
            for rows, tracks in together:
                values = measure.own(tracks, one.network)
                for row, n in enumerate(rows):
                    known[n][measure.name] = values.track(row)
    return [
        replace(each, found=risk, _known=mine, _looking={})
        for each, risk, mine in zip(drives, risks, known, strict=True)
    ]


def _of_scenes(
    drives: Sequence[MeasureInputs], names: Sequence[str]
) -> tuple[list[Risk], list[dict[str, MeasureValues]]]:
    """The risk and these measures of each drive, computed for the scenes of all."""
    every = replace(drives[0], drive=joined([each.drive for each in drives]), _known={}, _looking={})
    ends = np.cumsum([len(each.drive.t) for each in drives]).tolist()
    parts = [slice(end - len(each.drive.t), end) for each, end in zip(drives, ends, strict=True)]
    found = {name: every.measure(name) for name in names}
    known = [{name: values.scenes(part) for name, values in found.items()} for part in parts]
    return [every.risk.scenes(part) for part in parts], known


def _of_same_times(drives: Sequence[MeasureInputs]) -> list[tuple[list[int], Tracks]]:
    """Give which drives have the same times, and the tracks of their EGOs together; the ids are numbers."""
    alike = dict[object, list[int]]()
    for n, each in enumerate(drives):
        alike.setdefault((each.drive.t.tobytes(), each.drive.own.z is None), []).append(n)
    return [
        (rows, Tracks.concatenate([replace(drives[n].drive.own, ids=np.array([str(n)])) for n in rows]))
        for rows in alike.values()
    ]


def _are_alike(one: MeasureInputs, other: MeasureInputs) -> bool:
    """Whether two drives have the same objects, and are looked at in the same way."""
    a, b = one.drive, other.drive
    return (
        a.ids == b.ids and a.scenes.plan.shape[1:] == b.scenes.plan.shape[1:] and one.parameters == other.parameters
        and a.scenes.ways is None and b.scenes.ways is None
    )  # fmt: skip
