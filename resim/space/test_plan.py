"""What to do next: which drives or runs would shrink the upper limit of accidents most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from resim.core.intervals import exact
from resim.space.expected import ExposedScenarios, RiskLimit, expected_accidents, unseen_rate
from resim.space.limits import ReleaseLimits
from resim.space.traces import Ints

MOST = 20
"""Proposals that are told."""


@dataclass(frozen=True)
class PlannedTest:
    """A proposal.

    Attributes:
        what: `drive` more hours on the road, `simulate` scenarios of a cluster of which no member counts yet, or
            `hold out` other drives, by which its risk is calibrated.
        cluster: Of which; "" for drives.
        medoid: Its test case.
        amount: Hours; scenarios: all that the cluster has; drives of such a risk that are missing, at least.
        before: Upper limit of accidents an hour now, apart from what happened in no scenario.
        after: The same if all goes as so far: no new kind seen once beyond what is expected, the same mean risk.
        first: What has to come before it, "" for nothing.
    """

    what: Literal["drive", "simulate", "hold out"]
    cluster: str
    medoid: str
    amount: float
    before: float
    after: float
    first: str

    @property
    def task(self) -> str:
        """What to do, in words."""
        if self.what == "drive":
            return f"drive {self.amount:.3g} h more"
        if self.what == "hold out":
            return f"hold out {self.amount:g} more drives with such a risk as {self.medoid}"
        return f"simulate {self.amount:g} scenarios of which no member counts, as {self.medoid}"


class PlannedCluster(NamedTuple):
    """A cluster with its test case: in how many drives it was, of how many scenarios no member counts, and how many
    drives have to be held out until its risk can be believed."""

    name: str
    medoid: str
    drives: int
    left: int
    held_out: int


def test_plan(
    clusters: Sequence[PlannedCluster], exposed: ExposedScenarios, risks: Sequence[RiskLimit],
    asked: tuple[float, ReleaseLimits], whole: ExposedScenarios,
) -> tuple[PlannedTest, ...]:  # fmt: skip
    """Give proposals, the best first. clusters, risks: (C,).

    asked: hours driven, and the limits; whole: all that was seen, those of no known kind each of one of its own.
    """
    hours, limits = asked
    if not hours > 0.0 or not len(exposed.kind):
        return ()
    before = expected_accidents(exposed, risks, hours, limits.confidence, whole).high
    out = [PlannedTest("drive", "", "", hours, before, _doubled(exposed, risks, asked, whole), "")]
    alpha = (1.0 - limits.confidence) / 3.0 / len(clusters)
    for k, one in enumerate(clusters):
        if not one.left and not one.held_out:
            continue
        better = _all_simulated(risks[k], alpha, one.drives, limits.least_drives)
        changed = [*risks[:k], better, *risks[k + 1 :]]
        after = expected_accidents(exposed, changed, hours, limits.confidence, whole).high
        if not one.left:
            out.append(PlannedTest("hold out", one.name, one.medoid, float(one.held_out), before, after, ""))
            continue
        first = "" if risks[k].known else "verify a test drive near its test case, and calibrate risk"
        if one.held_out:
            first += f": hold out {one.held_out} more drives with such a risk"
        out.append(PlannedTest("simulate", one.name, one.medoid, float(one.left), before, after, first))
    ranked = sorted(out, key=lambda one: (one.after, one.what, one.cluster))
    return tuple(one for one in ranked if one.after < before)[:MOST]


test_plan.__test__ = False  # type: ignore[attr-defined]


def _all_simulated(risk: RiskLimit, alpha: float, every: int, least: int) -> RiskLimit:
    """The risk of a cluster with members of every scenario, of the mean that it has; of none without an accident."""
    if every < least:
        return risk
    mean = 0.0 if np.isnan(risk.mean) else risk.mean
    high = float(exact(mean, every, confidence=1.0 - 2.0 * alpha)[1])
    return RiskLimit(mean, risk.low, min(risk.high, high), True)


def _doubled(
    exposed: ExposedScenarios, risks: Sequence[RiskLimit], asked: tuple[float, ReleaseLimits],
    whole: ExposedScenarios,
) -> float:  # fmt: skip
    """The upper limit after as many hours again: all as before, and every kind seen once is seen again."""
    hours, limits = asked
    lengths = exposed.lengths
    drive = exposed.drive + (1 + exposed.drive.max() if lengths is None else len(lengths))
    twice = ExposedScenarios(
        np.tile(exposed.kind, 2), _again(exposed.occasion), np.concatenate([exposed.drive, drive]), exposed.clusters,
        None if lengths is None else np.tile(lengths, 2),
    )  # fmt: skip
    found = expected_accidents(twice, risks, 2.0 * hours, limits.confidence)
    seen_once = unseen_rate(whole, hours, (1.0 - limits.confidence) / 3.0)
    # about half of the kinds seen once stay so or are new ones: the unseen share falls as 1 / n at best
    return found.high - found.unseen + 0.5 * seen_once


def _again(number: Ints) -> Ints:
    return np.concatenate([number, number + number.max() + 1])
