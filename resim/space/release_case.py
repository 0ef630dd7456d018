"""What a decision about a release follows from, and what happened that no scenario tells of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resim.core.geometry import Floats
from resim.space.calibration import ReliabilityReport
from resim.space.coverage import SeenScenarios, first_of_each, halves
from resim.space.described import seen as in_order_driven
from resim.space.draws import drive_numbers, driven_in
from resim.space.expected import (
    AccidentTerms,
    ExposedScenarios,
    RiskLimit,
    expected_accidents,
    risk_limits,
)
from resim.space.limits import Per, ReleaseLimits
from resim.space.model import Space
from resim.space.risk import ClusterRisk, CoverReport
from resim.space.sources import UNKNOWN_BUILD


@dataclass(frozen=True, eq=False)
class ReleaseCase:
    """All that a decision follows from.

    Attributes:
        names: Of the C clusters.
        exposed: Scenarios that were measured.
        seen: The same, where those whose kind is not known are each of one of its own: without slots, and where the EGO
            leaves the lanes.
        risks: Of the clusters, by name.
        calibration: Of predicted risk, None without one.
        unknown: What happened on drives and is in no scenario: sentences, none where there is nothing.
        driven: h and km.
        lengths: h and km (D,) of each drive by its number.
        limits: What is asked for.
    """

    names: tuple[str, ...]
    exposed: ExposedScenarios
    seen: ExposedScenarios
    risks: Mapping[str, ClusterRisk]
    calibration: ReliabilityReport | None
    unknown: tuple[str, ...]
    driven: Mapping[Per, float]
    lengths: Mapping[Per, Floats]
    limits: ReleaseLimits

    @property
    def believed(self) -> bool:
        """Whether predicted risk is calibrated."""
        return self.calibration is not None and self.calibration.verdict == "calibrated"

    @cached_property
    def risk(self) -> list[RiskLimit]:
        """The risk of a scenario of each cluster (C,)."""
        told = self.limits
        return risk_limits(self.names, self.risks, told.confidence, told.least_drives, self.calibration)

    def exposed_over(self, per: Per) -> tuple[ExposedScenarios, ExposedScenarios]:
        """Give `exposed` and `seen` with the lengths of drives in that unit."""
        lengths = self.lengths[per]
        return replace(self.exposed, lengths=lengths), replace(self.seen, lengths=lengths)

    def accidents(self, per: Per, left_out: Sequence[int] = ()) -> AccidentTerms:
        """Give expected accidents, without clusters that are left out of the ODD."""
        exposed, seen = self.exposed_over(per)
        return expected_accidents(
            exposed.without(left_out), self.risk, self.driven[per], self.limits.confidence, seen
        )


def release_case(space: Space, cover: CoverReport | None, limits: ReleaseLimits) -> ReleaseCase:
    """Give what a decision about a release follows from."""
    names, kind = np.unique(space.rows["cluster"].to_numpy(str), return_inverse=True)
    exposed = ExposedScenarios(
        kind, space.rows["occasion"].to_numpy(np.intp), drive_numbers(space.rows), len(names)
    )
    driven = driven_in(space)
    told = in_order_driven(space, np.arange(len(space.rows)), driven)
    seen = _seen(told, sum(one.left_out for one in space.sources))
    risks = {} if cover is None else {one.cluster: one for one in cover.clusters}
    calibration = None if cover is None else cover.calibration
    return ReleaseCase(
        tuple(names.tolist()), exposed, seen, risks, calibration, tuple(_unknown(space, told, cover)),
        {"hour": driven.whole[0], "kilometre": driven.whole[1]},
        {"hour": driven.lengths[:, 0], "kilometre": driven.lengths[:, 1]}, limits,
    )  # fmt: skip


def _seen(told: SeenScenarios, left_out: int) -> ExposedScenarios:
    """Scenarios in the order in which they were driven, and so many more, each of a kind and drive of its own."""
    more, clusters = np.arange(left_out), 1 + int(told.kind.max(initial=-1))
    occasion, drive = (
        np.concatenate([one, 1 + one.max(initial=-1) + more]) for one in (told.occasion, told.drive)
    )
    return ExposedScenarios(
        np.concatenate([told.kind, clusters + more]), occasion, drive, clusters + left_out
    )


def _unlike(told: SeenScenarios) -> Iterator[str]:
    """Where the later half has more new kinds than the first half tells."""
    check = halves(first_of_each(told))
    if check is not None and check.found.low > check.predicted.high:
        yield (
            f"of the later half of scenarios at least {100.0 * check.found.low:.3g} % are of new kinds, where the "
            f"first half tells of at most {100.0 * check.predicted.high:.3g} %: what comes is not as what was seen"
        )


def _mixed(space: Space, build: str) -> Iterator[str]:
    """Where drives of a build are mixed with others: how often it meets scenarios itself is not known."""
    own = sum(one.driven_by.get(build, 0.0) for one in space.sources) if build else 0.0
    others = sum(hours for one in space.sources for who, hours in one.driven_by.items() if who != build)
    if own and others:
        yield (
            f"{others:.3g} of {own + others:.3g} h were driven by others than this build, and rates are of all "
            "together: build a space of its test drives alone"
        )


def _unknown(space: Space, told: SeenScenarios, cover: CoverReport | None) -> Iterator[str]:
    """What happened on drives of the space, and is in no scenario."""
    build = "" if cover is None else cover.build
    if accidents := sum(one.accidents.get(who, 0) for one in space.sources for who in {build, UNKNOWN_BUILD}):
        yield (
            f"{accidents} collisions or ends of test drives of this build, or of one without a hash, are in no "
            "scenario (a drive of which nobody says whether it collided counts as one): mine them so that these are "
            "cut out"
        )
    yield from _mixed(space, build)
    if cover is not None and cover.accidents:
        yield (
            f"{cover.accidents} of this build's test drives collide or break off and are not in the space: mine them, "
            "and build it of them as well"
        )
    yield from _unlike(told)
    if left_out := sum(one.left_out for one in space.sources):
        yield f"{left_out} scenarios have no slots: of which kinds they are is not known"
    if off := int((space.traces.lane < 0).sum()):
        yield f"in {off} scenes the EGO is on no lane: who was around it is not known"
    if failed := [name for one in space.sources for name in one.failed]:
        yield f"{len(failed)} recordings could not be mined ({failed[0]}): what happened in them is not known"
