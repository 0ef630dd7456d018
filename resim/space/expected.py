"""Expected accidents: exposure times risk over all clusters, with all that is not known as a bounded term of its own.

    accidents / h  <=  upper limit of  sum over clusters of  rate  x  upper limit of risk   +   rate of unseen kinds

The three upper limits share what the confidence leaves (Bonferroni): a third for the risks of all clusters together, a
third for their rates, a third for the rate and the share of unseen kinds, each of whose scenarios counts as an
accident. A cluster with too few members, without legitimised ones or without calibrated risk has the risk 1. It is
on the safe side.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from resim.core.geometry import Floats
from resim.core.intervals import exact
from resim.space.calibration import ReliabilityReport, believed, drives_missing
from resim.space.risk import ClusterRisk
from resim.space.statistics.rates import IntervalEstimate, poisson_limits, scatter, spread_by
from resim.space.statistics.unseen import unseen_by_drive
from resim.space.traces import Ints


class RiskLimit(NamedTuple):
    """Risk of a scenario of a cluster: mean, NaN of no member; lower and upper limit; whether it is known at all."""

    mean: float
    low: float
    high: float
    known: bool


@dataclass(frozen=True, eq=False)
class ExposedScenarios:
    """N measured scenarios: numbers of their cluster, their occasion and their drive (N,) each; C clusters.

    lengths (D,): of drives by their number, in the unit of what was driven; None where they are taken for alike.
    """

    kind: Ints
    occasion: Ints
    drive: Ints
    clusters: int
    lengths: Floats | None = None

    def without(self, left_out: Sequence[int]) -> ExposedScenarios:
        """Give those of other clusters."""
        keep = ~np.isin(self.kind, np.asarray(left_out, dtype=np.intp))
        return replace(self, kind=self.kind[keep], occasion=self.occasion[keep], drive=self.drive[keep])

    def once(self) -> Ints:
        """Give the row (K,) of the first of each kind and occasion."""
        return np.unique(np.stack([self.kind, self.occasion]), axis=1, return_index=True)[1]

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

    least: drives in which a member counts, at least. Members that do not count, and scenarios that nobody simulated,
    may make the upper limit larger, never smaller: it is the largest that some of them together with those that count
    would give. calibration: of predicted risk; it is believed where it covers all bins in which the mean could lie if
    nothing were missing: members that do not count did, and what is not known were.
    """
    if one is None or not one.drives:
        return RiskLimit(np.nan, 0.0, 1.0, False)
    confidence = 1.0 - 2.0 * alpha
    mean, (means, drives) = float(one.risk.value), one.means(largest=True)
    low = float(exact(mean, drives[0], confidence=confidence)[0])
    high = float(exact(np.minimum(means, 1.0), drives, confidence=confidence)[1].max())
    known = is_believed(one, calibration) and one.drives >= least
    return RiskLimit(mean, low, high if known else 1.0, known)


def is_believed(one: ClusterRisk, calibration: ReliabilityReport | None) -> bool:
    """Say whether the risk of a cluster is calibrated, wherever it could lie if nothing were missing."""
    return bool(one.drives) and believed(calibration, *_range(one))


def held_out_missing(one: ClusterRisk, calibration: ReliabilityReport | None) -> int:
    """Give how many more drives have to be held out at least until the risk of a cluster can be believed."""
    return drives_missing(calibration, *_range(one)) if one.drives else 0


def _range(one: ClusterRisk) -> tuple[float, float]:
    """Where the risk of a cluster could lie if nothing were missing."""
    least, most = one.means(largest=False)[0].min(), one.means(largest=True)[0].max()
    return min(max(float(least), 0.0), 1.0), min(max(float(most), 0.0), 1.0)


def expected_accidents(
    exposed: ExposedScenarios, risks: Sequence[RiskLimit], driven: float, confidence: float,
    whole: ExposedScenarios | None = None,
) -> AccidentTerms:  # fmt: skip
    """Give expected accidents by what was driven, in its unit. risks (C,): of `risk_limit`, at a third of the error.

    A drive with all that comes in it is one event: traffic differs from drive to drive, and what comes in one is no
    evidence of how often it comes in others.
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
    least = _lower(*_per_drive(exposed, np.where(known, low, 0.0)[of]), driven, alpha)
    parts = [
        _upper(_per_drive(exposed, weights[of]), float(weights.max(initial=0.0)), driven, alpha)
        for weights in (high, np.where(known, high, 0.0), np.where(known, 0.0, 1.0))
    ]
    unseen = unseen_rate(exposed if whole is None else whole, driven, alpha)
    return AccidentTerms(value, least, parts[0] + unseen, parts[1], parts[2], unseen)


def unseen_rate(exposed: ExposedScenarios, driven: float, alpha: float) -> float:
    """Give the upper limit of how often scenarios of unseen kinds come, with error probability alpha in all."""
    spread = spread_by(exposed.drive, exposed.lengths)
    rate = float(poisson_limits(len(exposed.kind) / spread, 1.0 - alpha)[1]) * spread / driven
    return rate * unseen_of(exposed, 1.0 - alpha).high


def unseen_of(exposed: ExposedScenarios, confidence: float) -> IntervalEstimate:
    """Give the probability that the next scenario is of a kind not seen, from the first of each kind and occasion."""
    first = exposed.once()
    return unseen_by_drive(exposed.kind[first], exposed.drive[first], confidence)


def _per_drive(exposed: ExposedScenarios, weights: Floats) -> tuple[Floats, float]:
    """Sums of weights (N,) by drive, what comes in one being one event of that weight, and the variance of them all."""
    count = 0 if exposed.lengths is None else len(exposed.lengths)
    sizes = np.bincount(exposed.drive, weights, count).astype(float)
    return sizes, scatter(sizes, exposed.lengths)


def _upper(told: tuple[Floats, float], largest: float, driven: float, alpha: float) -> float:
    """Upper limit of a rate of weighted events, one event more of the largest weight (Fay and Feuer 1997).

    told: their weights (O,) and variance; largest: weight of a single event, at least. It is at least that of a single
    event with their variance: for few events and a small alpha Fay and Feuer's falls as a weight rises.
    """
    weights, variance = told
    most = max(float(weights.max(initial=0.0)), largest)
    if most == 0.0:
        return 0.0
    mean, variance = float(weights.sum()) + most, variance + most**2
    high = float(variance / mean * gammaincinv(mean**2 / variance, 1.0 - alpha))
    return max(high, -math.log(alpha) * math.sqrt(variance)) / driven


def _lower(weights: Floats, variance: float, driven: float, alpha: float) -> float:
    """Lower limit likewise."""
    mean = float(weights.sum())
    return 0.0 if mean == 0.0 else float(variance / mean * gammaincinv(mean**2 / variance, alpha)) / driven


def risk_limits(
    names: Sequence[str], risks: Mapping[str, ClusterRisk], confidence: float, least: int,
    calibration: ReliabilityReport | None,
) -> list[RiskLimit]:  # fmt: skip
    """Give the risk of every cluster by name, all limits together with a third of the error."""
    alpha = (1.0 - confidence) / 3.0 / max(len(names), 1)
    return [risk_limit(risks.get(name), alpha, least, calibration) for name in names]
