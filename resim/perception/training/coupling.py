"""How the drifts of the quantities go together."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.model import QUANTITIES, TrainedParameter
from resim.perception.training.clusters import FEWEST, between_drives, by_drive, certain
from resim.perception.training.errors import ObjectErrors, sizes_of
from resim.perception.training.lists import around

SURE = 3.3
"""Standard errors, of many drives, by which a correlation differs from none to be one."""


def fit_coupling(
    objects: ObjectErrors, group: NDArray[np.intp]
) -> tuple[tuple[tuple[float, ...], ...] | None, dict[str, TrainedParameter]]:
    """Give the correlation (6, 6) of what drives the drifts, None where none is sure.

    Of standardised residuals of two quantities a sample apart: white noise is not in them. With correlation times
    tau the drifts themselves correlate by 2 sqrt(tau1 tau2) / (tau1 + tau2) of it.
    """
    drifts = {
        name: f for name, f in objects.fitted.items() if f.spreads is not None and f.spreads.drift is not None
    }
    sizes, out, estimates = sizes_of(objects.features), np.eye(len(QUANTITIES)), {}
    standard: dict[str, Floats] = {}
    for name, fitted in drifts.items():
        assert fitted.spreads is not None
        level = fitted.spreads.levels(sizes)[0]
        standard[name] = np.where(fitted.known, fitted.residual / level, np.nan)
    taus: Mapping[str, float] = {n: f.spreads.tau for n, f in drifts.items() if f.spreads is not None}
    names = list(drifts)
    for i, one in enumerate(names):
        for other in names[:i]:
            products, count = np.zeros(len(group)), np.zeros(len(group))
            for a, b in ((one, other), (other, one)):
                decay = np.exp(objects.steps[:, 1:] / taus[b])
                product = standard[a][:, :-1] * standard[b][:, 1:] * decay
                products += np.nansum(product, axis=1)
                count += np.isfinite(product).sum(axis=1)
            if count.sum() < 50:
                continue
            value = float(products.sum() / count.sum())
            known = count > 0
            drives = len(np.unique(group[known]))
            alike = group if drives >= FEWEST else np.arange(len(group))
            scores, weights = (by_drive(v[known], alike[known]) for v in (products - value * count, count))
            se = float(np.sqrt(between_drives(scores[:, None], weights[:, None, None])[0, 0]))
            factor = (taus[one] + taus[other]) / (2.0 * np.sqrt(taus[one] * taus[other]))
            if abs(value) > certain(SURE, drives) * se > 0.0:
                p, q = QUANTITIES.index(one), QUANTITIES.index(other)
                driving = float(np.clip(value * factor, -0.999, 0.999))
                out[p, q] = out[q, p] = driving
                estimates[f"errors.coupling.{p}.{q}"] = around(driving, se * factor, int(count.sum()), drives)
    if not estimates:
        return None, {}
    values, vectors = np.linalg.eigh(out)
    near = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    scale = np.sqrt(np.diag(near))
    near = near / np.outer(scale, scale)
    return tuple(tuple(row) for row in near.tolist()), estimates
