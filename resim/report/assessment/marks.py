"""The scenes of a drive that are worth a look, and the colours of an assessment."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from resim.core.geometry import Floats
from resim.metrics.assessment import Assessment
from resim.report.view import EGO_COLORS

TIMES: Mapping[str, str] = {
    "TTC": "#D55E00", "THW": "#009E73", "TTR": "#0072B2", "WTTR": "#CC79A7", "WTTC": "#8A6D00",
}  # fmt: skip
"""Measures in time drawn beside the risk, as in Fig. 4.12, and their colours (Okabe-Ito)."""
RISK = "#1d2733"
NUMBERS = "①②③"
SMALL = 0.1
"""Share of the largest risk under which a scene is before it or after it."""


def block_color(name: str) -> str:
    """Give the colour of GT, SD, rGT, rSD."""
    return EGO_COLORS[name.removeprefix("r")]


def marked(assessment: Assessment) -> list[int]:
    """Give the scenes worth a look: of the largest risk, the last before and the first after it with a tenth of it.

    Where there is no risk at all, the first scene, the one in the middle, and the last.
    """
    risk = np.nan_to_num(assessment.risk.r_ind)
    last = len(risk) - 1
    if not risk.max() > 0.0:
        return sorted({0, last // 2, last})
    peak = int(risk.argmax())
    little = np.flatnonzero(risk <= SMALL * risk[peak])
    before, after = little[little < peak], little[little > peak]
    first = int(before[-1]) if len(before) else 0
    return sorted({first, peak, int(after[0]) if len(after) else last})


def least(assessment: Assessment, name: str) -> Floats:
    """Give the least value of a measure over all objects (S,), NaN where it has none."""
    value = assessment.measures[name].value
    if not value.shape[1]:
        return np.full(len(value), np.nan)
    return np.where(
        np.isnan(value).all(axis=1), np.nan, np.nanmin(np.where(np.isnan(value), np.inf, value), axis=1)
    )
