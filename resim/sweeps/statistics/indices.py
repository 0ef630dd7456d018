"""What Sobol indices and their intervals are; `sensitivity` finds them of full grids, `chaos` of all other plans."""

from __future__ import annotations

from dataclasses import dataclass

from resim.core.geometry import Floats


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Sobol indices of P parameters with their 95 % intervals (P, 2), NaN where there is none.

    first, total: (P,). noise: share of the variance that is between seeds of a point, NaN with one seed. unexplained:
    share that the estimator leaves. method: "anova" or "chaos"; of the latter, q2: the share of the points' variance
    that it predicts where it was not fitted, and its degree.
    """

    first: Floats
    first_interval: Floats
    total: Floats
    total_interval: Floats
    noise: float
    unexplained: float
    method: str
    q2: float | None = None
    degree: int | None = None
