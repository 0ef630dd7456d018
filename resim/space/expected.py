"""Expected accidents: exposure times risk over all clusters, with all that is not known as a bounded term of its own.

    accidents / h  <=  upper limit of  sum over clusters of  rate  x  upper limit of risk   +   rate of unseen kinds

The three upper limits share what the confidence leaves (Bonferroni): a third for the risks of all clusters together, a
third for their rates, a third for the rate and the share of unseen kinds, each of whose scenarios counts as an
accident. A cluster with too few members, without legitimised ones or without calibrated risk has the risk 1. It is
on the safe side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from resim.core.geometry import Floats
from resim.core.intervals import exact
from resim.space.calibration import ReliabilityReport, believed
from resim.space.risk import ClusterRisk
from resim.space.statistics.rates import IntervalEstimate, poisson_limits, spread_of
from resim.space.statistics.unseen import unseen_share
from resim.space.traces import Ints


class RiskLimit(NamedTuple):
    """Risk of a scenario of a cluster: mean, NaN of no member; lower and upper limit; whether it is known at all."""

    mean: float
    low: float
    high: float
    known: bool


@dataclass(frozen=True, eq=False)
class ExposedScenarios:
    """N measured scenarios: number of their cluster (N,) and of their occasion (N,); C clusters."""

    kind: Ints
    occasion: Ints
    clusters: int

    def without(self, left_out: Sequence[int]) -> ExposedScenarios:
        """Give those of other clusters."""
        keep = ~np.isin(self.kind, np.asarray(left_out, dtype=np.intp))
        return ExposedScenarios(self.kind[keep], self.occasion[keep], self.clusters)

    def counts(self) -> Ints:
        """Give how many occasions (C,) each cluster has."""
        pairs = np.unique(np.stack([self.kind, self.occasion]), axis=1)[0]
        return np.bincount(pairs, minlength=self.clusters)


class AccidentTerms(NamedTuple):
    """Accidents by hour or kilometre.

    value: of clusters whose risk is known, estimated, NaN of none; low: their lower limit; high: upper limit of all;
    known, thin and unseen: upper limits of clusters whose risk is known, of others, and of kinds not seen.
    """

    value: float
    low: float
    high: float
    known: float
    thin: float
    unseen: float


def risk_limit(
    one: ClusterRisk | None, alpha: float, least: int, calibration: ReliabilityReport | None
) -> RiskLimit:  # fmt: skip
    """Give the risk of a scenario of a cluster with limits of error probability alpha each.

    least: draws that count, at least. Members that do not count may make the upper limit larger, never smaller: it is
    the largest that any of them together with those that count would give. calibration: of predicted risk; it is
    believed where it covers all bins in which the mean could lie if nothing were missing: members that do not count
    did, and what is not known were.
    """
    if one is None or not one.scenarios:
        return RiskLimit(np.nan, 0.0, 1.0, False)
    confidence, count = 1.0 - 2.0 * alpha, float(one.scenarios)
    total = sum(draw.risk for draw in one.draws[: one.scenarios])
    low = float(exact(total / count, count, confidence=confidence)[0])
    means, counts = _means(one, [draw.most for draw in one.draws], largest=True)
    high = float(exact(np.minimum(means, 1.0), counts, confidence=confidence)[1].max())
    known = is_believed(one, calibration) and count >= least
    return RiskLimit(total / count, low, high if known else 1.0, known)


def is_believed(one: ClusterRisk, calibration: ReliabilityReport | None) -> bool:
    """Say whether the risk of a cluster is calibrated, wherever it could lie if nothing were missing."""
    if not one.scenarios:
        return False
    least = _means(one, [draw.least for draw in one.draws], largest=False)[0].min()
    most = _means(one, [draw.most for draw in one.draws], largest=True)[0].max()
    return believed(calibration, *(min(max(float(mean), 0.0), 1.0) for mean in (least, most)))


def _means(one: ClusterRisk, values: Sequence[float], *, largest: bool) -> tuple[Floats, Floats]:
    """Means of the draws that count and none, one, ... of the others, and of how many they are.

    values: of all draws; largest: whether the others with the largest ones come first.
    """
    total, beside = sum(values[: one.scenarios]), np.sort(values[one.scenarios :])
    sums = total + np.concatenate([[0.0], np.cumsum(beside[::-1] if largest else beside)])
    counts = one.scenarios + np.arange(len(sums), dtype=float)
    return sums / counts, counts


def expected_accidents(
    exposed: ExposedScenarios, risks: Sequence[RiskLimit], driven: float, confidence: float,
    whole: ExposedScenarios | None = None,
) -> AccidentTerms:  # fmt: skip
    """Give expected accidents by what was driven, in its unit. risks (C,): of `risk_limit`, at a third of the error.

    whole: all that was seen, where exposed is a part: nobody can leave kinds out of an ODD that were not seen.
    """
    alpha = (1.0 - confidence) / 3.0
    if not driven > 0.0:
        return AccidentTerms(np.nan, 0.0, np.inf, np.inf, np.inf, np.inf)
    known = np.array([one.known for one in risks], dtype=bool)
    mean, low, high = (np.array([one[k] for one in risks], dtype=float) for k in range(3))
    value = float((np.bincount(exposed.kind, minlength=exposed.clusters)[known] * mean[known]).sum()) / driven
    of = exposed.kind
    if not known.any():
        value = np.nan
    least = _lower(_per_occasion(exposed, np.where(known, low, 0.0)[of]), driven, alpha)
    parts = [
        _upper(_per_occasion(exposed, weights[of]), float(weights.max(initial=0.0)), driven, alpha)
        for weights in (high, np.where(known, high, 0.0), np.where(known, 0.0, 1.0))
    ]
    unseen = unseen_rate(exposed if whole is None else whole, driven, alpha)
    return AccidentTerms(value, least, parts[0] + unseen, parts[1], parts[2], unseen)


def unseen_rate(exposed: ExposedScenarios, driven: float, alpha: float) -> float:
    """Give the upper limit of how often scenarios of unseen kinds come, with error probability alpha in all."""
    _, per = np.unique(exposed.occasion, return_counts=True)
    spread = spread_of(per)
    rate = float(poisson_limits(len(exposed.kind) / spread, 1.0 - alpha)[1]) * spread / driven
    return rate * unseen_of(exposed, 1.0 - alpha).high


def unseen_of(exposed: ExposedScenarios, confidence: float) -> IntervalEstimate:
    """Give the probability that the next scenario is of a kind not seen, from occasions."""
    counts = exposed.counts()
    pairs = np.unique(np.stack([exposed.kind, exposed.occasion]), axis=1)
    single = counts[pairs[0]] == 1
    spread = spread_of(np.unique(pairs[1][single], return_counts=True)[1])
    return unseen_share(counts[counts > 0], spread, confidence)


def _per_occasion(exposed: ExposedScenarios, weights: Floats) -> Floats:
    """Sums of weights (N,) by occasion: what comes at once is one event of that weight."""
    _, where = np.unique(exposed.occasion, return_inverse=True)
    return np.asarray(np.bincount(where, weights), dtype=float) if len(where) else np.zeros(0)


def _upper(weights: Floats, largest: float, driven: float, alpha: float) -> float:
    """Upper limit of a rate of weighted events (O,), one event more of the largest weight (Fay and Feuer 1997).

    largest: weight of a single event, at least.
    """
    most = max(float(weights.max(initial=0.0)), largest)
    if most == 0.0:
        return 0.0
    mean, variance = float(weights.sum()) + most, float((weights**2).sum()) + most**2
    return float(variance / mean * gammaincinv(mean**2 / variance, 1.0 - alpha)) / driven


def _lower(weights: Floats, driven: float, alpha: float) -> float:
    """Lower limit likewise."""
    mean, variance = float(weights.sum()), float((weights**2).sum())
    return (
        0.0 if variance == 0.0 else float(variance / mean * gammaincinv(mean**2 / variance, alpha)) / driven
    )


def risk_limits(
    names: Sequence[str], risks: Mapping[str, ClusterRisk], confidence: float, least: int,
    calibration: ReliabilityReport | None,
) -> list[RiskLimit]:  # fmt: skip
    """Give the risk of every cluster by name, all limits together with a third of the error."""
    alpha = (1.0 - confidence) / 3.0 / max(len(names), 1)
    return [risk_limit(risks.get(name), alpha, least, calibration) for name in names]
