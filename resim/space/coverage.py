"""How much of a space was seen: discovery, expansion, convergence (Wagner 2021, Fig. 6.20; no formula in the text)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from resim.core.geometry import Floats
from resim.space.draws import Driven
from resim.space.report import ConvergenceEntry, CoverageEntry, DiscoveryCurve
from resim.space.statistics.rates import IntervalEstimate, share, spread_by
from resim.space.statistics.unseen import HeldOutCheck, held_out, kinds_at_least, more_needed, unseen_by_drive
from resim.space.traces import Ints

LIMIT = 0.05
"""Convergence: with 95 % confidence at most so much of what comes next is new, or enlarges a kind (our choice)."""
TOLERANCE = 0.05
"""Distance by which a kind must grow to count as growing (our choice): 4 m in one slot."""
POINTS = 40
"""Of a curve at most."""


@dataclass(frozen=True, eq=False)
class SeenScenarios:
    """N scenarios in order of time.

    Attributes:
        kind: (N,) number of their cluster.
        occasion: (N,) number of their occasion: those that see the same maneuvers share it.
        distance: (N,) to the medoid of their cluster.
        hours: (N,) h driven until they come, NaN where nobody says.
        kilometres: (N,) km likewise.
        driven: What was driven in all; its numbers of drives are those of `drive`.
        drive: (N,) number of the recording of each.
    """

    kind: Ints
    occasion: Ints
    distance: Floats
    hours: Floats
    kilometres: Floats
    driven: Driven
    drive: Ints

    def take(self, rows: Ints) -> SeenScenarios:
        """Give some of them."""
        return SeenScenarios(
            self.kind[rows], self.occasion[rows], self.distance[rows], self.hours[rows], self.kilometres[rows],
            self.driven, self.drive[rows],
        )  # fmt: skip


def coverage(seen: SeenScenarios, *, whole: bool = True) -> CoverageEntry:
    """Give how much of a space was seen. whole: whether that is all that was driven, with no scenario or recording left
    out.

    Scenarios of one kind and occasion are one: several EGOs that see the same lane change tell of one kind once.
    """
    once = first_of_each(seen)
    hours, kilometres = _later_discovery(once)
    return CoverageEntry(
        kinds_at_least(_counts(once.kind)),
        hours,
        kilometres,
        convergence(once, whole=whole),
        halves(once),
        curve(once),
    )


def halves(once: SeenScenarios) -> HeldOutCheck | None:
    """Check the unseen share of the first half against the second. once: the first of each kind and occasion."""
    return held_out(once.kind, once.drive)


def first_of_each(seen: SeenScenarios) -> SeenScenarios:
    """Give the first scenario of each kind and occasion; its distance is the largest of them."""
    key = np.stack([seen.kind, seen.occasion])
    _, first, inverse = np.unique(key, axis=1, return_index=True, return_inverse=True)
    most = np.zeros(len(first))
    np.maximum.at(most, inverse.ravel(), seen.distance)
    order = np.argsort(first)
    taken = seen.take(first[order])
    return replace(taken, distance=most[order])


def _counts(kind: Ints) -> Ints:
    return np.asarray(np.unique(kind, return_counts=True)[1], dtype=np.intp)


def convergence(once: SeenScenarios, limit: float = LIMIT, *, whole: bool = True) -> ConvergenceEntry:
    """Say whether discovery and expansion have stopped, by the upper ends of two shares.

    whole: whether nothing was left out: of what kinds that is nobody says, so that nothing has stopped.
    """
    counts, n = _counts(once.kind), len(once.kind)
    unseen = unseen_by_drive(once.kind, once.drive)
    new = expands(once.kind, once.distance)[n // 2 :]
    spread = spread_by(once.drive[n // 2 :])
    expanding = share(float(new.sum()) / spread, len(new) / spread)
    if not len(new):
        expanding = IntervalEstimate(np.nan, 0.0, 1.0)
    done = whole and unseen.high <= limit and expanding.high <= limit
    missing = max(
        more_needed(counts, limit), spread * _more_without_growth(expanding, len(new) / spread, limit)
    )
    if not done and missing == 0.0:
        missing = np.nan  # drives differ, or something was left out: nobody can say how many more are needed
    per_scenario = once.driven.whole[0] / n if n else np.nan
    return ConvergenceEntry(
        bool(done), limit, unseen, expanding, 0.0 if done else missing,
        0.0 if done else missing * per_scenario,
    )  # fmt: skip


def expands(kind: Ints, distance: Floats) -> np.ndarray:
    """Say of each scenario (N,), in order of time, whether it is of a new kind or enlarges its kind by over
    TOLERANCE.
    """
    out = np.zeros(len(kind), dtype=bool)
    radius: dict[int, float] = {}
    for n, (k, d) in enumerate(zip(kind.tolist(), distance.tolist(), strict=True)):
        before = radius.get(k)
        out[n] = before is None or d > before + TOLERANCE
        radius[k] = d if before is None else max(before, d)
    return out


def _more_without_growth(expanding: IntervalEstimate, of: float, limit: float) -> float:
    """How many more draws in the later half bring the upper end of a share down to a limit, if none of them is new: at
    least so many.
    """
    if expanding.high <= limit:
        return 0.0
    seen = 0.0 if np.isnan(expanding.value) else expanding.value * of
    n = max(of, 1.0)
    while share(seen, n).high > limit:
        n = np.ceil(n * 1.02 + 1.0)
    return n - of


def _later_discovery(once: SeenScenarios) -> tuple[IntervalEstimate, IntervalEstimate]:
    """New kinds by hour and kilometre in the later half of what was driven."""
    _, first = np.unique(once.kind, return_index=True)
    hours, kilometres = (
        float((until[first] >= 0.5 * whole).sum()) if np.isfinite(whole) else np.nan
        for until, whole in zip((once.hours, once.kilometres), once.driven.whole, strict=True)
    )
    return once.driven.rates(once.drive[first], (hours, kilometres), 0.5)


def curve(once: SeenScenarios) -> DiscoveryCurve:
    """Give what was found over what was driven."""
    n = len(once.kind)
    at = np.unique(np.linspace(1, n, min(n, POINTS)).astype(int)).tolist() if n else []
    clusters, radii, unseen = [], [], []
    for k in at:
        kinds, counts = np.unique(once.kind[:k], return_counts=True)
        radius = np.zeros(len(kinds))
        np.maximum.at(radius, np.searchsorted(kinds, once.kind[:k]), once.distance[:k])
        clusters.append(len(kinds))
        radii.append(float(radius[counts > 1].mean()) if (counts > 1).any() else np.nan)
        unseen.append(unseen_by_drive(once.kind[:k], once.drive[:k]).value)
    where = [k - 1 for k in at]
    return DiscoveryCurve(
        tuple(at), tuple(once.hours[where].tolist()), tuple(once.kilometres[where].tolist()), tuple(clusters),
        tuple(radii), tuple(unseen),
    )  # fmt: skip
